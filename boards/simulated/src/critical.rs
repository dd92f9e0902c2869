//! The critical section of a program with one thread and no interrupts. It does nothing.

struct Alone;

critical_section::set_impl!(Alone);

// SAFETY: there is no other thread and no interrupt.
unsafe impl critical_section::Impl for Alone {
    unsafe fn acquire() -> critical_section::RawRestoreState {
        Default::default()
    }

    unsafe fn release(_: critical_section::RawRestoreState) {}
}
