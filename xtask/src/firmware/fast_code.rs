//! Whether the code that an ESP runs from a frame's interrupt to the command of its answer is in RAM, where
//! `boards/esp32/rwtext_hook.x` puts it: in flash, code that other code has driven out of the cache waits a microsecond
//! for each line.

use anyhow::{Result, ensure};
use object::read::{Object, ObjectSymbol};
use object::{File, SymbolKind};
use wire::config::Memory;

/// The crates and modules of this code.
const FAST: [&str; 5] =
    ["baliza_dw1000::", "ranging::", "radio::", "baliza_wire::uwb::", "firmware_common::protocol::"];

/// The least code that is found, bytes. It is 77 KiB in an anchor and 102 KiB in a tag: less means that functions have
/// other names, or have become parts of functions elsewhere.
const LEAST: u64 = 64 << 10;

/// Checks an image with ranging.
///
/// # Errors
/// A function is in flash, or hardly any function is found.
pub fn check(elf: &File<'_>, memory: Memory) -> Result<()> {
    let in_flash = |address: u64| {
        let mut regions =
            memory.flash.iter().map(|&(first, bytes)| u64::from(first)..u64::from(first) + u64::from(bytes));
        regions.any(|region| region.contains(&address))
    };
    let mut bytes = 0;
    for symbol in elf.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0) {
        let Some(name) = symbol.name().ok().and_then(fast) else { continue };
        let address = symbol.address();
        ensure!(!in_flash(address), "{name} is in flash, at {address:#x}: rwtext_hook.x does not catch its symbol");
        bytes += symbol.size();
    }
    ensure!(bytes >= LEAST, "only {bytes} bytes of ranging's code are found in RAM, of {LEAST} at least");
    Ok(())
}

/// The function of a symbol, if it is fast code.
fn fast(symbol: &str) -> Option<String> {
    let name = format!("{:#}", rustc_demangle::try_demangle(symbol).ok()?);
    let path = name.trim_start_matches(['<', '&']).trim_start_matches("mut ");
    FAST.iter().any(|part| path.starts_with(part)).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_known_in_both_forms_of_symbols() {
        let idle = [
            "_ZN7ranging6native3tag3Tag4idle17hc9a1dbe5584a8252E",
            "_RNvMNtNtCs6UdfUck7fkc_7ranging6native3tagNtB2_3Tag4idle",
        ];
        let pace = [
            "_ZN86_$LT$firmware_common..protocol..TagProtocol$u20$as$u20$ranging..exchange..Protocol$GT$4pace17h243bc8f6a610aaeeE",
            "_RNvXs0_NtCs3V9Dq5hU36E_15firmware_common8protocolNtB5_11TagProtocolNtNtCs6UdfUck7fkc_7ranging8exchange8Protocol4pace",
        ];
        for symbol in idle {
            assert!(fast(symbol).is_some_and(|name| name.ends_with("idle")), "{symbol}");
        }
        for symbol in pace {
            assert!(fast(symbol).is_some_and(|name| name.ends_with("pace")), "{symbol}");
        }
        let others = [
            "_ZN9esp_radio14common_adapter10queue_recv17h243bc8f6a610aaeeE",
            "_RINvNtCsdarCstKo01G_8postcard2de15take_from_bytesINtNtNtCsbBeQbFoXO4M_16positioning_core4nlos5model7TrainedNtBO_7LeftOutB1H_EECsi5pyBRKXpbi_3tag",
            "memcpy",
        ];
        assert!(others.iter().all(|symbol| fast(symbol).is_none()));
    }
}
