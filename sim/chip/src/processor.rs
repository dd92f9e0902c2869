//! A node's processor: its work takes time, by the [`BoardProfile`].
//!
//! In a simulation, code between two awaits runs in zero time. Its cost is [charged](Processor::charge) to the
//! processor, in instructions. The next access to the outside world pays the cost: a transaction on the bus, or the
//! arming of a wait, begins only when the processor has done the charged work. The processor is thus ahead of true time
//! by the unpaid cost, which nothing outside can detect.
//!
//! There are two priorities. **Ranging** (the high one) is the code that drives the chip: its charges, its
//! transactions, during which the processor does not sleep, and the interrupts that wake it. **The background** is
//! everything else ([`Processor::background`]). It continues only while ranging does nothing, but for the parts that it
//! runs with interrupts off ([`Processor::locked`]). [Interrupts of a Bluetooth controller](Processor::interfere) have
//! a higher priority than both.
//!
//! The processor adds up how long it ran, waited and slept ([`Processor::times`]). From that follows the charge that
//! the board draws.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

use rand::Rng;

use crate::board::{BoardProfile, Interrupts};
use crate::random::Stream;
use crate::time::{PS_PER_S, TrueTime};
use crate::world::World;

/// A processor; clones are the same one.
#[derive(Clone)]
pub struct Processor(Rc<State>);

struct State {
    board: BoardProfile,
    /// Charged and unpaid work, picoseconds.
    debt_ps: Cell<u64>,
    /// The time until which ranging is busy.
    free_at: Cell<TrueTime>,
    /// The total time that ranging was or will be busy up to `free_at`, picoseconds.
    busy_ps: Cell<u64>,
    /// The total time that the background ran, picoseconds.
    background_ps: Cell<u64>,
    /// The total time that interrupts of higher priority took from either, and from sleep, picoseconds.
    stolen_ps: Cell<u64>,
    /// The total time asleep with the clocks off, picoseconds.
    asleep_ps: Cell<u64>,
    /// The background work that runs or is ready to run; and the work charged to the background and unpaid,
    /// picoseconds.
    background_running: Cell<u32>,
    background_debt_ps: Cell<u64>,
    interference: RefCell<Option<Interference>>,
}

struct Interference {
    interrupts: Interrupts,
    next: TrueTime,
    random: Stream,
}

/// The use of a processor's time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProcessorTimes {
    /// Running.
    pub running: Duration,
    /// Waiting with its clocks on.
    pub waiting: Duration,
    /// Asleep with its clocks off.
    pub asleep: Duration,
}

impl ProcessorTimes {
    /// The charge that a board draws in these times, microcoulombs.
    pub fn charge_uc(&self, board: &BoardProfile) -> f64 {
        // A milliampere for a second is a millicoulomb.
        1e3 * (board.run_ma * self.running.as_secs_f64()
            + board.wait_ma * self.waiting.as_secs_f64()
            + board.sleep_ma * self.asleep.as_secs_f64())
    }
}

impl Processor {
    /// An idle processor.
    pub fn new(board: BoardProfile) -> Self {
        Self(Rc::new(State {
            board,
            debt_ps: Cell::new(0),
            free_at: Cell::new(TrueTime::ZERO),
            busy_ps: Cell::new(0),
            background_ps: Cell::new(0),
            stolen_ps: Cell::new(0),
            asleep_ps: Cell::new(0),
            background_running: Cell::new(0),
            background_debt_ps: Cell::new(0),
            interference: RefCell::new(None),
        }))
    }

    /// The board.
    pub fn board(&self) -> &BoardProfile {
        &self.0.board
    }

    /// Ranging has run this number of instructions. The next operation of ranging pays for them.
    pub fn charge(&self, instructions: u32) {
        let debt = &self.0.debt_ps;
        debt.set(debt.get() + self.0.board.instructions_ps(instructions.into()));
    }

    /// Ranging has waited this long for a unit of the processor. The next operation of ranging pays for it.
    pub fn charge_ns(&self, nanoseconds: u32) {
        let debt = &self.0.debt_ps;
        debt.set(debt.get() + self.0.board.stretched_ps(nanoseconds));
    }

    /// The background has run this number of instructions. The next [`background`](Self::background) pays for them.
    pub fn charge_background(&self, instructions: u32) {
        let debt = &self.0.background_debt_ps;
        debt.set(debt.get() + self.0.board.instructions_ps(instructions.into()));
    }

    /// Starts the interrupts of Bluetooth or Wi-Fi, or ends them with `None`.
    pub fn interfere(&self, now: TrueTime, interrupts: Option<Interrupts>, random: Stream) {
        *self.0.interference.borrow_mut() = interrupts.map(|interrupts| {
            let mut interference = Interference { interrupts, next: now, random };
            interference.draw();
            interference
        });
    }

    /// The time at which ranging has paid its debt: not before `now`, which is true time.
    pub fn settle(&self, now: TrueTime) -> TrueTime {
        self.occupy(now, 0)
    }

    /// Ranging pays its debt and is then busy for this time. Returns when it is done.
    pub fn occupy(&self, now: TrueTime, picoseconds: u64) -> TrueTime {
        let state = &self.0;
        let begin = state.free_at.get().max(now);
        let work = state.debt_ps.take() + picoseconds;
        if work == 0 {
            return begin;
        }
        let end = self.interrupted(begin, work);
        state.busy_ps.set(state.busy_ps.get() + end.ps_since(begin));
        state.free_at.set(end);
        end
    }

    /// An interrupt wakes ranging now. Returns when its task continues.
    pub fn wake(&self, now: TrueTime) -> TrueTime {
        let state = &self.0;
        let board = &state.board;
        let switch = if state.background_running.get() > 0 { board.switch_instructions } else { 0 };
        self.charge(board.wake_instructions + switch);
        self.occupy(now, board.stretched_ps(board.interrupt_latency_ns))
    }

    /// The end of a wait of `duration` that ranging arms now, in steps of the board's timer.
    pub(crate) fn timer_end(&self, now: TrueTime, duration: Duration) -> TrueTime {
        self.charge(self.0.board.wait_instructions);
        let end = self.settle(now) + duration;
        let board = &self.0.board;
        let is_long = board.sleep_from.is_some_and(|from| duration >= from);
        let step_ns = if is_long { board.sleep_timer_ns.max(board.timer_ns) } else { board.timer_ns };
        match u64::from(step_ns) * 1000 {
            0 => end,
            step => TrueTime::from_ps(end.as_ps().div_ceil(step).saturating_mul(step)),
        }
    }

    /// Counts this time as sleep with the clocks off, if the board sleeps during waits of this length.
    pub(crate) fn slept(&self, picoseconds: u64) {
        let long = |from: Duration| u128::from(picoseconds / 1000) >= from.as_nanos();
        if self.0.board.sleep_from.is_some_and(long) {
            self.0.asleep_ps.set(self.0.asleep_ps.get() + picoseconds);
        }
    }

    /// The background runs this number of instructions, and the work charged to it. Returns when it has had the time.
    pub async fn background(&self, world: &World, instructions: u32) {
        let state = &self.0;
        let mut left_ps = state.board.instructions_ps(instructions.into()) + state.background_debt_ps.take();
        state.background_ps.set(state.background_ps.get() + left_ps);
        let _running = Running::begin(&state.background_running);
        while left_ps > 0 {
            let begin = world.now();
            let busy = self.busy_before(begin);
            let free = state.free_at.get().max(begin);
            world.sleep_until(self.interrupted(free, left_ps)).await;
            let now = world.now();
            let passed = now.ps_since(begin).saturating_sub(self.busy_before(now) - busy);
            left_ps = left_ps.saturating_sub(passed);
        }
    }

    /// The background runs this number of instructions with interrupts off: ranging waits for its end.
    pub async fn locked(&self, world: &World, instructions: u32) {
        let end = self.occupy(world.now(), self.0.board.instructions_ps(instructions.into()));
        world.sleep_until(end).await;
    }

    /// The time that ranging was busy up to `now`, picoseconds.
    fn busy_before(&self, now: TrueTime) -> u64 {
        self.0.busy_ps.get() - self.0.free_at.get().ps_since(now)
    }

    /// The end of work that begins now, with the interrupts of higher priority that fall into it.
    fn interrupted(&self, begin: TrueTime, work_ps: u64) -> TrueTime {
        let mut end = begin.plus_ps(work_ps);
        let mut interference = self.0.interference.borrow_mut();
        let Some(interference) = interference.as_mut() else { return end };
        let each = (interference.interrupts.each.as_nanos() as f64 * 1e3 * self.0.board.slowdown) as u64;
        while interference.next < end {
            // An interrupt that began before this work may still run when it begins.
            let stolen = interference.next.plus_ps(each).ps_since(begin).min(each);
            end = end.plus_ps(stolen);
            self.0.stolen_ps.set(self.0.stolen_ps.get() + each - stolen);
            interference.draw();
        }
        end
    }

    /// The use of the time from the beginning of the simulation up to `now`.
    pub fn times(&self, now: TrueTime) -> ProcessorTimes {
        let state = &self.0;
        let all = now.as_ps();
        let running = self.busy_before(now) + state.background_ps.get() + state.stolen_ps.get();
        let running = running.min(all);
        let asleep = state.asleep_ps.get().min(all - running);
        let duration = |ps: u64| Duration::from_nanos(ps / 1000);
        ProcessorTimes {
            running: duration(running),
            waiting: duration(all - running - asleep),
            asleep: duration(asleep),
        }
    }

    /// Drops the unpaid work: the processor is reset, or has lost its supply.
    pub fn reset(&self, now: TrueTime) {
        let state = &self.0;
        state.busy_ps.set(self.busy_before(now));
        state.free_at.set(now.min(state.free_at.get()));
        state.debt_ps.set(0);
        state.background_debt_ps.set(0);
    }
}

impl Interference {
    /// The time to the next interrupt, exponentially distributed.
    fn draw(&mut self) {
        let uniform: f64 = self.random.random_range(f64::MIN_POSITIVE..1.0);
        let seconds = -uniform.ln() / self.interrupts.per_second.max(1e-9);
        self.next = self.next.plus_ps((seconds * PS_PER_S as f64) as u64);
    }
}

/// Counts background work, also work that is dropped before its end.
struct Running<'a>(&'a Cell<u32>);

impl<'a> Running<'a> {
    fn begin(count: &'a Cell<u32>) -> Self {
        count.set(count.get() + 1);
        Self(count)
    }
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        self.0.set(self.0.get() - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::air::AirConfig;
    use crate::random::{Purpose, stream};

    /// An instruction takes a nanosecond, an interrupt 100 ns and 50 instructions.
    const BOARD: BoardProfile = BoardProfile {
        clock_hz: 1_000_000_000,
        cycles_per_instruction: 1.0,
        interrupt_latency_ns: 100,
        wake_instructions: 50,
        run_ma: 4.0,
        wait_ma: 1.0,
        ..BoardProfile::INSTANT
    };

    fn at_us(micros: u64) -> TrueTime {
        TrueTime::from_micros(micros)
    }

    #[test]
    fn debts_are_paid_by_what_comes_next() {
        let processor = Processor::new(BOARD);
        processor.charge(2_000);
        processor.charge(1_000);
        assert_eq!(processor.occupy(at_us(10), 5_000_000), at_us(18));
        // Nothing is unpaid any more, but the processor is busy until then.
        assert_eq!(processor.settle(at_us(12)), at_us(18));
        assert_eq!(processor.settle(at_us(20)), at_us(20));
    }

    #[test]
    fn an_interrupt_waits_for_ranging_that_is_busy() {
        let processor = Processor::new(BOARD);
        let latency_ps = 150_000;
        assert_eq!(processor.wake(at_us(1)), at_us(1).plus_ps(latency_ps));
        processor.occupy(at_us(2), 3_000_000);
        assert_eq!(processor.wake(at_us(3)), at_us(5).plus_ps(latency_ps));
    }

    #[test]
    fn the_background_goes_on_while_ranging_does_nothing() {
        let world = World::new(1, AirConfig::default());
        let processor = Processor::new(BOARD);
        let (w, p) = (world.clone(), processor.clone());
        world.spawn(async move {
            w.sleep_until(at_us(4)).await;
            // Ranging takes three microseconds of the background's ten.
            let end = p.occupy(w.now(), 3_000_000);
            w.sleep_until(end).await;
            w.sleep_until(at_us(12)).await;
            p.charge(2_000);
            p.settle(w.now());
        });
        let done = processor.background(&world, 10_000);
        world.block_on(done).expect("it ends");
        assert_eq!(world.now(), at_us(15));
        let times = processor.times(at_us(20));
        assert_eq!((times.running, times.waiting), (Duration::from_micros(15), Duration::from_micros(5)));
        // 15 µs at 4 mA and 5 µs at 1 mA: 65 nC.
        assert!((times.charge_uc(&BOARD) - 0.065).abs() < 1e-12);
    }

    #[test]
    fn ranging_waits_while_interrupts_are_off() {
        let world = World::new(1, AirConfig::default());
        let processor = Processor::new(BOARD);
        // Ranging has 2 µs to pay when the background locks for 5 µs.
        processor.charge(2_000);
        let (w, p) = (world.clone(), processor.clone());
        world.spawn(async move { p.locked(&w, 5_000).await });
        world.block_on(world.sleep_until(at_us(3))).expect("it ends");
        assert_eq!(processor.wake(at_us(3)), at_us(7).plus_ps(150_000));
        // Nobody had to wait for an earlier lock, nor has it run twice.
        assert_eq!(processor.settle(at_us(9)), at_us(9));
        assert_eq!(processor.times(at_us(20)).running, Duration::from_nanos(7_150));
    }

    #[test]
    fn what_the_background_was_charged_with_it_pays() {
        let world = World::new(1, AirConfig::default());
        let processor = Processor::new(BOARD);
        processor.charge_background(4_000);
        world.block_on(processor.background(&world, 1_000)).expect("it ends");
        assert_eq!(world.now(), at_us(5));
    }

    #[test]
    fn bluetooth_takes_its_share_of_a_long_stretch() {
        let processor = Processor::new(BOARD);
        let interrupts = Interrupts { per_second: 2_000.0, each: Duration::from_micros(50) };
        processor.interfere(TrueTime::ZERO, Some(interrupts), stream(1, Purpose::Scanner, 7));
        // Ten seconds of work while interrupts take a tenth of the time: 11.1 s, within four standard deviations of a
        // Poisson count of 22,000.
        let end = processor.occupy(TrueTime::ZERO, 10 * PS_PER_S).as_secs_f64();
        assert!((end - 10.0 / 0.9).abs() < 4.0 * 22_000_f64.sqrt() * 50e-6 / 0.9, "{end}");
        processor.interfere(TrueTime::from_secs_f64(end), None, stream(1, Purpose::Scanner, 7));
        let begin = TrueTime::from_secs_f64(20.0);
        assert_eq!(processor.occupy(begin, 1_000_000), begin.plus_ps(1_000_000));
    }

    #[test]
    fn waits_end_at_steps_of_the_timer_after_what_is_owed() {
        let processor = Processor::new(BoardProfile { timer_ns: 1_000, wait_instructions: 200, ..BOARD });
        processor.charge(1_300);
        // 1.5 µs of instructions and 10 µs of wait, up to the next whole microsecond.
        assert_eq!(processor.timer_end(TrueTime::ZERO, Duration::from_micros(10)), at_us(12));
    }

    #[test]
    fn long_waits_are_slept_through_where_the_board_does_so() {
        let sleeper = BoardProfile { sleep_from: Some(Duration::from_millis(1)), sleep_timer_ns: 30_000, ..BOARD };
        let processor = Processor::new(sleeper);
        processor.slept(999_000_000);
        processor.slept(4_000_000_000);
        assert_eq!(processor.times(at_us(10_000)).asleep, Duration::from_millis(4));
        // Up to the next step of the slow timer: 34 · 30 µs.
        assert_eq!(processor.timer_end(TrueTime::ZERO, Duration::from_millis(1)), at_us(1_020));
        assert_eq!(processor.timer_end(TrueTime::ZERO, Duration::from_micros(999)), at_us(999));
        let processor = Processor::new(BOARD);
        processor.slept(4_000_000_000);
        assert_eq!(processor.times(at_us(10_000)).asleep, Duration::ZERO);
    }

    #[test]
    fn a_reset_forgets_what_was_owed() {
        let processor = Processor::new(BOARD);
        processor.charge(1_000);
        processor.occupy(TrueTime::ZERO, 9_000_000);
        processor.charge(1_000);
        processor.reset(at_us(4));
        assert_eq!(processor.settle(at_us(4)), at_us(4));
        assert_eq!(processor.times(at_us(4)).running, Duration::from_micros(4));
    }
}
