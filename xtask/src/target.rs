//! The targets that code is compiled for.

/// A target without an operating system, by the compiler's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Target(pub &'static str);

impl Target {
    /// The compiler's name.
    pub fn triple(self) -> &'static str {
        self.0
    }

    /// The name in cargo's environment variables.
    pub fn variable(self) -> String {
        self.0.replace('-', "_").to_uppercase()
    }

    /// Whether it is an Arm Cortex-M.
    pub fn is_cortex_m(self) -> bool {
        self.0.starts_with("thumb")
    }
}
