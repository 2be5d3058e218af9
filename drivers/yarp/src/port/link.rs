//! A TCP connection with what has arrived of the next message, and limits on everything.

use super::PortOptions;
use crate::wire::{Carrier, FrameError, LineError, TextCommand, frame, line};
use bytes::{Bytes, BytesMut};
use std::sync::Arc;
use std::{io, time::Duration};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

/// Why a connection ended.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LinkError {
    #[error("{0}")]
    Io(#[from] io::Error),
    #[error("the peer closed the connection")]
    Closed,
    #[error("nothing came for {0:?} while {1} was expected")]
    Late(Duration, &'static str),
    #[error("{0}")]
    Frame(#[from] FrameError),
    #[error("{0}")]
    TextMessage(#[from] LineError),
    #[error("{0}")]
    Handshake(#[from] crate::wire::handshake::HandshakeError),
    #[error("too many unfinished long messages on this port; raise PortOptions::max_buffered if that is meant")]
    Crowded,
    #[error("the reply is no bottle: {0}")]
    Reply(crate::DecodeError),
}

/// A message as it came over a link.
#[derive(Debug)]
pub(crate) struct Incoming {
    pub command: TextCommand,
    pub payload: Bytes,
}

pub(crate) struct Link {
    stream: TcpStream,
    buffer: BytesMut,
    scanner: line::Scanner,
    write_limit: Duration,
    /// Room for long messages, shared with other connections of the port, and what of it is taken.
    budget: Option<Arc<Semaphore>>,
    taken: Option<OwnedSemaphorePermit>,
}

/// How much of a message is not counted against the budget, KiB.
const FREE: usize = 1024;

/// The longest reply as text, bytes.
const MAX_LINE: usize = 4 << 20;

/// The least that is read at a time.
const STEP: usize = 4096;

/// The most room that is made for what a peer only announced.
const CREDIT: usize = 256 << 10;

impl Link {
    pub fn new(stream: TcpStream, options: &PortOptions) -> Link {
        let (buffer, scanner, write_limit) = (BytesMut::new(), line::Scanner::default(), options.write);
        Link { stream, buffer, scanner, write_limit, budget: None, taken: None }
    }

    /// With this room (KiB) for long messages, shared with others.
    pub fn within(self, budget: &Arc<Semaphore>) -> Link {
        Link { budget: Some(budget.clone()), ..self }
    }

    pub fn stream(&self) -> &TcpStream {
        &self.stream
    }

    pub fn stream_mut(&mut self) -> &mut TcpStream {
        &mut self.stream
    }

    /// Reads on; the buffer at most doubles, whatever the peer claims to send. Cancel safe.
    pub async fn fill(&mut self) -> Result<(), LinkError> {
        self.fill_for(0).await
    }

    /// As [`Link::fill`], for so many bytes still to come: room for them is made at once, if they are no more than
    /// [`CREDIT`], so that a picture is read without moving what there is.
    async fn fill_for(&mut self, missing: usize) -> Result<(), LinkError> {
        self.buffer.reserve(STEP.max(self.buffer.len()).max(missing.min(CREDIT)));
        match self.stream.read_buf(&mut self.buffer).await? {
            0 => Err(LinkError::Closed),
            _ => self.account(),
        }
    }

    /// Takes room for what has arrived beyond the free part.
    fn account(&mut self) -> Result<(), LinkError> {
        let Some(budget) = &self.budget else { return Ok(()) };
        let (size, taken) = (self.buffer.len() >> 10, self.taken.as_ref().map_or(0, OwnedSemaphorePermit::num_permits));
        if size <= FREE + taken {
            return Ok(());
        }
        // Twice what is needed, like the buffer itself; so this is done seldom.
        let more = u32::try_from(size).map_err(|_| LinkError::Crowded)?;
        let more = budget.clone().try_acquire_many_owned(more).map_err(|_| LinkError::Crowded)?;
        match &mut self.taken {
            Some(taken) => taken.merge(more),
            taken => *taken = Some(more),
        }
        Ok(())
    }

    /// Reads until `parse` has an item. Cancel safe: what has arrived stays.
    pub async fn take<T, E: Into<LinkError>>(
        &mut self,
        mut parse: impl FnMut(&[u8]) -> Result<Option<(T, usize)>, E>,
    ) -> Result<T, LinkError> {
        loop {
            if let Some((item, used)) = parse(&self.buffer).map_err(Into::into)? {
                let _ = self.buffer.split_to(used.min(self.buffer.len()));
                return Ok(item);
            }
            self.fill().await?;
        }
    }

    /// The next message, which must be whole `limit` after its first byte; it may begin any time. Cancel safe.
    pub async fn message(&mut self, carrier: Carrier, max: usize, limit: Duration) -> Result<Incoming, LinkError> {
        if self.buffer.is_empty() {
            self.buffer = BytesMut::new();
            self.taken = None;
            self.fill().await?;
        }
        timeout(limit, self.whole_message(carrier, max))
            .await
            .map_err(|_| LinkError::Late(limit, "the rest of a message"))?
    }

    async fn whole_message(&mut self, carrier: Carrier, max: usize) -> Result<Incoming, LinkError> {
        loop {
            if carrier.is_text() {
                if let Some(line) = self.scanner.parse(&self.buffer, max)? {
                    let _ = self.buffer.split_to(line.end.min(self.buffer.len()));
                    return Ok(Incoming { command: line.command, payload: line.payload.into() });
                }
                self.fill().await?;
                continue;
            }
            if let Some(found) = frame::parse(&self.buffer, max)? {
                let mut bytes = self.buffer.split_to(found.end.min(self.buffer.len())).freeze();
                let payload = bytes.split_off(found.payload.min(bytes.len()));
                return Ok(Incoming { command: found.command, payload });
            }
            let whole = frame::length(&self.buffer, max)?.unwrap_or_default();
            self.fill_for(whole.saturating_sub(self.buffer.len())).await?;
        }
    }

    /// Reads lines until one is `<ACK>`; others are thrown away.
    pub async fn ack_line(&mut self) -> Result<(), LinkError> {
        while self.line().await? != b"<ACK>" {}
        Ok(())
    }

    /// Reads one line of bottle text, continuation lines included, without its end.
    pub async fn line(&mut self) -> Result<Vec<u8>, LinkError> {
        self.take(|bytes| {
            if bytes.len() > MAX_LINE {
                return Err(LineError(MAX_LINE));
            }
            Ok(line::reply_end(bytes).map(|end| (line::trimmed(bytes.get(..end).unwrap_or_default()).to_vec(), end)))
        })
        .await
    }

    /// Reads and throws away what comes, until the peer closes. Cancel safe.
    pub async fn until_closed(&mut self) -> LinkError {
        loop {
            self.buffer.clear();
            if let Err(error) = self.fill().await {
                return error;
            }
        }
    }

    /// Writes pieces one after the other; a peer that reads nothing for a while is given up.
    pub async fn write(&mut self, pieces: &[&[u8]]) -> Result<(), LinkError> {
        // Short ones go together, so that they leave in one packet.
        let joined: Vec<u8>;
        let together;
        let pieces = if pieces.iter().map(|piece| piece.len()).sum::<usize>() <= 1 << 14 {
            joined = pieces.concat();
            together = [joined.as_slice()];
            &together
        } else {
            pieces
        };
        for piece in pieces {
            let mut rest = *piece;
            while !rest.is_empty() {
                let stuck = |_| LinkError::Late(self.write_limit, "the peer to read");
                match timeout(self.write_limit, self.stream.write(rest)).await.map_err(stuck)?? {
                    0 => return Err(LinkError::Closed),
                    n => rest = rest.get(n..).unwrap_or_default(),
                }
            }
        }
        Ok(())
    }

    /// Says that nothing more is written.
    pub async fn shutdown(&mut self) {
        let _ = timeout(self.write_limit, self.stream.shutdown()).await;
    }
}
