//! A connection to one given port without a port of our own, reconnected on demand.

use super::dial::{self, DialedConnection};
use super::{PortError, PortOptions, output};
use crate::{Carrier, Contact, Network};
use std::pin::Pin;
use std::task::Poll;
use std::time::Duration;
use tokio::time::{Sleep, sleep};

const MIN_PAUSE: Duration = Duration::from_millis(50);
const MAX_PAUSE: Duration = Duration::from_secs(2);

/// Holds the connection. A user takes it out and puts it back after success, so that a canceled exchange
/// never leaves a connection out of step.
pub(crate) struct Keeper {
    pub network: Network,
    pub options: PortOptions,
    pub carrier: Carrier,
    to: Contact,
    own_name: String,
    keep: bool,
    /// True if the last address of the other side may be tried.
    remembers: bool,
    last: Option<Contact>,
    line: Option<DialedConnection>,
    delay: Duration,
    pause: Option<Pin<Box<Sleep>>>,
}

impl Keeper {
    pub async fn connect(
        network: &Network,
        own_name: &str,
        to: Contact,
        carrier: Carrier,
        options: PortOptions,
    ) -> Result<Keeper, PortError> {
        let mut keeper = Keeper::idle(network, own_name, to, carrier, options);
        keeper.line = Some(keeper.dial().await?);
        Ok(keeper)
    }

    /// Creates a keeper without a connection.
    pub fn idle(network: &Network, own_name: &str, to: Contact, carrier: Carrier, options: PortOptions) -> Keeper {
        Keeper {
            network: network.clone(),
            options,
            carrier,
            to,
            own_name: network.full_name(own_name),
            keep: false,
            remembers: false,
            last: None,
            line: None,
            delay: MIN_PAUSE,
            pause: None,
        }
    }

    pub fn keep(&mut self) {
        self.keep = true;
    }

    /// Allows the last address of the other side as a fallback if the name server does not return one.
    pub fn remember(&mut self) {
        self.remembers = true;
    }

    pub fn to(&self) -> &Contact {
        &self.to
    }

    pub fn is_connected(&self) -> bool {
        self.line.is_some()
    }

    async fn dial(&mut self) -> Result<DialedConnection, PortError> {
        let last = self.last.as_ref().filter(|_| self.remembers);
        let found = match (dial::find(&self.network, &self.to).await, last) {
            (Err(PortError::Name(_) | PortError::Unknown(_)), Some(last)) => last.clone(),
            (found, _) => found?,
        };
        let line = dial::dial(&self.network, &self.options, &found, self.carrier, &self.own_name).await?;
        self.last = Some(found);
        Ok(line)
    }

    /// Takes the connection. A lost one is re-established if [`keep`](Keeper::keep) was called, but not
    /// before a pause that grows from failure to failure.
    pub async fn take(&mut self) -> Result<DialedConnection, PortError> {
        if let Some(line) = self.line.take() {
            return Ok(line);
        }
        if !self.keep {
            return Err(self.lost("the connection was lost"));
        }
        if self.is_pausing().await {
            return Err(self.lost("the connection was lost; waiting before the next attempt"));
        }
        self.pause = Some(Box::pin(sleep(self.delay)));
        self.delay = (self.delay * 2).min(MAX_PAUSE);
        self.dial().await
    }

    /// True if it is too early for another attempt. An unpolled sleep never ends, so it is polled here.
    async fn is_pausing(&mut self) -> bool {
        let Some(pause) = &mut self.pause else { return false };
        std::future::poll_fn(|cx| Poll::Ready(pause.as_mut().poll(cx).is_pending())).await
    }

    /// Waits until the next attempt is allowed, if there is no connection.
    pub async fn pause(&mut self) {
        if let (None, Some(pause)) = (&self.line, &mut self.pause) {
            pause.as_mut().await;
        }
    }

    /// Puts the connection back after success: if it is lost or canceled later, the first new attempt is made
    /// at once.
    pub fn put(&mut self, line: DialedConnection) {
        self.line = Some(line);
        (self.delay, self.pause) = (MIN_PAUSE, None);
    }

    /// Ends the connection in order.
    pub async fn close(self) {
        if let Some(line) = self.line
            && let Err(error) = output::leave(&self.network, &self.options, &self.own_name, self.carrier, line).await
        {
            tracing::debug!(to = %self.to, %error, "no orderly end of a connection");
        }
    }

    fn lost(&self, why: &str) -> PortError {
        PortError::Connect { to: self.to.to_string(), why: why.to_owned() }
    }
}
