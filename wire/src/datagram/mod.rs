//! Datagrams between a gateway and a station, in UDP. A gateway sends telemetry of nodes, and the station sends receipts.
//! `docs/reference/wire-format.md` describes them byte by byte.
//!
//! A datagram ends with a message authentication code where both have a key. The feature `gateway` has what makes and checks
//! it.

#[cfg(feature = "gateway")]
mod secret;

use heapless::Vec;

use crate::uwb::{FrameError, Reader};

#[cfg(feature = "gateway")]
pub use secret::{Secret, sealed};

/// The longest datagram, bytes. Networks pass it on in one piece.
pub const MAX_DATAGRAM: usize = 1200;
/// Bytes of the message authentication code: HMAC-SHA-256, cut.
pub const CODE_BYTES: usize = 16;
/// Bytes of a datagram of telemetry before its frames.
pub const HEADER_BYTES: usize = 41;
/// The most frames' bytes of a datagram.
pub const MAX_FRAMES: usize = MAX_DATAGRAM - HEADER_BYTES - CODE_BYTES;
/// The most numbers of a receipt.
pub const MAX_NUMBERS: usize = 64;

/// How a datagram begins. In a stream of telemetry, a zero ends a frame, and the next one begins with the distance to its
/// first zero, which is more than 1, because the number of the schema comes first.
const MARK: [u8; 2] = [0, 1];
const TELEMETRY: u8 = 1;
const RECEIPT: u8 = 2;
const TO_NODE: u8 = 3;
/// Telemetry that was sent before.
const REPEATED: u8 = 0x41;
/// In the byte of the kind: the datagram ends with a code.
const HAS_CODE: u8 = 0x80;

/// Telemetry of one node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Envelope<'f> {
    /// The gateway: any number that no other gateway of the station has.
    pub gateway: u64,
    /// A random number of the gateway's run, in which its datagrams are counted.
    pub session: u32,
    /// Counts the datagrams of the session.
    pub number: u32,
    /// The station's run, as its last receipt told it; 0: unknown. A station with keys takes only datagrams of its own
    /// run, so that nobody can send recorded ones again.
    pub station: u32,
    /// The datagram was sent before, and no receipt came.
    pub is_repeated: bool,
    /// When it is sent, by the gateway's clock: microseconds since 1970.
    pub sent_us: u64,
    /// When its last frame was received, by the same clock.
    pub received_us: u64,
    /// Short address of the node.
    pub node: u16,
    /// Whole frames of telemetry in their order, at most [`MAX_FRAMES`] bytes.
    pub frames: &'f [u8],
}

/// What a station has received of a gateway's session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Receipt {
    /// The gateway.
    pub gateway: u64,
    /// Its session.
    pub session: u32,
    /// A random number of the station's run, not 0. Of another run than before: what was received lately may be lost.
    pub station: u32,
    /// When it is sent, by the station's clock: microseconds since 1970. A gateway without a calendar takes it from here.
    pub sent_us: u64,
    /// The datagrams that it has taken.
    pub numbers: Vec<u32, MAX_NUMBERS>,
}

/// What a station tells a gateway's node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ToNode<'f> {
    /// The gateway.
    pub gateway: u64,
    /// Its session.
    pub session: u32,
    /// The station's run.
    pub station: u32,
    /// When it is sent, by the station's clock: microseconds since 1970. Each is later than the one before.
    pub sent_us: u64,
    /// Frames for the node ([`to_node`](crate::to_node)), as they go through a cable.
    pub frames: &'f [u8],
}

/// A datagram.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(
    clippy::large_enum_variant,
    reason = "a datagram lives on the stack for one step; there is no heap to put it on"
)]
pub enum Datagram<'f> {
    /// From a gateway to a station.
    Telemetry(Envelope<'f>),
    /// From a station to a gateway.
    Receipt(Receipt),
    /// From a station to a gateway.
    ToNode(ToNode<'f>),
}

/// Why bytes are no datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DatagramError {
    /// It does not begin as one.
    Foreign,
    /// It is of an unknown kind.
    Kind(u8),
    /// It is cut, or has more bytes than its kind has.
    Length,
}

/// A datagram and what authenticates it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received<'d> {
    /// The datagram.
    pub datagram: Datagram<'d>,
    /// What the code is made of: all bytes before it.
    pub signed: &'d [u8],
    /// The code, where there is one.
    pub code: Option<&'d [u8]>,
}

/// Whether bytes begin as a datagram does, and as no part of a stream of telemetry.
pub fn is_datagram(bytes: &[u8]) -> bool {
    bytes.starts_with(&MARK)
}

/// Parses a datagram. Its code is not checked.
///
/// # Errors
/// The bytes are no datagram.
pub fn parse(bytes: &[u8]) -> Result<Received<'_>, DatagramError> {
    let Some([kind, ..]) = bytes.strip_prefix(&MARK) else { return Err(DatagramError::Foreign) };
    let code_bytes = if kind & HAS_CODE == 0 { 0 } else { CODE_BYTES };
    let signed = bytes.len().checked_sub(code_bytes).ok_or(DatagramError::Length)?;
    let (signed, code) = bytes.split_at_checked(signed).ok_or(DatagramError::Length)?;
    let body = signed.get(3..).ok_or(DatagramError::Length)?;
    let datagram = match kind & !HAS_CODE {
        TELEMETRY => Datagram::Telemetry(Envelope::parse(body, false)?),
        REPEATED => Datagram::Telemetry(Envelope::parse(body, true)?),
        RECEIPT => Datagram::Receipt(Receipt::parse(body)?),
        TO_NODE => Datagram::ToNode(ToNode::parse(body)?),
        kind => return Err(DatagramError::Kind(kind)),
    };
    Ok(Received { datagram, signed, code: (code_bytes > 0).then_some(code) })
}

impl<'f> Envelope<'f> {
    /// Writes it without its code, which is to follow if `has_code`. Returns the number of bytes.
    pub fn emit(&self, has_code: bool, out: &mut [u8; MAX_DATAGRAM]) -> Option<usize> {
        let kind = if self.is_repeated { REPEATED } else { TELEMETRY } | if has_code { HAS_CODE } else { 0 };
        let mut writer = Writer { out, end: 0 };
        writer.put(&MARK)?;
        writer.put(&[kind])?;
        writer.put(&self.gateway.to_le_bytes())?;
        writer.put(&self.session.to_le_bytes())?;
        writer.put(&self.number.to_le_bytes())?;
        writer.put(&self.station.to_le_bytes())?;
        writer.put(&self.sent_us.to_le_bytes())?;
        writer.put(&self.received_us.to_le_bytes())?;
        writer.put(&self.node.to_le_bytes())?;
        writer.put(self.frames)?;
        (writer.end + CODE_BYTES <= MAX_DATAGRAM).then_some(writer.end)
    }

    fn parse(body: &'f [u8], is_repeated: bool) -> Result<Self, DatagramError> {
        let mut reader = Reader(body);
        Ok(Self {
            gateway: reader.u64()?,
            session: reader.u32()?,
            number: reader.u32()?,
            station: reader.u32()?,
            is_repeated,
            sent_us: reader.u64()?,
            received_us: reader.u64()?,
            node: reader.u16()?,
            frames: reader.0,
        })
    }
}

impl Receipt {
    /// Writes it as [`Envelope::emit`] does.
    pub fn emit(&self, has_code: bool, out: &mut [u8; MAX_DATAGRAM]) -> Option<usize> {
        let mut writer = Writer { out, end: 0 };
        writer.put(&MARK)?;
        writer.put(&[RECEIPT | if has_code { HAS_CODE } else { 0 }])?;
        writer.put(&self.gateway.to_le_bytes())?;
        writer.put(&self.session.to_le_bytes())?;
        writer.put(&self.station.to_le_bytes())?;
        writer.put(&self.sent_us.to_le_bytes())?;
        for number in &self.numbers {
            writer.put(&number.to_le_bytes())?;
        }
        Some(writer.end)
    }

    fn parse(body: &[u8]) -> Result<Self, DatagramError> {
        let mut reader = Reader(body);
        let (gateway, session, station, sent_us) = (reader.u64()?, reader.u32()?, reader.u32()?, reader.u64()?);
        let (numbers, []) = reader.0.as_chunks() else { return Err(DatagramError::Length) };
        if numbers.len() > MAX_NUMBERS {
            return Err(DatagramError::Length);
        }
        Ok(Self {
            gateway,
            session,
            station,
            sent_us,
            numbers: numbers.iter().map(|n| u32::from_le_bytes(*n)).collect(),
        })
    }
}

impl<'f> ToNode<'f> {
    /// Writes it as [`Envelope::emit`] does.
    pub fn emit(&self, has_code: bool, out: &mut [u8; MAX_DATAGRAM]) -> Option<usize> {
        let mut writer = Writer { out, end: 0 };
        writer.put(&MARK)?;
        writer.put(&[TO_NODE | if has_code { HAS_CODE } else { 0 }])?;
        writer.put(&self.gateway.to_le_bytes())?;
        writer.put(&self.session.to_le_bytes())?;
        writer.put(&self.station.to_le_bytes())?;
        writer.put(&self.sent_us.to_le_bytes())?;
        writer.put(self.frames)?;
        (writer.end + CODE_BYTES <= MAX_DATAGRAM).then_some(writer.end)
    }

    fn parse(body: &'f [u8]) -> Result<Self, DatagramError> {
        let mut reader = Reader(body);
        let (gateway, session, station, sent_us) = (reader.u64()?, reader.u32()?, reader.u32()?, reader.u64()?);
        Ok(Self { gateway, session, station, sent_us, frames: reader.0 })
    }
}

/// A field is cut.
impl From<FrameError> for DatagramError {
    fn from(_: FrameError) -> Self {
        Self::Length
    }
}

struct Writer<'o> {
    out: &'o mut [u8; MAX_DATAGRAM],
    end: usize,
}

impl Writer<'_> {
    fn put(&mut self, bytes: &[u8]) -> Option<()> {
        let end = self.end.checked_add(bytes.len())?;
        self.out.get_mut(self.end..end)?.copy_from_slice(bytes);
        self.end = end;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The golden frame of the state message.
    const FRAME: &[u8] = &[0x0B, 0x01, 0x04, 0x80, 0x89, 0x7A, 0x04, 0x81, 0x02, 0x52, 0x17, 0x00];

    fn envelope() -> Envelope<'static> {
        Envelope {
            gateway: 0x0102_0304_0506_0708,
            session: 0x1112_1314,
            number: 0x2122_2324,
            station: 0x3132_3334,
            is_repeated: true,
            // 2024-01-01T00:00:00Z and half a second before.
            sent_us: 1_704_067_200_000_000,
            received_us: 1_704_067_199_500_000,
            node: 0x0101,
            frames: FRAME,
        }
    }

    fn receipt() -> Receipt {
        let numbers = [0x2122_2324, 0x2122_2325].into_iter().collect();
        let (gateway, session, station) = (0x0102_0304_0506_0708, 0x1112_1314, 0x3132_3334);
        Receipt { gateway, session, station, sent_us: 1_704_067_200_000_000, numbers }
    }

    /// A message to a node, and its bytes.
    struct ToNodeParts {
        to_node: ToNode<'static>,
        golden: std::vec::Vec<u8>,
    }

    fn message_to_a_node() -> ToNodeParts {
        let (gateway, session, station) = (0x0102_0304_0506_0708, 0x1112_1314, 0x3132_3334);
        let to_node = ToNode { gateway, session, station, sent_us: 1_704_067_200_000_000, frames: &[4, 1, 9, 8, 0] };
        let mut golden = std::vec![0, 1, 3, 8, 7, 6, 5, 4, 3, 2, 1, 0x14, 0x13, 0x12, 0x11, 0x34, 0x33, 0x32, 0x31];
        golden.extend([0x00, 0x20, 0x21, 0x10, 0xD7, 0x0D, 6, 0, 4, 1, 9, 8, 0]);
        ToNodeParts { to_node, golden }
    }

    /// Bytes in hexadecimal digits, in groups of four as the page has them.
    fn hex(bytes: &[u8]) -> std::string::String {
        let digits: std::vec::Vec<_> = bytes.iter().map(|byte| std::format!("{byte:02X}")).collect();
        digits.chunks(4).map(|group| group.concat()).collect::<std::vec::Vec<_>>().join(" ")
    }

    #[test]
    fn golden_datagrams_are_those_of_the_page() {
        let mut out = [0; MAX_DATAGRAM];
        let length = envelope().emit(false, &mut out).unwrap();
        let mut golden = std::vec![0, 1, 0x41, 8, 7, 6, 5, 4, 3, 2, 1, 0x14, 0x13, 0x12, 0x11, 0x24, 0x23, 0x22, 0x21];
        golden.extend([0x34, 0x33, 0x32, 0x31]);
        // 1,704,067,200,000,000 = 0x0006_0DD7_1021_2000; 500,000 less: 0x0006_0DD7_1019_7EE0.
        golden.extend([0x00, 0x20, 0x21, 0x10, 0xD7, 0x0D, 6, 0]);
        golden.extend([0xE0, 0x7E, 0x19, 0x10, 0xD7, 0x0D, 6, 0]);
        golden.extend([1, 1]);
        assert_eq!(golden.len(), HEADER_BYTES);
        golden.extend(FRAME);
        assert_eq!(out[..length], golden[..]);
        let told = receipt().emit(true, &mut out).unwrap();
        let mut of_receipt =
            std::vec![0, 1, 0x82, 8, 7, 6, 5, 4, 3, 2, 1, 0x14, 0x13, 0x12, 0x11, 0x34, 0x33, 0x32, 0x31];
        of_receipt.extend([0x00, 0x20, 0x21, 0x10, 0xD7, 0x0D, 6, 0]);
        of_receipt.extend([0x24, 0x23, 0x22, 0x21, 0x25, 0x23, 0x22, 0x21]);
        assert_eq!(out[..told], of_receipt[..]);
        let ToNodeParts { to_node, golden: of_message } = message_to_a_node();
        let length = to_node.emit(false, &mut out).unwrap();
        assert_eq!(out[..length], of_message[..]);
        let page = include_str!("../../../docs/reference/wire-format.md");
        for bytes in [&golden, &of_receipt, &of_message] {
            assert!(page.contains(&hex(bytes)), "{}", hex(bytes));
        }
    }

    #[test]
    fn datagrams_come_back_with_what_their_code_is_made_of() {
        let mut out = [0; MAX_DATAGRAM];
        let length = envelope().emit(true, &mut out).unwrap();
        out[length..length + CODE_BYTES].fill(0xAA);
        let received = parse(&out[..length + CODE_BYTES]).unwrap();
        assert_eq!(received.datagram, Datagram::Telemetry(envelope()));
        assert_eq!((received.signed.len(), received.code), (length, Some(&[0xAA; CODE_BYTES][..])));
        let length = receipt().emit(false, &mut out).unwrap();
        let received = parse(&out[..length]).unwrap();
        assert_eq!((received.datagram, received.code), (Datagram::Receipt(receipt()), None));
    }

    #[test]
    fn what_is_no_datagram_is_refused_with_why() {
        let mut out = [0; MAX_DATAGRAM];
        let length = envelope().emit(true, &mut out).unwrap();
        for cut in 0..HEADER_BYTES + CODE_BYTES {
            assert!(parse(&out[..cut]).is_err(), "{cut} bytes");
        }
        assert_eq!(parse(FRAME), Err(DatagramError::Foreign));
        assert_eq!(parse(&[0, 0, 1, 2]), Err(DatagramError::Foreign));
        assert_eq!(parse(&[0, 2, 1, 2]), Err(DatagramError::Foreign));
        assert_eq!(parse(&[0, 1, 4, 2]), Err(DatagramError::Kind(4)));
        // A receipt is not sent again.
        assert_eq!(parse(&[0, 1, 0x42, 2]), Err(DatagramError::Kind(0x42)));
        // A frame's end and the next one's beginning.
        assert!(
            is_datagram(&out[..length]) && !is_datagram(FRAME) && !is_datagram(&[0, FRAME[0]]) && !is_datagram(&[0])
        );
        let numbers = [7; MAX_NUMBERS].into_iter().collect();
        let length = Receipt { numbers, ..receipt() }.emit(false, &mut out).unwrap();
        for more in [1, 4] {
            assert_eq!(parse(&out[..length + more]), Err(DatagramError::Length));
        }
        let too_long = [1; MAX_FRAMES + 1];
        assert_eq!(Envelope { frames: &too_long, ..envelope() }.emit(false, &mut out), None);
        assert!(Envelope { frames: &too_long[1..], ..envelope() }.emit(true, &mut out).is_some());
    }
}
