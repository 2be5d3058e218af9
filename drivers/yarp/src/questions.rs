//! Queries of other programs, passed on to a board on their own connection so that they never delay an order.

use mobee_contract::{Answer, DriverFault, NativeMessage};
use mobee_yarp::{Carrier, Network, RpcClient};
use std::sync::Arc;
use tokio::sync::{Mutex, Semaphore};

/// Number of queries that may wait for one board.
const WAITING: usize = 32;

/// Connection `LOCAL/ask:o ──> PREFIX/rpc:i`. Driven by the tasks of the callers, so that no other thread
/// stands between them and the board.
pub struct Questions {
    line: Arc<Mutex<RpcClient>>,
    room: Arc<Semaphore>,
}

impl Questions {
    /// Creates a connection to the board whose ports begin with `port`; it connects on use.
    pub fn new(network: &Network, local: &str, port: &str) -> Questions {
        let line = RpcClient::keep(network, &format!("{local}/ask:o"), &format!("{port}/rpc:i"), Carrier::Tcp);
        Questions { line: Arc::new(Mutex::new(line)), room: Arc::new(Semaphore::new(WAITING)) }
    }

    /// Passes on the bytes of a bottle and returns the board's answer. `None` if too many queries are
    /// waiting.
    pub fn pass(&self, question: NativeMessage) -> Option<Answer<Result<NativeMessage, DriverFault>>> {
        let line = self.line.clone();
        let place = self.room.clone().try_acquire_owned().ok()?;
        Some(Box::pin(async move {
            let answer = line.lock().await.call_raw(&question.0).await;
            drop(place);
            answer.map(NativeMessage).map_err(|error| {
                tracing::debug!(error = error.to_string(), "a question was not answered");
                DriverFault::Lost
            })
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Requests beyond the limit are refused until another one is answered or abandoned.
    #[test]
    fn no_more_questions_wait_than_there_is_room_for() {
        let questions = Questions::new(&Network::of("localhost", 1), "/own", "/arm");
        let ask = || questions.pass(NativeMessage(Vec::new()));
        let mut waiting: Vec<_> = (0..WAITING).map_while(|_| ask()).collect();
        assert!(waiting.len() == WAITING && ask().is_none());
        waiting.pop();
        assert!(ask().is_some());
    }
}
