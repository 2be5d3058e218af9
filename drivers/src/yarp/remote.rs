//! What the crew needs of boards and of the way to them: over YARP, or over the simulated wire of `sim.rs`.

use super::layout::Patch;
use super::questions::Questions;
use mobee_yarp::board::{Ask, AxisFacts, LinkState, RemoteBoard, RemoteOptions, RemoteState, Streamed};
use mobee_yarp::{Bottle, CallError, Carrier, Network, RpcClient};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;

/// What comes later, at the cost of a box.
pub type Later<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// How the boards of a robot are reached. Its methods are called within a tokio runtime.
pub trait Wire: Send + Sync {
    /// The client of a board, which connects by itself and for ever again. `None`: there is no such board.
    fn board(&self, patch: &Patch, options: RemoteOptions) -> Option<Arc<dyn Remote>>;
    /// The line for stops, under the port name `own`; answers are waited for no longer than `timeout`.
    fn stop_line(&self, patch: &Patch, own: &str, timeout: Duration) -> Option<Box<dyn StopLine>>;
    /// A line for the questions of others, if there is one, under port names that begin with `local`.
    fn questions(&self, patch: &Patch, local: &str, timeout: Duration) -> Option<Questions>;
}

/// One board from afar; see [`RemoteBoard`], whose methods these are.
pub trait Remote: Send + Sync {
    /// First part of the board's port names.
    fn port(&self) -> &str;
    /// Whether there is a connection, as it changes.
    fn link(&self) -> watch::Receiver<LinkState>;
    /// What is known of the board's axes, as it changes.
    fn facts(&self) -> watch::Receiver<Option<Arc<[AxisFacts]>>>;
    /// The newest state, as it changes.
    fn state(&self) -> watch::Receiver<Option<Arc<RemoteState>>>;
    /// How many states were lost on the way.
    fn lost(&self) -> u64;
    /// Asks the board, one request after the other; without an answer it is not known whether an order was done.
    fn ask<'a>(&'a self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>>;
    /// Sends set-points that expect no answer; `false` if too many wait.
    fn stream(&self, command: Streamed) -> bool;
    /// Throws away the set-points that still wait to be sent.
    fn hush(&self);
    /// Ready when the client is of no use any more.
    fn died(&self) -> Later<'_, ()>;
    /// Ends in order; its port names are free then.
    fn close(&self) -> Later<'_, ()>;
}

/// A line to a board that nothing uses but its brake.
pub trait StopLine: Send {
    /// Says something and waits for the answer.
    fn say<'a>(&'a mut self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>>;
}

impl Wire for Network {
    fn board(&self, patch: &Patch, options: RemoteOptions) -> Option<Arc<dyn Remote>> {
        Some(Arc::new(RemoteBoard::new(self, &patch.port, options)))
    }

    fn stop_line(&self, patch: &Patch, own: &str, timeout: Duration) -> Option<Box<dyn StopLine>> {
        let network = self.clone().with_timeout(timeout);
        // a stop must find its board while no name server runs, too
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
    fn say<'a>(&'a mut self, request: &'a Ask) -> Later<'a, Result<Bottle, CallError>> {
        Box::pin(async move { self.call(&request.bottle()).await })
    }
}
