//! A YARP network of its own with a simulated robot of two parts, on a thread of its own.

#![allow(clippy::disallowed_methods, reason = "real sockets live in real time")]

use crate::way::Way;
use mobee_contract::{Axis, Command, Driver, Move, Sample, Time};
use mobee_driver_yarp::{SimBoard, SimClock, YarpDriverSettings, YarpHardware, joint_kind};
use mobee_model::Robot;
use mobee_sim::{SimHardware, SimSettings};
use mobee_yarp::Network;
use mobee_yarp::board::{BoardServer, Device, Units};
use mobee_yarp::name::{NameServer, ServerOptions};
use std::net::SocketAddr;
use std::sync::{Arc, mpsc};
use std::time::Duration;

/// Two parts: a trunk of two motors, an arm of three.
const ROBOT: &str = r#"<ZeroPositionKinematicTree version="1.0" robotName="two">
<bodypart name="trunk">
  <motor name="yaw" idx="0" minPos="-50" maxPos="50"><joint z="1" minPos="-50" maxPos="50">
  <link z="0.2" radius="0.02">
  <motor name="elbow" idx="1" minPos="15" maxPos="106" homePos="60"><joint y="1" minPos="15" maxPos="106">
  <link z="0.2" radius="0.02">
  <bodypart name="arm">
    <motor name="shoulder" idx="0" minPos="-60" maxPos="60"><joint x="1" minPos="-60" maxPos="60">
    <link z="0.2" radius="0.02">
    <motor name="wrist" idx="1" minPos="-40" maxPos="40"><joint y="1" minPos="-40" maxPos="40">
    <link z="0.1" radius="0.02">
    <motor name="stiff" idx="2" minPos="0" maxPos="1"><joint z="1" minPos="0" maxPos="1">
    <link z="0.1" radius="0.02"></link>
    </joint></motor>
    </link></joint></motor></link></joint></motor>
  </bodypart>
  </link></joint></motor></link></joint></motor>
</bodypart>
</ZeroPositionKinematicTree>"#;

/// A part of three motors, the first and the last of which slide: a rail, a turn, a gripper.
const SLIDING: &str = r#"<ZeroPositionKinematicTree version="1.0" robotName="gantry">
<bodypart name="arm">
  <motor name="rail" minPos="-400" maxPos="600"><joint type="prismatic" x="1" minPos="-0.4" maxPos="0.6">
  <link z="0.2" radius="0.02">
  <motor name="turn" minPos="-60" maxPos="60"><joint y="1" minPos="-60" maxPos="60">
  <link z="0.2" radius="0.02">
  <motor name="gripper" minPos="0" maxPos="40" home="20"><joint type="prismatic" x="1" minPos="0" maxPos="0.04">
  <link z="0.1" radius="0.02"></link>
  </joint></motor></link></joint></motor></link></joint></motor>
</bodypart>
</ZeroPositionKinematicTree>"#;

/// A robot with motors that slide, and how it is driven.
pub fn sliding() -> (Robot, YarpDriverSettings) {
    let settings = YarpDriverSettings::of([("arm", "/two/arm")]);
    let robot = mobee_model::parse_robot("gantry.xml", SLIDING).unwrap().value;
    (robot, YarpDriverSettings { max_speed_deg_per_s: 100.0, latency_ms: 80.0, ..settings })
}

pub fn robot() -> Robot {
    mobee_model::parse_robot("two.xml", ROBOT).unwrap().value
}

pub fn settings() -> YarpDriverSettings {
    let settings = YarpDriverSettings::of([("trunk", "/two/trunk"), ("arm", "/two/arm")]);
    YarpDriverSettings { max_speed_deg_per_s: 100.0, latency_ms: 80.0, ..settings }
}

/// What can be done to the network.
#[derive(Clone, Copy, Debug)]
pub enum Act {
    BoardsDown,
    BoardsUp,
    ServerDown,
    ServerUp,
}

pub struct Net {
    pub robot: Robot,
    settings: YarpDriverSettings,
    /// The simulated boards themselves, whatever the network does.
    pub boards: Vec<Arc<SimBoard>>,
    /// The way to each of them.
    pub ways: Vec<Arc<Way>>,
    address: SocketAddr,
    acts: Option<tokio::sync::mpsc::Sender<(Act, mpsc::SyncSender<()>)>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Net {
    pub fn start() -> Net {
        Net::of(robot(), settings())
    }

    /// Boards of another robot.
    pub fn of(robot: Robot, settings: YarpDriverSettings) -> Net {
        let clock = SimClock::start(1.0, 1.79e9);
        let board = |p: &mobee_model::Part| {
            let units = Units::new(robot.motors[p.motors.clone()].iter().map(|m| joint_kind(m.motion)));
            let board = SimBoard::new(&p.name, simulated(&robot, &p.name), clock).unwrap();
            Arc::new(board.counting(&units))
        };
        let boards: Vec<Arc<SimBoard>> = robot.parts.iter().map(board).collect();
        let ways: Vec<Arc<Way>> = boards.iter().map(|b| Arc::new(Way::to(b.clone()))).collect();
        let (acts, told) = tokio::sync::mpsc::channel(1);
        let (tell, ready) = mpsc::sync_channel(1);
        let devices = ways.clone();
        let thread = std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            runtime.block_on(live(devices, told, tell));
        });
        Net { robot, settings, boards, ways, address: ready.recv().unwrap(), acts: Some(acts), thread: Some(thread) }
    }

    pub fn act(&self, act: Act) {
        let (done, wait) = mpsc::sync_channel(1);
        self.acts.as_ref().unwrap().blocking_send((act, done)).unwrap();
        wait.recv().unwrap();
    }

    pub fn network(&self) -> Network {
        Network::at(self.address)
    }

    pub fn settings(&self) -> YarpDriverSettings {
        self.settings.clone()
    }

    /// Where the motors really are, deg, or m.
    pub fn truth(&self) -> Vec<f64> {
        self.boards.iter().flat_map(|b| b.state().unwrap().1.position.values).collect()
    }
}

async fn live(
    devices: Vec<Arc<Way>>,
    mut told: tokio::sync::mpsc::Receiver<(Act, mpsc::SyncSender<()>)>,
    ready: mpsc::SyncSender<SocketAddr>,
) {
    let server = NameServer::bind("127.0.0.1:0".parse().unwrap(), ServerOptions::default()).await.unwrap();
    let (address, network) = (server.address(), server.network());
    let mut server = Some(server);
    let mut boards = open(&network, &devices).await;
    ready.send(address).unwrap();
    while let Some((act, done)) = told.recv().await {
        match act {
            Act::BoardsDown => {
                for board in boards.drain(..) {
                    board.close().await;
                }
            }
            Act::BoardsUp => boards = open(&network, &devices).await,
            Act::ServerDown => server.take().unwrap().close().await,
            Act::ServerUp => server = Some(NameServer::bind(address, ServerOptions::default()).await.unwrap()),
        }
        done.send(()).unwrap();
    }
    for board in boards {
        board.close().await;
    }
    if let Some(server) = server {
        server.close().await;
    }
}

async fn open(network: &Network, devices: &[Arc<Way>]) -> Vec<BoardServer> {
    let mut boards = Vec::new();
    for device in devices {
        let prefix = format!("/two/{}", device.board.part());
        boards.push(BoardServer::open(network, &prefix, device.clone(), Duration::from_millis(20)).await.unwrap());
    }
    boards
}

fn simulated(robot: &Robot, part: &str) -> SimHardware {
    let motors = robot.parts.iter().find(|p| p.name == part).unwrap().motors.clone();
    let axis = |m: &mobee_model::Motor| Axis {
        name: m.name.clone(),
        min: m.min,
        max: m.max,
        max_speed: 100f64.to_radians(),
        max_acceleration: 200f64.to_radians(),
        motion: m.motion,
        ..Default::default()
    };
    let motors = &robot.motors[motors];
    let start: Vec<f64> = motors.iter().map(|m| m.home).collect();
    SimHardware::with_axes(motors.iter().map(axis).collect(), &start, &SimSettings::ideal(), 11)
}

impl Drop for Net {
    fn drop(&mut self) {
        drop(self.acts.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(20);

/// A robot on a network of its own, as its driver sees it.
pub struct Rig {
    pub hardware: YarpHardware,
    begun: tokio::time::Instant,
    pub net: Net,
}

impl Rig {
    pub fn new() -> Rig {
        Rig::on(Net::start())
    }

    pub fn on(net: Net) -> Rig {
        let hardware = YarpHardware::on(&net.network(), &net.settings(), &net.robot).unwrap();
        Rig { hardware, begun: tokio::time::Instant::now(), net }
    }

    pub fn now(&self) -> Time {
        Time(self.begun.elapsed().as_nanos() as u64 + 1_000_000_000)
    }

    pub fn wait<T>(&self, what: &str, mut there: impl FnMut(Time) -> Option<T>) -> T {
        let end = self.now() + PATIENCE;
        while self.now() < end {
            if let Some(found) = there(self.now()) {
                return found;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        panic!("waited in vain for {what}");
    }

    /// Keeps the lease until a reading is as wanted.
    pub fn reading(&self, driver: &mut Box<dyn Driver>, what: &str, wanted: impl Fn(&Sample) -> bool) -> Sample {
        self.wait(what, |now| {
            driver.lease(now, now + Duration::from_millis(500));
            driver.sample(now).unwrap_or_else(|e| panic!("{what}: {e}")).filter(|s| wanted(s))
        })
    }

    /// Keeps the lease until something is so.
    pub fn keep<T>(&self, driver: &mut Box<dyn Driver>, what: &str, mut there: impl FnMut(Time) -> Option<T>) -> T {
        self.wait(what, |now| {
            driver.lease(now, now + Duration::from_millis(500));
            there(now)
        })
    }

    /// A move of the yaw, in degrees.
    pub fn yaw(&self, to: f64, speed: f64) -> Command {
        let (q, speed) = (vec![to.to_radians()], Some(vec![speed.to_radians()]));
        Command::Move(Move { motors: vec![0], q, relative: false, speed, acceleration: None })
    }

    /// A move of the yaw, well under way.
    pub fn under_way(&self, driver: &mut Box<dyn Driver>) {
        self.reading(driver, "a first reading", |_| true);
        let there = Move {
            motors: vec![0, 2],
            q: [45f64, 50.0].map(f64::to_radians).to_vec(),
            relative: false,
            speed: Some([10f64, 12.0].map(f64::to_radians).to_vec()),
            acceleration: None,
        };
        driver.command(self.now(), &Command::Move(there)).unwrap();
        self.reading(driver, "the motors to move", |s| s.q[0].to_degrees() > 5.0 && s.q[2].to_degrees() > 5.0);
    }

    pub fn rests(&self) -> Vec<f64> {
        self.wait("rest", |_| {
            let before = self.net.truth();
            std::thread::sleep(Duration::from_millis(200));
            let after = self.net.truth();
            before.iter().zip(&after).all(|(a, b)| (a - b).abs() < 0.1).then_some(after)
        })
    }
}
