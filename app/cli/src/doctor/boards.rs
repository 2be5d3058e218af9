//! The network: the name server, and the control boards of a robot.

use super::{ANSWER_TIMEOUT, Finding, ModelMotor, YarpRobot};
use mobee_driver_yarp::joint_kind;
use mobee_yarp::board::{Ask, Get, LinkState, RemoteBoard, RemoteOptions, Units};
use mobee_yarp::config::{self, Env};
use mobee_yarp::{Carrier, Network};
use std::time::Duration;

/// Number of round trips for the answer time.
const ROUND_TRIPS: usize = 10;
/// Time for which states are counted.
const COUNT_TIME: Duration = Duration::from_secs(1);

/// Checks that the name server answers.
pub(super) async fn name_server(network: &Network, needed: bool) -> Finding {
    match network.clone().with_timeout(ANSWER_TIMEOUT).list("").await {
        Ok(ports) => {
            let (host, port) = network.server();
            Finding::ok(format!("the YARP name server at {host}:{port} answers; it knows {} ports", ports.len()))
        }
        Err(e) if needed => Finding::bad(e.to_string(), "start it: `mobee yarp server`, or `yarpserver`"),
        Err(e) => Finding::warn(e.to_string(), "only robots and programs behind YARP need it: `mobee yarp server`"),
    }
}

/// Checks each board of a robot, and counts its states.
pub(super) async fn robot(robot: &YarpRobot) -> Vec<Finding> {
    let network = match &robot.settings.server {
        Some(server) => match server.parse::<Network>() {
            Ok(network) => network,
            Err(e) => return vec![Finding::bad(e.to_string(), "mend `server` in the driver's table")],
        },
        // reported already
        None => match config::network_or_default(&Env::real()) {
            Ok(network) => network,
            Err(_) => return Vec::new(),
        },
    };
    let mut found = Vec::new();
    if robot.settings.server.is_some() {
        found.push(name_server(&network, true).await);
    }
    for (part, motors) in robot.settings.parts.iter().zip(&robot.motors) {
        let what = format!("{} {} at {}", robot.name, part.part, part.port);
        found.extend(board(robot, &network, &part.port, motors, what).await);
    }
    found
}

/// Checks a board through ports of our own, whose names are removed afterwards.
async fn board(robot: &YarpRobot, network: &Network, port: &str, motors: &[ModelMotor], what: String) -> Vec<Finding> {
    let options = RemoteOptions {
        local: format!("/MoBeE/doctor/{}{port}", std::process::id()),
        carrier: robot.settings.carrier.parse().unwrap_or(Carrier::FastTcp),
        timeout: robot.settings.timeout(),
        stale: robot.settings.stale(),
    };
    let board = RemoteBoard::new(network, port, options);
    let found = check_link(robot, &board, port, motors, what).await;
    let _ = tokio::time::timeout(ANSWER_TIMEOUT, board.close()).await;
    found
}

async fn check_link(
    robot: &YarpRobot,
    board: &RemoteBoard,
    port: &str,
    motors: &[ModelMotor],
    what: String,
) -> Vec<Finding> {
    let mut link = board.link();
    let up = async { link.wait_for(|link| matches!(link, LinkState::Up(_))).await.is_ok() };
    if !tokio::time::timeout(ANSWER_TIMEOUT, up).await.unwrap_or(false) {
        let why = match &*board.link().borrow() {
            LinkState::Down(why) | LinkState::Taken(why) => why.clone(),
            LinkState::Up(_) => String::new(),
        };
        let remedy = format!("start the robot\'s boards, and see `mobee yarp list {port}` for what is there");
        return vec![Finding::bad(format!("{what}: {why}"), remedy)];
    }
    let facts = board.facts().borrow().clone().unwrap_or_default();
    let axes = facts.len();
    if axes != motors.len() {
        let remedy = "give the model of this robot, and the ports of this part";
        return vec![Finding::bad(format!("{what}: {axes} joints, {} in the model", motors.len()), remedy)];
    }
    let mut found = Vec::new();
    let units = Units::new(motors.iter().map(|m| joint_kind(m.motion)));
    for (joint, (motor, fact)) in motors.iter().zip(facts.iter()).enumerate() {
        let joint = format!("joint {joint} of {port}");
        let wrong = mobee_driver_yarp::disagreement(fact.kind, joint_kind(motor.motion), &motor.name, &joint);
        found.extend(wrong.map(|[what, remedy]| Finding::bad(what, remedy)));
    }
    let limits = motors.iter().zip(facts.iter()).enumerate().filter_map(|(joint, (motor, fact))| {
        let (min, max) = units.facts_from_wire(joint, fact).limits?;
        Some((motor.name.as_str(), motor.motion, motor.limits, (min.to_radians(), max.to_radians())))
    });
    if let Some(less) = mobee_contract::narrowed(limits) {
        let remedy = "the narrower limits apply; put them into the model too if they are the robot's";
        found.push(Finding::warn(format!("{what}: {less}"), remedy));
    }
    found.push(states(robot, board, port, axes, what).await);
    found
}

/// Checks the answer time of a board, and its stream of states.
async fn states(robot: &YarpRobot, board: &RemoteBoard, port: &str, axes: usize, what: String) -> Finding {
    let mut state = board.state();
    let answers = answer_time(board).await;
    let first = async { state.wait_for(Option::is_some).await.is_ok() };
    let streams = tokio::time::timeout(ANSWER_TIMEOUT, first).await.unwrap_or(false);
    let seq = || board.state().borrow().as_ref().map_or(0, |s| s.seq);
    let before = seq();
    if streams {
        tokio::time::sleep(COUNT_TIME).await;
    }
    let rate = seq().saturating_sub(before) as f64 / COUNT_TIME.as_secs_f64();
    let wanted = 1.0 / robot.settings.period().as_secs_f64();
    let what = format!("{what}: {axes} joints, {rate:.0} states per second of {wanted:.0}, answers in {answers:.0?}");
    if rate == 0.0 {
        return Finding::bad(what, format!("check that {port}/state:o exists and sends"));
    }
    if rate < 0.8 * wanted {
        return Finding::warn(what, "set the driver\'s period_ms to the board\'s real period, or check the network");
    }
    if answers > robot.settings.latency() {
        let remedy = "the filter does not open while that is longer than the driver's latency_ms: find out what slows the board, \
                      or allow more and keep a wider margin";
        return Finding::warn(what, remedy);
    }
    Finding::ok(what)
}

/// The second longest of some round trips.
async fn answer_time(board: &RemoteBoard) -> Duration {
    let mut took = Vec::new();
    for _ in 0..ROUND_TRIPS {
        let begun = now();
        if board.ask(&Ask::Get(Get::Axes)).await.is_ok() {
            took.push(begun.elapsed());
        }
    }
    took.sort();
    took.get(took.len().saturating_sub(2)).copied().unwrap_or(ANSWER_TIMEOUT)
}

#[expect(clippy::disallowed_methods, reason = "it is real time that a board takes to answer")]
fn now() -> tokio::time::Instant {
    tokio::time::Instant::now()
}
