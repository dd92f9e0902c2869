//! The scalar of every formula: `f32` on the node, `f64` as its reference on a desktop.
//!
//! It is a separate trait and not `num_traits::Float`, because there `sqrt` is a software routine on a bare-metal
//! target. Here it is the FPU's own instruction where the target has one.

use core::fmt::{Debug, Display};
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// A floating-point scalar: `f32` or `f64`.
pub trait Real:
    sealed::Sealed
    + Copy
    + Debug
    + Display
    + Default
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// The distance from 1 to the next larger number.
    const EPSILON: Self;

    /// A constant of a formula, written as `f64` and rounded to the scalar.
    fn of(value: f64) -> Self;
    /// A count, exactly. It is converted through 32-bit integers, for which an FPU of single precision has an
    /// instruction.
    fn count(number: usize) -> Self;
    /// The value as `f64`, exactly.
    fn to_f64(self) -> f64;
    /// The whole part, from 0 to `u32::MAX`; 0 for smaller numbers and for NaN.
    fn truncated(self) -> u32;
    /// Square root, correctly rounded; NaN below zero.
    fn sqrt(self) -> Self;
    /// eˣ.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// The logarithm to base 2 of a positive number that is not denormal, within 1.2·10⁻⁴. For any other number the
    /// result is finite. It takes 15 FPU instructions instead of a hundred.
    fn log2_about(self) -> Self;
    /// |x|.
    fn abs(self) -> Self;
    /// Neither NaN nor infinite.
    fn is_finite(self) -> bool;

    /// The larger of two numbers; `self` if they cannot be compared.
    #[inline(always)]
    fn at_least(self, floor: Self) -> Self {
        if floor > self { floor } else { self }
    }

    /// The smaller of two numbers; `self` if they cannot be compared.
    #[inline(always)]
    fn at_most(self, ceiling: Self) -> Self {
        if ceiling < self { ceiling } else { self }
    }

    /// x².
    #[inline(always)]
    fn squared(self) -> Self {
        self * self
    }
}

impl Real for f32 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    const EPSILON: Self = f32::EPSILON;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn count(number: usize) -> Self {
        number as u32 as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn truncated(self) -> u32 {
        self as u32
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        sqrt_f32(self)
    }
    #[inline]
    fn exp(self) -> Self {
        libm::expf(self)
    }
    #[inline]
    fn ln(self) -> Self {
        libm::logf(self)
    }
    #[inline(always)]
    fn log2_about(self) -> Self {
        // The exponent's bits, plus log₂ (1 + t) of the mantissa as t + t (1 − t) q(t). This is exact at both ends. q
        // is fitted for the least greatest error: 1.13·10⁻⁴.
        let bits = self.to_bits();
        let exponent = (bits >> 23 & 0xff) as i32 - 127;
        let t = f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000) - 1.0;
        exponent as f32 + t + t * (1.0 - t) * (0.438_725_74 + t * (-0.239_058_25 + t * 0.082_130_7))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f32::abs(self)
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        f32::is_finite(self)
    }
}

impl Real for f64 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    const EPSILON: Self = f64::EPSILON;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn count(number: usize) -> Self {
        f64::from(number as u32)
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
    #[inline(always)]
    fn truncated(self) -> u32 {
        self as u32
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        libm::sqrt(self)
    }
    #[inline]
    fn exp(self) -> Self {
        libm::exp(self)
    }
    #[inline]
    fn ln(self) -> Self {
        libm::log(self)
    }
    #[inline]
    fn log2_about(self) -> Self {
        let logarithm = libm::log2(self);
        if logarithm.is_finite() { logarithm } else { 0.0 }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }
}

/// `vsqrt.f32`, 14 cycles. Stable Rust has no `sqrt` in `core`, and inline assembly has no register class for an FPU
/// register on this target. So the argument goes through core registers, and s0 is restored.
#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
#[allow(unsafe_code)]
#[inline(always)]
fn sqrt_f32(x: f32) -> f32 {
    let mut bits = x.to_bits();
    // SAFETY: this touches only the two core registers it is given and s0, which it restores; no memory, no stack, no
    // flags.
    unsafe {
        core::arch::asm!(
            "vmov {kept}, s0", "vmov s0, {bits}", "vsqrt.f32 s0, s0", "vmov {bits}, s0", "vmov s0, {kept}",
            bits = inout(reg) bits, kept = out(reg) _, options(pure, nomem, nostack, preserves_flags)
        );
    }
    f32::from_bits(bits)
}

/// The host's own instruction through `libm` where it has one, else correctly rounded software (no FPU: riscv32imc,
/// thumbv7m).
#[cfg(not(all(target_arch = "arm", target_abi = "eabihf")))]
#[inline(always)]
fn sqrt_f32(x: f32) -> f32 {
    libm::sqrtf(x)
}

#[cfg(test)]
mod tests {
    use super::Real;

    #[test]
    fn the_quick_logarithm_keeps_its_bound() {
        let mut worst = 0.0_f64;
        for exponent in [-126, -60, -4, -1, 0, 1, 7, 60, 127] {
            for step in 0..4096_u16 {
                let x = (1.0 + f32::from(step) / 4096.0) * 2_f32.powi(exponent);
                worst = worst.max((x.log2_about().to_f64() - f64::from(x).log2()).abs());
            }
        }
        assert!(worst < 1.2e-4, "{worst}");
    }

    #[test]
    fn the_quick_logarithm_of_no_such_number_is_finite() {
        for x in [0.0_f32, -1.0, f32::NAN, f32::INFINITY, f32::MIN_POSITIVE / 2.0] {
            assert!(x.log2_about().is_finite() && f64::from(x).log2_about().is_finite());
        }
    }
}
