//! Messages to tags: what people and programs ask for, on its way to gateways, and what became of it.
//!
//! [`Messages::send`] takes a message. Sources whose nodes take messages [`listen`](Messages::listen), and pass each on
//! when it is due: `downlink` says when. The tag's answer comes back as a report, through the hub. A restart of the station
//! forgets what waits.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use downlink::{MOST_WAITING, MessageOutcome, PendingMessages, Settled, data_bytes};
use serde::{Deserialize, Serialize};
use tokio::sync::broadcast;
use tokio::time::{Instant, MissedTickBehavior, interval};
use utoipa::ToSchema;
use wire::config::MAX_RATE_CHZ;
use wire::telemetry::Address;
use wire::uwb::native::{Answer, Downlink, TagCommand};

use crate::Utc;

/// From one look for due messages to the next.
const LOOK: Duration = Duration::from_millis(50);
/// Messages that a source may be behind.
const BEHIND: usize = 16;
/// The messages of which the station knows what became of them.
const KNOWN: usize = 1_000;

/// What a message says: one of these.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum MessageContent {
    /// The tag's light flashes for so many seconds, 1 to 255.
    IdentifyS(u8),
    /// The tag ranges so often until it restarts, Hz, 0.01 to 1000; 0: as its record says. Only in a network with a key.
    RateHz(f64),
    /// The tag's program gets these bytes, at most 24, two hexadecimal digits each.
    Data(String),
}

impl MessageContent {
    /// The command; `None` where a value is out of its range.
    fn command<'b>(&self, bytes: &'b mut Vec<u8>) -> Option<TagCommand<'b>> {
        match self {
            Self::IdentifyS(seconds) => (*seconds > 0).then_some(TagCommand::Identify(*seconds)),
            Self::RateHz(hz) => {
                let chz = hz * 100.0;
                let is_rate = *hz == 0.0 || (1.0..=f64::from(MAX_RATE_CHZ)).contains(&chz);
                is_rate.then(|| TagCommand::Rate(chz.round() as u32))
            }
            Self::Data(digits) => {
                *bytes = data_bytes(digits)?;
                Some(TagCommand::Data(bytes))
            }
        }
    }
}

/// What became of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MessageState {
    /// The tag has not answered yet.
    Waiting,
    /// The tag does it, or its program has the bytes.
    Taken,
    /// The tag cannot do it: it has another build, or its program takes no data.
    Unknown,
    /// The tag does this only in a network with a key.
    NeedsKey,
    /// The tag's program has not taken earlier data yet.
    Full,
    /// The tag has not answered in time.
    Expired,
    /// It was withdrawn.
    Withdrawn,
}

impl From<MessageOutcome> for MessageState {
    fn from(outcome: MessageOutcome) -> Self {
        match outcome {
            MessageOutcome::Answered(Answer::Taken) => Self::Taken,
            MessageOutcome::Answered(Answer::Unknown) => Self::Unknown,
            MessageOutcome::Answered(Answer::NeedsKey) => Self::NeedsKey,
            MessageOutcome::Answered(Answer::Full) => Self::Full,
            MessageOutcome::Expired => Self::Expired,
        }
    }
}

/// A message to a tag.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TagMessage {
    /// Its number in this run of the station.
    pub id: u64,
    /// The tag.
    pub tag: String,
    /// What it says.
    pub content: MessageContent,
    /// When it was asked for.
    pub asked: Utc,
    /// What became of it.
    pub state: MessageState,
    /// When that was known.
    pub settled: Option<Utc>,
}

/// Why a message is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MessageRefusal {
    /// A value is out of its range.
    #[error("identify_s is 1 to 255, rate_hz 0 or 0.01 to 1000, data 1 to 24 bytes of two hexadecimal digits")]
    Content,
    /// Too many wait for this tag.
    #[error("{MOST_WAITING} messages wait for this tag already")]
    TooMany,
}

struct Book {
    pending: PendingMessages,
    /// Oldest first.
    known: VecDeque<TagMessage>,
}

struct Shared {
    book: Mutex<Book>,
    due: broadcast::Sender<Downlink>,
    begun: Instant,
}

/// The messages of a station.
#[derive(Clone)]
pub struct Messages(Arc<Shared>);

impl std::fmt::Debug for Messages {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Messages").finish_non_exhaustive()
    }
}

impl Messages {
    /// None.
    pub(crate) fn new() -> Self {
        let first = Utc::now().us().unsigned_abs() / 1_000_000;
        let book = Book { pending: PendingMessages::new(first), known: VecDeque::new() };
        Self(Arc::new(Shared { book: Mutex::new(book), due: broadcast::channel(BEHIND).0, begun: Instant::now() }))
    }

    fn book(&self) -> MutexGuard<'_, Book> {
        self.0.book.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now_us(&self) -> u64 {
        u64::try_from(self.0.begun.elapsed().as_micros()).unwrap_or(u64::MAX)
    }

    /// Takes a message for a tag that is of use for this time.
    ///
    /// # Errors
    /// It cannot be sent.
    pub fn send(&self, tag: u16, content: MessageContent, lasts: Duration) -> Result<TagMessage, MessageRefusal> {
        let mut bytes = Vec::new();
        let command = content.command(&mut bytes).ok_or(MessageRefusal::Content)?;
        let mut book = self.book();
        let lasts_us = u64::try_from(lasts.as_micros()).unwrap_or(u64::MAX);
        let id = book.pending.send(tag, command, self.now_us(), lasts_us).ok_or(MessageRefusal::TooMany)?;
        if book.known.len() >= KNOWN {
            book.known.pop_front();
        }
        let (tag, asked) = (Address(tag).to_string(), Utc::now());
        let message = TagMessage { id, tag, content, asked, state: MessageState::Waiting, settled: None };
        book.known.push_back(message.clone());
        Ok(message)
    }

    /// Gives a message to this tag up. Returns false if there is none that waits.
    pub fn withdraw(&self, tag: &str, id: u64) -> bool {
        let mut book = self.book();
        let is_its = book.known.iter().any(|message| (message.id, &*message.tag) == (id, tag));
        let is_withdrawn = is_its && book.pending.withdraw(id);
        if is_withdrawn {
            book.settle(id, MessageState::Withdrawn);
        }
        is_withdrawn
    }

    /// The last messages to a tag, the newest first.
    pub fn to(&self, tag: &str) -> Vec<TagMessage> {
        self.book().known.iter().rev().filter(|message| message.tag == tag).cloned().collect()
    }

    /// The messages that gateways are to send, each when it is due.
    pub fn listen(&self) -> broadcast::Receiver<Downlink> {
        self.0.due.subscribe()
    }

    /// A gateway reports a tag's answer.
    pub(crate) fn answered(&self, tag: u16, number: u8, answer: Answer) {
        let mut book = self.book();
        if let Some(settled) = book.pending.answered(tag, number, answer, self.now_us()) {
            book.settle(settled.id, settled.outcome.into());
        }
    }

    /// Passes messages on when they are due, for ever.
    pub(crate) async fn run(self) {
        let mut looks = interval(LOOK);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            looks.tick().await;
            self.look();
        }
    }

    fn look(&self) {
        let mut book = self.book();
        for Settled { id, outcome, .. } in book.pending.expired(self.now_us()) {
            book.settle(id, outcome.into());
        }
        // Without a source that takes messages they wait.
        if self.0.due.receiver_count() > 0
            && let Some(message) = book.pending.due(self.now_us())
        {
            let _ = self.0.due.send(message);
        }
    }
}

impl Book {
    fn settle(&mut self, id: u64, state: MessageState) {
        if let Some(message) = self.known.iter_mut().find(|message| message.id == id) {
            (message.state, message.settled) = (state, Some(Utc::now()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contents_are_checked() {
        let command = |content: MessageContent| content.command(&mut Vec::new()).map(|command| format!("{command:?}"));
        let right = [MessageContent::IdentifyS(255), MessageContent::RateHz(0.0), MessageContent::RateHz(0.01)];
        let right = right.map(command).map(Option::unwrap);
        assert_eq!(right, ["Identify(255)", "Rate(0)", "Rate(1)"]);
        assert_eq!(command(MessageContent::Data("6f6B".into())).as_deref(), Some("Data([111, 107])"));
        let wrong = ["", "6", "6x", "é6", &"00".repeat(25)].map(|digits| MessageContent::Data(digits.into()));
        let rates = [-1.0, 0.001, 1_000.1, f64::NAN].map(MessageContent::RateHz);
        assert!(wrong.into_iter().chain(rates).chain([MessageContent::IdentifyS(0)]).all(|it| command(it).is_none()));
    }

    #[tokio::test(start_paused = true)]
    async fn a_message_waits_for_a_source_and_ends_with_its_answer() {
        let messages = Messages::new();
        let lasts = Duration::from_secs(600);
        let message = messages.send(0x1001, MessageContent::IdentifyS(30), lasts).expect("right");
        messages.look();
        let mut source = messages.listen();
        messages.look();
        let due = source.try_recv().expect("it is due");
        assert_eq!((due.tag, due.command()), (0x1001, Some(TagCommand::Identify(30))));
        assert_eq!(messages.to("0x1001"), std::slice::from_ref(&message));
        messages.answered(0x1001, due.data.number(), Answer::Taken);
        let [settled] = &messages.to("0x1001")[..] else { panic!("one message") };
        assert_eq!((settled.id, settled.state, settled.settled.is_some()), (message.id, MessageState::Taken, true));
        assert!(!messages.withdraw("0x1001", message.id), "it is over");
    }

    #[tokio::test(start_paused = true)]
    async fn messages_expire_and_are_withdrawn() {
        let messages = Messages::new();
        let _source = messages.listen();
        let send = |seconds| messages.send(7, MessageContent::IdentifyS(1), Duration::from_secs(seconds));
        let (short, long) = (send(5).expect("right"), send(50).expect("right"));
        tokio::time::advance(Duration::from_secs(6)).await;
        messages.look();
        assert!(!messages.withdraw("0x0008", long.id) && messages.withdraw("0x0007", long.id));
        let states: Vec<_> = messages.to("0x0007").into_iter().map(|message| (message.id, message.state)).collect();
        assert_eq!(states, [(long.id, MessageState::Withdrawn), (short.id, MessageState::Expired)]);
        (0..MOST_WAITING).for_each(|_| assert!(send(50).is_ok()));
        assert_eq!(send(50).expect_err("too many"), MessageRefusal::TooMany);
        assert_eq!(messages.send(7, MessageContent::IdentifyS(0), Duration::MAX), Err(MessageRefusal::Content));
    }
}
