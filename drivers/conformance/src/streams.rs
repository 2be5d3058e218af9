//! Promises about position-direct streaming and control modes.

use super::trial::{DEG, DriverTrial, TOLERANCE_RAD, at, see};
use super::{Bench, DriverPromise};
use mobee_contract::{Command, ControlMode};
use std::time::Duration;

pub const PROMISES: &[DriverPromise] = &[
    DriverPromise { name: "control modes read back", check: modes },
    DriverPromise { name: "a stream of set-points is followed closely and held at its end", check: stream },
    DriverPromise { name: "set-points of one motor touch no other", check: one_alone },
    DriverPromise { name: "a move puts its motors into position mode", check: move_after_stream },
];

fn modes(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let here = t.last.q.clone();
    let direct = if t.board.position_direct { ControlMode::PositionDirect } else { ControlMode::Idle };
    for mode in [direct, ControlMode::Position, ControlMode::Idle, ControlMode::Position] {
        t.give(Command::Mode { motors: t.all(), mode })?;
        t.until_mode(mode)?;
        t.settle(3)?;
        t.rests_at(&here).map_err(|e| format!("switching to {mode:?} moved it: {e}"))?;
    }
    let m = t.motors()?.first().copied().unwrap_or_default();
    t.give(Command::Mode { motors: vec![m], mode: ControlMode::Idle })?;
    t.settle(50)?;
    let wrong = |(i, mode): (usize, &ControlMode)| (*mode == ControlMode::Idle) != (i == m);
    see(!t.driver.modes().iter().enumerate().any(wrong), || "a mode set for one motor is not its alone".into())
}

/// Streams setpoints of these motors every 20 ms at 5 deg/s to `pose`. Returns the greatest lag (rad) behind
/// the newest setpoint.
fn follow(t: &mut DriverTrial, motors: &[usize], pose: &[f64]) -> Result<f64, String> {
    let start = t.last.q.to_vec();
    let tick = Duration::from_millis(20);
    let way = start.iter().zip(pose).map(|(a, b)| (b - a).abs()).fold(0.0, f64::max);
    let ticks = (way / (5.0 * DEG * tick.as_secs_f64())).ceil().max(1.0);
    let mut next = t.now();
    let mut i = 0.0;
    let mut lag = 0.0f64;
    while i < ticks {
        t.step()?;
        let q = |share: f64| start.iter().zip(pose).map(|(a, b)| a + share * (b - a)).collect::<Vec<f64>>();
        let newest = q(i / ticks);
        lag = newest.iter().zip(t.last.q.iter()).map(|(a, b)| (a - b).abs()).fold(lag, f64::max);
        while t.now() >= next && i < ticks {
            i += 1.0;
            let q = q(i / ticks);
            t.give(Command::Direct { motors: motors.to_vec(), q: motors.iter().map(|m| at(&q, *m)).collect() })?;
            next = next + tick;
        }
    }
    Ok(lag)
}

fn stream(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    if !t.board.position_direct {
        return Ok(());
    }
    t.give(Command::Mode { motors: t.all(), mode: ControlMode::PositionDirect })?;
    t.until_mode(ControlMode::PositionDirect)?;
    let pose = t.away(&t.motors()?);
    let all = t.all();
    let lag = follow(&mut t, &all, &pose)?;
    // it starts from rest, commands have a latency, and it lags by three setpoints at most
    let late = (t.board.latency + t.board.period + Duration::from_millis(60)).as_secs_f64();
    let most = 5.0 * DEG * late + 0.3 * DEG + TOLERANCE_RAD;
    see(lag <= most, || format!("it lags by {}, at most {:.2}", t.board.units().told(lag, 2), most / DEG))?;
    t.until_done()?;
    t.settle(20)?;
    t.rests_at(&pose)
}

/// Streams one motor; the others must stay in their mode and position.
fn one_alone(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    if !t.board.position_direct {
        return Ok(());
    }
    let m = t.motors()?.first().copied().unwrap_or_default();
    t.give(Command::Mode { motors: t.all(), mode: ControlMode::Position })?;
    t.until_mode(ControlMode::Position)?;
    t.give(Command::Mode { motors: vec![m], mode: ControlMode::PositionDirect })?;
    t.settle(50)?;
    let pose = t.away(&[m]);
    t.refused(Command::Direct { motors: t.all(), q: t.last.q.to_vec() }, "")?;
    follow(&mut t, &[m], &pose)?;
    let wrong = |(i, mode): (usize, &ControlMode)| (*mode == ControlMode::PositionDirect) != (i == m);
    see(!t.driver.modes().iter().enumerate().any(wrong), || "another motor's mode was changed".into())?;
    t.until_done()?;
    t.settle(20)?;
    t.rests_at(&pose)
}

fn move_after_stream(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    let other = if t.board.position_direct { ControlMode::PositionDirect } else { ControlMode::Idle };
    t.give(Command::Mode { motors: t.all(), mode: other })?;
    t.until_mode(other)?;
    let pose = t.away(&[m]);
    t.give(Command::Move(t.to(&[m], &pose)))?;
    t.until_done()?;
    t.rests_at(&pose)?;
    let wrong = |(i, mode): (usize, &ControlMode)| (*mode == ControlMode::Position) != (i == m);
    see(!t.driver.modes().iter().enumerate().any(wrong), || "not the moved motor alone is in position mode".into())?;
    see((at(&t.last.q, m) - at(&pose, m)).abs() <= TOLERANCE_RAD, || "it did not arrive".into())
}
