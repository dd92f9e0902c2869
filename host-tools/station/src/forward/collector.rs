//! From the messages of one source to datagrams of its node.

use wire::datagram::MAX_FRAMES;
use wire::telemetry::{MAX_FRAME, Message, encode};

/// Frames wait for others for this time at most, microseconds.
const TOGETHER_US: u64 = 100_000;
/// The most bytes of frames that wait for the hello of their node, which comes every two seconds.
const MOST_NAMELESS: usize = 1 << 18;

/// The frames of a datagram.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Bundle {
    /// Short address of the node.
    pub(super) node: u16,
    /// When the last frame was received, microseconds since 1970.
    pub(super) received_us: u64,
    /// The frames.
    pub(super) frames: Vec<u8>,
}

/// Frames that were received together.
#[derive(Clone, Debug, Default)]
struct Frames {
    bytes: Vec<u8>,
    first_us: u64,
    last_us: u64,
    /// The node's time of the last message.
    node_us: u64,
}

/// Bundles the messages of one source.
#[derive(Debug, Default)]
pub(super) struct Collector {
    /// None: it is not known before the next hello.
    node: Option<u16>,
    open: Frames,
    /// Without a node.
    nameless: Vec<Frames>,
    /// Frames that were dropped, because no hello came.
    dropped: u64,
    ready: Vec<Bundle>,
}

impl Collector {
    /// Takes a message that was received at this time.
    pub(super) fn take(&mut self, message: &Message, received_us: u64) {
        if let Message::Hello(hello) = message {
            if self.node.is_some_and(|node| node != hello.address) {
                self.close();
            }
            self.node = Some(hello.address);
            let waiting = std::mem::take(&mut self.nameless);
            self.ready.extend(waiting.into_iter().map(|frames| frames.of(hello.address)));
        }
        let mut frame = [0; MAX_FRAME];
        let frame = encode(message, &mut frame);
        let is_full = self.open.bytes.len() + frame.len() > MAX_FRAMES;
        // A node that has started again has another clock.
        let is_back = message.t_us() < self.open.node_us;
        if is_full || is_back {
            self.close();
        }
        if self.open.bytes.is_empty() {
            self.open.first_us = received_us;
        }
        self.open.bytes.extend_from_slice(frame);
        (self.open.last_us, self.open.node_us) = (received_us, message.t_us());
        self.pass(received_us);
    }

    /// Time has passed.
    pub(super) fn pass(&mut self, now_us: u64) {
        if !self.open.bytes.is_empty() && now_us.saturating_sub(self.open.first_us) >= TOGETHER_US {
            self.close();
        }
    }

    /// The connection was lost: perhaps another node comes next.
    pub(super) fn lost(&mut self) {
        self.close();
        self.node = None;
        self.dropped += self.nameless.drain(..).map(|frames| frames.count()).sum::<u64>();
    }

    fn close(&mut self) {
        let frames = std::mem::take(&mut self.open);
        if frames.bytes.is_empty() {
            return;
        }
        match self.node {
            Some(node) => self.ready.push(frames.of(node)),
            None => {
                self.nameless.push(frames);
                while self.nameless.iter().map(|frames| frames.bytes.len()).sum::<usize>() > MOST_NAMELESS {
                    self.dropped += self.nameless.remove(0).count();
                }
            }
        }
    }

    /// What is ready to be sent.
    pub(super) fn take_ready(&mut self) -> Vec<Bundle> {
        std::mem::take(&mut self.ready)
    }

    /// Frames that were dropped since the last call, because nobody knows whose they are.
    pub(super) fn take_dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }
}

impl Frames {
    fn of(self, node: u16) -> Bundle {
        Bundle { node, received_us: self.last_us, frames: self.bytes }
    }

    /// Each ends with a zero.
    fn count(&self) -> u64 {
        self.bytes.iter().filter(|byte| **byte == 0).count() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::telemetry::{Board, Condition, Hello, Role, State};

    fn state(t_us: u64) -> Message {
        State { t_us, is: Condition::Searching }.into()
    }

    fn hello(t_us: u64, address: u16) -> Message {
        Hello { t_us, eui: 1, address, role: Role::Tag, board: Board::Dwm1001, build: [0; 8], keyed: false }.into()
    }

    fn frames(messages: &[Message]) -> Vec<u8> {
        messages.iter().flat_map(|message| encode(message, &mut [0; MAX_FRAME]).to_vec()).collect()
    }

    #[test]
    fn frames_wait_for_their_nodes_name_and_for_others() {
        let mut collector = Collector::default();
        collector.take(&state(1), 1000);
        collector.pass(1000 + TOGETHER_US);
        assert_eq!(collector.take_ready(), [], "nobody knows whose it is");
        collector.take(&hello(2, 0x1001), 300_000);
        collector.take(&state(3), 300_500);
        let first = Bundle { node: 0x1001, received_us: 1000, frames: frames(&[state(1)]) };
        assert_eq!(collector.take_ready(), [first]);
        collector.pass(300_000 + TOGETHER_US);
        let second = Bundle { node: 0x1001, received_us: 300_500, frames: frames(&[hello(2, 0x1001), state(3)]) };
        assert_eq!(collector.take_ready(), [second]);
    }

    #[test]
    fn another_node_and_another_clock_have_datagrams_of_their_own() {
        let mut collector = Collector::default();
        collector.take(&hello(9_000_000, 1), 10);
        collector.take(&state(5), 20);
        collector.take(&hello(6, 2), 30);
        collector.lost();
        collector.take(&state(7), 40);
        collector.take(&hello(8, 3), 50);
        collector.pass(1_000_000);
        let told = collector.take_ready();
        let nodes: Vec<_> = told.iter().map(|bundle| (bundle.node, bundle.received_us)).collect();
        // The last two frames are of one datagram: the hello names both.
        assert_eq!(nodes, [(1, 10), (1, 20), (2, 30), (3, 50)]);
        assert_eq!(collector.take_dropped(), 0);
    }

    #[test]
    fn datagrams_have_their_bounds_and_what_nobody_names_is_counted() {
        let mut collector = Collector::default();
        collector.take(&hello(0, 1), 0);
        for t_us in 1..1000 {
            collector.take(&state(t_us), 0);
        }
        let told = collector.take_ready();
        assert!(told.len() > 3 && told.iter().all(|bundle| bundle.frames.len() <= MAX_FRAMES));
        collector.lost();
        for t_us in 1..40_000 {
            collector.take(&state(t_us), 0);
        }
        let dropped = collector.take_dropped();
        collector.lost();
        assert!(dropped > 0);
        assert_eq!(dropped + collector.take_dropped(), 39_999);
    }
}
