//! `mobee locator run`: the locator of a sensor, and its world gate, in a process of their own.

use super::body::{Body, Unavailable};
use super::{RETRY_DELAY, RemoteSensor, RemoteSensorArgs, WarnOnce, port_name};
use crate::signals::Interrupt;
use miette::{IntoDiagnostic, Report};
use mobee_bridge_yarp::seen::SeenRegions;
use mobee_contract::{Admission, BodyState, Located, Locator, Sighting, Time};
use mobee_runtime::clock::{Clock, ClockKind};
use mobee_runtime::system::{LocatorSetup, WorldGate};
use mobee_yarp::{Bottle, Carrier, Dialect, InputPort, Message, Network, Queue, RpcClient, StreamSource, Value};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, sleep};

/// Maximum number of waiting messages of detectors; further ones are dropped.
const MAX_WAITING: usize = 16;
/// Interval at which a missing state of the boards is polled.
const STATE_POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Maximum number of those polls.
const MAX_STATE_POLLS: u32 = 100;
/// Interval at which failed requests to the world are retried, and stale objects are reported.
const RETRY_INTERVAL: Duration = Duration::from_millis(200);

/// Silence of a detector after which its port is reconnected: detectors report every image.
const RECONNECT_TIMEOUT: Duration = Duration::from_secs(2);

/// The arguments of `mobee locator run`.
#[derive(clap::Args, Clone, Debug)]
pub struct LocatorRunArgs {
    #[command(flatten)]
    configured: RemoteSensorArgs,
    /// The port of the world whose objects are moved.
    #[arg(long, value_name = "PORT", default_value = "/MoBeE/world", value_parser = port_name)]
    world: String,
}

/// Runs the locator of a sensor until Ctrl-C.
///
/// # Errors
/// Complaints about the configuration or the network, before any port is opened.
pub(crate) fn command(args: &LocatorRunArgs) -> Result<(), Report> {
    let mut configured = RemoteSensor::load(&args.configured)?;
    let at = format!("sensor[{}]", configured.index);
    let names: Vec<String> = configured
        .config
        .sensor
        .get(configured.index)
        .map(|s| s.eye.iter().map(|e| e.name.clone()).collect())
        .unwrap_or_default();
    let Some(locator) = configured.sensor()?.locator else {
        let help = "add a table [sensor.locator]; `mobee kinds` lists the kinds";
        return Err(configured.source.error(&at, "this sensor has no locator", help).into());
    };
    if locator.gate.is_none() {
        let help = "add a table [sensor.gate] with the objects that it keeps: objects = [\"cup\"]";
        return Err(configured.source.error(&at, "this sensor has no gate, and so moves no object", help).into());
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().into_diagnostic()?;
    runtime.block_on(serve(&configured, locator, names, &args.world))
}

async fn serve(configured: &RemoteSensor, setup: LocatorSetup, names: Vec<String>, world: &str) -> Result<(), Report> {
    configured.reach().await?;
    let mut interrupt = Interrupt::new();
    let clock = Clock::new(ClockKind::Real);
    let robots = configured.composition.scene.robots();
    let robot = robots.iter().find(|r| r.name == setup.robot).ok_or_else(|| Report::msg("the robot is not there"))?;
    let body = Body::watch(configured, &setup.robot, robot, &clock)?;
    let (send, seen) = mpsc::channel(MAX_WAITING);
    let mut ears = JoinSet::new();
    for name in &names {
        let own = format!("{}/locator/{name}:i", configured.ports);
        let theirs = format!("{}/{name}/regions:o", configured.ports);
        println!("{own} <- {theirs}");
        let ear =
            RegionReceiver { network: configured.network.clone(), own, theirs, name: name.clone(), send: send.clone() };
        ears.spawn(ear.listen());
    }
    println!("positions go to {world}; Ctrl-C ends");
    let locator = (setup.locator)().map_err(Report::msg)?;
    let gate = setup.gate.clone().map(|settings| WorldGate::new(settings, clock.now()));
    let rpc =
        RpcClient::keep(&configured.network, &format!("{}/locator/world:o", configured.ports), world, Carrier::Tcp);
    let mut process = LocatorProcess {
        setup,
        locator,
        gate,
        body,
        clock,
        world: World { rpc, port: world.to_owned(), due: BTreeMap::new() },
        dialect: configured.network.dialect(),
        warnings: WarnOnce::default(),
    };
    tokio::select! {
        () = process.work(seen) => {}
        () = interrupt.wait() => {}
    }
    ears.shutdown().await;
    Ok(())
}

/// Receives the regions of one detector.
struct RegionReceiver {
    network: Network,
    own: String,
    theirs: String,
    name: String,
    send: mpsc::Sender<(String, Message)>,
}

impl RegionReceiver {
    /// Receives forever, with retries: the detector may start later, or restart.
    async fn listen(self) {
        let mut warnings = WarnOnce::default();
        loop {
            match self.connected().await {
                Ok(mut port) => {
                    self.receive(&mut port, &mut warnings).await;
                    port.close().await;
                }
                Err(why) => warnings.warn(format!("nothing from {}: {why}; retrying", self.theirs)),
            }
            sleep(RETRY_DELAY).await;
        }
    }

    async fn connected(&self) -> Result<InputPort, String> {
        let mut port = InputPort::open(&self.network, &self.own, Queue::Newest).await.map_err(|e| e.to_string())?;
        match port.connect_from(&self.theirs, Carrier::Tcp).await {
            Ok(()) => Ok(port),
            Err(e) => {
                port.close().await;
                Err(e.to_string())
            }
        }
    }

    /// Receives while the port is open. Drops messages while too many wait: newer ones follow soon.
    async fn receive(&self, port: &mut InputPort, warnings: &mut WarnOnce) {
        let mut source = StreamSource::new(&self.theirs, Carrier::Tcp, RECONNECT_TIMEOUT);
        loop {
            match source.recv(port).await {
                Ok(Some(message)) => drop(self.send.try_send((self.name.clone(), message))),
                Ok(None) => return,
                Err(why) => warnings.warn(format!("nothing from {}: {why}; retrying", self.theirs)),
            }
        }
    }
}

/// The running locator.
struct LocatorProcess {
    setup: LocatorSetup,
    locator: Box<dyn Locator>,
    gate: Option<WorldGate>,
    body: Body,
    clock: Clock,
    world: World,
    dialect: Dialect,
    warnings: WarnOnce,
}

impl LocatorProcess {
    async fn work(&mut self, mut seen: mpsc::Receiver<(String, Message)>) {
        let mut look = interval(RETRY_INTERVAL);
        look.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                Some((eye, message)) = seen.recv() => self.receive(&eye, &message).await,
                _ = look.tick() => {
                    let stale = self.gate.as_mut().map(|gate| gate.stale(self.clock.now())).unwrap_or_default();
                    for object in stale {
                        eprintln!("{object} has not been seen for a while");
                    }
                }
            }
            self.world.send_due(&mut self.warnings).await;
        }
    }

    /// Processes the regions of one image.
    async fn receive(&mut self, eye: &str, message: &Message) {
        let bottle = message.payload.bottle(self.dialect).map_err(|e| e.to_string());
        let SeenRegions { intrinsics, regions } = match bottle.and_then(|bottle| SeenRegions::parse(&bottle)) {
            Ok(seen) => seen,
            Err(why) => return self.warnings.warn(format!("a message of {} was dropped: {why}", message.from)),
        };
        if regions.is_empty() {
            return;
        }
        let Some(at) = self.exposed(message) else {
            let why = "its stamp is no time of the last minute: set both machines' clocks alike";
            return self.warnings.warn(format!("a message of {} was dropped: {why}", message.from));
        };
        let Some(body) = self.body(at).await else { return };
        let camera: Arc<str> = eye.into();
        let sighting = |region| Sighting { camera: camera.clone(), intrinsics, region, at };
        let seen: Vec<Sighting> = regions.into_iter().map(sighting).collect();
        let located = catch_unwind(AssertUnwindSafe(|| self.locator.locate(&seen, &body)));
        match located {
            Ok(located) => self.admit(at, &located),
            Err(_) => match (self.setup.locator)() {
                Ok(rebuilt) => {
                    self.warnings.warn("the locator failed, and is rebuilt");
                    self.locator = rebuilt;
                }
                Err(why) => self.warnings.warn(format!("the locator failed, and can't be rebuilt: {why}")),
            },
        }
    }

    fn admit(&mut self, at: Time, located: &[Located]) {
        let answers = self.gate.as_mut().map(|gate| gate.admit(at, located)).unwrap_or_default();
        for (located, _) in located.iter().zip(answers).filter(|(_, answer)| *answer == Admission::Moved) {
            self.world.due.insert(located.object.clone(), located.position);
        }
    }

    /// Exposure time of an image by our clock; now if the message has no stamp. `None` if the stamp is of a different
    /// clock.
    fn exposed(&self, message: &Message) -> Option<Time> {
        let now = self.clock.now();
        let Some(stamp) = message.stamp() else { return Some(now) };
        let age = self.clock.time_of_day(now) - stamp.time;
        let age = Some(age).filter(|age| (-0.5..60.0).contains(age))?;
        Some(Time(now.0.saturating_sub((age.max(0.0) * 1e9) as u64)))
    }

    /// The configuration at a time, once its boards have reported it.
    async fn body(&mut self, at: Time) -> Option<BodyState> {
        for _ in 0..MAX_STATE_POLLS {
            match self.body.at(at) {
                Ok(body) => return Some(body),
                Err(Unavailable::NotYet) => sleep(STATE_POLL_INTERVAL).await,
                Err(Unavailable::NoMore) => return None,
            }
        }
        self.body.complain(&mut self.warnings);
        None
    }
}

/// The world of a run, and the updates for it.
struct World {
    rpc: RpcClient,
    port: String,
    /// Pending updates: the newest position of each object.
    due: BTreeMap<String, [f64; 3]>,
}

impl World {
    /// Sends the pending updates. If the world does not answer, they stay pending.
    async fn send_due(&mut self, warnings: &mut WarnOnce) {
        while let Some((object, [x, y, z])) = self.due.pop_first() {
            let request = Bottle::new().with("set").with(object.as_str()).with(x).with(y).with(z);
            match self.rpc.call(&request).await {
                Ok(reply) if is_done(&reply) => println!("{object} at {x:.4} {y:.4} {z:.4}"),
                Ok(reply) => warnings.warn(format!("{} does not move {object}: {}", self.port, reply)),
                Err(e) => {
                    warnings.warn(format!("the world does not answer: {e}; start `mobee run` with a table [yarp]"));
                    self.due.entry(object).or_insert([x, y, z]);
                    return;
                }
            }
        }
    }
}

/// True if the world reports that it moved the object.
fn is_done(reply: &Bottle) -> bool {
    reply.0.get(1).and_then(Value::as_text).is_some_and(|warnings| warnings.starts_with("Set "))
}
