//! Debug probes: selects a probe and a chip, and opens a session.
//!
//! Arguments → [`ProbeArguments::attach`] → a `probe_rs::Session` that reads and writes the chip's memory. An error is
//! one sentence that says what to do: connect a probe, set permissions, or select one of several probes.

use std::sync::Once;

use anyhow::{Result, anyhow};
use probe_rs::architecture::arm::ArmError;
use probe_rs::config::{Registry, RegistryError, TargetSelector};
use probe_rs::probe::list::{Accessibility, Lister, ProbeListItem};
use probe_rs::probe::{DebugProbeError, DebugProbeInfo, DebugProbeSelector, Probe, ProbeCreationError, WireProtocol};
use probe_rs::{CoreType, Permissions, Session};

use crate::UserError;

/// Chooses a probe and its chip.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ProbeArguments {
    /// The probe, where there are several; its vendor and product as hexadecimal numbers
    #[arg(long, value_name = "VID:PID[:SERIAL]")]
    pub probe: Option<DebugProbeSelector>,
    /// The chip, in probe-rs's words [default: the board's, else what the probe finds out]
    #[arg(long, value_name = "NAME")]
    pub chip: Option<String>,
    /// The probe's clock, kHz [default: the probe's own choice]
    #[arg(long, value_name = "KHZ", value_parser = clap::value_parser!(u32).range(1..))]
    pub speed: Option<u32>,
}

impl ProbeArguments {
    /// Opens the probe and attaches to the chip, which runs on: `--chip`, else `default_chip`, else what the probe
    /// finds out.
    ///
    /// # Errors
    /// [`UserError`] where the arguments do not select one probe and a known chip. Otherwise an error that says which
    /// step failed and what may help.
    pub fn attach(&self, default_chip: Option<&str>) -> Result<Session> {
        let registry = registry();
        let target = match (self.chip.as_deref(), default_chip) {
            (Some(name), _) => TargetSelector::Specified(find(&registry, name)?),
            (None, Some(name)) => TargetSelector::Specified(find(&registry, name)?),
            (None, None) => TargetSelector::Auto,
        };
        let chosen = choose(Lister::new().list_all_with_access(), self.probe.as_ref())?;
        let name = describe(&chosen);
        let mut probe = chosen.open().map_err(|error| not_opened(error, &name))?;
        if let Some(khz) = self.speed {
            probe
                .set_speed(khz)
                .map_err(|error| UserError::flag("--speed", format!("{name} refuses {khz} kHz: {error}")))?;
        }
        if let TargetSelector::Specified(target) = &target {
            prefer(&mut probe, target.cores.first().map(|core| core.core_type));
        }
        probe
            .attach_with_registry(target, Permissions::default(), &registry)
            .map_err(|error| not_attached(error, &name))
    }
}

/// Whether probe-rs can attach to the chip of this name.
pub fn supports(chip: &str) -> bool {
    registry().get_target_by_name(chip).is_ok()
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
fn prefer(probe: &mut Probe, core: Option<CoreType>) {
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

    #[test]
    fn probe_rs_knows_the_chips() {
        for chip in ["nRF52832_xxAA", "STM32F105RC", "esp32c3", "esp32c6", "esp32"] {
            assert!(supports(chip), "{chip}");
        }
        assert!(!supports("nRF9999"));
    }

    #[test]
    fn an_unknown_chip_is_refused_with_its_neighbours() {
        let arguments = ProbeArguments { chip: Some("nRF52832_xxZZ".into()), ..ProbeArguments::default() };
        let error = arguments.attach(None).expect_err("there is no such chip");
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
