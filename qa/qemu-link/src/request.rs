//! The requests of an image to the world.

use crate::{LinkError, LinkMessage, begin, put, seal, take};

/// The maximum number of operations in a transaction.
pub const MAX_OPERATIONS: usize = 4;

/// Instructions executed since the last answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spent {
    /// At the priority of ranging: their time passes before the request is done.
    pub ranging: u32,
    /// At the lower priority: their time passes while ranging waits.
    pub background: u32,
}

/// One operation of a transaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Bytes go out.
    Write(u32),
    /// Bytes come in.
    Read(u32),
    /// Bytes go out, and as many come in.
    Transfer(u32),
    /// No transfer for this time, nanoseconds.
    DelayNs(u32),
}

impl Operation {
    const fn coded(self) -> (u8, u32) {
        match self {
            Self::Write(bytes) => (0, bytes),
            Self::Read(bytes) => (1, bytes),
            Self::Transfer(bytes) => (2, bytes),
            Self::DelayNs(ns) => (3, ns),
        }
    }

    const fn decoded(kind: u8, value: u32) -> Result<Self, LinkError> {
        match kind {
            0 => Ok(Self::Write(value)),
            1 => Ok(Self::Read(value)),
            2 => Ok(Self::Transfer(value)),
            3 => Ok(Self::DelayNs(value)),
            4.. => Err(LinkError::Malformed),
        }
    }

    /// Bytes that the operation sends.
    pub const fn sent(self) -> usize {
        match self {
            Self::Write(bytes) | Self::Transfer(bytes) => bytes as usize,
            Self::Read(_) | Self::DelayNs(_) => 0,
        }
    }

    /// Bytes that the operation receives.
    pub const fn received(self) -> usize {
        match self {
            Self::Read(bytes) | Self::Transfer(bytes) => bytes as usize,
            Self::Write(_) | Self::DelayNs(_) => 0,
        }
    }
}

/// A request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request<'a> {
    /// The image runs and asks for its settings.
    Start,
    /// A transaction on the bus, with the bytes that it sends. The bytes of each operation follow those of the
    /// operation before.
    Transaction {
        /// The operations in their order.
        operations: &'a [Operation],
        /// The bytes that all operations send.
        sent: &'a [u8],
    },
    /// Sets the bus clock to fast or slow.
    Clock {
        /// Whether the clock is fast.
        fast: bool,
    },
    /// Pulls the chip's reset line low, or lets it float.
    Reset {
        /// Whether the line is low.
        low: bool,
    },
    /// The image has nothing to do until one of these happens.
    Wait {
        /// The world's time, nanoseconds; `u64::MAX`: never.
        until_ns: u64,
        /// Whether an interrupt of the chip ends the wait.
        interrupt: bool,
        /// Whether the end of the background's work ends the wait.
        background: bool,
    },
    /// Frames of telemetry.
    Telemetry(&'a [u8]),
}

/// A request that was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asked<'a> {
    /// The instructions before it.
    pub spent: Spent,
    operations: heapless::Vec<Operation, MAX_OPERATIONS>,
    request: Request<'a>,
}

impl Request<'_> {
    /// Encodes the request as a message.
    ///
    /// # Errors
    /// [`LinkError::TooLong`] if the message would be longer than the maximum.
    pub fn encode(&self, spent: Spent) -> Result<LinkMessage, LinkError> {
        let mut message = begin();
        let kind = match self {
            Self::Start => 0,
            Self::Transaction { .. } => 1,
            Self::Clock { .. } => 2,
            Self::Reset { .. } => 3,
            Self::Wait { .. } => 4,
            Self::Telemetry(_) => 5,
        };
        put(&mut message, &[kind])?;
        put(&mut message, &spent.ranging.to_le_bytes())?;
        put(&mut message, &spent.background.to_le_bytes())?;
        match self {
            Self::Start => {}
            Self::Transaction { operations, sent } => {
                if operations.len() > MAX_OPERATIONS {
                    return Err(LinkError::TooLong);
                }
                put(&mut message, &[operations.len() as u8])?;
                for (kind, value) in operations.iter().map(|operation| operation.coded()) {
                    put(&mut message, &[kind])?;
                    put(&mut message, &value.to_le_bytes())?;
                }
                put(&mut message, sent)?;
            }
            Self::Clock { fast: flag } | Self::Reset { low: flag } => put(&mut message, &[u8::from(*flag)])?,
            Self::Wait { until_ns, interrupt, background } => {
                put(&mut message, &until_ns.to_le_bytes())?;
                put(&mut message, &[u8::from(*interrupt) | u8::from(*background) << 1])?;
            }
            Self::Telemetry(frames) => put(&mut message, frames)?,
        }
        Ok(seal(message))
    }
}

impl<'a> Asked<'a> {
    /// Decodes a message without its length.
    ///
    /// # Errors
    /// [`LinkError::Malformed`], or [`LinkError::TooLong`] for too many operations.
    pub fn decode(mut bytes: &'a [u8]) -> Result<Self, LinkError> {
        let [kind] = take(&mut bytes)?;
        let ranging = u32::from_le_bytes(take(&mut bytes)?);
        let background = u32::from_le_bytes(take(&mut bytes)?);
        let mut operations = heapless::Vec::new();
        let flag = |bytes: &mut &[u8]| take(bytes).map(|[flag]| flag != 0);
        let request = match kind {
            0 => Request::Start,
            1 => {
                let [count] = take(&mut bytes)?;
                for _ in 0..count {
                    let [kind] = take(&mut bytes)?;
                    let operation = Operation::decoded(kind, u32::from_le_bytes(take(&mut bytes)?))?;
                    operations.push(operation).map_err(|_| LinkError::TooLong)?;
                }
                if operations.iter().map(|operation| operation.sent()).sum::<usize>() != bytes.len() {
                    return Err(LinkError::Malformed);
                }
                Request::Transaction { operations: &[], sent: bytes }
            }
            2 => Request::Clock { fast: flag(&mut bytes)? },
            3 => Request::Reset { low: flag(&mut bytes)? },
            4 => {
                let until_ns = u64::from_le_bytes(take(&mut bytes)?);
                let [flags] = take(&mut bytes)?;
                Request::Wait { until_ns, interrupt: flags & 1 != 0, background: flags & 2 != 0 }
            }
            5 => Request::Telemetry(bytes),
            6.. => return Err(LinkError::Malformed),
        };
        Ok(Self { spent: Spent { ranging, background }, operations, request })
    }

    /// The request.
    pub fn request(&self) -> Request<'_> {
        match self.request {
            Request::Transaction { sent, .. } => Request::Transaction { operations: &self.operations, sent },
            other @ (Request::Start
            | Request::Clock { .. }
            | Request::Reset { .. }
            | Request::Wait { .. }
            | Request::Telemetry(_)) => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPENT: Spent = Spent { ranging: 0x0102_0304, background: 5 };

    #[test]
    fn a_transaction_is_these_bytes() {
        let request = Request::Transaction { operations: &[Operation::Write(1), Operation::Read(4)], sent: &[0x0F] };
        let expected = [21, 0, 1, 4, 3, 2, 1, 5, 0, 0, 0, 2, 0, 1, 0, 0, 0, 1, 4, 0, 0, 0, 0x0F];
        assert_eq!(request.encode(SPENT).unwrap(), expected);
    }

    #[test]
    fn every_request_is_read_as_it_was_written() {
        let operations = [Operation::Transfer(3), Operation::DelayNs(600_000)];
        let requests = [
            Request::Start,
            Request::Transaction { operations: &operations, sent: &[1, 2, 3] },
            Request::Clock { fast: true },
            Request::Reset { low: false },
            Request::Wait { until_ns: u64::MAX, interrupt: true, background: false },
            Request::Wait { until_ns: 7, interrupt: false, background: true },
            Request::Telemetry(&[9; 100]),
        ];
        for request in requests {
            let message = request.encode(SPENT).unwrap();
            let asked = Asked::decode(&message[2..]).unwrap();
            assert_eq!((asked.request(), asked.spent), (request, SPENT));
        }
    }

    #[test]
    fn what_is_no_request_is_refused() {
        let message = Request::Transaction { operations: &[Operation::Write(2)], sent: &[1, 2] }.encode(SPENT).unwrap();
        for end in 2..message.len() {
            assert_eq!(Asked::decode(&message[2..end]), Err(LinkError::Malformed), "{end}");
        }
        assert_eq!(Asked::decode(&[6, 0, 0, 0, 0, 0, 0, 0, 0]), Err(LinkError::Malformed));
        let many = Request::Transaction { operations: &[Operation::DelayNs(1); MAX_OPERATIONS + 1], sent: &[] };
        assert_eq!(many.encode(SPENT), Err(LinkError::TooLong));
        assert_eq!(Request::Telemetry(&[0; crate::MAX_MESSAGE]).encode(SPENT), Err(LinkError::TooLong));
    }
}
