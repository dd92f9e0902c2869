//! The targets that code is compiled for.

/// A target without an operating system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// The EVB1000's STM32F105: no FPU.
    CortexM3,
    /// The DWM1001's nRF52832: single-precision FPU.
    CortexM4F,
    /// The ESP32-C3: no FPU.
    RiscV32Imc,
    /// The ESP32-C6: no FPU; atomic instructions.
    RiscV32Imac,
}

impl Target {
    /// The compiler's name.
    pub fn triple(self) -> &'static str {
        match self {
            Self::CortexM3 => "thumbv7m-none-eabi",
            Self::CortexM4F => "thumbv7em-none-eabihf",
            Self::RiscV32Imc => "riscv32imc-unknown-none-elf",
            Self::RiscV32Imac => "riscv32imac-unknown-none-elf",
        }
    }

    /// The name in cargo's environment variables.
    pub fn variable(self) -> String {
        self.triple().replace('-', "_").to_uppercase()
    }

    /// Whether it is an Arm Cortex-M.
    pub fn is_cortex_m(self) -> bool {
        match self {
            Self::CortexM3 | Self::CortexM4F => true,
            Self::RiscV32Imc | Self::RiscV32Imac => false,
        }
    }
}
