//! A host's messages to tags, as a station sends them: to every anchor with a cable, again until the tag answers.

use baliza_report::percentile;
use downlink::{MessageOutcome, PendingMessages, Settled};
use wire::telemetry::TagAnswer;
use wire::uwb::native::{Answer, Downlink, TagCommand, UserData};

use super::Scenario;

/// A message is of use for this time, microseconds.
const LASTS_US: u64 = 600_000_000;
/// When the first messages are written, seconds: the others follow from each tag's own interval.
const BEGIN_S: f64 = 5.0;

/// The station that sends messages.
#[derive(Default)]
pub(super) struct Sender {
    pending: PendingMessages,
    /// By tag: from one message to the next, when the next is due, seconds, and how many there were.
    plans: Vec<(u16, f64, f64, u8)>,
    /// How long each took that its tag took, seconds.
    taken_s: Vec<f64>,
    lost: usize,
}

/// The bytes of a tag's message: its number and the complement, in turn.
pub(super) fn content(number: u8) -> [u8; UserData::MOST] {
    core::array::from_fn(|i| if i % 2 == 0 { number } else { !number })
}

impl Sender {
    /// The sender of a scenario: the first messages to its tags are spread over their interval.
    pub(super) fn of(scenario: &Scenario) -> Self {
        let tags = scenario.tags.iter().filter_map(|tag| Some((tag.address, tag.messages_every_s?)));
        let tags: Vec<_> = tags.collect();
        let count = tags.len().max(1) as f64;
        let plans = tags.into_iter().zip(0_u32..);
        let plans = plans
            .map(|((tag, every_s), place)| (tag, every_s, BEGIN_S + every_s * f64::from(place) / count, 0))
            .collect();
        Self { plans, ..Self::default() }
    }

    /// The message that all gateways are to send now.
    pub(super) fn due(&mut self, now_s: f64) -> Option<Downlink> {
        let Self { pending, plans, lost, .. } = self;
        for (tag, every_s, next_s, number) in plans.iter_mut().filter(|plan| plan.2 <= now_s) {
            *next_s += *every_s;
            let taken = pending.send(*tag, TagCommand::Data(&content(*number)), micros(now_s), LASTS_US);
            *lost += usize::from(taken.is_none());
            *number = number.wrapping_add(1);
        }
        self.lost += self.pending.expired(micros(now_s)).len();
        self.pending.due(micros(now_s))
    }

    /// A gateway reports an answer.
    pub(super) fn answered(&mut self, told: &TagAnswer, now_s: f64) {
        match self.pending.answered(told.tag, told.number, told.answer(), micros(now_s)) {
            Some(Settled { outcome: MessageOutcome::Answered(Answer::Taken), took_us, .. }) => {
                self.taken_s.push(took_us as f64 / 1e6);
            }
            Some(_) => self.lost += 1,
            None => {}
        }
    }

    /// The share of the messages that their tags have taken, and how long 99 % of those took at most, seconds. Those that
    /// wait count as taken by nobody if there are more than one for a tag. `None` without messages.
    pub(super) fn figures(&self) -> Option<(f64, Option<f64>)> {
        let mut taken_s = self.taken_s.clone();
        taken_s.sort_by(f64::total_cmp);
        let counted = taken_s.len() + self.lost + self.pending.overdue();
        let p99_s = (!taken_s.is_empty()).then(|| percentile(&taken_s, 0.99));
        (counted > 0).then(|| (taken_s.len() as f64 / counted as f64, p99_s))
    }
}

fn micros(seconds: f64) -> u64 {
    (seconds * 1e6) as u64
}
