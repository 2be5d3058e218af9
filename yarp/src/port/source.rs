//! Source of an input, which is connected again whenever it is silent.

use super::{InputPort, Message, PortError};
use crate::{Carrier, Contact, clock};
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// Period of requests by an input without any connection, and of checks for silence.
const CHECK_PERIOD: Duration = Duration::from_millis(500);
/// Longest time between two requests to a source that remains silent, in multiples of its patience.
const MAX_BACKOFF: u32 = 8;

/// A port that has to send to an input. A connection proves nothing: it may belong to another program, or may
/// have lost its other end without notice. So only messages count.
#[derive(Debug)]
pub struct StreamSource {
    port: String,
    name: String,
    carrier: Carrier,
    patience: Duration,
    wait: Duration,
    due: Instant,
}

impl StreamSource {
    /// Creates a source. A new connection is requested after each `patience` of silence, less often the longer
    /// it lasts.
    pub fn new(port: &str, carrier: Carrier, patience: Duration) -> StreamSource {
        let name = Contact::parse(port).name;
        let port = port.to_owned();
        StreamSource { port, name, carrier, patience, wait: patience, due: clock::now() + patience }
    }

    /// Receives the next message of the input, from any port; `None` when the input is closed.
    ///
    /// # Errors
    /// The source was silent and can't be connected to; the next call retries.
    pub async fn recv(&mut self, input: &mut InputPort) -> Result<Option<Message>, PortError> {
        let name = input.core().network.full_name(&self.name);
        let mut alone = false;
        loop {
            // messages of other ports don't postpone it
            if clock::now() >= self.due || alone {
                let connected = input.connect_from(&self.port, self.carrier).await;
                self.due = clock::now() + self.wait;
                self.wait = (2 * self.wait).min(MAX_BACKOFF * self.patience);
                connected?;
            }
            match timeout_at(self.due.min(clock::now() + CHECK_PERIOD), input.recv()).await {
                Ok(Some(message)) => {
                    if message.from == name {
                        (self.wait, self.due) = (self.patience, clock::now() + self.patience);
                    }
                    return Ok(Some(message));
                }
                Ok(None) => return Ok(None),
                Err(_) => alone = input.peers().is_empty(),
            }
        }
    }
}
