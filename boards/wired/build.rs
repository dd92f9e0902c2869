//! Sets the linker's arguments.

fn main() {
    baliza_board_link::qemu();
}
