//! The chips that QEMU simulates.

use std::process::Command;

use crate::target::Target;

/// A kind of chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chip {
    /// The DWM1001's: single-precision FPU.
    CortexM4F,
    /// The EVB1000's: no FPU.
    CortexM3,
    /// The ESP32-C3's: no FPU.
    RiscV32,
}

impl Chip {
    /// Chips whose methods are measured, in the order of the documents.
    pub const ALL: [Self; 2] = [Self::CortexM4F, Self::RiscV32];
    /// Chips whose nodes are simulated, in the order of the table of costs.
    pub const SIMULATED: [Self; 3] = [Self::CortexM4F, Self::CortexM3, Self::RiscV32];

    /// Its name in the names of its images.
    pub fn name(self) -> &'static str {
        match self {
            Self::CortexM4F => "arm",
            Self::CortexM3 => "arm-m3",
            Self::RiscV32 => "riscv",
        }
    }

    /// Its name in the documents.
    pub fn title(self) -> &'static str {
        match self {
            Self::CortexM4F => "Cortex-M4F (nRF52832)",
            Self::CortexM3 => "Cortex-M3 (STM32F105)",
            Self::RiscV32 => "RISC-V without FPU (ESP32-C3)",
        }
    }

    /// The compilation target of its code.
    pub fn target(self) -> Target {
        match self {
            Self::CortexM4F => Target("thumbv7em-none-eabihf"),
            Self::CortexM3 => Target("thumbv7m-none-eabi"),
            Self::RiscV32 => Target("riscv32imc-unknown-none-elf"),
        }
    }

    /// QEMU with a machine of this kind. Its clock advances by the same time for each instruction (`-icount`), in the
    /// unit that the images' `instrument` expects. Its counts are meaningful only in this way.
    pub fn qemu(self) -> Command {
        let (program, machine) = match self {
            Self::CortexM4F => {
                ("qemu-system-arm", ["-machine", "mps2-an386", "-icount", "shift=8,sleep=off"].as_slice())
            }
            Self::CortexM3 => {
                ("qemu-system-arm", ["-machine", "mps2-an385", "-icount", "shift=8,sleep=off"].as_slice())
            }
            Self::RiscV32 => (
                "qemu-system-riscv32",
                ["-machine", "virt", "-bios", "none", "-icount", "shift=0,sleep=off"].as_slice(),
            ),
        };
        let mut command = Command::new(program);
        command.args(machine).args(["-nographic", "-monitor", "none", "-serial", "none"]);
        command.args(["-semihosting-config", "enable=on,target=native"]);
        command
    }
}
