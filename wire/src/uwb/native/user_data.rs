//! Data of a tag's user in a poll, and a tag's answer to a message of a host.

use super::Answer;
use crate::uwb::{FrameBuffer, FrameError, Reader};

/// Up to 24 bytes that a tag's user sends, which anchors pass on to their hosts. No node reads them. Or the tag's answer to
/// a message of a host, which goes the same way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct UserData {
    number: u8,
    length: u8,
    is_answer: bool,
    bytes: [u8; UserData::MOST],
}

/// In the byte of the length.
const IS_ANSWER: u8 = 0x80;

impl UserData {
    /// The most bytes.
    pub const MOST: usize = 24;
    /// The longest on the air, with number and length.
    pub const LONGEST: u16 = 2 + Self::MOST as u16;

    /// Data with its number; `None` for no bytes, or more than [`UserData::MOST`].
    pub fn new(number: u8, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; Self::MOST];
        bytes.get_mut(..data.len()).filter(|place| !place.is_empty())?.copy_from_slice(data);
        Some(Self { number, length: data.len() as u8, is_answer: false, bytes })
    }

    /// The answer to the host's message with this number.
    pub const fn answering(number: u8, answer: Answer) -> Self {
        let mut bytes = [0; Self::MOST];
        bytes[0] = answer as u8;
        Self { number, length: 1, is_answer: true, bytes }
    }

    /// The answer to the host's message with this number; `None` of data of the user.
    pub fn answer(&self) -> Option<Answer> {
        self.bytes().first().filter(|_| self.is_answer).map(|code| Answer::from_code(*code))
    }

    /// Counts the tag's data, wrapping: data that comes again has the same number, and one that is left out was lost. Of an
    /// answer, the number of the message.
    pub const fn number(&self) -> u8 {
        self.number
    }

    /// The number, and whether it is that of an answer: what tells a tag's data from others that wait.
    pub const fn id(&self) -> (bool, u8) {
        (self.is_answer, self.number)
    }

    /// The bytes, at least one.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length.into()).unwrap_or(&self.bytes)
    }

    pub(super) fn parse(reader: &mut Reader<'_>) -> Result<Self, FrameError> {
        let [number, length] = reader.take()?;
        let (data, rest) = reader.0.split_at_checked((length & !IS_ANSWER).into()).ok_or(FrameError::Truncated)?;
        reader.0 = rest;
        let data = Self::new(number, data).ok_or(FrameError::Field)?;
        Ok(Self { is_answer: length & IS_ANSWER != 0, ..data })
    }

    pub(super) fn emit(&self, out: &mut FrameBuffer) {
        out.put(&[self.number, self.length | if self.is_answer { IS_ANSWER } else { 0 }]);
        out.put(self.bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::UserData;

    #[test]
    fn no_bytes_and_too_many_are_no_data() {
        assert_eq!(UserData::new(0, &[]), None);
        assert_eq!(UserData::new(0, &[1; UserData::MOST + 1]), None);
        for length in [1, UserData::MOST] {
            let data = UserData::new(7, &[9; UserData::MOST][..length]).expect("it fits");
            assert_eq!((data.number(), data.bytes()), (7, &[9; UserData::MOST][..length]));
        }
    }
}
