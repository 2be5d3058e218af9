//! A counterpart for drivers of servo arms: STS3215 servos on a pseudo-terminal, with the faults that real ones have.
//!
//! ```text
//! driver ──serial port (a pseudo-terminal)──> ServoTerminal ──> ServoWorld: one SimulatedServo per id
//! ```
//! Written against the protocol's manual, and apart from any driver: neither shares a line with the other. The servos are of first order,
//! sag under a load, are blocked, flicker, lose their supply, and lower their torque after two seconds of overload.

mod servo;
mod terminal;

pub use servo::SimulatedServo;
pub use terminal::ServoTerminal;

use std::collections::BTreeMap;
use std::time::Duration;

const PING: u8 = 0x01;
const READ: u8 = 0x02;
const WRITE: u8 = 0x03;
const SYNC_READ: u8 = 0x82;
const SYNC_WRITE: u8 = 0x83;
const ALL: u8 = 0xFE;
/// Bytes of a request that are stored at most.
const MAX_BUFFER_BYTES: usize = 4096;

/// The servos of a bus, and what happens to its packets.
#[derive(Clone, Debug)]
pub struct ServoWorld {
    servos: BTreeMap<u8, SimulatedServo>,
    /// The share of answers that arrive damaged.
    pub damaged: f64,
    /// The share of answers that are lost.
    pub lost: f64,
    /// By how much every answer is late.
    pub late: Duration,
    /// Bytes that another program sends with each answer.
    pub chatter: Vec<u8>,
    /// Requests understood so far.
    pub requests: u64,
    /// Requests that were damaged.
    pub bad_requests: u64,
    buffer: Vec<u8>,
    random: u64,
}

impl ServoWorld {
    /// Servos with these ids, without torque, each at its middle.
    pub fn new(ids: impl IntoIterator<Item = u8>) -> ServoWorld {
        ServoWorld {
            servos: ids.into_iter().map(|id| (id, SimulatedServo::new(id))).collect(),
            damaged: 0.0,
            lost: 0.0,
            late: Duration::ZERO,
            chatter: Vec::new(),
            requests: 0,
            bad_requests: 0,
            buffer: Vec::new(),
            random: 0x9E37_79B9_7F4A_7C15,
        }
    }

    /// One servo.
    pub fn servo(&mut self, id: u8) -> Option<&mut SimulatedServo> {
        self.servos.get_mut(&id)
    }

    /// All servos.
    pub fn servos(&mut self) -> impl Iterator<Item = &mut SimulatedServo> {
        self.servos.values_mut()
    }

    /// Lets time pass until then, since the beginning.
    pub fn advance(&mut self, now: Duration) {
        for servo in self.servos.values_mut() {
            // a number in -1..1 for the flicker
            self.random = next(self.random);
            servo.advance(now, 2.0 * share(self.random) - 1.0);
        }
    }

    /// Takes received bytes; the bytes that come back.
    pub fn feed(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.buffer.extend(bytes);
        let excess = self.buffer.len().saturating_sub(MAX_BUFFER_BYTES);
        self.buffer.drain(..excess);
        let mut back = Vec::new();
        while let Some((id, instruction, parameters)) = self.next_request() {
            self.requests += 1;
            back.extend(self.answer(id, instruction, &parameters));
        }
        if !back.is_empty() {
            back.extend(self.chatter.iter());
        }
        back
    }

    fn next_request(&mut self) -> Option<(u8, u8, Vec<u8>)> {
        loop {
            let start = self.buffer.windows(2).position(|two| two == [0xFF, 0xFF])?;
            self.buffer.drain(..start);
            let (id, length) = (*self.buffer.get(2)?, usize::from(*self.buffer.get(3)?));
            if id == 0xFF || length < 2 {
                self.buffer.drain(..1);
                continue;
            }
            let body = self.buffer.get(2..length + 3)?.to_vec();
            let sum = *self.buffer.get(length + 3)?;
            if complement(&body) != sum {
                self.bad_requests += 1;
                self.buffer.drain(..1);
                continue;
            }
            self.buffer.drain(..length + 4);
            let instruction = body.get(2).copied().unwrap_or_default();
            return Some((id, instruction, body.get(3..).unwrap_or_default().to_vec()));
        }
    }

    fn answer(&mut self, id: u8, instruction: u8, parameters: &[u8]) -> Vec<u8> {
        let (at, rest) = parameters.split_first().map_or((0, parameters), |(at, rest)| (usize::from(*at), rest));
        let count = rest.first().map_or(0, |count| usize::from(*count));
        match instruction {
            PING => self.status(id, 0, 0),
            READ => self.status(id, at, count),
            WRITE => {
                self.write(id, at, rest);
                self.status(id, 0, 0)
            }
            SYNC_READ => rest.iter().skip(1).flat_map(|id| self.status(*id, at, count)).collect(),
            SYNC_WRITE => {
                for one in rest.get(1..).unwrap_or_default().chunks(count + 1) {
                    if let [id, data @ ..] = one {
                        self.write(*id, at, data);
                    }
                }
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    fn write(&mut self, id: u8, at: usize, data: &[u8]) {
        for servo in self.servos.values_mut().filter(|s| s.answers && (s.id() == id || id == ALL)) {
            servo.write(at, data);
        }
    }

    /// The answer of a servo with so many of its registers.
    fn status(&mut self, id: u8, at: usize, count: usize) -> Vec<u8> {
        let Some(servo) = self.servos.get(&id).filter(|s| s.answers) else { return Vec::new() };
        let data = servo.read(at, count);
        let mut body = vec![id, (data.len() + 2) as u8, servo.status()];
        body.extend(data);
        let sum = complement(&body);
        let mut packet = vec![0xFF, 0xFF];
        packet.extend(body);
        packet.push(sum);
        if self.chance(self.lost) {
            return Vec::new();
        }
        if self.chance(self.damaged)
            && let Some(last) = packet.last_mut()
        {
            *last ^= 0x55;
        }
        packet
    }

    fn chance(&mut self, of: f64) -> bool {
        self.random = next(self.random);
        share(self.random) < of
    }
}

/// The low byte of the complement of the sum.
fn complement(body: &[u8]) -> u8 {
    !body.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte))
}

/// Xorshift: equal runs for equal requests.
fn next(random: u64) -> u64 {
    let random = random ^ (random << 13);
    let random = random ^ (random >> 7);
    random ^ (random << 17)
}

fn share(random: u64) -> f64 {
    (random >> 11) as f64 / (1u64 << 53) as f64
}
