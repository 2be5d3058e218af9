//! Messages in datagrams (spec section 18): CRC, packet counter, a piece of the message.

use super::frame;

/// Greatest size of one datagram, header included.
pub const MAX_DATAGRAM: usize = 65_499;

const HEADER: usize = 8;

/// Splits a message into datagrams.
pub fn split(message: &[u8]) -> impl Iterator<Item = Vec<u8>> + '_ {
    message.chunks(MAX_DATAGRAM - HEADER).enumerate().map(|(counter, piece)| {
        let mut out = crc32fast::hash(piece).to_le_bytes().to_vec();
        out.extend_from_slice(&(counter as i32).to_le_bytes());
        out.extend_from_slice(piece);
        out
    })
}

/// Reassembles messages. A datagram with a wrong checksum or counter discards the message it belongs to.
#[derive(Debug, Default)]
pub struct Assembler {
    message: Vec<u8>,
    next: i32,
    lost: u64,
}

impl Assembler {
    /// Adds a datagram; returns the message that it completes.
    pub fn take(&mut self, datagram: &[u8], max: usize) -> Option<Vec<u8>> {
        let (crc, rest) = datagram.split_first_chunk::<4>()?;
        let (counter, piece) = rest.split_first_chunk::<4>()?;
        let counter = i32::from_le_bytes(*counter);
        if counter == -1 {
            return None;
        }
        if u32::from_le_bytes(*crc) != crc32fast::hash(piece) {
            return self.discard();
        }
        if counter == 0 {
            if !self.message.is_empty() {
                self.discard();
            }
        } else if counter != self.next || self.message.is_empty() {
            return self.discard();
        }
        self.message.extend_from_slice(piece);
        self.next = counter.wrapping_add(1);
        match frame::length(&self.message, max) {
            Ok(Some(length)) if self.message.len() >= length => {
                let mut message = std::mem::take(&mut self.message);
                self.next = 0;
                message.truncate(length);
                Some(message)
            }
            Ok(_) => None,
            Err(_) => self.discard(),
        }
    }

    /// Number of discarded messages.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    fn discard(&mut self) -> Option<Vec<u8>> {
        self.lost += 1;
        self.message = Vec::new();
        self.next = 0;
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(size: usize) -> Vec<u8> {
        let mut out = frame::encode(b'D', None, size);
        out.extend((0..size).map(|i| i as u8));
        out
    }

    #[test]
    fn long_messages_go_in_pieces_and_come_back_whole() {
        let (long, short) = (message(200_000), message(10));
        let mut assembler = Assembler::default();
        let pieces: Vec<_> = split(&long).collect();
        assert_eq!(pieces.len(), 4);
        let whole: Vec<_> = pieces.iter().filter_map(|p| assembler.take(p, 1 << 20)).collect();
        assert_eq!(whole, std::slice::from_ref(&long));
        // a lost datagram loses only its message
        for piece in pieces.iter().skip(1) {
            assert_eq!(assembler.take(piece, 1 << 20), None);
        }
        let mut broken = split(&short).next().unwrap();
        broken[12] ^= 1;
        assert_eq!(assembler.take(&broken, 1 << 20), None);
        let piece = split(&short).next().unwrap();
        assert_eq!(assembler.take(&piece, 1 << 20), Some(short.clone()));
        assert!(assembler.lost() > 0);
    }
}
