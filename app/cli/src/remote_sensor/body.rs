//! A robot's configuration at past times, from the states that its boards publish.

use super::{RemoteSensor, WarnOnce};
use miette::Report;
use mobee_compose::driver_of;
use mobee_contract::{BodyState, Time};
use mobee_driver_yarp::{YARP, YarpDriverSettings, joint_kind};
use mobee_model::Robot;
use mobee_runtime::clock::Clock;
use mobee_yarp::board::{LinkState, RemoteBoard, RemoteOptions, RemoteState, Units};
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::task::JoinSet;

/// Number of stored states per board: some seconds.
const MAX_STATES: usize = 512;
/// Maximum difference between a state's stamp and its arrival, s; a greater one is the time of another clock.
const MAX_STAMP_AGE_S: f64 = 0.1;
/// Maximum gap between states for an interpolation.
const MAX_GAP: Duration = Duration::from_millis(500);

/// The boards of a robot. They are never commanded.
pub(super) struct Body {
    boards: Vec<Board>,
    home: Vec<f64>,
    tasks: JoinSet<()>,
}

struct Board {
    port: String,
    motors: Range<usize>,
    remote: Arc<RemoteBoard>,
    past: Arc<Mutex<StateBuffer>>,
}

/// The states of a board, oldest first: time, and motor positions, rad.
#[derive(Default)]
struct StateBuffer {
    ring: VecDeque<(Time, Vec<f64>)>,
    /// Its number of joints, if that differs from the model's.
    wrong: Option<usize>,
}

/// Reasons why a configuration is not available.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unavailable {
    /// It is newer than the newest state of some board.
    NotYet,
    /// It is older than the stored states, or lies in a gap.
    NoMore,
}

impl Body {
    /// Receives the states of the boards that the robot's driver names, in the background.
    ///
    /// # Errors
    /// If the driver is not of kind `yarp`, with the remedy.
    pub(super) fn watch(configured: &RemoteSensor, name: &str, robot: &Robot, clock: &Clock) -> Result<Body, Report> {
        let found = configured.config.robot.iter().position(|r| r.name == name).unwrap_or_default();
        let at = format!("robot[{found}].driver");
        let table = configured.config.robot.get(found).map(|r| r.driver.clone()).unwrap_or_default();
        let (kind, settings) = driver_of(&configured.source, &at, &table)?;
        if kind != YARP {
            let what = format!("the driver is of the kind `{kind}`, which has no ports that tell where the head is");
            let help = "give the kind `yarp` and the boards of torso and head; configs/sensing/eyes-yarp.toml has them";
            return Err(configured.source.error(&format!("{at}.kind"), what, help).into());
        }
        let settings: YarpDriverSettings =
            mobee_contract::settings(&settings).map_err(|e| configured.source.error(&at, e.what, e.help))?;
        let mut body =
            Body { boards: Vec::new(), home: robot.motors.iter().map(|m| m.home).collect(), tasks: JoinSet::new() };
        for part in &settings.parts {
            let Some(known) = robot.parts.iter().find(|p| p.name == part.part) else { continue };
            let options = RemoteOptions {
                local: format!("{}/locator/{}", configured.ports, part.part),
                carrier: settings.carrier.parse().unwrap_or_default(),
                timeout: millis(settings.timeout_ms),
                stale: millis(settings.stale_ms),
            };
            let remote = Arc::new(RemoteBoard::new(&configured.network, &part.port, options));
            let motors = robot.motors.get(known.motors.clone()).unwrap_or_default();
            let units = Units::new(motors.iter().map(|m| joint_kind(m.motion)));
            let past = Arc::new(Mutex::new(StateBuffer::default()));
            body.tasks.spawn(listen(remote.clone(), clock.clone(), units, past.clone()));
            body.boards.push(Board { port: part.port.clone(), motors: known.motors.clone(), remote, past });
        }
        Ok(body)
    }

    /// The configuration at this time: each board's motors are interpolated between its states before and after.
    ///
    /// # Errors
    /// If the states of some board do not cover it.
    pub(super) fn at(&self, at: Time) -> Result<BodyState, Unavailable> {
        let mut q = self.home.clone();
        for board in &self.boards {
            let past = board.past.lock().unwrap_or_else(PoisonError::into_inner);
            let there = past.at(at)?;
            q.get_mut(board.motors.clone()).into_iter().flatten().zip(there).for_each(|(to, from)| *to = from);
        }
        Ok(BodyState { at, q: q.into() })
    }

    /// Warns about boards that send no states, with the reason.
    pub(super) fn complain(&self, warnings: &mut WarnOnce) {
        for board in &self.boards {
            let past = board.past.lock().unwrap_or_else(PoisonError::into_inner);
            let port = &board.port;
            let motors = board.motors.len();
            if let Some(joints) = past.wrong {
                warnings.warn(format!(
                    "{port} has {joints} joints and the part of the model {motors} motors: correct `parts`"
                ));
            } else if past.ring.is_empty() {
                let why = match &*board.remote.link().borrow() {
                    LinkState::Down(why) => why.clone(),
                    LinkState::Taken(by) => format!("another program has our port names: {by}"),
                    LinkState::Up(_) => "it sends none".into(),
                };
                warnings.warn(format!("no states of {port} yet ({why}): detections are not located"));
            }
        }
    }
}

impl StateBuffer {
    fn at(&self, at: Time) -> Result<Vec<f64>, Unavailable> {
        let next = self.ring.partition_point(|(t, _)| *t < at);
        let (after, there) = self.ring.get(next).ok_or(Unavailable::NotYet)?;
        if *after == at {
            return Ok(there.clone());
        }
        let (before, here) = next.checked_sub(1).and_then(|i| self.ring.get(i)).ok_or(Unavailable::NoMore)?;
        let span = after.since(*before);
        if span > MAX_GAP {
            return Err(Unavailable::NoMore);
        }
        let share = at.since(*before).as_secs_f64() / span.as_secs_f64();
        Ok(here.iter().zip(there).map(|(a, b)| a + share * (b - a)).collect())
    }

    fn push(&mut self, at: Time, q: Vec<f64>) {
        if self.ring.back().is_none_or(|(last, _)| *last < at) {
            if self.ring.len() >= MAX_STATES {
                self.ring.pop_front();
            }
            self.ring.push_back((at, q));
        }
    }
}

/// Stores the states of a board as they arrive.
async fn listen(board: Arc<RemoteBoard>, clock: Clock, units: Units, past: Arc<Mutex<StateBuffer>>) {
    let mut state = board.state();
    while state.changed().await.is_ok() {
        let Some(newest) = state.borrow_and_update().clone() else { continue };
        let degrees = newest.joints.position.values.iter().enumerate();
        let q: Vec<f64> = degrees.map(|(j, q)| units.kind(j).from_wire(*q).to_radians()).collect();
        let mut past = past.lock().unwrap_or_else(PoisonError::into_inner);
        if q.len() != units.axes() {
            past.wrong = Some(q.len());
        } else if q.iter().all(|q| q.is_finite()) {
            past.wrong = None;
            past.push(read_at(&newest, &clock), q);
        }
    }
}

/// Time at which a state was read, by our clock: from its stamp if the board's clock agrees with this machine's, else
/// from its arrival.
fn read_at(state: &RemoteState, clock: &Clock) -> Time {
    let age = state.arrived.elapsed();
    let arrived = Time(clock.now().0.saturating_sub(u64::try_from(age.as_nanos()).unwrap_or(u64::MAX)));
    let late = state.stamp.map(|stamp| clock.time_of_day(arrived) - stamp.time);
    match late.filter(|late| (0.0..MAX_STAMP_AGE_S).contains(late)) {
        Some(late) => Time(arrived.0.saturating_sub((late * 1e9) as u64)),
        None => arrived,
    }
}

fn millis(ms: f64) -> Duration {
    Duration::try_from_secs_f64(ms * 1e-3).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_is_known_between_states_and_not_across_a_gap() {
        let mut past = StateBuffer::default();
        for (ms, q) in [(100, 1.0), (120, 3.0), (110, 9.0), (900, 5.0)] {
            past.push(Time(ms * 1_000_000), vec![q]);
        }
        let at = |ms: u64| past.at(Time(ms * 1_000_000));
        assert_eq!(at(110), Ok(vec![2.0]), "what comes late is left out");
        assert_eq!((at(100), at(900)), (Ok(vec![1.0]), Ok(vec![5.0])));
        assert_eq!(
            (at(99), at(500), at(901)),
            (Err(Unavailable::NoMore), Err(Unavailable::NoMore), Err(Unavailable::NotYet))
        );
    }
}
