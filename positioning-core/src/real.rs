//! The scalar of every formula: `f32` on the node, `f64` as its reference on a desktop.
//!
//! A trait of its own and not `num_traits::Float`, because there `sqrt` is a software routine on a bare-metal target;
//! here it is the FPU's own instruction where the target has one.

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
    /// A count, exactly: through 32-bit integers, for which an FPU of single precision has an instruction.
    fn count(number: usize) -> Self;
    /// The value as `f64`, exactly.
    fn to_f64(self) -> f64;
    /// Square root, correctly rounded; NaN below zero.
    fn sqrt(self) -> Self;
    /// eˣ.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// |x|.
    fn abs(self) -> Self;
    /// Neither NaN nor infinite.
    fn is_finite(self) -> bool;

    /// The larger of two numbers; `self` where they do not compare.
    #[inline(always)]
    fn at_least(self, floor: Self) -> Self {
        if floor > self { floor } else { self }
    }

    /// The smaller of two numbers; `self` where they do not compare.
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
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }
}

/// `vsqrt.f32`, 14 cycles. Stable Rust has no `sqrt` in `core` and gives inline assembly no class for an FPU register on
/// this target, so the argument goes through core registers and s0 is put back.
#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
#[allow(unsafe_code)]
#[inline(always)]
fn sqrt_f32(x: f32) -> f32 {
    let mut bits = x.to_bits();
    // SAFETY: touches only the two core registers it is given and s0, which it restores; no memory, no stack, no flags.
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
