//! The robot's body for an agent in another process: the filtered control boards of its parts, used by RPC only.
//!
//! A motion is commanded to every part that takes part in it. The first part's command opens the transaction, those of
//! the others join it, and `[don]` is 0 until the transaction has its outcome. If it fails, each part's connection
//! answers `[fail]` once.

use mobee_contract::{Axis, MotionEnd, Move, Target};
use mobee_model::{Part, Robot};
use mobee_yarp::board::Units;
use mobee_yarp::{Bottle, CallError, Carrier, Network, PortError, RpcClient, Value, Vocab};
use std::ops::Range;
use std::time::Duration;

/// Interval at which the boards are polled for the end of a motion.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Pause before a closed or lost board is polled again.
const RETRY_DELAY: Duration = Duration::from_millis(50);
/// Minimum distance of a motor that takes part in a motion, deg.
const MIN_MOVE_DEG: f64 = 1e-3;
/// Minimum reference speed, deg/s.
const MIN_SPEED_DEG_PER_S: f64 = 0.01;
/// Of a minimum-jerk motion: ratio of its peak speed to its mean speed, and of its peak acceleration to distance over
/// time squared.
const PEAKS: (f64, f64) = (1.875, 5.774);

/// Errors of the body.
#[derive(Debug, thiserror::Error)]
pub enum BodyError {
    /// A port is not there.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A board does not answer.
    #[error(transparent)]
    Call(#[from] CallError),
    /// A board's answer does not follow the protocol.
    #[error("{port} answers {answer} to {request}")]
    Answer {
        /// The board's port.
        port: String,
        /// The request.
        request: String,
        /// The answer.
        answer: String,
    },
    /// A board of another part.
    #[error("{port} has {axes} axes, the part {part} of the model {motors} motors")]
    Axes {
        /// The board's port.
        port: String,
        /// Its axes.
        axes: i64,
        /// The part.
        part: String,
        /// The model's motors.
        motors: usize,
    },
}

/// The answer to a command.
enum BoardAnswer {
    Ok(Bottle),
    /// `[fail]`: closed, refused, or a motion that failed.
    Fail,
}

struct Board {
    port: String,
    motors: Range<usize>,
    /// The units of its joints on the wire.
    units: Units,
    rpc: RpcClient,
}

impl Board {
    async fn call(&mut self, request: &Bottle) -> Result<BoardAnswer, BodyError> {
        let answer = self.rpc.call(request).await?;
        match answer.0.last().and_then(Value::as_vocab) {
            Some(v) if v == Vocab::new("ok") => Ok(BoardAnswer::Ok(answer)),
            _ if answer.get(0).and_then(Value::as_vocab) == Some(Vocab::new("fail")) => Ok(BoardAnswer::Fail),
            _ => Err(BodyError::Answer {
                port: self.port.clone(),
                request: request.to_string(),
                answer: answer.to_string(),
            }),
        }
    }

    /// Polls until the board answers: a closed one answers `[fail]`, a lost one is reconnected.
    async fn reading(&mut self, request: &Bottle) -> Result<Bottle, BodyError> {
        let mut waited = Duration::ZERO;
        loop {
            match self.call(request).await {
                Ok(BoardAnswer::Ok(answer)) => return Ok(answer),
                Err(e @ (BodyError::Answer { .. } | BodyError::Axes { .. })) => return Err(e),
                Ok(BoardAnswer::Fail) => {}
                Err(e) if waited.is_zero() => eprintln!("waiting: {e}"),
                Err(_) => {}
            }
            waited += RETRY_DELAY;
            tokio::time::sleep(RETRY_DELAY).await;
        }
    }
}

/// The robot's body.
pub struct Body {
    boards: Vec<Board>,
    axes: Vec<Axis>,
    tolerance: f64,
}

fn words(words: &[&str]) -> Bottle {
    words.iter().map(|w| Value::Vocab(Vocab::new(w))).collect()
}

/// A command to a group of joints: `[set] [posg] n (J) (V)`.
fn group(code: &str, joints: &[usize], values: &[f64]) -> Bottle {
    let list: Bottle = joints.iter().map(|j| Value::Int32(i32::try_from(*j).unwrap_or(i32::MAX))).collect();
    let count = i32::try_from(joints.len()).unwrap_or(i32::MAX);
    let mut command = words(&["set", code]);
    command.push(Value::Int32(count)).push(Value::List(list));
    command.push(Value::List(values.iter().copied().map(Value::Float64).collect()));
    command
}

impl Body {
    /// Connects to the boards `PREFIX/<part>/rpc:i`, and reads their limits.
    ///
    /// # Errors
    /// If a board is missing, or belongs to another part.
    pub async fn connect(
        network: &Network,
        prefix: &str,
        robot: &Robot,
        axes: &[Axis],
        tolerance: f64,
    ) -> Result<Body, BodyError> {
        let mut boards = Vec::new();
        for Part { name, motors, .. } in robot.parts.iter().filter(|p| !p.motors.is_empty()) {
            let port = format!("{prefix}/{name}/rpc:i");
            let own = format!("{prefix}/{name}/agent{}/rpc:o", std::process::id());
            // the first connection must succeed; later ones are retried
            drop(RpcClient::connect(network, &own, &port, Carrier::Tcp).await?);
            let rpc = RpcClient::keep(network, &own, &port, Carrier::Tcp);
            let moved = robot.motors.get(motors.clone()).unwrap_or_default();
            let units = Units::new(moved.iter().map(|m| mobee_driver_yarp::joint_kind(m.motion)));
            let mut board = Board { rpc, port, motors: motors.clone(), units };
            let answer = board.reading(&words(&["get", "axes"])).await?;
            let axes = answer.get(2).and_then(Value::as_i64).unwrap_or(-1);
            if usize::try_from(axes) != Ok(motors.len()) {
                let port = board.port;
                let part = name.clone();
                return Err(BodyError::Axes { port, axes, part, motors: motors.len() });
            }
            boards.push(board);
        }
        let mut body = Body { boards, axes: axes.to_vec(), tolerance };
        body.read_limits().await?;
        Ok(body)
    }

    /// Reads the boards' own limits, which replace the model's where they are reported.
    async fn read_limits(&mut self) -> Result<(), BodyError> {
        for board in &mut self.boards {
            for (joint, motor) in board.motors.clone().enumerate() {
                let Some(axis) = self.axes.get_mut(motor) else { continue };
                let mut pair = [None, None];
                for (code, slot) in ["llim", "vlim"].iter().zip(&mut pair) {
                    let mut request = words(&["get", code]);
                    request.push(Value::Int32(i32::try_from(joint).unwrap_or(i32::MAX)));
                    let answer = board.reading(&request).await?;
                    let at = |i: usize| answer.get(i).and_then(Value::as_f64).filter(|v| v.is_finite());
                    let rad = |v: f64| board.units.kind(joint).from_wire(v).to_radians();
                    *slot = at(2).zip(at(3)).map(|(a, b)| (rad(a), rad(b)));
                }
                let [limits, speeds] = pair;
                if let Some((min, max)) = limits.filter(|(min, max)| min < max) {
                    (axis.min, axis.max) = (min, max);
                }
                if let Some((_, max)) = speeds.filter(|(_, max)| *max > 0.0) {
                    axis.max_speed = max;
                }
            }
        }
        Ok(())
    }

    /// The motors' limits.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Reads the robot's configuration, rad. Waits until all boards answer: all are open then, and have reported their
    /// failures.
    ///
    /// # Errors
    /// If a board's answer is malformed.
    pub async fn pose(&mut self) -> Result<Vec<f64>, BodyError> {
        let mut q = vec![0.0; self.axes.len()];
        let request = words(&["get", "encs"]);
        for board in &mut self.boards {
            let answer = board.reading(&request).await?;
            let read = answer.get(2).and_then(Value::as_list).and_then(Bottle::numbers);
            let slots = q.get_mut(board.motors.clone());
            match read.zip(slots).filter(|(read, slots)| read.len() == slots.len()) {
                Some((read, slots)) => {
                    for (joint, (slot, v)) in slots.iter_mut().zip(read).enumerate() {
                        *slot = board.units.kind(joint).from_wire(v).to_radians();
                    }
                }
                None => {
                    let port = board.port.clone();
                    let request = request.to_string();
                    return Err(BodyError::Answer { port, request, answer: answer.to_string() });
                }
            }
        }
        Ok(q)
    }

    /// Stops all motors.
    ///
    /// # Errors
    /// If a board does not answer.
    pub async fn stop(&mut self) -> Result<(), BodyError> {
        for board in &mut self.boards {
            board.call(&words(&["set", "stos"])).await?;
        }
        Ok(())
    }

    /// Drives to a target, with all motors arriving together or each at its own speed (rad/s), and waits for the end
    /// (WAITFORMOTION). `None`: the motion did not begin, because the filter was not ready.
    ///
    /// # Errors
    /// If a board's answer is malformed. If a board is lost during the motion, the motion has failed.
    pub async fn drive(
        &mut self,
        target: &Target,
        speeds: Option<&[f64]>,
        from: &[f64],
    ) -> Result<Option<MotionEnd>, BodyError> {
        let within = |(m, q): (&usize, &f64)| self.axes.get(*m).is_some_and(|a| *q >= a.min && *q <= a.max);
        if target.motors.len() != target.q.len() || !target.motors.iter().zip(&target.q).all(within) {
            return Ok(Some(MotionEnd::Failed));
        }
        let (motion, secs) = match speeds {
            Some(speeds) if speeds.len() != target.motors.len() => return Ok(Some(MotionEnd::Failed)),
            Some(speeds) => each(target, speeds, from),
            None => in_step(target, from, &self.axes),
        };
        let shares = self.shares(&motion);
        let speeds = shares.iter().map(|s| (s.board, group("velg", &s.joints, &s.speeds)));
        let goals = shares.iter().map(|s| (s.board, group("posg", &s.joints, &s.goals)));
        let commands: Vec<(usize, Bottle)> = speeds.chain(goals).collect();
        for (k, (b, command)) in commands.iter().enumerate() {
            let Some(board) = self.boards.get_mut(*b) else { continue };
            match board.call(command).await {
                Ok(BoardAnswer::Ok(_)) => {}
                // no motor has received its target yet
                Ok(BoardAnswer::Fail) | Err(BodyError::Call(_) | BodyError::Port(_)) if k <= shares.len() => {
                    return Ok(None);
                }
                Ok(BoardAnswer::Fail) | Err(BodyError::Call(_) | BodyError::Port(_)) => {
                    let _ = self.stop().await;
                    return Ok(Some(MotionEnd::Failed));
                }
                Err(e) => return Err(e),
            }
        }
        let patience = Duration::from_secs_f64((3.0 * secs + 30.0).min(1e6));
        let involved: Vec<usize> = shares.iter().map(|s| s.board).collect();
        match tokio::time::timeout(patience, self.wait(&involved)).await {
            Ok(Ok(true)) => {}
            Ok(Ok(false)) => return Ok(Some(MotionEnd::Failed)),
            Ok(Err(e)) => return Err(e),
            Err(_) => {
                let _ = self.stop().await;
                return Ok(Some(MotionEnd::Failed));
            }
        }
        let there = self.pose().await?;
        let near = |(m, q): (&usize, &f64)| there.get(*m).is_some_and(|at| (at - q).abs() <= self.tolerance);
        let reached = target.motors.iter().zip(&target.q).all(near);
        Ok(Some(if reached { MotionEnd::Reached } else { MotionEnd::Failed }))
    }

    /// Waits until these boards report the motion as done; `false` if one reports a failure, or is lost.
    async fn wait(&mut self, boards: &[usize]) -> Result<bool, BodyError> {
        let request = words(&["get", "dons"]);
        for b in boards {
            let Some(board) = self.boards.get_mut(*b) else { continue };
            loop {
                match board.call(&request).await {
                    Ok(BoardAnswer::Ok(answer)) if answer.get(2).and_then(Value::as_i64) == Some(1) => break,
                    Ok(BoardAnswer::Ok(_)) => {}
                    Ok(BoardAnswer::Fail) | Err(BodyError::Call(_) | BodyError::Port(_)) => return Ok(false),
                    Err(e) => return Err(e),
                }
                tokio::time::sleep(POLL_INTERVAL).await;
            }
        }
        Ok(true)
    }

    /// Each board's share in a motion.
    fn shares(&self, motion: &Move) -> Vec<Share> {
        let speeds = motion.speed.as_deref().unwrap_or_default();
        let of = |(index, board): (usize, &Board)| {
            let mut share = Share { board: index, joints: Vec::new(), goals: Vec::new(), speeds: Vec::new() };
            for ((motor, to), speed) in motion.motors.iter().zip(&motion.q).zip(speeds) {
                if board.motors.contains(motor) {
                    let joint = motor - board.motors.start;
                    let wire = |v: f64| board.units.kind(joint).to_wire(v);
                    share.joints.push(joint);
                    share.goals.push(wire(to.to_degrees()));
                    share.speeds.push(wire(speed.to_degrees().max(MIN_SPEED_DEG_PER_S)));
                }
            }
            (!share.joints.is_empty()).then_some(share)
        };
        self.boards.iter().enumerate().filter_map(of).collect()
    }
}

/// One board's share in a motion.
struct Share {
    /// The board's index.
    board: usize,
    /// Its moving joints.
    joints: Vec<usize>,
    /// Their targets in wire units.
    goals: Vec<f64>,
    /// Their speeds in wire units.
    speeds: Vec<f64>,
}

/// A motion of all motors with a distance to go, which arrive together, and its duration in seconds. A client sets no
/// accelerations, so the speeds are low enough for every motor's maximum acceleration.
fn in_step(target: &Target, from: &[f64], axes: &[Axis]) -> (Move, f64) {
    let mut motion = Move { motors: Vec::new(), q: Vec::new(), relative: false, speed: None, acceleration: None };
    let mut ways = Vec::new();
    let mut secs = 0.0;
    for (m, q) in target.motors.iter().zip(&target.q) {
        let (Some(axis), Some(here)) = (axes.get(*m), from.get(*m)) else { continue };
        let way = (q - here).abs();
        if way.to_degrees() < MIN_MOVE_DEG {
            continue;
        }
        motion.motors.push(*m);
        motion.q.push(*q);
        ways.push(way);
        let by_speed = PEAKS.0 * way / (target.speed.clamp(1e-3, 1.0) * axis.max_speed).max(1e-9);
        let by_acceleration = (PEAKS.1 * way / axis.max_acceleration.max(1e-9)).sqrt();
        secs = f64::max(secs, by_speed.max(by_acceleration));
    }
    motion.speed = Some(ways.iter().map(|way| PEAKS.0 * way / secs.max(1e-9)).collect());
    (motion, secs)
}

/// A motion with a speed per motor, rad/s, and the duration of the slowest in seconds.
fn each(target: &Target, speeds: &[f64], from: &[f64]) -> (Move, f64) {
    let motors = target.motors.clone();
    let q = target.q.clone();
    let legs = motors.iter().zip(&q).zip(speeds);
    let secs = legs.filter_map(|((m, q), v)| Some(PEAKS.0 * (q - from.get(*m)?).abs() / v.max(1e-9)));
    let secs = secs.fold(0.0, f64::max);
    (Move { motors, q, relative: false, speed: Some(speeds.to_vec()), acceleration: None }, secs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motors_arrive_together_and_keep_their_limits() {
        let axis = |v: f64, a: f64| Axis {
            name: "m".into(),
            min: -3.0,
            max: 3.0,
            max_speed: v,
            max_acceleration: a,
            ..Default::default()
        };
        let axes = [axis(1.0, 2.0), axis(0.5, 1.0), axis(1.0, 1.0)];
        let target = Target { motors: vec![0, 1, 2], q: vec![1.0, -0.4, 0.2], speed: 0.5 };
        let (motion, secs) = in_step(&target, &[0.0, 0.0, 0.2], &axes);
        // the third has no way to go
        assert_eq!((motion.motors.as_slice(), motion.q.as_slice()), (&[0, 1][..], &[1.0, -0.4][..]));
        let speed = motion.speed.unwrap();
        assert!((speed[0] / speed[1] - 1.0 / 0.4).abs() < 1e-9, "{speed:?}");
        assert!(speed[0] <= 0.5 + 1e-9 && speed[1] <= 0.25 + 1e-9, "{speed:?}");
        assert!(secs >= PEAKS.0 / 0.5 - 1e-9, "{secs}");
        let near = Target { motors: vec![0], q: vec![0.01], speed: 1.0 };
        let (motion, secs) = in_step(&near, &[0.0; 3], &axes);
        // a short way is bound by the acceleration
        assert!((secs - (PEAKS.1 * 0.01_f64 / 2.0).sqrt()).abs() < 1e-9 && motion.speed.unwrap()[0] < 1.0);
    }

    #[test]
    fn commands_are_those_of_the_protocol() {
        assert_eq!(group("posg", &[0, 2], &[1.5, -2.0]).to_string(), "[set] [posg] 2 (0 2) (1.5 -2.0)");
        assert_eq!(words(&["get", "dons"]).to_string(), "[get] [dons]");
    }
}
