//! The answers of the world.

use crate::{LinkError, LinkMessage, begin, put, seal, take};

/// An answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorldAnswer<'a> {
    /// The world's time, nanoseconds.
    pub now_ns: u64,
    /// The flags: [`WorldAnswer::IRQ_IS_HIGH`] and so on.
    pub flags: u8,
    /// The bytes received, or the settings of the node ([`NodeStart`]).
    pub body: &'a [u8],
}

/// The settings of the node: the body of the answer to [`Request::Start`](crate::Request::Start).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeStart<'a> {
    /// The duration of an instruction, picoseconds.
    pub instruction_ps: u32,
    /// The beginning of a config record's page.
    pub record: &'a [u8],
}

impl<'a> WorldAnswer<'a> {
    /// The chip's interrupt line is high.
    pub const IRQ_IS_HIGH: u8 = 1 << 0;
    /// The background's work is not done yet: the image must not do more of it now.
    pub const BACKGROUND_IS_BUSY: u8 = 1 << 1;
    /// The world ends: the image sends the last telemetry and ends.
    pub const END: u8 = 1 << 2;

    /// Encodes the answer as a message.
    ///
    /// # Errors
    /// [`LinkError::TooLong`] if the message would be longer than the maximum.
    pub fn encode(&self) -> Result<LinkMessage, LinkError> {
        let mut message = begin();
        put(&mut message, &self.now_ns.to_le_bytes())?;
        put(&mut message, &[self.flags])?;
        put(&mut message, self.body)?;
        Ok(seal(message))
    }

    /// Decodes a message without its length.
    ///
    /// # Errors
    /// [`LinkError::Malformed`] if the message is too short.
    pub fn decode(mut bytes: &'a [u8]) -> Result<Self, LinkError> {
        let now_ns = u64::from_le_bytes(take(&mut bytes)?);
        let [flags] = take(&mut bytes)?;
        Ok(Self { now_ns, flags, body: bytes })
    }
}

impl<'a> NodeStart<'a> {
    /// Encodes the settings as a body. `into` is overwritten.
    ///
    /// # Errors
    /// [`LinkError::TooLong`] if the message would be longer than the maximum.
    pub fn encode(&self, into: &mut LinkMessage) -> Result<(), LinkError> {
        into.clear();
        put(into, &self.instruction_ps.to_le_bytes())?;
        put(into, self.record)
    }

    /// Decodes an answer's body.
    ///
    /// # Errors
    /// [`LinkError::Malformed`] if the body is too short.
    pub fn decode(mut body: &'a [u8]) -> Result<Self, LinkError> {
        Ok(Self { instruction_ps: u32::from_le_bytes(take(&mut body)?), record: body })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_these_bytes() {
        let answer = WorldAnswer { now_ns: 0x0A0B, flags: WorldAnswer::IRQ_IS_HIGH | WorldAnswer::END, body: &[7, 8] };
        let message = answer.encode().unwrap();
        assert_eq!(message, [11, 0, 0x0B, 0x0A, 0, 0, 0, 0, 0, 0, 5, 7, 8]);
        assert_eq!(WorldAnswer::decode(&message[2..]), Ok(answer));
        assert_eq!(WorldAnswer::decode(&message[2..10]), Err(LinkError::Malformed));
    }

    #[test]
    fn a_start_goes_through_a_body() {
        let start = NodeStart { instruction_ps: 20_000, record: &[1, 2, 3] };
        let mut body = LinkMessage::new();
        start.encode(&mut body).unwrap();
        assert_eq!(NodeStart::decode(&body), Ok(start));
        assert_eq!(NodeStart::decode(&[0; 3]), Err(LinkError::Malformed));
    }
}
