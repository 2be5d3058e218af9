//! Promises about velocities.

use super::trial::{DEG, DriverTrial, TOLERANCE_RAD, at, see};
use super::{Bench, DriverPromise};
use mobee_contract::{Command, ControlMode, Sample, Time};
use std::time::Duration;

pub const PROMISES: &[DriverPromise] = &[
    DriverPromise {
        name: "a velocity is kept by its motor alone, and ends soon after it is no longer given",
        check: velocity_is_kept,
    },
    DriverPromise { name: "a velocity passes no limit", check: limit },
    DriverPromise { name: "velocities that do not fit, or have no lease, are refused", check: refused },
    DriverPromise { name: "a move takes over from a velocity", check: move_after },
];

/// Period at which velocities are sent.
const TICK: Duration = Duration::from_millis(20);
/// Time within which a velocity ends that is not renewed.
const WATCHDOG: Duration = Duration::from_millis(500);

/// Sends a velocity repeatedly for this time. Returns the readings.
fn drive(t: &mut DriverTrial, motor: usize, speed: f64, time: Duration) -> Result<Vec<Sample>, String> {
    let mut next = t.now();
    let end = t.now() + t.board.latency + time;
    let mut all = Vec::new();
    while t.now() < end {
        if t.now() >= next {
            t.give(Command::Velocity { motors: vec![motor], speed: vec![speed] })?;
            next = next + TICK;
        }
        all.extend(t.step()?);
    }
    Ok(all)
}

/// Velocity of the motor in the suite, towards the farther limit.
fn speed(t: &DriverTrial, m: usize) -> f64 {
    let to = at(&t.away(&[m]), m);
    (0.5 * t.reference(m).0).copysign(to - at(&t.last.q, m))
}

fn velocity_is_kept(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    let home = t.last.q.clone();
    let v = speed(&t, m);
    let begun = drive(&mut t, m, v, Duration::from_millis(400))?;
    let wrong = |(i, mode): (usize, &ControlMode)| (*mode == ControlMode::Velocity) != (i == m);
    see(!t.driver.modes().iter().enumerate().any(wrong), || "not its motor alone is in velocity mode".into())?;
    let held = drive(&mut t, m, v, Duration::from_millis(500))?;
    see(begun.iter().chain(&held).any(|s| s.done.get(m) == Some(&false)), || "it was never under way".into())?;
    let (Some(first), Some(last)) = (held.first(), held.last()) else { return Err("no readings".into()) };
    let got = (at(&last.q, m) - at(&first.q, m)) / last.at.since(first.at).as_secs_f64();
    see((got - v).abs() <= 0.1 * v.abs() + TOLERANCE_RAD / 0.4, || {
        format!("{}/s instead of {:.2}", t.in_units(m, got), v / DEG)
    })?;
    let quiet = at(&t.last.q, m);
    t.until_done()?;
    let most = v.abs() * (t.board.latency + t.board.period + WATCHDOG).as_secs_f64() + TOLERANCE_RAD;
    let way = (at(&t.last.q, m) - quiet).abs();
    see(way <= most, || format!("it went on for {}, at most {:.2}", t.in_units(m, way), most / DEG))?;
    let rest = t.last.q.clone();
    t.settle(30)?;
    t.rests_at(&rest)?;
    let stray = (0..home.len()).find(|i| *i != m && (at(&rest, *i) - at(&home, *i)).abs() > TOLERANCE_RAD);
    see(stray.is_none(), || format!("motor {stray:?} moved too"))
}

fn limit(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    let Some(axis) = t.board.axes.get(m).cloned() else { return Ok(()) };
    for (q, sign) in [(axis.max - 1.5 * DEG, 1.0), (axis.min + 1.5 * DEG, -1.0)] {
        let mut near = t.last.q.to_vec();
        near.iter_mut().skip(m).take(1).for_each(|slot| *slot = q);
        t.give(Command::Move(t.to(&[m], &near)))?;
        t.until_done()?;
        let v = sign * t.reference(m).0;
        let seen = drive(&mut t, m, v, Duration::from_secs(1))?;
        let passed =
            seen.iter().find(|s| at(&s.q, m) > axis.max + TOLERANCE_RAD || at(&s.q, m) < axis.min - TOLERANCE_RAD);
        see(passed.is_none(), || format!("it was at {}", t.in_units(m, passed.map_or(f64::NAN, |s| at(&s.q, m)))))?;
        t.until_done()?;
    }
    Ok(())
}

fn refused(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    let n = t.last.q.len();
    let name = t.board.axes.get(m).map(|a| a.name.clone()).unwrap_or_default();
    let v = speed(&t, m);
    t.refused(Command::Velocity { motors: vec![m], speed: vec![f64::NAN] }, &name)?;
    for (motors, speed) in [(vec![], vec![]), (vec![n], vec![v]), (vec![m, m], vec![v, v]), (vec![m], vec![v, v])] {
        t.refused(Command::Velocity { motors, speed }, "")?;
    }
    t.keeps_lease = false;
    let now = t.now();
    t.driver.lease(now, Time::ZERO);
    t.refused(Command::Velocity { motors: vec![m], speed: vec![v] }, "")
}

fn move_after(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    let home = t.last.q.to_vec();
    let v = speed(&t, m);
    drive(&mut t, m, v, Duration::from_millis(300))?;
    // readings at a limit may lie beyond it by encoder noise
    let inside = |(q, a): (&f64, &mobee_contract::Axis)| q.clamp(a.min, a.max);
    let back: Vec<f64> = home.iter().zip(&t.board.axes).map(inside).collect();
    t.give(Command::Move(t.to(&[m], &back)))?;
    t.until_done()?;
    t.rests_at(&home)?;
    t.until_mode(ControlMode::Position)
}
