//! The port that an input is meant to read from, connected to again whenever it is silent.

use super::{InputPort, Message, PortError};
use crate::{Carrier, Contact, clock};
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// How often an input without any connection requests one, and how often silence is looked for.
const LOOK: Duration = Duration::from_millis(500);
/// The longest time between two requests to a source that remains silent, in multiples of its patience.
const LONGEST: u32 = 8;

/// A port that is to send to an input. A connection says nothing about it: another program may be connected, or the
/// connection may have lost its other end without notice. So only its messages count.
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
    /// This port, which is asked to connect again after each `patience` of silence; more rarely the longer it lasts.
    pub fn new(port: &str, carrier: Carrier, patience: Duration) -> StreamSource {
        let (port, name) = (port.to_owned(), Contact::parse(port).name);
        StreamSource { port, name, carrier, patience, wait: patience, due: clock::now() + patience }
    }

    /// The next message that comes to the input, from whatever port; `None` when the input is closed.
    ///
    /// # Errors
    /// The source was silent and can't be connected to; it is tried again in the next call.
    pub async fn recv(&mut self, input: &mut InputPort) -> Result<Option<Message>, PortError> {
        let name = input.core().network.full_name(&self.name);
        let mut alone = false;
        loop {
            // messages of others don't put it off
            if clock::now() >= self.due || alone {
                let connected = input.connect_from(&self.port, self.carrier).await;
                self.due = clock::now() + self.wait;
                self.wait = (2 * self.wait).min(LONGEST * self.patience);
                connected?;
            }
            match timeout_at(self.due.min(clock::now() + LOOK), input.recv()).await {
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
