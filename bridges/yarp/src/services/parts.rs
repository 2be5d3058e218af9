//! Ports of a robot's parts and of the robot itself, and the force-field controllers behind them.
//!
//! Collisions and observations are published at `/MoBeE/<robot>/collisions:o` and `observation:o`: they
//! belong to the robot, like its filtered boards, and the original had no names for them.

use super::YarpSettings;
use super::steering::Steering;
use mobee_contract::{Filtered, Latest, Running};
use mobee_filter::force_field::ForceField;
use mobee_filter::observation;
use mobee_filter::part_rpc::{self, PartView};
use mobee_model::Robot;
use mobee_yarp::{
    Delivery, Handler, InputPort, Message, Network, OutputPort, Payload, PortError, Queue, RpcServer, Stamp,
};
use std::collections::BTreeSet;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Time between two messages, and between two cycles of the force field.
const PERIOD: Duration = Duration::from_millis(20);

/// Ports of one robot.
pub(super) struct OpenRobotPorts {
    robot: Arc<SharedRobot>,
    servers: Vec<RpcServer>,
    parts: Vec<PartPorts>,
    collisions: OutputPort,
    observation: OutputPort,
}

/// State shared by all ports of a robot.
pub(super) struct SharedRobot {
    pub running: Arc<dyn Running>,
    pub filtered: Arc<dyn Filtered>,
    pub model: Arc<Robot>,
    pub network: Network,
    /// Velocities commanded to each motor, deg/s.
    pub commanded: Mutex<Vec<f64>>,
}

pub(super) struct PartPorts {
    pub part: usize,
    state: OutputPort,
    pub control: Option<(ForceField, InputPort)>,
}

impl OpenRobotPorts {
    /// Opens all ports. `taken` contains the names of parts of earlier robots.
    ///
    /// # Errors
    /// A message with the remedy.
    pub(super) async fn open(
        network: &Network,
        running: &Arc<dyn Running>,
        filtered: &Arc<dyn Filtered>,
        model: &Arc<Robot>,
        settings: &YarpSettings,
        taken: &mut BTreeSet<String>,
    ) -> Result<OpenRobotPorts, String> {
        let wrong = |e: PortError| e.to_string();
        let robot = Arc::new(SharedRobot {
            running: running.clone(),
            filtered: filtered.clone(),
            model: model.clone(),
            network: network.clone(),
            commanded: Mutex::new(vec![0.0; model.motors.len()]),
        });
        let own = format!("{}/{}", settings.prefix, filtered.name());
        let handler = Arc::new(RpcHandler(robot.clone(), RpcReceiver::Robot));
        let mut servers = vec![RpcServer::open(network, &format!("{own}/rpc"), handler).await.map_err(wrong)?];
        let writer = async |name: String| OutputPort::open(network, &name, Delivery::Newest).await.map_err(wrong);
        let (collisions, observed) =
            (writer(format!("{own}/collisions:o")).await?, writer(format!("{own}/observation:o")).await?);
        let mut parts = Vec::new();
        for (index, part) in model.parts.iter().enumerate() {
            let first = taken.insert(part.name.clone());
            let robots = running.robots();
            let prefix = settings.part_prefix(model, &part.name, first, robots.iter().map(|robot| robot.name()));
            let handler = Arc::new(RpcHandler(robot.clone(), RpcReceiver::Part(index)));
            servers.push(RpcServer::open(network, &format!("{prefix}/rpc"), handler).await.map_err(wrong)?);
            let state = writer(format!("{prefix}/state:o")).await?;
            let control = match settings.force_field.get(&part.name).filter(|_| settings.steers(&part.name, first)) {
                None => None,
                Some(constants) => {
                    let q = degrees(filtered.latest().q.get(part.motors.clone()).unwrap_or_default());
                    let field = ForceField::new(constants.clone(), part, &filtered.board().axes, &q).map_err(|e| {
                        format!("the force field of part {}: {e}; correct it in [yarp.force_field]", part.name)
                    })?;
                    let name = format!("{prefix}/cmd:i");
                    Some((field, InputPort::open(network, &name, Queue::Bounded(16)).await.map_err(wrong)?))
                }
            };
            parts.push(PartPorts { part: index, state, control });
        }
        Ok(OpenRobotPorts { robot, servers, parts, collisions, observation: observed })
    }

    /// Publishes to the connected ports.
    fn publish(&self, latest: &Latest, envelope: &str) {
        let is_read = |writer: &OutputPort| !writer.peers().is_empty();
        let envelope = || Some(envelope.to_owned());
        for ports in self.parts.iter().filter(|p| is_read(&p.state)) {
            let shares = self.robot.view(ports.part, &latest.q, &[], part_rpc::shares);
            ports.state.write(crate::part::floats(&shares), envelope());
        }
        if is_read(&self.collisions) {
            let scene = self.robot.running.scene();
            let contacts = observation::collisions(self.robot.filtered.index(), &latest.contacts, &scene);
            self.collisions.write(crate::observation::collisions(&contacts), envelope());
        }
        if is_read(&self.observation) {
            self.observation.write(crate::observation::observation(&self.robot.model, latest), envelope());
        }
    }

    /// Publishes and steers until `leave` is set, then closes the ports.
    pub(super) async fn serve(mut self, mut leave: tokio::sync::watch::Receiver<bool>) {
        let mut ticks = tokio::time::interval(PERIOD);
        ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
        let mut steering = Steering::new(&self.robot);
        let mut stamp = Stamp::default();
        loop {
            tokio::select! {
                _ = leave.wait_for(|leave| *leave) => break,
                _ = ticks.tick() => {}
            }
            let latest = self.robot.filtered.latest();
            stamp = stamp.next(self.robot.running.time_of_day(latest.at));
            self.publish(&latest, &stamp.envelope());
            steering.cycle(&self.robot, &mut self.parts).await;
        }
        for server in self.servers {
            server.close().await;
        }
        for ports in self.parts {
            ports.state.close().await;
            if let Some((_, reader)) = ports.control {
                reader.close().await;
            }
        }
        self.collisions.close().await;
        self.observation.close().await;
    }
}

/// Receiver of an RPC.
enum RpcReceiver {
    Robot,
    Part(usize),
}

struct RpcHandler(Arc<SharedRobot>, RpcReceiver);

impl Handler for RpcHandler {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        let robot = &self.0;
        let request = request.payload.bottle(robot.network.dialect()).unwrap_or_default();
        let latest = robot.filtered.latest();
        let reply = match self.1 {
            RpcReceiver::Robot => crate::robot::answer(&request, robot.filtered.as_ref()),
            RpcReceiver::Part(part) => {
                let commanded = robot.commanded.lock().unwrap_or_else(PoisonError::into_inner).clone();
                robot.view(part, &latest.q, &commanded, |view| crate::part::answer(&request, view))
            }
        };
        Box::pin(std::future::ready(Some(reply.into())))
    }
}

impl SharedRobot {
    fn view<T>(&self, part: usize, q: &[f64], commanded: &[f64], f: impl FnOnce(&PartView) -> T) -> T {
        let motors = self.model.parts.get(part).map(|p| p.motors.clone()).unwrap_or_default();
        let base = self.running.scene().base(self.filtered.index());
        let commanded = commanded.get(motors).unwrap_or_default();
        f(&PartView { robot: &self.model, part, base, q, commanded })
    }
}

pub(super) fn degrees(q: &[f64]) -> Vec<f64> {
    q.iter().map(|q| q.to_degrees()).collect()
}
