//! A radio directly on the air: [`ranging::Radio`] without a chip, a bus or an interrupt in between.
//!
//! It receives frames, misses frames, is late and loses frames as the chip does, on the same air and with the same kind
//! of clock. Its operations take the time that the driver's transactions and interrupts take on a board, by the node's
//! [`Processor`] and the table of [`Costs`]. A simulation of a thousand such nodes takes as long as one of a dozen
//! nodes on simulated chips.

mod air_phy;
mod bus_load;

use std::cell::RefCell;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::poll_fn;
use std::pin::pin;
use std::rc::Rc;
use std::task::{Poll, Waker};

use crc::{CRC_16_KERMIT, Crc};
use rand::Rng;
use ranging::Restart;
use ranging::radio::{Capabilities, Config, FrameFilter, MAX_FRAME, RangeBias};
use ranging::{
    Diagnostics, Pace, Radio, RadioDuration, RadioInstant, ReceiveError, ResponseWindow, RxFrame, Sample, Start,
    TransmitError,
};
use wire::uwb::{Address, BROADCAST, Header};

use crate::air::{
    AirClient, Path, Payload, Phy, PortId, Reception, ReceptionEvent, Response, RxSettings, TxStart, estimated_dbm,
};
use crate::clock::{Clock, ClockConfig, Count, TICKS_PER_PS};
use crate::costs::Costs;
use crate::random::{Purpose, gauss, stream};
use crate::{Processor, TrueTime, World};

use air_phy::settings;
pub(crate) use air_phy::{air_phy, radiated_dbm};
use bus_load::{
    ARMED, CLOCK, FRAME_READ, FRAME_SEEN, LISTEN, LISTEN_AGAIN, LOAD_AT, LOAD_NOW, SENT_AT, SENT_NOW, STOP,
    STOP_AND_SEND, STOP_AND_SEND_AT, WINDOW_OVER,
};

const CHECK: Crc<u16> = Crc::<u16>::new(&CRC_16_KERMIT);
/// From a command to the first preamble symbol, ticks (10 µs): a delayed start that is nearer than this is late.
const LEAD_TICKS: i64 = 638_976;
/// Standard deviation of the clock offset that the carrier integrator reports, parts per million.
const CARRIER_DEVIATION_PPM: f64 = 0.05;
/// The maximum number of receptions that wait for the node, as in the chip's two buffers.
const BUFFERS: usize = 2;
/// The minimum time that the end of a window takes, ticks (1 µs). Without it, a node that asks again for the rest of
/// the window could stop time.
const WINDOW_END_TICKS: i64 = 63_898;
const WRAP: u64 = 1 << 40;

/// A node's antenna and oscillator, which persist when the node is switched off and on.
#[derive(Clone)]
pub struct Antenna {
    world: World,
    port: PortId,
    phy: Phy,
    /// That of the chip, whose estimates of powers it gives.
    range_bias: RangeBias,
    processor: Processor,
    costs: &'static Costs,
    state: Rc<RefCell<State>>,
}

/// A radio on the air. After it is dropped, nothing is received.
pub struct Direct {
    antenna: Antenna,
    pace: Pace,
}

/// The client of the air.
struct State {
    port: PortId,
    settings: RxSettings,
    /// Network and address, if only frames for them are received.
    filter: Option<(u16, u16)>,
    clock: Clock,
    /// The receiver is on.
    listening: bool,
    heard: VecDeque<Option<Received>>,
    /// The accumulator of the last frame, while the receiver is off after it.
    accumulated: Option<Response>,
    waiting: Option<Waker>,
}

/// A frame that was received without errors.
struct Received {
    bytes: Rc<[u8]>,
    rx_time: RadioInstant,
    diagnostics: Diagnostics,
    response: Response,
}

impl Antenna {
    /// An antenna that moves along `path`, on a board with this processor. Its clock starts at a random count. It takes
    /// the PHY from the driver's configuration and, unless the filter is off, the network and the address: then only
    /// data frames to this node and to everyone are received.
    pub fn new(world: &World, path: Path, clock: ClockConfig, config: &Config, processor: Processor) -> Self {
        let phy = &config.phy;
        let air_phy = air_phy(phy);
        let filter = (config.filter != FrameFilter::OFF).then_some((config.pan, config.short_address));
        let state = |port: PortId| {
            let first = WRAP + stream(world.seed(), Purpose::Birth, u64::from(port)).random_range(0..WRAP);
            let oscillator = stream(world.seed(), Purpose::Oscillator, u64::from(port));
            Rc::new(RefCell::new(State {
                port,
                settings: settings(phy, &air_phy),
                filter,
                clock: Clock::new(clock, Count::from_ticks(first), oscillator),
                listening: false,
                heard: VecDeque::new(),
                accumulated: None,
                waiting: None,
            }))
        };
        let (port, state) = world.add_client(path, state);
        let costs = Costs::of(processor.board().core);
        let range_bias = baliza_dw1000::bias::of(phy);
        Self { world: world.clone(), port, phy: air_phy, range_bias, processor, costs, state }
    }

    /// Its number on the air.
    pub fn port(&self) -> PortId {
        self.port
    }

    /// The radio at this antenna. Only one may exist at a time.
    pub fn radio(&self) -> Direct {
        Direct { antenna: self.clone(), pace: Pace::default() }
    }

    fn listen(&self) {
        let mut state = self.state.borrow_mut();
        if !state.listening && state.heard.len() < BUFFERS {
            state.switch_on(&self.world);
        }
    }

    fn switch_off(&self) {
        let mut state = self.state.borrow_mut();
        if std::mem::take(&mut state.listening) {
            self.world.air().deafen(self.port);
        }
        state.heard.clear();
    }

    /// Makes the processor spend the time of `transactions` transactions of `bytes` bytes together. Each transaction
    /// has one operation.
    async fn bus(&self, (transactions, bytes): (u64, usize)) {
        let board = self.processor.board();
        self.processor.charge(self.costs.driver.transaction * transactions as u32);
        let bus_ps = transactions * board.setup_ps(1) + board.bytes_ps(bytes, board.spi_fast_hz);
        self.world.pass(self.processor.occupy(self.world.now(), bus_ps)).await;
    }

    /// The processor is woken.
    async fn wake(&self) {
        self.world.pass(self.processor.wake(self.world.now())).await;
    }

    fn instant_now(&self) -> RadioInstant {
        RadioInstant::from_ticks(self.ticks_now() as u64)
    }

    fn ticks_now(&self) -> i64 {
        self.state.borrow_mut().clock.count_at(self.world.now()).ticks() as i64
    }

    /// The true time at which the unwrapped counter shows `ticks`.
    fn time_of(&self, ticks: i64) -> TrueTime {
        self.state.borrow_mut().clock.time_of(Count::from_ticks(ticks as u64))
    }

    /// The unwrapped count of an instant that is at most half a wrap from now.
    fn unwrap(&self, instant: RadioInstant) -> i64 {
        let now = self.ticks_now();
        now + instant.since(RadioInstant::from_ticks(now as u64)).ticks()
    }

    /// The next reception up to `until`.
    async fn next(&self, until: TrueTime) -> Option<Option<Received>> {
        let mut timer = pin!(self.world.sleep_until(until));
        poll_fn(|context| {
            let mut state = self.state.borrow_mut();
            if let Some(heard) = state.heard.pop_front() {
                return Poll::Ready(Some(heard));
            }
            state.waiting = Some(context.waker().clone());
            drop(state);
            timer.as_mut().poll(context).map(|()| None)
        })
        .await
    }
}

impl State {
    fn switch_on(&mut self, world: &World) {
        self.listening = true;
        self.accumulated = None;
        world.listen(self.port, self.settings);
    }

    fn wants(&self, bytes: &[u8]) -> bool {
        let Some((pan, address)) = self.filter else { return true };
        Header::parse(bytes).is_ok_and(|(header, _)| {
            let ours = [Address::Short(address), Address::Short(BROADCAST)];
            header.pan == pan && ours.contains(&header.destination)
        })
    }

    fn take(&mut self, now: TrueTime, reception: &Reception) -> Option<Received> {
        let length = reception.bytes.len();
        let payload = reception.bytes.get(..length.checked_sub(2)?)?;
        if reception.payload != Payload::Good || payload.len() > MAX_FRAME {
            return None;
        }
        let stamp = self.clock.count_at(reception.marker).plus_ticks(reception.stamp_error_ps * TICKS_PER_PS);
        let response = Response::of(reception);
        // The chip's estimates of the powers.
        let (link, prf) = (&reception.link, reception.phy.prf);
        let estimate_dbm = estimated_dbm(prf, link.power_dbm);
        let rx_power_dbm = if response.cir_power == 0 { f64::NAN } else { estimate_dbm };
        let first_path_power_dbm = link.first_path_dbm + estimate_dbm - link.power_dbm;
        let mut noise = rand_pcg::Pcg64Mcg::new(u128::from(reception.noise_seed) | 1);
        let offset_ppm = reception.sender_ppm - self.clock.ppm_at(now) + CARRIER_DEVIATION_PPM * gauss(&mut noise);
        Some(Received {
            bytes: Rc::from(payload),
            rx_time: RadioInstant::from_ticks(stamp.ticks()),
            diagnostics: Diagnostics {
                rx_power_dbm: rx_power_dbm as f32,
                first_path_power_dbm: first_path_power_dbm as f32,
                first_path_index: response.first_path as f32,
                first_path_amplitudes: response.first_path_amplitudes(),
                cir_power: response.cir_power,
                preamble_count: response.rxpacc,
                noise_deviation: response.noise.round() as u16,
                clock_offset_ppm: offset_ppm as f32,
            },
            response,
        })
    }
}

impl AirClient for State {
    fn on_air(&mut self, world: &World, now: TrueTime, heard: ReceptionEvent) {
        let received = match heard {
            ReceptionEvent::Preamble | ReceptionEvent::Sfd => return,
            ReceptionEvent::Header { bytes, .. } => {
                if !self.wants(&bytes) {
                    world.air().deafen(self.port);
                    self.switch_on(world);
                }
                return;
            }
            ReceptionEvent::SfdTimeout | ReceptionEvent::HeaderError => None,
            ReceptionEvent::Frame(reception) => self.take(now, &reception),
        };
        self.listening = false;
        self.heard.push_back(received);
        if let Some(waker) = self.waiting.take() {
            waker.wake();
        }
    }
}

impl Direct {
    /// Switches off a receiver that is on, as the driver does before anything else.
    async fn stop(&self, takes: (u64, usize)) {
        let listens = self.antenna.state.borrow().listening;
        if listens {
            self.antenna.bus(takes).await;
        }
        self.antenna.switch_off();
    }
}

/// Sends a frame from its beginning, now, to its end. `end` says when its last bit leaves, with this many bytes on the air.
pub(crate) async fn emit(
    world: &World,
    sender: PortId,
    sent: TxStart,
    frame: &[u8],
    end: impl FnOnce(usize) -> TrueTime,
) {
    let on_air = world.begin_frame(sender, sent);
    world.sleep_until(sent.marker).await;
    let mut bytes = frame.to_vec();
    bytes.extend_from_slice(&CHECK.checksum(frame).to_le_bytes());
    let end = end(bytes.len());
    world.air().fill(on_air, Rc::from(bytes), end);
    world.sleep_until(end).await;
}

impl Radio for Direct {
    type Error = Infallible;

    const CAPABILITIES: Capabilities = baliza_dw1000::CAPABILITIES;

    async fn now(&mut self) -> Result<RadioInstant, Infallible> {
        self.antenna.bus(CLOCK).await;
        Ok(self.antenna.instant_now())
    }

    fn antenna_delay(&self) -> RadioDuration {
        RadioDuration::ZERO
    }

    fn range_bias(&self) -> RangeBias {
        self.antenna.range_bias
    }

    async fn transmit(
        &mut self,
        frame: &[u8],
        start: Start,
        listen: bool,
    ) -> Result<RadioInstant, TransmitError<Infallible>> {
        self.pace = Pace::default();
        if frame.len() > MAX_FRAME {
            return Err(TransmitError::TooLong);
        }
        let (stop, load, sent_by) = match start {
            Start::Now => (STOP_AND_SEND, LOAD_NOW, SENT_NOW),
            Start::At(_) => (STOP_AND_SEND_AT, LOAD_AT, SENT_AT),
        };
        self.stop(stop).await;
        let antenna = &self.antenna;
        antenna.bus((load.0, load.1 + frame.len())).await;
        let shr = antenna.phy.shr_ticks() as i64;
        let soonest = antenna.ticks_now() + LEAD_TICKS + shr;
        let marker = match start {
            Start::Now => (soonest as u64).next_multiple_of(Self::CAPABILITIES.delayed_step.into()) as i64,
            Start::At(at) => {
                self.pace.armed = Some(antenna.instant_now());
                antenna.unwrap(self.departure(at))
            }
        };
        if marker < soonest {
            return Err(TransmitError::Late);
        }
        let begin = antenna.time_of(marker - shr);
        if let Start::At(_) = start {
            // This is done while the frame leaves, if there is no time before.
            antenna.processor.charge(antenna.costs.driver.transaction * ARMED.0 as u32);
        }
        antenna.processor.settle(antenna.world.now());
        antenna.world.sleep_until(begin).await;
        let sender_ppm = antenna.state.borrow_mut().clock.ppm_at(begin);
        let marked = antenna.time_of(marker);
        let sent = TxStart {
            phy: antenna.phy,
            ranging: true,
            start: begin,
            marker: marked,
            power_dbm: radiated_dbm(&antenna.phy, frame.len() + 2),
            sender_ppm,
        };
        let end = |bytes| antenna.time_of(marker + (antenna.phy.phr_ticks() + antenna.phy.payload_ticks(bytes)) as i64);
        emit(&antenna.world, antenna.port, sent, frame, end).await;
        if listen {
            antenna.listen();
        }
        antenna.wake().await;
        antenna.bus(sent_by).await;
        Ok(RadioInstant::from_ticks(marker as u64))
    }

    async fn receive<'b>(
        &mut self,
        buffer: &'b mut [u8; MAX_FRAME],
        start: Start,
        window: RadioDuration,
        keep_listening: bool,
    ) -> Result<RxFrame<'b>, ReceiveError<Infallible>> {
        self.pace = Pace::default();
        let was_on = {
            let state = self.antenna.state.borrow();
            state.listening || !state.heard.is_empty()
        };
        let begin = match start {
            Start::Now => {
                if !was_on {
                    self.antenna.bus(LISTEN).await;
                }
                self.antenna.ticks_now()
            }
            Start::At(at) => {
                self.stop(STOP).await;
                let begin = self.antenna.unwrap(at);
                self.antenna.bus(LISTEN).await;
                if begin < self.antenna.ticks_now() {
                    return Err(ReceiveError::Late);
                }
                self.antenna.world.sleep_until(self.antenna.time_of(begin)).await;
                begin
            }
        };
        let antenna = &self.antenna;
        antenna.listen();
        let until = antenna.time_of(begin + window.ticks().max(0) + WINDOW_END_TICKS);
        // The charged work is done while the frame is awaited, not after it.
        antenna.processor.settle(antenna.world.now());
        let heard = antenna.next(until).await;
        antenna.wake().await;
        match heard {
            Some(Some(Received { bytes, rx_time, diagnostics, response })) => {
                antenna.bus(FRAME_SEEN).await;
                antenna.state.borrow_mut().accumulated = (!keep_listening).then_some(response);
                if keep_listening {
                    antenna.bus(LISTEN_AGAIN).await;
                    antenna.listen();
                    self.pace.listening = Some(antenna.instant_now());
                }
                antenna.bus((FRAME_READ.0, FRAME_READ.1 + bytes.len())).await;
                let bytes = match buffer.get_mut(..bytes.len()) {
                    Some(place) => {
                        place.copy_from_slice(&bytes);
                        place
                    }
                    None => return Err(ReceiveError::Corrupt),
                };
                Ok(RxFrame { bytes, rx_time, diagnostics })
            }
            Some(None) => {
                antenna.bus(WINDOW_OVER).await;
                antenna.switch_off();
                Err(ReceiveError::Corrupt)
            }
            None => {
                antenna.bus(WINDOW_OVER).await;
                antenna.switch_off();
                Err(ReceiveError::Timeout)
            }
        }
    }

    async fn idle(&mut self) -> Result<(), Infallible> {
        self.stop(STOP).await;
        Ok(())
    }

    fn pace(&self) -> Pace {
        self.pace
    }

    async fn impulse_response(
        &mut self,
        window: ResponseWindow,
        mut take: impl FnMut(Sample),
    ) -> Result<Option<u16>, Infallible> {
        let state = self.antenna.state.borrow();
        let Some(response) = &state.accumulated else { return Ok(None) };
        let all = response.length as u16;
        let count = window.count.min(all);
        let first = (window.first_path_index as u16).saturating_sub(window.before).min(all - count);
        for at in first..first + count {
            let [i, q] = response.sample(at.into());
            take(Sample { i, q });
        }
        Ok(Some(first))
    }
}

impl Restart for Direct {
    async fn restart(&mut self) -> Result<(), Infallible> {
        self.antenna.switch_off();
        Ok(())
    }
}

impl Drop for Direct {
    fn drop(&mut self) {
        self.antenna.switch_off();
    }
}
