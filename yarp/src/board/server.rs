//! The four ports of a control board, in front of any device (spec sections 12 to 14).

use super::words;
use crate::payload::{pair, vector};
use crate::{
    Bottle, Delivery, Handler, JointData, Message, Network, OutputPort, Payload, PortError, RpcServer, Stamp, Value,
    Vocab,
};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::task::JoinHandle;
use tokio::time::MissedTickBehavior;

/// A future answer.
pub type Reply = Pin<Box<dyn Future<Output = Payload> + Send>>;

/// Device behind the ports: a robot, a simulation, a filter.
pub trait Device: Send + Sync + 'static {
    /// Answers a request. There is always an answer; `[fail]` if unsure.
    fn rpc(&self, request: Message) -> Reply;

    /// Handles a streamed command: head and body as received, checked only for being a head and numbers
    /// ([`super::Streamed::parse`] checks the rest). There is no answer, and it must not block.
    fn command(&self, from: &str, connection: u64, head: Bottle, body: Vec<f64>);

    /// Present state, in degrees (meters for prismatic joints), with its stamp; `None` to publish nothing
    /// this period.
    fn state(&self) -> Option<(Stamp, JointData)>;

    /// Reports the end of a client's connection.
    fn gone(&self, _connection: u64) {}
}

/// Server of a control board: `PREFIX/rpc:i`, `command:i`, `state:o` and `stateExt:o`.
pub struct BoardServer {
    rpc: RpcServer,
    command: RpcServer,
    state: Arc<OutputPort>,
    extended: Arc<OutputPort>,
    publishing: JoinHandle<()>,
}

impl BoardServer {
    /// Opens the four ports and publishes the device's state every period, as long as a client is connected.
    /// `rpc:i` is the last, so that a program that finds it finds all of them.
    ///
    /// # Errors
    /// A port that can't be opened; those opened before are closed again.
    pub async fn open(
        network: &Network,
        prefix: &str,
        device: Arc<dyn Device>,
        period: Duration,
    ) -> Result<BoardServer, PortError> {
        let name = |port: &str| format!("{prefix}/{port}");
        let handler = Arc::new(RequestHandler(device.clone()));
        let streaming = Streaming(device.clone(), network.clone());
        let command = RpcServer::open(network, &name("command:i"), Arc::new(streaming)).await?;
        let state = Arc::new(OutputPort::open(network, &name("state:o"), Delivery::Newest).await?);
        let extended = Arc::new(OutputPort::open(network, &name("stateExt:o"), Delivery::Newest).await?);
        let rpc = RpcServer::open(network, &name("rpc:i"), handler).await?;
        let publishing = tokio::spawn(publish(network.clone(), device, state.clone(), extended.clone(), period));
        Ok(BoardServer { rpc, command, state, extended, publishing })
    }

    /// Name of its RPC port.
    pub fn name(&self) -> &str {
        self.rpc.name()
    }

    /// Names of the clients connected to its RPC and streaming ports.
    pub fn clients(&self) -> Vec<String> {
        let mut all = self.rpc.peers();
        all.extend(self.command.peers());
        all
    }

    /// Closes the ports and unregisters them.
    pub async fn close(mut self) {
        self.publishing.abort();
        let _ = (&mut self.publishing).await;
        self.rpc.close().await;
        self.command.close().await;
        for writer in [self.state, self.extended] {
            if let Some(writer) = Arc::into_inner(writer) {
                writer.close().await;
            }
        }
    }
}

struct RequestHandler(Arc<dyn Device>);

impl Handler for RequestHandler {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        let answer = self.0.rpc(request);
        Box::pin(async move { Some(answer.await) })
    }

    fn gone(&self, connection: u64) {
        self.0.gone(connection);
    }
}

struct Streaming(Arc<dyn Device>, Network);

impl Handler for Streaming {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        let bottle = request.payload.bottle(self.1.dialect());
        match bottle.map_err(|e| e.to_string()).and_then(|b| pair::from_bottle(&b).map_err(|e| e.to_string())) {
            Ok((head, body)) => self.0.command(&request.from, request.connection, head, body),
            Err(error) => tracing::debug!(from = request.from, error, "a streamed command is malformed"),
        }
        Box::pin(std::future::ready(None))
    }

    fn gone(&self, connection: u64) {
        self.0.gone(connection);
    }
}

async fn publish(
    network: Network,
    device: Arc<dyn Device>,
    state: Arc<OutputPort>,
    extended: Arc<OutputPort>,
    period: Duration,
) {
    let mut ticks = tokio::time::interval(period.max(Duration::from_micros(100)));
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    loop {
        ticks.tick().await;
        let plain = !state.peers().is_empty();
        let rich = !extended.peers().is_empty();
        if !(plain || rich) {
            continue;
        }
        let Some((stamp, joints)) = device.state() else { continue };
        let dialect = network.dialect();
        if plain {
            state.write(vector::encode(&joints.position.values, dialect), Some(stamp.envelope()));
        }
        if rich {
            extended.write(joints.encode(dialect), Some(stamp.envelope()));
        }
    }
}

impl super::Shadow {
    /// Converts the shadow to the state that a board publishes.
    pub fn joint_data(&self) -> JointData {
        use crate::JointField;
        let known = |of: fn(&super::ShadowAxis) -> f64| JointField::known(self.axes.iter().map(of).collect());
        let words = |of: fn(&super::ShadowAxis) -> Vocab| {
            JointField::known(self.axes.iter().map(|a| i32::from_le_bytes(of(a).0.to_le_bytes())).collect())
        };
        let none = || JointField::unknown(self.axes.len());
        // one validity flag applies to all joints
        let torque: Option<Vec<f64>> = self.axes.iter().map(|a| a.torque).collect();
        JointData {
            position: known(|a| a.q),
            velocity: known(|a| a.speed),
            acceleration: known(|a| a.acc),
            motor_position: none(),
            motor_velocity: none(),
            motor_acceleration: none(),
            torque: torque.map_or_else(none, JointField::known),
            pwm: none(),
            current: none(),
            control_modes: words(|a| a.mode),
            interaction_modes: words(|a| a.interaction),
            temperature: none(),
        }
    }
}

/// True if a reply ends with `[ok]`, as every reply with values does.
pub(super) fn ends_well(reply: &Bottle) -> bool {
    reply.0.last() == Some(&Value::Vocab(words::OK))
}
