//! Transactions on the serial bus: each with a deadline, verified, and never confused with another.
//!
//! ```text
//! drain old bytes ──> send request ──> collect answers until the deadline ──> line quiet again
//! ```
//! A late answer of one read can't be taken for the answer of the next: old bytes are drained, a transaction that timed out waits
//! until the line is quiet, and eight reads in a row differ in length, which is verified.

use crate::packet::{BusPacket, EncodeError, Instruction, PacketDecoder};
use crate::registers::STATE;
use std::io;
use std::time::{Duration, Instant};

/// Reads in a row that differ in length.
const READ_LENGTHS: u8 = 8;
/// After a time-out the line must be quiet for this long.
const QUIET: Duration = Duration::from_millis(1);
/// No longer than this is waited for the line to become quiet.
const MAX_DRAIN: Duration = Duration::from_millis(20);
/// Bytes that are received at once.
const RECEIVED_AT_ONCE: usize = 512;

/// A serial line.
pub trait SerialLine: Send {
    /// Sends all of these bytes.
    ///
    /// # Errors
    /// If the line is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;
    /// Receives what comes within this time; 0 if nothing does.
    ///
    /// # Errors
    /// If the line is gone.
    fn receive(&mut self, into: &mut [u8], within: Duration) -> io::Result<usize>;
}

impl SerialLine for Box<dyn serialport::SerialPort> {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        io::Write::write_all(self, bytes)
    }

    fn receive(&mut self, into: &mut [u8], within: Duration) -> io::Result<usize> {
        self.set_timeout(within)?;
        match io::Read::read(self, into) {
            // a hang-up: a port that is there blocks instead
            Ok(0) => Err(io::ErrorKind::BrokenPipe.into()),
            Err(e) if matches!(e.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => Ok(0),
            received => received,
        }
    }
}

/// Opens a serial port for this program alone.
///
/// # Errors
/// The reason, with a remedy.
pub fn open_port(port: &str, baud: u32) -> Result<Box<dyn SerialLine>, String> {
    // a port's path is opened by its own rules: it must not become the controlling terminal, and is locked for this program
    match serialport::new(port, baud).timeout(QUIET).open() {
        Ok(port) => Ok(Box::new(port)),
        Err(e) => {
            let remedy = match e.kind() {
                serialport::ErrorKind::Io(io::ErrorKind::PermissionDenied) => {
                    "add yourself to the group that owns the port, such as `dialout`"
                }
                _ if is_taken(&e) => "end the other program that uses the port",
                _ => "plug the arm's USB cable in, and check the port's name: ls /dev/ttyACM* /dev/ttyUSB*",
            };
            Err(format!("the serial port {port} can't be opened ({e}): {remedy}"))
        }
    }
}

fn is_taken(e: &serialport::Error) -> bool {
    let text = e.description.to_lowercase();
    ["in use", "busy", "lock", "temporarily unavailable"].iter().any(|word| text.contains(word))
}

/// A failed transaction.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The line itself failed: the port is gone.
    #[error("the serial port is gone ({0})")]
    Gone(#[from] io::Error),
    /// The servo did not answer in time.
    #[error("servo {id} did not answer within {within:?}")]
    Silent {
        /// The servo.
        id: u8,
        /// The deadline.
        within: Duration,
    },
    /// The request does not fit a packet.
    #[error(transparent)]
    Request(#[from] EncodeError),
}

/// The answer of one servo.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServoAnswer {
    /// The servo.
    pub id: u8,
    /// Its error byte.
    pub error: u8,
    /// The registers.
    pub data: Vec<u8>,
}

/// The bus, with one transaction at a time.
pub struct ServoBus {
    line: Box<dyn SerialLine>,
    decoder: PacketDecoder,
    timeout: Duration,
    reads: u8,
    /// Packets that belong to no transaction.
    foreign: u64,
}

impl ServoBus {
    /// A bus on this line, on which every answer must have arrived within `timeout`.
    pub fn new(line: Box<dyn SerialLine>, timeout: Duration) -> ServoBus {
        ServoBus { line, decoder: PacketDecoder::default(), timeout, reads: 0, foreign: 0 }
    }

    /// Bytes and packets received so far that belong to no transaction: late answers, damage, and other programs.
    pub fn foreign(&self) -> u64 {
        self.foreign + self.decoder.skipped()
    }

    /// The error byte of a servo.
    ///
    /// # Errors
    /// If the port is gone or the servo silent.
    pub fn ping(&mut self, id: u8) -> Result<u8, BusError> {
        let answers = self.transact(&Instruction::Ping { id }, &[id], 0, self.timeout)?;
        self.single(id, answers).map(|answer| answer.error)
    }

    /// Registers of one servo.
    ///
    /// # Errors
    /// If the port is gone or the servo silent.
    pub fn read(&mut self, id: u8, address: u8, count: u8) -> Result<ServoAnswer, BusError> {
        let request = Instruction::Read { id, address, count };
        let answers = self.transact(&request, &[id], usize::from(count), self.timeout)?;
        self.single(id, answers)
    }

    /// Writes registers of one servo and waits for its answer; the error byte.
    ///
    /// # Errors
    /// If the port is gone or the servo silent.
    pub fn write(&mut self, id: u8, address: u8, data: Vec<u8>) -> Result<u8, BusError> {
        let answers = self.transact(&Instruction::Write { id, address, data }, &[id], 0, self.timeout)?;
        self.single(id, answers).map(|answer| answer.error)
    }

    /// Writes registers of several servos. None answers.
    ///
    /// # Errors
    /// If the port is gone.
    pub fn sync_write(&mut self, address: u8, data: Vec<(u8, Vec<u8>)>) -> Result<(), BusError> {
        let bytes = Instruction::SyncWrite { address, data }.encode()?;
        Ok(self.line.send(&bytes)?)
    }

    /// Registers of several servos, in one request. A servo that did not answer in time, or whose answer was damaged, is missing.
    ///
    /// # Errors
    /// If the port is gone.
    pub fn sync_read(&mut self, address: u8, count: u8, ids: &[u8]) -> Result<Vec<ServoAnswer>, BusError> {
        let request = Instruction::SyncRead { address, count, ids: ids.to_vec() };
        self.transact(&request, ids, usize::from(count), self.timeout)
    }

    /// The state registers of these servos, in one request; the missing ones are read again, one by one.
    ///
    /// # Errors
    /// If the port is gone.
    pub fn read_states(&mut self, ids: &[u8]) -> Result<Vec<ServoAnswer>, BusError> {
        let (address, count, lead) = self.state_block();
        let mut answers = self.sync_read(address, count, ids)?;
        cut(&mut answers, lead);
        // a silent bus gets no six further requests, whose answers might come late
        let retried = if answers.is_empty() { &[] } else { ids };
        for id in retried {
            if answers.iter().any(|a| a.id == *id) {
                continue;
            }
            let (address, count, lead) = self.state_block();
            match self.read(*id, address, count) {
                Ok(answer) => {
                    let mut one = vec![answer];
                    cut(&mut one, lead);
                    answers.extend(one);
                }
                Err(BusError::Silent { .. }) => {}
                Err(e) => return Err(e),
            }
        }
        Ok(answers)
    }

    /// The registers that the next read of states asks for: first, number, and how many of them lead up to the state. The number
    /// differs from those of the reads before.
    fn state_block(&mut self) -> (u8, u8, usize) {
        self.reads = (self.reads + 1) % READ_LENGTHS;
        let lead = self.reads;
        (STATE.0 - lead, STATE.1 - STATE.0 + 1 + lead, usize::from(lead))
    }

    fn single(&self, id: u8, answers: Vec<ServoAnswer>) -> Result<ServoAnswer, BusError> {
        answers.into_iter().next().ok_or(BusError::Silent { id, within: self.timeout })
    }

    /// One request, and the answers of these servos with so many bytes, until all have come or the time is up.
    fn transact(
        &mut self,
        request: &Instruction,
        ids: &[u8],
        count: usize,
        within: Duration,
    ) -> Result<Vec<ServoAnswer>, BusError> {
        let bytes = request.encode()?;
        self.drain(Duration::ZERO)?;
        self.line.send(&bytes)?;
        let begun = monotonic();
        let mut answers: Vec<ServoAnswer> = Vec::with_capacity(ids.len());
        loop {
            while let Some(packet) = self.decoder.next_packet() {
                self.sort(packet, ids, count, &mut answers);
            }
            // servos answer in the order of the request: after the last there is nothing to wait for
            let last = answers.last().map(|a| a.id) == ids.last().copied();
            if answers.len() == ids.len() || (last && !answers.is_empty()) {
                break;
            }
            let left = within.saturating_sub(begun.elapsed());
            if left.is_zero() {
                break;
            }
            self.receive(left)?;
        }
        if answers.len() < ids.len() {
            self.drain(QUIET)?;
        }
        Ok(answers)
    }

    fn sort(&mut self, packet: BusPacket, ids: &[u8], count: usize, answers: &mut Vec<ServoAnswer>) {
        let BusPacket { id, code: error, parameters: data } = packet;
        let fits = ids.contains(&id) && data.len() == count && answers.iter().all(|a| a.id != id);
        if fits {
            answers.push(ServoAnswer { id, error, data });
        } else {
            self.foreign += 1;
        }
    }

    fn receive(&mut self, within: Duration) -> Result<usize, BusError> {
        let mut bytes = [0; RECEIVED_AT_ONCE];
        let count = self.line.receive(&mut bytes, within)?;
        self.decoder.push(bytes.get(..count).unwrap_or_default());
        Ok(count)
    }

    /// Discards what has arrived until the line has been quiet for this long.
    fn drain(&mut self, quiet: Duration) -> Result<(), BusError> {
        let begun = monotonic();
        self.decoder.clear();
        if quiet.is_zero() && !self.has_input()? {
            return Ok(());
        }
        while begun.elapsed() < MAX_DRAIN && self.receive(quiet)? > 0 {
            self.decoder.clear();
        }
        self.decoder.clear();
        Ok(())
    }

    /// Receives bytes that arrived before a request; true if there were any.
    fn has_input(&mut self) -> Result<bool, BusError> {
        Ok(self.receive(Duration::ZERO)? > 0)
    }
}

/// Strikes the registers that lead up to the state.
fn cut(answers: &mut [ServoAnswer], lead: usize) {
    for answer in answers {
        answer.data.drain(..lead.min(answer.data.len()));
    }
}

/// The time by which deadlines on the wire are met.
#[expect(clippy::disallowed_methods, reason = "a serial line has deadlines in real time")]
pub fn monotonic() -> Instant {
    Instant::now()
}
