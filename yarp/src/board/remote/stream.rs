//! Port that receives a board's states.

use super::{RemoteState, SharedRemote};
use crate::clock;
use crate::payload::vector;
use crate::port::PortCore;
use crate::{InputPort, JointData, JointField, Message, PortError, Queue, Stamp};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::timeout;

/// Largest gap between two counts that counts as lost states; beyond it the board has restarted its count.
const GREATEST_GAP: u32 = 100_000;

/// Name of the port.
pub(super) fn name(shared: &SharedRemote) -> String {
    format!("{}/state:i", shared.options.local)
}

/// The open port, with the task that reads it.
pub(super) struct AxisStream {
    /// The port, for its name and for checks that the name is still its own.
    pub port: Arc<PortCore>,
    axes: mpsc::Sender<usize>,
    task: JoinHandle<()>,
}

impl AxisStream {
    /// Opens the port.
    pub async fn open(shared: Arc<SharedRemote>) -> Result<AxisStream, PortError> {
        let reader = InputPort::open(&shared.network, &name(&shared), Queue::Bounded(64)).await?;
        let port = reader.core().clone();
        let (axes, told) = mpsc::channel(1);
        let task = tokio::spawn(read(shared, reader, told));
        Ok(AxisStream { port, axes, task })
    }

    /// Requests the states of the board: the extended ones, or otherwise the plain ones.
    pub async fn begin(&mut self, shared: &SharedRemote, axes: usize) -> Result<(), String> {
        let _ = self.axes.try_send(axes);
        let mut why = String::new();
        for port in ["stateExt:o", "state:o"] {
            let source = format!("{}/{port}", shared.port);
            let carrier = shared.options.carrier.name();
            let connecting = crate::remote::connect(&shared.network, &source, &self.port.name, Some(carrier));
            match timeout(shared.options.timeout * 4, connecting).await {
                Ok(Ok(_)) => return Ok(()),
                Ok(Err(e)) => why = e.to_string(),
                Err(_) => why = format!("{source} does not answer"),
            }
        }
        Err(format!("no states: {why}"))
    }
}

impl AxisStream {
    /// True if its task has ended, and so nothing reads the states.
    pub fn is_over(&self) -> bool {
        self.task.is_finished()
    }

    /// Closes the port and releases its name.
    pub async fn close(mut self) {
        // its task ends when the sender is gone
        self.axes = mpsc::channel(1).0;
        self.over().await;
    }

    /// Ready when its task has ended.
    pub async fn over(&mut self) {
        if !self.task.is_finished() {
            let _ = (&mut self.task).await;
        }
    }
}

impl Drop for AxisStream {
    fn drop(&mut self) {
        self.task.abort();
    }
}

async fn read(shared: Arc<SharedRemote>, mut reader: InputPort, mut told: mpsc::Receiver<usize>) {
    let mut axes = None;
    let mut seq = 0;
    let mut last: Option<Stamp> = None;
    loop {
        let message = tokio::select! {
            biased;
            n = told.recv() => match n {
                None => break,
                n => {
                    axes = n;
                    continue;
                }
            },
            message = reader.recv() => message,
        };
        let Some(message) = message else { break };
        let arrived = clock::now();
        let Some(joints) = axes.and_then(|n| joints(&shared, &message, n)) else {
            tracing::debug!(board = shared.port, from = message.from, "a state that makes no sense");
            continue;
        };
        let stamp = message.envelope.as_deref().and_then(Stamp::from_envelope);
        let gap = match (last, stamp) {
            (Some(before), Some(now)) => now.count.wrapping_sub(before.count).wrapping_sub(1),
            _ => 0,
        };
        let gap = if gap < GREATEST_GAP { u64::from(gap) } else { 0 };
        shared.lost.fetch_add(gap, Ordering::Relaxed);
        seq += 1 + gap;
        last = stamp;
        shared.state.send_replace(Some(Arc::new(RemoteState { seq, stamp, arrived, joints })));
    }
    reader.close().await;
}

/// State in a message of either port; `None` unless it is finite and has one value per axis.
fn joints(shared: &SharedRemote, message: &Message, axes: usize) -> Option<JointData> {
    let bottle = message.payload.bottle(shared.network.dialect()).ok()?;
    let joints = match JointData::from_bottle(&bottle) {
        Ok(joints) => joints,
        Err(_) => {
            let position = JointField::known(vector::from_bottle(&bottle).ok()?);
            JointData { position, ..JointData::default() }
        }
    };
    let fits = joints.position.valid && joints.position.values.len() == axes;
    (fits && joints.position.values.iter().all(|q| q.is_finite())).then_some(joints)
}
