//! Traits of boards and of the connections to them, implemented over YARP and over the simulated wire of
//! `sim.rs`.

use super::layout::Patch;
use super::questions::Questions;
use mobee_yarp::board::{Ask, AxisFacts, LinkState, RemoteBoard, RemoteOptions, RemoteState, Streamed};
use mobee_yarp::{Bottle, CallError, Carrier, Network, RpcClient};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;

/// Boxed future.
pub type Later<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// Access to the boards of a robot. Its methods are called within a tokio runtime.
pub trait Wire: Send + Sync {
    /// Creates the client of a board, which connects and reconnects by itself. `None` if there is no such
    /// board.
    fn board(&self, patch: &Patch, options: RemoteOptions) -> Option<Arc<dyn Remote>>;
    /// Creates the connection for stops under the port name `own`; answers are awaited for at most `timeout`.
    fn stop_line(&self, patch: &Patch, own: &str, timeout: Duration) -> Option<Box<dyn StopLine>>;
    /// Creates a connection for queries of other programs, if supported, under port names that begin with
    /// `local`.
    fn questions(&self, patch: &Patch, local: &str, timeout: Duration) -> Option<Questions>;
}

/// Client of one board; see [`RemoteBoard`], which has the same methods.
pub trait Remote: Send + Sync {
    /// Prefix of the board's port names.
    fn port(&self) -> &str;
    /// State of the connection, as it changes.
    fn link(&self) -> watch::Receiver<LinkState>;
    /// Facts of the board's axes, as they change.
    fn facts(&self) -> watch::Receiver<Option<Arc<[AxisFacts]>>>;
    /// The newest state, as it changes.
    fn state(&self) -> watch::Receiver<Option<Arc<RemoteState>>>;
    /// Number of states lost in transit.
    fn lost(&self) -> u64;
    /// Sends requests to the board, one after the other. Without an answer, the outcome of an order is
    /// unknown.
    fn ask<'a>(&'a self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>>;
    /// Sends setpoints, which have no answer; `false` if too many are waiting.
    fn stream(&self, command: Streamed) -> bool;
    /// Discards the setpoints that still wait to be sent.
    fn hush(&self);
    /// Ready when the client can't be used any more.
    fn died(&self) -> Later<'_, ()>;
    /// Closes the client in order, which frees its port names.
    fn close(&self) -> Later<'_, ()>;
}

/// Connection to a board that only its brake uses.
pub trait StopLine: Send {
    /// Sends a request and waits for the answer.
    fn send<'a>(&'a mut self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>>;
}

impl Wire for Network {
    fn board(&self, patch: &Patch, options: RemoteOptions) -> Option<Arc<dyn Remote>> {
        Some(Arc::new(RemoteBoard::new(self, &patch.port, options)))
    }

    fn stop_line(&self, patch: &Patch, own: &str, timeout: Duration) -> Option<Box<dyn StopLine>> {
        let network = self.clone().with_timeout(timeout);
        // a stop must reach its board even while no name server runs
        let line = RpcClient::keep(&network, own, &format!("{}/rpc:i", patch.port), Carrier::Tcp).remembering();
        Some(Box::new(line))
    }

    fn questions(&self, patch: &Patch, local: &str, timeout: Duration) -> Option<Questions> {
        Some(Questions::new(&self.clone().with_timeout(timeout), local, &patch.port))
    }
}

impl Remote for RemoteBoard {
    fn port(&self) -> &str {
        RemoteBoard::port(self)
    }
    fn link(&self) -> watch::Receiver<LinkState> {
        RemoteBoard::link(self)
    }
    fn facts(&self) -> watch::Receiver<Option<Arc<[AxisFacts]>>> {
        RemoteBoard::facts(self)
    }
    fn state(&self) -> watch::Receiver<Option<Arc<RemoteState>>> {
        RemoteBoard::state(self)
    }
    fn lost(&self) -> u64 {
        RemoteBoard::lost(self)
    }
    fn ask<'a>(&'a self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>> {
        Box::pin(RemoteBoard::ask(self, request))
    }
    fn stream(&self, command: Streamed) -> bool {
        RemoteBoard::stream(self, command)
    }
    fn hush(&self) {
        RemoteBoard::hush(self);
    }
    fn died(&self) -> Later<'_, ()> {
        Box::pin(RemoteBoard::died(self))
    }
    fn close(&self) -> Later<'_, ()> {
        Box::pin(RemoteBoard::close(self))
    }
}

impl StopLine for RpcClient {
    fn send<'a>(&'a mut self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>> {
        Box::pin(async move { self.call(&request.bottle()).await })
    }
}
