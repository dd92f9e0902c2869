//! What is counted from the node's start on: frames and their fates at the radio, and what was dropped for want of time.

use core::sync::atomic::{AtomicU32, Ordering};

use ranging::node::Restart;
use ranging::radio::MAX_FRAME;
use ranging::{Radio, RadioDuration, RadioInstant, ReceiveError, RxFrame, Start, TransmitError};
use telemetry::Counters;

/// A count that one task writes and any may read; it wraps.
#[derive(Debug, Default)]
pub struct Tally(AtomicU32);

impl Tally {
    /// Nothing counted.
    pub const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// One more.
    pub fn add(&self) {
        // Load and store: some chips have no more, and there is one writer.
        self.0.store(self.get().wrapping_add(1), Ordering::Relaxed);
    }

    /// The count.
    pub fn get(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }
}

/// All counts of a node, for a `static`; each has one task that writes it.
#[derive(Debug, Default)]
#[allow(missing_docs, reason = "they are the fields of `telemetry::Counters`")]
pub struct Counts {
    pub sent: Tally,
    pub received: Tally,
    pub timeouts: Tally,
    pub corrupt: Tally,
    pub late: Tally,
    pub not_sent: Tally,
    pub radio_failures: Tally,
    pub rounds_dropped: Tally,
    pub sightings: Tally,
    pub sightings_dropped: Tally,
}

impl Counts {
    /// Nothing counted.
    pub const fn new() -> Self {
        Self {
            sent: Tally::new(),
            received: Tally::new(),
            timeouts: Tally::new(),
            corrupt: Tally::new(),
            late: Tally::new(),
            not_sent: Tally::new(),
            radio_failures: Tally::new(),
            rounds_dropped: Tally::new(),
            sightings: Tally::new(),
            sightings_dropped: Tally::new(),
        }
    }

    /// As they are told.
    pub fn told(&self, t_us: u64, telemetry_dropped: u32) -> Counters {
        Counters {
            t_us,
            sent: self.sent.get(),
            received: self.received.get(),
            timeouts: self.timeouts.get(),
            corrupt: self.corrupt.get(),
            late: self.late.get(),
            not_sent: self.not_sent.get(),
            radio_failures: self.radio_failures.get(),
            rounds_dropped: self.rounds_dropped.get(),
            telemetry_dropped,
            sightings: self.sightings.get(),
            sightings_dropped: self.sightings_dropped.get(),
        }
    }
}

/// A radio whose frames and failures are counted; else the radio that it wraps.
#[derive(Debug)]
pub struct Counted<'c, R> {
    radio: R,
    counts: &'c Counts,
}

impl<'c, R> Counted<'c, R> {
    /// A radio, counted from now on.
    pub fn new(radio: R, counts: &'c Counts) -> Self {
        Self { radio, counts }
    }

    fn judged<T, E>(&self, result: Result<T, E>) -> Result<T, E> {
        if result.is_err() {
            self.counts.radio_failures.add();
        }
        result
    }
}

impl<R: Radio> Radio for Counted<'_, R> {
    type Error = R::Error;

    async fn now(&mut self) -> Result<RadioInstant, Self::Error> {
        let result = self.radio.now().await;
        self.judged(result)
    }

    fn departure(&self, at: RadioInstant) -> RadioInstant {
        self.radio.departure(at)
    }

    async fn transmit(
        &mut self,
        frame: &[u8],
        start: Start,
        listen: bool,
    ) -> Result<RadioInstant, TransmitError<Self::Error>> {
        let result = self.radio.transmit(frame, start, listen).await;
        match &result {
            Ok(_) => &self.counts.sent,
            Err(TransmitError::Late) => &self.counts.late,
            Err(TransmitError::TooLong | TransmitError::NoConfirmation) => &self.counts.not_sent,
            Err(TransmitError::Radio(_)) => &self.counts.radio_failures,
        }
        .add();
        result
    }

    async fn receive<'b>(
        &mut self,
        buffer: &'b mut [u8; MAX_FRAME],
        start: Start,
        window: RadioDuration,
        keep_listening: bool,
    ) -> Result<RxFrame<'b>, ReceiveError<Self::Error>> {
        let result = self.radio.receive(buffer, start, window, keep_listening).await;
        match &result {
            Ok(_) => &self.counts.received,
            Err(ReceiveError::Timeout) => &self.counts.timeouts,
            Err(ReceiveError::Late) => &self.counts.late,
            Err(ReceiveError::Corrupt) => &self.counts.corrupt,
            Err(ReceiveError::Radio(_)) => &self.counts.radio_failures,
        }
        .add();
        result
    }

    async fn idle(&mut self) -> Result<(), Self::Error> {
        let result = self.radio.idle().await;
        self.judged(result)
    }
}

impl<R: Restart> Restart for Counted<'_, R> {
    async fn restart(&mut self) -> Result<(), Self::Error> {
        let result = self.radio.restart().await;
        self.judged(result)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embassy_futures::block_on;
    use ranging::Diagnostics;

    /// Answers each call with the next of these.
    struct Scripted {
        transmissions: std::vec::Vec<Result<RadioInstant, TransmitError<()>>>,
        receptions: std::vec::Vec<Result<(), ReceiveError<()>>>,
        failing: bool,
    }

    impl Radio for Scripted {
        type Error = ();

        async fn now(&mut self) -> Result<RadioInstant, ()> {
            if self.failing { Err(()) } else { Ok(RadioInstant::default()) }
        }

        fn departure(&self, at: RadioInstant) -> RadioInstant {
            at
        }

        async fn transmit(&mut self, _: &[u8], _: Start, _: bool) -> Result<RadioInstant, TransmitError<()>> {
            self.transmissions.pop().unwrap()
        }

        async fn receive<'b>(
            &mut self,
            buffer: &'b mut [u8; MAX_FRAME],
            _: Start,
            _: RadioDuration,
            _: bool,
        ) -> Result<RxFrame<'b>, ReceiveError<()>> {
            let (rx_time, diagnostics) = (RadioInstant::default(), Diagnostics::default());
            self.receptions.pop().unwrap().map(|()| RxFrame { bytes: &buffer[..1], rx_time, diagnostics })
        }

        async fn idle(&mut self) -> Result<(), ()> {
            Ok(())
        }
    }

    impl Restart for Scripted {
        async fn restart(&mut self) -> Result<(), ()> {
            self.now().await.map(|_| ())
        }
    }

    #[test]
    fn every_fate_of_a_frame_is_counted_once() {
        let now = RadioInstant::default();
        let transmissions = std::vec![
            Ok(now),
            Ok(now),
            Ok(now),
            Err(TransmitError::Late),
            Err(TransmitError::TooLong),
            Err(TransmitError::NoConfirmation),
            Err(TransmitError::Radio(())),
        ];
        let receptions = std::vec![
            Ok(()),
            Ok(()),
            Err(ReceiveError::Timeout),
            Err(ReceiveError::Timeout),
            Err(ReceiveError::Timeout),
            Err(ReceiveError::Timeout),
            Err(ReceiveError::Late),
            Err(ReceiveError::Corrupt),
            Err(ReceiveError::Radio(())),
        ];
        let counts = Counts::new();
        let (sends, hears) = (transmissions.len(), receptions.len());
        let mut radio = Counted::new(Scripted { transmissions, receptions, failing: true }, &counts);
        for _ in 0..sends {
            let _ = block_on(radio.transmit(&[], Start::Now, false));
        }
        for _ in 0..hears {
            let _ = block_on(radio.receive(&mut [0; MAX_FRAME], Start::Now, RadioDuration::ZERO, false));
        }
        let _ = block_on(radio.now());
        let _ = block_on(radio.restart());
        assert_eq!(block_on(radio.idle()), Ok(()));
        // Late: one of each kind. Failures: one of each kind, the clock, the restart.
        let told = counts.told(5, 6);
        let expected = Counters {
            t_us: 5,
            sent: 3,
            received: 2,
            timeouts: 4,
            corrupt: 1,
            late: 2,
            not_sent: 2,
            radio_failures: 4,
            telemetry_dropped: 6,
            ..Counters::default()
        };
        assert_eq!(told, expected);
    }

    #[test]
    fn a_tally_wraps() {
        let tally = Tally(AtomicU32::new(u32::MAX));
        tally.add();
        assert_eq!(tally.get(), 0);
    }
}
