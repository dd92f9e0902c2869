//! `baliza monitor --tell`: a message to a tag, by way of the node that is listened to.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use downlink::{MessageOutcome, PendingMessages, data_bytes};
use recording::UserError;
use wire::telemetry::{Address, Message};
use wire::to_node::{MAX_FRAME, encode};
use wire::uwb::native::{Answer, Downlink, TagCommand, UserData};

/// A tag that sleeps for minutes answers as well.
const LASTS: Duration = Duration::from_secs(3600);

/// What to tell which tag.
#[derive(clap::Args)]
pub struct TellArguments {
    /// Send a message to this tag, by way of the node, and end with its answer: with --identify, --rate or --data
    #[arg(long, value_name = "TAG", conflicts_with_all = ["stdin", "file"], requires = "what", value_parser = address)]
    tell: Option<u16>,
    /// The tag's light flashes for so long, seconds: up to 255
    #[arg(long, value_name = "S", requires = "tell", group = "what", value_parser = clap::value_parser!(u8).range(1..))]
    identify: Option<u8>,
    /// The tag ranges so often until it restarts, Hz, or as often as its record says; only in a network with a key
    #[arg(long, value_name = "HZ|record", requires = "tell", group = "what", value_parser = rate_chz)]
    rate: Option<u32>,
    /// The tag's program gets these bytes, at most 24, as hexadecimal digits
    #[arg(long, value_name = "HEX", requires = "tell", group = "what", value_parser = bytes)]
    data: Option<Bytes>,
}

/// Bytes of a message.
#[derive(Clone)]
struct Bytes(Vec<u8>);

fn address(text: &str) -> Result<u16, String> {
    let parsed = match text.strip_prefix("0x") {
        Some(digits) => u16::from_str_radix(digits, 16),
        None => text.parse(),
    };
    parsed.map_err(|_| format!("{text:?} is no short address, such as 0x1001"))
}

/// Rounds in 100 s; 0 is that of the record.
fn rate_chz(text: &str) -> Result<u32, String> {
    if text == "record" {
        return Ok(0);
    }
    let most_hz = f64::from(wire::config::MAX_RATE_CHZ) / 100.0;
    let hz = text.parse::<f64>().ok().filter(|hz| (0.01..=most_hz).contains(hz));
    hz.map(|hz| (hz * 100.0).round() as u32).ok_or_else(|| format!("a rate is 0.01 to {most_hz} Hz, or record"))
}

fn bytes(text: &str) -> Result<Bytes, String> {
    let wrong = || format!("{text:?}: up to {} bytes, two hexadecimal digits each", UserData::MOST);
    data_bytes(text).map(Bytes).ok_or_else(wrong)
}

/// A message on its way.
pub struct Telling {
    tag: u16,
    pending: PendingMessages,
    /// What the node has not taken yet.
    frame: Option<Vec<u8>>,
    answer: Option<Answer>,
}

impl TellArguments {
    /// The message, if there is one.
    pub fn telling(&self) -> Option<Telling> {
        let tag = self.tell?;
        let command = match (self.identify, self.rate, &self.data) {
            (Some(seconds), ..) => TagCommand::Identify(seconds),
            (None, Some(chz), _) => TagCommand::Rate(chz),
            (None, None, data) => TagCommand::Data(data.as_ref().map_or(&[], |Bytes(bytes)| bytes)),
        };
        let now_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let mut pending = PendingMessages::new(now_s);
        let is_sent = pending.send(tag, command, 0, micros(LASTS)).is_some();
        is_sent.then_some(Telling { tag, pending, frame: None, answer: None })
    }
}

fn micros(time: Duration) -> u64 {
    u64::try_from(time.as_micros()).unwrap_or(u64::MAX)
}

impl Telling {
    /// What the node is to get now.
    pub fn outgoing(&mut self, elapsed: Duration) -> Option<Vec<u8>> {
        if let Some(message) = self.pending.due(micros(elapsed)) {
            self.frame = Some(frame(&message));
        }
        self.frame.clone()
    }

    /// The node got it.
    pub fn sent(&mut self) {
        self.frame = None;
    }

    /// Takes a message of the node. Returns what to say of the tag's answer, which ends the listening.
    pub fn take(&mut self, message: &Message, elapsed: Duration) -> Option<String> {
        let Message::TagAnswer(told) = message else { return None };
        let settled = self.pending.answered(told.tag, told.number, told.answer(), micros(elapsed))?;
        let MessageOutcome::Answered(answer) = settled.outcome else { return None };
        self.answer = Some(answer);
        Some(format!("{} answers after {:.1} s: {}", Address(self.tag), settled.took_us as f64 / 1e6, answer.as_str()))
    }

    /// Whether the tag has done what it was told.
    ///
    /// # Errors
    /// It has not, with what to do.
    pub fn result(&self) -> Result<(), UserError> {
        let what = match self.answer {
            Some(Answer::Taken) => return Ok(()),
            Some(Answer::NeedsKey) => "the tag does this only in a network with a key, as anybody could ask for it",
            Some(Answer::Unknown) => "the tag cannot do this: it has another build, or its program takes no data",
            Some(Answer::Full) => "the tag's program has not taken the data before yet",
            None => "the tag has not answered: is it on, in this network, and does a node read here that is an anchor?",
        };
        Err(UserError::flag("--tell", what))
    }
}

/// A message as a node gets it.
pub fn frame(message: &Downlink) -> Vec<u8> {
    encode(message, &mut [0; MAX_FRAME]).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::telemetry::TagAnswer;

    fn telling(arguments: &[&str]) -> Telling {
        use clap::FromArgMatches as _;
        let command = <TellArguments as clap::Args>::augment_args(
            clap::Command::new("monitor").arg(clap::arg!(--stdin)).arg(clap::arg!(--file)),
        );
        let matches = command.try_get_matches_from([&["monitor"], arguments].concat()).expect("known arguments");
        TellArguments::from_arg_matches(&matches).expect("right arguments").telling().expect("a message")
    }

    #[test]
    fn a_message_goes_to_the_node_until_the_tag_answers() {
        let mut telling = telling(&["--tell", "0x1001", "--data", "6F6b"]);
        let seconds = Duration::from_secs;
        let first = telling.outgoing(seconds(1)).expect("a frame");
        assert_eq!(telling.outgoing(seconds(1)).as_ref(), Some(&first), "the node has no room yet");
        telling.sent();
        assert_eq!(telling.outgoing(seconds(2)), None);
        assert_eq!(telling.outgoing(seconds(4)).as_ref(), Some(&first), "nobody answers");
        let mut reader = wire::to_node::FrameReader::new();
        let message = first.iter().find_map(|byte| reader.feed(*byte)).expect("a message");
        assert_eq!((message.tag, message.command()), (0x1001, Some(TagCommand::Data(b"ok"))));
        assert!(telling.result().is_err());
        let number = message.data.number();
        let answer = |tag, number, answer| TagAnswer { t_us: 0, tag, number, age_us: 0, code: answer as u8 }.into();
        assert_eq!(telling.take(&answer(0x1002, number, Answer::Taken), seconds(5)), None);
        let said = telling.take(&answer(0x1001, number, Answer::Full), seconds(5));
        assert_eq!(said.as_deref(), Some("0x1001 answers after 5.0 s: full"));
        assert!(telling.result().is_err_and(|error| error.to_string().contains("--tell")));
    }

    #[test]
    fn numbers_and_bytes_are_checked() {
        assert_eq!(["0x1001", "4097"].map(address), [Ok(0x1001), Ok(0x1001)]);
        assert_eq!(["10", "0.01", "record"].map(rate_chz), [Ok(1_000), Ok(1), Ok(0)]);
        assert!(["", "0x", "70000"].map(address).iter().all(Result::is_err));
        assert!(["0", "-1", "nan", "2000"].map(rate_chz).iter().all(Result::is_err));
        let too_long = "00".repeat(25);
        assert!(["", "1", "1g", "+1", "ä", &too_long].map(bytes).iter().all(Result::is_err));
    }
}
