//! Messages of a host to tags until they are answered: which one gateways are to send when.
//!
//! Gateways and anchors keep a message for ten minutes, so that a tag that sleeps gets it. They keep few, and any frame may
//! be lost: what is not answered is sent again, after a longer time each time. A tag gets one message at a time, in their
//! order, and all gateways send it: nobody knows which of them its tag receives.

use std::collections::{BTreeMap, VecDeque};

use wire::uwb::native::{Answer, Downlink, TagCommand, UserData};

/// From one message of a host to the next, microseconds: an anchor's sync frame carries one, and is sent again when a tag asks.
const EVERY_US: u64 = 250_000;
/// From the first sending to the second one, and the longest time to the next one, microseconds.
const FIRST_PATIENCE_US: u64 = 3_000_000;
const LONGEST_PATIENCE_US: u64 = 60_000_000;
/// As many messages as anchors keep, without an answer, were sent within this time: others wait.
const FRESH_US: u64 = 10_000_000;
const MOST_FRESH: usize = 8;
/// Messages that may wait for a tag.
pub const MOST_WAITING: usize = 16;

/// The bytes of a message's data, two hexadecimal digits each; `None` if there are none, more than a message holds, or another
/// character.
pub fn data_bytes(digits: &str) -> Option<Vec<u8>> {
    let are_digits = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    if digits.is_empty() || !are_digits || !digits.len().is_multiple_of(2) || digits.len() > 2 * UserData::MOST {
        return None;
    }
    (0..digits.len()).step_by(2).map(|at| u8::from_str_radix(digits.get(at..at + 2)?, 16).ok()).collect()
}

/// What became of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MessageOutcome {
    /// The tag has answered.
    Answered(Answer),
    /// The tag has not answered in time.
    Expired,
}

/// A message that is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settled {
    /// The message, by the number that [`PendingMessages::send`] gave it.
    pub id: u64,
    /// Short address of the tag.
    pub tag: u16,
    /// What became of it.
    pub outcome: MessageOutcome,
    /// How long it took, microseconds.
    pub took_us: u64,
}

/// A message that waits for its answer.
#[derive(Clone, Copy, Debug)]
struct Pending {
    id: u64,
    message: Downlink,
    asked_us: u64,
    expires_us: u64,
    /// When it was sent last, and the time until it is sent again.
    sent: Option<(u64, u64)>,
}

/// The messages to the tags of one host. All times are microseconds of any clock that never goes back.
#[derive(Clone, Debug, Default)]
pub struct PendingMessages {
    tags: BTreeMap<u16, VecDeque<Pending>>,
    /// The next message's number at each tag that had one.
    numbers: BTreeMap<u16, u8>,
    first_number: u8,
    next_id: u64,
    sent_us: Option<u64>,
}

impl PendingMessages {
    /// None. A tag knows the numbers of the last messages for as long as anchors keep these, ten minutes: the first
    /// number follows from the time, seconds since 1970, and comes again after 17 minutes. So a host that starts again begins
    /// with one that it has not used lately, if it sends a tag a message in four seconds at most.
    pub fn new(unix_s: u64) -> Self {
        Self { first_number: (unix_s / 4) as u8, ..Self::default() }
    }

    /// Takes a message that is of use for `lasts_us`. Returns its number in this host; `None` if it cannot be sent, or too
    /// many wait for this tag.
    pub fn send(&mut self, tag: u16, command: TagCommand<'_>, now_us: u64, lasts_us: u64) -> Option<u64> {
        let waiting = self.tags.get(&tag).map_or(0, VecDeque::len);
        let number = self.numbers.get(&tag).copied().unwrap_or(self.first_number);
        let message = Downlink::new(tag, number, command).filter(|_| waiting < MOST_WAITING)?;
        self.numbers.insert(tag, number.wrapping_add(1));
        let id = self.next_id;
        self.next_id += 1;
        let expires_us = now_us.saturating_add(lasts_us);
        let pending = Pending { id, message, asked_us: now_us, expires_us, sent: None };
        self.tags.entry(tag).or_default().push_back(pending);
        Some(id)
    }

    /// Gives a message up. Gateways that have it still pass it on.
    pub fn withdraw(&mut self, id: u64) -> bool {
        let before = self.len();
        self.tags.retain(|_, of_tag| {
            of_tag.retain(|pending| pending.id != id);
            !of_tag.is_empty()
        });
        before > self.len()
    }

    /// How many wait.
    pub fn len(&self) -> usize {
        self.tags.values().map(VecDeque::len).sum()
    }

    /// How many wait although a later message to their tag waits as well.
    pub fn overdue(&self) -> usize {
        self.tags.values().map(|of_tag| of_tag.len() - 1).sum()
    }

    /// Whether none waits.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The message that all gateways are to send now.
    pub fn due(&mut self, now_us: u64) -> Option<Downlink> {
        let since = |at_us: u64| now_us.saturating_sub(at_us);
        if self.sent_us.is_some_and(|at_us| since(at_us) < EVERY_US) {
            return None;
        }
        let fronts = || self.tags.values().filter_map(VecDeque::front);
        let fresh = fronts().filter(|pending| pending.sent.is_some_and(|(at_us, _)| since(at_us) < FRESH_US)).count();
        let is_due = |pending: &&mut Pending| match pending.sent {
            Some((at_us, patience_us)) => since(at_us) >= patience_us,
            None => fresh < MOST_FRESH,
        };
        // The one that has been sent least lately; of those that were never sent, the oldest.
        let fronts = self.tags.values_mut().filter_map(VecDeque::front_mut).filter(is_due);
        let due = fronts.min_by_key(|pending| (pending.sent.map(|(at_us, _)| at_us), pending.asked_us))?;
        let patience_us = due.sent.map_or(FIRST_PATIENCE_US, |(_, patience_us)| 2 * patience_us);
        due.sent = Some((now_us, patience_us.min(LONGEST_PATIENCE_US)));
        self.sent_us = Some(now_us);
        Some(due.message)
    }

    /// A gateway reports a tag's answer to the message with this number. Returns the message that it settles.
    pub fn answered(&mut self, tag: u16, number: u8, answer: Answer, now_us: u64) -> Option<Settled> {
        let of_tag = self.tags.get_mut(&tag)?;
        let pending =
            of_tag.pop_front_if(|pending| pending.message.data.number() == number && pending.sent.is_some())?;
        if of_tag.is_empty() {
            self.tags.remove(&tag);
        }
        Some(Settled {
            id: pending.id,
            tag,
            outcome: MessageOutcome::Answered(answer),
            took_us: now_us - pending.asked_us,
        })
    }

    /// Takes the messages that are of no use any more.
    pub fn expired(&mut self, now_us: u64) -> Vec<Settled> {
        let mut expired = Vec::new();
        self.tags.retain(|&tag, of_tag| {
            of_tag.retain(|pending| {
                let is_over = now_us >= pending.expires_us;
                if is_over {
                    let took_us = now_us - pending.asked_us;
                    expired.push(Settled { id: pending.id, tag, outcome: MessageOutcome::Expired, took_us });
                }
                !is_over
            });
            !of_tag.is_empty()
        });
        expired
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000;
    const LONG: u64 = 3_600 * SECOND;

    /// The times in seconds at which a tag's messages are sent until `until_s`, with their numbers.
    fn sendings(pending: &mut PendingMessages, from_s: u64, until_s: u64) -> Vec<(f64, u16, u8)> {
        let steps = (from_s * 10..until_s * 10).map(|tenth| tenth * SECOND / 10);
        steps.filter_map(|now| pending.due(now).map(|due| (now as f64 / 1e6, due.tag, due.data.number()))).collect()
    }

    #[test]
    fn what_is_not_answered_is_sent_again_after_twice_the_time() {
        let mut pending = PendingMessages::new(4 * 250);
        let id = pending.send(7, TagCommand::Identify(9), 0, LONG).expect("it fits");
        // 3, 6, 12 … seconds after each other, at last a minute.
        let expected = [0, 3, 9, 21, 45, 93, 153, 213].map(|at| (at as f64, 7, 250));
        assert_eq!(sendings(&mut pending, 0, 214), expected);
        assert_eq!(pending.answered(7, 249, Answer::Taken, 214 * SECOND), None);
        let settled = pending.answered(7, 250, Answer::Full, 214 * SECOND);
        let outcome = MessageOutcome::Answered(Answer::Full);
        assert_eq!(settled, Some(Settled { id, tag: 7, outcome, took_us: 214 * SECOND }));
        assert_eq!(pending.answered(7, 250, Answer::Full, 215 * SECOND), None, "from another anchor");
        assert!(pending.is_empty() && sendings(&mut pending, 214, 400).is_empty());
    }

    #[test]
    fn a_tag_gets_one_message_at_a_time_and_others_get_theirs_meanwhile() {
        let mut pending = PendingMessages::new(4 * 255);
        for tag in [7, 8] {
            (0..2).for_each(|s| assert!(pending.send(tag, TagCommand::Identify(s), 0, LONG).is_some()));
        }
        assert_eq!(sendings(&mut pending, 0, 2), [(0.0, 7, 255), (0.3, 8, 255)]);
        assert!(pending.answered(8, 255, Answer::Taken, 2 * SECOND).is_some());
        // Numbers wrap.
        assert_eq!(sendings(&mut pending, 2, 4), [(2.0, 8, 0), (3.0, 7, 255)]);
    }

    #[test]
    fn not_more_are_on_their_way_than_anchors_keep() {
        let mut pending = PendingMessages::new(0);
        (0..20).for_each(|tag| assert!(pending.send(tag, TagCommand::Data(b"1"), 0, LONG).is_some()));
        let first = sendings(&mut pending, 0, 10);
        let tags =
            |sent: &[(f64, u16, u8)]| sent.iter().map(|(_, tag, _)| *tag).collect::<std::collections::BTreeSet<_>>();
        assert_eq!(tags(&first).len(), MOST_FRESH);
        // Nobody answers: the others are sent as well, as the first ones are repeated more and more seldom.
        assert_eq!(tags(&sendings(&mut pending, 10, 300)).len(), 20);
    }

    #[test]
    fn messages_end_with_their_time_and_too_many_are_refused() {
        let mut pending = PendingMessages::new(0);
        let ids: Vec<_> = (0..MOST_WAITING).map(|_| pending.send(7, TagCommand::Identify(1), 0, SECOND)).collect();
        assert!(ids.iter().all(Option::is_some));
        assert_eq!(pending.send(7, TagCommand::Identify(1), 0, SECOND), None);
        assert_eq!(pending.send(8, TagCommand::Data(&[]), 0, SECOND), None, "no bytes");
        assert!(pending.withdraw(3) && !pending.withdraw(3));
        let alone = pending.send(9, TagCommand::Identify(1), 0, LONG).expect("it fits");
        assert!(pending.withdraw(alone));
        assert_eq!((pending.overdue(), pending.len()), (MOST_WAITING - 2, MOST_WAITING - 1));
        assert_eq!(pending.expired(SECOND - 1), []);
        let expired = pending.expired(SECOND);
        assert_eq!((expired.len(), pending.len()), (MOST_WAITING - 1, 0));
        assert!(expired.iter().all(|it| it.outcome == MessageOutcome::Expired && it.took_us == SECOND && it.id != 3));
    }
}
