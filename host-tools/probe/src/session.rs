//! Probes by probe-rs: selects a probe and a chip, opens a session, and reads and writes the chip's memory.
//!
//! An error is one sentence that says what to do: connect a probe, set permissions, or select one of several probes.

use std::io::Cursor;
use std::ops::Range;
use std::sync::Once;
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use probe_rs::architecture::arm::ArmError;
use probe_rs::config::{MemoryRegion, Registry, RegistryError, TargetSelector};
use probe_rs::flashing::{DownloadOptions, FlashProgress, ProgressEvent, image_format};
use probe_rs::probe::list::{Accessibility, Lister, ProbeListItem};
use probe_rs::probe::{DebugProbeError, DebugProbeInfo, DebugProbeSelector, ProbeCreationError, WireProtocol};
use probe_rs::{CoreType, MemoryInterface, Permissions, Session, Target};

use node_link::monitor::Memory;
use node_link::probe::{Driver, Probe, ProbeArguments};
use node_link::provision::Firmware;
use node_link::provision::transfer::Flash;
use recording::UserError;

/// A chip behind a debug probe. Its memory is that of its first core, on which the node runs.
pub struct Attached {
    session: Session,
    name: String,
}

impl Attached {
    /// Opens the probe and attaches to the chip: [`Driver::attach`].
    fn open(arguments: &ProbeArguments, default_chip: Option<&str>) -> Result<Self> {
        let registry = registry();
        let target = match arguments.chip.as_deref().or(default_chip) {
            Some(name) => TargetSelector::Specified(find(&registry, name)?),
            None => TargetSelector::Auto,
        };
        let selector = arguments.probe.as_deref().map(selector).transpose()?;
        let chosen = choose(Lister::new().list_all_with_access(), selector.as_ref())?;
        let name = describe(&chosen);
        let mut probe = chosen.open().map_err(|error| not_opened(error, &name))?;
        if let Some(khz) = arguments.speed {
            probe
                .set_speed(khz)
                .map_err(|error| UserError::flag("--speed", format!("{name} refuses {khz} kHz: {error}")))?;
        }
        if let TargetSelector::Specified(target) = &target {
            prefer(&mut probe, target.cores.first().map(|core| core.core_type));
        }
        let session = probe
            .attach_with_registry(target, Permissions::default(), &registry)
            .map_err(|error| not_attached(error, &name))?;
        Ok(Self { session, name })
    }
}

/// probe-rs, as the driver of debug probes.
pub struct ProbeRs;

impl Driver for ProbeRs {
    fn attach(&self, arguments: &ProbeArguments, default_chip: Option<&str>) -> Result<Box<dyn Probe>> {
        Ok(Box::new(Attached::open(arguments, default_chip)?))
    }

    fn is_connected(&self, arguments: &ProbeArguments) -> Result<bool> {
        let selector = arguments.probe.as_deref().map(selector).transpose()?;
        let allowed = |item: &ProbeListItem| selector.as_ref().is_none_or(|wanted| wanted.matches_probe(&item.info));
        Ok(Lister::new().list_all_with_access().iter().any(allowed))
    }
}

impl Probe for Attached {
    fn name(&self) -> &str {
        &self.name
    }

    fn chip(&self) -> String {
        self.session.target().name.clone()
    }

    fn into_memory(self: Box<Self>) -> Box<dyn Memory> {
        self
    }

    fn into_flash(self: Box<Self>) -> Box<dyn Flash> {
        self
    }
}

impl Memory for Attached {
    fn read(&mut self, address: u64, bytes: &mut [u8]) -> Result<()> {
        Ok(self.session.core(0)?.read(address, bytes)?)
    }

    fn write(&mut self, address: u64, bytes: &[u8]) -> Result<()> {
        Ok(self.session.core(0)?.write_8(address, bytes)?)
    }

    fn write_word(&mut self, address: u64, word: u32) -> Result<()> {
        Ok(self.session.core(0)?.write_word_32(address, word)?)
    }

    fn ram(&self) -> Vec<Range<u64>> {
        ram(self.session.target())
    }

    fn reset(&mut self) -> Result<()> {
        Ok(self.session.core(0)?.reset()?)
    }
}

impl Flash for Attached {
    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
        Ok(self.session.core(0)?.read(address.into(), bytes)?)
    }

    fn write_page(&mut self, address: u32, page: &[u8]) -> Result<()> {
        let mut loader = self.session.target().flash_loader();
        loader.add_data(address.into(), page)?;
        let mut options = DownloadOptions::default();
        options.verify = true;
        loader.commit(&mut self.session, options)?;
        Ok(())
    }

    fn write_image(&mut self, image: &Firmware, progress: &mut dyn FnMut(u64, u64)) -> Result<()> {
        let mut loader = self.session.target().flash_loader();
        if image.is_for_bootloader() {
            // espflash's library makes the app, and adds the bootloader and the table of partitions.
            let format = image_format("idf").context("probe-rs cannot make an ESP's image")?;
            let mut elf = Cursor::new(&image.elf);
            format.create_loader(None).load(&mut loader, &mut self.session, &mut elf)?;
        } else {
            for (address, bytes) in &image.segments {
                loader.add_data((*address).into(), bytes)?;
            }
        }
        let (mut done, mut all) = (0, 0);
        let mut options = DownloadOptions::default();
        options.verify = true;
        options.progress = FlashProgress::new(|event| match event {
            ProgressEvent::AddProgressBar { total, .. } => all += total.unwrap_or(0),
            ProgressEvent::Progress { size, .. } => {
                done += size;
                progress(done, all);
            }
            _ => {}
        });
        loader.commit(&mut self.session, options).context("the image is not complete: flash it again")
    }

    fn restart(&mut self) -> Result<()> {
        let mut core = self.session.core(0)?;
        // After the write, the core is halted in the flash routine.
        core.reset_and_halt(Duration::from_millis(500))?;
        core.run()?;
        Ok(())
    }
}

/// The address ranges of a chip's RAM.
fn ram(target: &Target) -> Vec<Range<u64>> {
    target.memory_map.iter().filter_map(MemoryRegion::as_ram_region).map(|region| region.range.clone()).collect()
}

/// The probe that `--probe` names.
fn selector(text: &str) -> Result<DebugProbeSelector, UserError> {
    text.parse().map_err(|error| UserError::flag("--probe", format!("\"{text}\": {error}")))
}

/// The chips that probe-rs knows, including those of Espressif.
fn registry() -> Registry {
    static ESPRESSIF: Once = Once::new();
    ESPRESSIF.call_once(probe_rs_espressif::register_plugin);
    Registry::from_builtin_families()
}

fn find(registry: &Registry, name: &str) -> Result<probe_rs::Target> {
    registry.get_target_by_name(name).map_err(|error| {
        let what = match error {
            RegistryError::ChipNotFound(_) => {
                // The chips whose names have the longest common beginning with this name.
                let near = (2..name.chars().count()).rev().map(|length| name.chars().take(length).collect::<String>());
                let near = near.map(|begin| registry.search_chips(&begin)).find(|near| !near.is_empty());
                let near = near.unwrap_or_default().into_iter().take(4).collect::<Vec<_>>().join(", ");
                if near.is_empty() {
                    format!("probe-rs knows no chip {name}")
                } else {
                    format!("probe-rs knows no chip {name}; near it are {near}")
                }
            }
            other => other.to_string(),
        };
        UserError::flag("--chip", what).into()
    })
}

/// The selected probe.
fn choose(found: Vec<ProbeListItem>, selector: Option<&DebugProbeSelector>) -> Result<DebugProbeInfo> {
    if found.is_empty() {
        return Err(anyhow!(
            "no debug probe found: plug in the board (a cable for data, not for charging alone); on Linux `lsusb` \
             shows whether it is there"
        ));
    }
    let all = list(&found);
    let mut meant: Vec<_> =
        found.into_iter().filter(|item| selector.is_none_or(|wanted| wanted.matches_probe(&item.info))).collect();
    let item = match (meant.pop(), meant.is_empty(), selector) {
        (Some(item), true, _) => item,
        (None, _, selector) => {
            let wanted = selector.map(ToString::to_string).unwrap_or_default();
            return Err(UserError::flag("--probe", format!("no probe {wanted}; found: {all}")).into());
        }
        (Some(item), false, _) => {
            meant.push(item);
            return Err(UserError::flag("--probe", format!("several probes, name one of {}", list(&meant))).into());
        }
    };
    match item.accessibility {
        Accessibility::Accessible => Ok(item.info),
        Accessibility::PermissionDenied => Err(not_allowed(&describe(&item.info))),
    }
}

fn list(items: &[ProbeListItem]) -> String {
    items.iter().map(|item| describe(&item.info)).collect::<Vec<_>>().join(", ")
}

/// The value for `--probe`, and the probe's own name.
fn describe(info: &DebugProbeInfo) -> String {
    format!("{} ({})", DebugProbeSelector::from(info), info.identifier)
}

/// Selects the wire protocol of the core's type, JTAG or SWD. A probe with only one protocol refuses another one and
/// keeps its own.
fn prefer(probe: &mut probe_rs::probe::Probe, core: Option<CoreType>) {
    let protocol = match core {
        Some(CoreType::Riscv | CoreType::Riscv64 | CoreType::Xtensa) => WireProtocol::Jtag,
        Some(_) => WireProtocol::Swd,
        None => return,
    };
    let _ = probe.select_protocol(protocol);
}

fn not_allowed(name: &str) -> anyhow::Error {
    anyhow!(
        "no permission to open the probe {name}: on Linux it needs a udev rule, see \
         https://probe.rs/docs/getting-started/probe-setup; then plug it in again"
    )
}

fn not_opened(error: DebugProbeError, name: &str) -> anyhow::Error {
    let denied = matches!(
        &error,
        DebugProbeError::ProbeCouldNotBeCreated(ProbeCreationError::Usb(cause)) | DebugProbeError::Usb(cause)
            if cause.kind() == std::io::ErrorKind::PermissionDenied
    );
    if denied {
        return not_allowed(name);
    }
    anyhow::Error::new(error)
        .context(format!("cannot open the probe {name}: another program may hold it, end that one"))
}

fn not_attached(error: probe_rs::Error, name: &str) -> anyhow::Error {
    let advice = match &error {
        probe_rs::Error::Probe(DebugProbeError::TargetNotFound) => "is the board powered, and wired to the probe?",
        probe_rs::Error::ChipNotFound(RegistryError::ChipAutodetectFailed) => "say which it is with --chip",
        probe_rs::Error::MissingPermissions(_) | probe_rs::Error::Arm(ArmError::MissingPermissions(_)) => {
            "its debug port is locked; `probe-rs erase --allow-erase-all` unlocks it and erases all of its flash"
        }
        _ => "is the board powered, wired to the probe, and of the chip that --chip says?",
    };
    anyhow::Error::new(error).context(format!("the probe {name} cannot attach to the chip: {advice}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::config::Board;

    #[test]
    fn probe_rs_knows_the_chips() {
        let registry = registry();
        let supports = |chip: &str| registry.get_target_by_name(chip).is_ok();
        for chip in ["nRF52832_xxAA", "STM32F105RC", "esp32c3", "esp32c6", "esp32"] {
            assert!(supports(chip), "{chip}");
        }
        assert!(!supports("nRF9999"));
        for board in Board::HARDWARE {
            assert!(board.spec().flasher.probe_chip().is_some_and(supports), "{board:?}");
        }
    }

    #[test]
    fn the_rings_of_our_images_lie_in_what_probe_rs_calls_ram() {
        // The addresses of _SEGGER_RTT in the images of the tag, as the linker assigned them.
        let images = [
            ("nRF52832_xxAA", 0x2000_4B98),
            ("STM32F105RC", 0x2000_0400),
            ("esp32c3", 0x3FC8_F240),
            ("esp32c6", 0x4080_F240),
            ("esp32", 0x3FFB_0000),
        ];
        let registry = registry();
        for (chip, address) in images {
            let target = registry.get_target_by_name(chip).expect("a chip");
            assert!(ram(&target).iter().any(|region| region.contains(&address)), "{chip}");
        }
    }

    #[test]
    fn an_unknown_chip_is_refused_with_its_neighbours() {
        let arguments = ProbeArguments { chip: Some("nRF52832_xxZZ".into()), ..ProbeArguments::default() };
        let error = ProbeRs.attach(&arguments, None).err().expect("there is no such chip");
        let wrong = error.downcast_ref::<UserError>().expect("the argument is wrong").to_string();
        assert!(wrong.starts_with("--chip: probe-rs knows no chip nRF52832_xxZZ; near it are "), "{wrong}");
        assert!(wrong.contains("nRF52832_xxAA"), "{wrong}");
    }

    #[test]
    fn without_a_probe_the_sentence_says_to_plug_it_in() {
        let error = choose(Vec::new(), None).expect_err("there is none");
        assert!(error.to_string().starts_with("no debug probe found: plug in"), "{error}");
    }
}
