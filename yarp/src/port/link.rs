//! A TCP connection with a buffer of the next message, and limits on all resources.

use super::PortOptions;
use crate::wire::{Carrier, FrameError, LineError, TextCommand, frame, line};
use bytes::{Bytes, BytesMut};
use std::sync::Arc;
use std::{io, time::Duration};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

/// Reason why a connection ended.
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

/// A message as received.
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
    /// Memory for long messages, shared with other connections of the port, and the part in use.
    budget: Option<Arc<Semaphore>>,
    taken: Option<OwnedSemaphorePermit>,
}

/// Part of a message that is not counted against the budget, KiB.
const FREE: usize = 1024;

/// Greatest size of a text reply, bytes.
const MAX_LINE: usize = 4 << 20;

/// Least number of bytes reserved for a read.
const STEP: usize = 4096;

/// Greatest number of bytes reserved for a message that a peer has only announced.
const CREDIT: usize = 256 << 10;

impl Link {
    pub fn new(stream: TcpStream, options: &PortOptions) -> Link {
        Link {
            stream,
            buffer: BytesMut::new(),
            scanner: line::Scanner::default(),
            write_limit: options.write,
            budget: None,
            taken: None,
        }
    }

    /// Sets the memory (KiB) for long messages, shared with others.
    pub fn within(self, budget: &Arc<Semaphore>) -> Link {
        Link { budget: Some(budget.clone()), ..self }
    }

    pub fn stream(&self) -> &TcpStream {
        &self.stream
    }

    pub fn stream_mut(&mut self) -> &mut TcpStream {
        &mut self.stream
    }

    /// Reads more bytes. The buffer at most doubles, independent of the length announced. Cancel safe.
    pub async fn fill(&mut self) -> Result<(), LinkError> {
        self.fill_for(0).await
    }

    /// As [`Link::fill`], for this number of missing bytes. Up to [`CREDIT`] they are reserved at once, so
    /// that an image is read without moving the buffer.
    async fn fill_for(&mut self, missing: usize) -> Result<(), LinkError> {
        self.buffer.reserve(STEP.max(self.buffer.len()).max(missing.min(CREDIT)));
        match self.stream.read_buf(&mut self.buffer).await? {
            0 => Err(LinkError::Closed),
            _ => self.account(),
        }
    }

    /// Acquires memory for bytes beyond the free part.
    fn account(&mut self) -> Result<(), LinkError> {
        let Some(budget) = &self.budget else { return Ok(()) };
        let size = self.buffer.len() >> 10;
        let taken = self.taken.as_ref().map_or(0, OwnedSemaphorePermit::num_permits);
        if size <= FREE + taken {
            return Ok(());
        }
        // Acquires twice what is needed, like the buffer itself, so that this is rare.
        let more = u32::try_from(size).map_err(|_| LinkError::Crowded)?;
        let more = budget.clone().try_acquire_many_owned(more).map_err(|_| LinkError::Crowded)?;
        match &mut self.taken {
            Some(taken) => taken.merge(more),
            taken => *taken = Some(more),
        }
        Ok(())
    }

    /// Reads until `parse` returns an item. Cancel safe: received bytes are retained.
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

    /// Receives the next message, which must be complete `limit` after its first byte but may begin at any
    /// time. Cancel safe.
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

    /// Reads and discards lines until one is `<ACK>`.
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

    /// Reads and discards bytes until the peer closes. Cancel safe.
    pub async fn until_closed(&mut self) -> LinkError {
        loop {
            self.buffer.clear();
            if let Err(error) = self.fill().await {
                return error;
            }
        }
    }

    /// Writes pieces one after the other; fails if the peer reads nothing for too long.
    pub async fn write(&mut self, pieces: &[&[u8]]) -> Result<(), LinkError> {
        // Short pieces are joined, so that they leave in one packet.
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

    /// Closes the sending side.
    pub async fn shutdown(&mut self) {
        let _ = timeout(self.write_limit, self.stream.shutdown()).await;
    }
}
