//! The packets of Feetech's serial bus, as bytes: pure, no I/O.
//!
//! ```text
//! FF FF id length instruction parameters... checksum        request
//! FF FF id length error       parameters... checksum        answer of one servo
//! length = bytes after it; checksum = !(id + length + instruction + parameters), low byte
//! ```
//! Source: Feetech, "SMS/STS communication protocol user manual"; protocol 1.0 of Dynamixel has the same frame.

use std::collections::VecDeque;

/// The id that addresses all servos.
pub const BROADCAST: u8 = 0xFE;
/// The greatest id of a servo.
pub const MAX_ID: u8 = 0xFD;
/// The greatest number of parameters in a packet.
pub const MAX_PARAMETERS: usize = 250;
/// Bytes that the decoder stores at most: what is older is discarded.
const MAX_BUFFER_BYTES: usize = 4096;
/// Header, id, length, instruction or error, checksum.
pub const FRAME_BYTES: usize = 6;

/// A request of the host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Instruction {
    /// Makes a servo answer with its error byte.
    Ping {
        /// The servo.
        id: u8,
    },
    /// Reads registers of one servo.
    Read {
        /// The servo.
        id: u8,
        /// The first register.
        address: u8,
        /// The number of bytes.
        count: u8,
    },
    /// Writes registers of one servo, which answers.
    Write {
        /// The servo.
        id: u8,
        /// The first register.
        address: u8,
        /// The bytes.
        data: Vec<u8>,
    },
    /// Reads the same registers of several servos, which answer one after the other.
    SyncRead {
        /// The first register.
        address: u8,
        /// The number of bytes of each.
        count: u8,
        /// The servos, in the order of their answers.
        ids: Vec<u8>,
    },
    /// Writes the same registers of several servos at once. None answers.
    SyncWrite {
        /// The first register.
        address: u8,
        /// Each servo with its bytes, all of one length.
        data: Vec<(u8, Vec<u8>)>,
    },
}

/// A request that has no packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// More than one packet has room for.
    #[error("the request needs {0} parameters, and a packet has room for 250")]
    TooLong(usize),
    /// Not an id of a servo.
    #[error("{0} is not the id of a servo: ids are 0 to 253")]
    Id(u8),
    /// The servos of one sync write get unlike numbers of bytes.
    #[error("the servos of a sync write get unlike numbers of bytes")]
    Unlike,
}

impl Instruction {
    /// The bytes on the wire.
    ///
    /// # Errors
    /// If the request does not fit a packet.
    pub fn encode(&self) -> Result<Vec<u8>, EncodeError> {
        let (id, code, parameters) = match self {
            Instruction::Ping { id } => (checked(*id)?, 0x01, Vec::new()),
            Instruction::Read { id, address, count } => (checked(*id)?, 0x02, vec![*address, *count]),
            Instruction::Write { id, address, data } => {
                (checked(*id)?, 0x03, std::iter::once(*address).chain(data.iter().copied()).collect())
            }
            Instruction::SyncRead { address, count, ids } => {
                for id in ids {
                    checked(*id)?;
                }
                (BROADCAST, 0x82, [*address, *count].into_iter().chain(ids.iter().copied()).collect())
            }
            Instruction::SyncWrite { address, data } => (BROADCAST, 0x83, sync_write(*address, data)?),
        };
        if parameters.len() > MAX_PARAMETERS {
            return Err(EncodeError::TooLong(parameters.len()));
        }
        Ok(frame(id, code, &parameters))
    }
}

fn checked(id: u8) -> Result<u8, EncodeError> {
    if id <= MAX_ID { Ok(id) } else { Err(EncodeError::Id(id)) }
}

fn sync_write(address: u8, data: &[(u8, Vec<u8>)]) -> Result<Vec<u8>, EncodeError> {
    let count = data.first().map_or(0, |(_, bytes)| bytes.len());
    if data.iter().any(|(_, bytes)| bytes.len() != count) {
        return Err(EncodeError::Unlike);
    }
    let length = u8::try_from(count).map_err(|_| EncodeError::TooLong(count))?;
    let mut parameters = vec![address, length];
    for (id, bytes) in data {
        parameters.push(checked(*id)?);
        parameters.extend(bytes);
    }
    Ok(parameters)
}

/// A frame around these parameters; the caller has checked that they fit.
fn frame(id: u8, code: u8, parameters: &[u8]) -> Vec<u8> {
    let length = u8::try_from(parameters.len() + 2).unwrap_or(u8::MAX);
    let mut bytes = vec![0xFF, 0xFF, id, length, code];
    bytes.extend(parameters);
    bytes.push(checksum(bytes.get(2..).unwrap_or_default()));
    bytes
}

/// The checksum of a frame's bytes between header and checksum.
pub fn checksum(body: &[u8]) -> u8 {
    !body.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte))
}

/// A packet whose checksum is right: an answer, or on a servo's side a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BusPacket {
    /// The servo that answers, or is addressed.
    pub id: u8,
    /// The error byte of an answer; the instruction of a request.
    pub code: u8,
    /// The parameters.
    pub parameters: Vec<u8>,
}

impl BusPacket {
    /// The bytes on the wire.
    ///
    /// # Errors
    /// If there are more parameters than a packet has room for.
    pub fn encode(&self) -> Result<Vec<u8>, EncodeError> {
        if self.parameters.len() > MAX_PARAMETERS {
            return Err(EncodeError::TooLong(self.parameters.len()));
        }
        Ok(frame(self.id, self.code, &self.parameters))
    }
}

/// Finds packets in a stream of bytes. What belongs to no packet is skipped and counted, and nothing is stored without a bound.
#[derive(Clone, Debug, Default)]
pub struct PacketDecoder {
    buffer: VecDeque<u8>,
    skipped: u64,
}

impl PacketDecoder {
    /// Appends received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend(bytes);
        let excess = self.buffer.len().saturating_sub(MAX_BUFFER_BYTES);
        self.skip(excess);
    }

    /// Discards what has not become a packet; the number of bytes.
    pub fn clear(&mut self) -> usize {
        let count = self.buffer.len();
        self.skip(count);
        count
    }

    /// Bytes that belonged to no packet.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// The next packet, once all of its bytes are there.
    pub fn next_packet(&mut self) -> Option<BusPacket> {
        loop {
            let (Some(first), Some(second)) = (self.buffer.front(), self.buffer.get(1)) else { return None };
            if (*first, *second) != (0xFF, 0xFF) {
                self.skip(1);
                continue;
            }
            let (id, length) = (*self.buffer.get(2)?, *self.buffer.get(3).unwrap_or(&0));
            // a third FF moves the header on by one byte
            if id == 0xFF {
                self.skip(1);
                continue;
            }
            if self.buffer.len() < 4 {
                return None;
            }
            if length < 2 || usize::from(length) > MAX_PARAMETERS + 2 {
                self.skip(1);
                continue;
            }
            let end = usize::from(length) + 4;
            if self.buffer.len() < end {
                return None;
            }
            let body: Vec<u8> = self.buffer.iter().skip(2).take(end - 3).copied().collect();
            if self.buffer.get(end - 1) != Some(&checksum(&body)) {
                self.skip(1);
                continue;
            }
            self.buffer.drain(..end);
            let code = body.get(2).copied().unwrap_or_default();
            return Some(BusPacket { id, code, parameters: body.get(3..).unwrap_or_default().to_vec() });
        }
    }

    fn skip(&mut self, count: usize) {
        self.buffer.drain(..count.min(self.buffer.len()));
        self.skipped += count as u64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn packets(bytes: &[u8]) -> Vec<BusPacket> {
        let mut decoder = PacketDecoder::default();
        decoder.push(bytes);
        std::iter::from_fn(|| decoder.next_packet()).collect()
    }

    /// The manual's own examples: a ping of servo 1, and a read of two bytes from register 56.
    #[test]
    fn the_manuals_examples_are_encoded_byte_for_byte() {
        assert_eq!(Instruction::Ping { id: 1 }.encode(), Ok(vec![0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB]));
        let read = Instruction::Read { id: 1, address: 0x38, count: 2 };
        assert_eq!(read.encode(), Ok(vec![0xFF, 0xFF, 0x01, 0x04, 0x02, 0x38, 0x02, 0xBE]));
        let write = Instruction::SyncWrite { address: 42, data: vec![(1, vec![0, 8]), (2, vec![1, 8])] };
        assert_eq!(write.encode().unwrap().len(), 14);
    }

    #[test]
    fn requests_that_fit_no_packet_are_refused() {
        assert_eq!(Instruction::Ping { id: 0xFE }.encode(), Err(EncodeError::Id(0xFE)));
        let unlike = Instruction::SyncWrite { address: 0, data: vec![(1, vec![0]), (2, vec![])] };
        assert_eq!(unlike.encode(), Err(EncodeError::Unlike));
        let long = Instruction::Write { id: 1, address: 0, data: vec![0; 250] };
        assert_eq!(long.encode(), Err(EncodeError::TooLong(251)));
    }

    fn packet() -> impl Strategy<Value = BusPacket> {
        (0u8..=MAX_ID, any::<u8>(), prop::collection::vec(any::<u8>(), 0..60))
            .prop_map(|(id, code, parameters)| BusPacket { id, code, parameters })
    }

    proptest! {
        /// Encoded packets are decoded, however the bytes arrive.
        #[test]
        fn packets_survive_the_wire(sent in prop::collection::vec(packet(), 0..6), cut in 1usize..9) {
            let bytes: Vec<u8> = sent.iter().flat_map(|p| p.encode().unwrap()).collect();
            let mut decoder = PacketDecoder::default();
            let mut got = Vec::new();
            for part in bytes.chunks(cut) {
                decoder.push(part);
                got.extend(std::iter::from_fn(|| decoder.next_packet()));
            }
            prop_assert_eq!(got, sent);
            prop_assert_eq!(decoder.skipped(), 0);
        }

        /// A packet with one damaged byte is never taken for an answer of the same servo with other contents.
        #[test]
        fn a_damaged_packet_is_no_packet(sent in packet(), at in 2usize..66, flip in 1u8..) {
            let mut bytes = sent.encode().unwrap();
            let at = at % bytes.len();
            bytes[at] ^= flip;
            prop_assert!(packets(&bytes).iter().all(|p| p.parameters.len() < sent.parameters.len()));
        }

        /// Any bytes: no panic, bounded storage, every byte accounted for; a packet after enough silence is found.
        #[test]
        fn garbage_is_skipped(noise in prop::collection::vec(any::<u8>(), 0..600), sent in packet()) {
            let mut decoder = PacketDecoder::default();
            decoder.push(&noise);
            while decoder.next_packet().is_some() {}
            decoder.clear();
            decoder.push(&sent.encode().unwrap());
            prop_assert_eq!(decoder.next_packet(), Some(sent));
        }

        #[test]
        fn storage_is_bounded(parts in prop::collection::vec(prop::collection::vec(0xFFu8.., 0..2000), 0..8)) {
            let mut decoder = PacketDecoder::default();
            for part in parts {
                decoder.push(&part);
                prop_assert!(decoder.buffer.len() <= MAX_BUFFER_BYTES);
            }
        }
    }
}
