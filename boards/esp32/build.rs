//! Sets the linker's arguments. A feature selects the chip.

fn main() {
    let enabled = |chip: &&str| std::env::var_os(format!("CARGO_FEATURE_{}", chip.to_uppercase())).is_some();
    if let Some(chip) = ["esp32c3", "esp32c6", "esp32"].into_iter().find(enabled) {
        baliza_board_link::esp(chip);
    }
}
