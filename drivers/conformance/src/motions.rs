//! Promises about position moves, their end, and stopping.

use super::trial::{DEG, DriverTrial, TOLERANCE_RAD, at, see, top_speed};
use super::{Bench, DriverPromise};
use mobee_contract::{Command, ControlMode, Move};
use std::time::Duration;

pub const PROMISES: &[DriverPromise] = &[
    DriverPromise { name: "one motor moves to its target and the others rest", check: one },
    DriverPromise { name: "a group and all motors move to their targets", check: group_and_all },
    DriverPromise { name: "a relative move counts from where the motor is", check: relative },
    DriverPromise { name: "reference speeds are kept, and the greatest speed always", check: references },
    DriverPromise { name: "motion is not done before it rests at its target, and done means at rest", check: done },
    DriverPromise { name: "stop brakes to a rest short of the target", check: stop },
    DriverPromise { name: "stopping one motor leaves the others moving", check: stop_one },
    DriverPromise { name: "a move in mid-motion goes on without a jump in speed", check: amend },
    DriverPromise { name: "both limits can be reached and are not passed", check: to_the_limits },
    DriverPromise { name: "an idle motor brakes and holds", check: idle },
];

fn one(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    for m in t.motors()? {
        let pose = t.away(&[m]);
        t.give(Command::Move(t.to(&[m], &pose)))?;
        let others = t.until_done()?;
        t.rests_at(&pose)?;
        let strayed = |i: usize| others.iter().any(|s| (at(&s.q, i) - at(&pose, i)).abs() > TOLERANCE_RAD);
        let stray = (0..pose.len()).find(|i| *i != m && strayed(*i));
        see(stray.is_none(), || format!("motor {stray:?} moved too"))?;
    }
    Ok(())
}

fn group_and_all(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let home = t.last.q.clone();
    let motors = t.motors()?;
    let pose = t.away(&motors);
    t.give(Command::Move(t.to(&motors, &pose)))?;
    t.until_done()?;
    t.rests_at(&pose)?;
    // readings at a limit may lie beyond it by encoder noise
    let inside = |(q, a): (&f64, &mobee_contract::Axis)| q.clamp(a.min, a.max);
    let back: Vec<f64> = home.iter().zip(&t.board.axes).map(inside).collect();
    let all: Vec<usize> = (0..home.len()).collect();
    t.give(Command::Move(t.to(&all, &back)))?;
    t.until_done()?;
    t.rests_at(&home)
}

fn relative(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let motors = t.motors()?;
    for _ in 0..2 {
        let pose = t.away(&motors);
        let mut by = t.to(&motors, &pose);
        by.q = motors.iter().map(|m| at(&pose, *m) - at(&t.last.q, *m)).collect();
        by.relative = true;
        t.give(Command::Move(by))?;
        t.until_done()?;
        t.rests_at(&pose)?;
    }
    Ok(())
}

fn references(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    let (home, (speed, acceleration)) = (t.last.q.clone(), t.reference(m));
    let mut took = Vec::new();
    for (share, pose) in [(1.0, t.away(&[m])), (0.4, home.to_vec())] {
        let reference = (vec![share * speed], vec![acceleration]);
        t.give(Command::Reference { motors: vec![m], speed: reference.0, acceleration: reference.1 })?;
        let start = t.now();
        let inside = t.board.axes.get(m).map_or(0.0, |a| at(&pose, m).clamp(a.min, a.max));
        t.give(Command::Move(Move { q: vec![inside], speed: None, acceleration: None, ..t.to(&[m], &pose) }))?;
        let samples = t.until_done()?;
        took.push(t.now().since(start).as_secs_f64());
        let (top, noise) = top_speed(&samples, m);
        see(top <= share * speed + noise, || {
            format!("{}/s at a reference of {:.2}", t.in_units(m, top), share * speed / DEG)
        })?;
    }
    let [fast, slow] = took.as_slice() else { return Ok(()) };
    see(*slow > 1.3 * fast, || format!("at 0.4 of the speed the way took {slow:.2} s instead of {fast:.2}"))?;
    // greater references are lowered; the trial itself checks for speeds beyond the greatest
    let pose = t.away(&[m]);
    t.give(Command::Move(Move { speed: Some(vec![1e3]), acceleration: Some(vec![1e3]), ..t.to(&[m], &pose) }))?;
    t.until_done()?;
    t.rests_at(&pose)
}

fn done(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    for _ in 0..3 {
        let pose = t.away(&[m]);
        let start = t.last.q.clone();
        t.give(Command::Move(t.to(&[m], &pose)))?;
        let given = t.now();
        let samples = t.until_done()?;
        // the last reading is the first that reports done, unless one in transit was read before the command
        let early = samples.iter().find(|s| {
            let there = (at(&s.q, m) - at(&pose, m)).abs() <= TOLERANCE_RAD;
            s.at > given && s.done.get(m) == Some(&true) && !there
        });
        see(early.is_none(), || {
            format!("done {:?} after the command, not at the target", early.map(|s| s.at.since(given)))
        })?;
        see(samples.iter().any(|s| s.done.get(m) == Some(&false)), || "a motion was never under way".into())?;
        t.settle(10)?;
        t.rests_at(&pose)?;
        see(t.last.done.get(m) == Some(&true), || "done was taken back".into())?;
        see((at(&start, m) - at(&t.last.q, m)).abs() > TOLERANCE_RAD, || "it did not move".into())?;
    }
    Ok(())
}

/// Starts a move and waits until all motors have covered a third of it; returns the target.
pub fn under_way(t: &mut DriverTrial, motors: &[usize]) -> Result<Vec<f64>, String> {
    let pose = t.away(motors);
    let start = t.last.q.clone();
    t.give(Command::Move(t.to(motors, &pose)))?;
    for _ in 0..2000 {
        t.step()?;
        if motors
            .iter()
            .all(|m| (at(&t.last.q, *m) - at(&start, *m)).abs() > 0.3 * (at(&pose, *m) - at(&start, *m)).abs())
        {
            return Ok(pose);
        }
    }
    Err("the motors don't get under way".into())
}

/// Greatest distance (rad) that a motor may cover after a stop at the suite's speed.
pub fn stopping_path(t: &DriverTrial, motor: usize) -> f64 {
    let (speed, acceleration) = t.reference(motor);
    let wait = (t.board.latency + 3 * t.board.period).as_secs_f64();
    speed * wait + speed * speed / (2.0 * acceleration) + TOLERANCE_RAD
}

fn stop(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let motors = t.motors()?;
    let pose = under_way(&mut t, &motors)?;
    let at_command = t.last.q.clone();
    t.give(Command::Stop { motors: vec![] })?;
    t.until_done()?;
    let rest = t.last.q.clone();
    for m in motors {
        let way = (at(&rest, m) - at(&at_command, m)).abs();
        let most = stopping_path(&t, m);
        see(way <= most, || format!("motor {m} went on for {}, at most {:.2}", t.in_units(m, way), most / DEG))?;
        see((at(&rest, m) - at(&pose, m)).abs() > TOLERANCE_RAD, || format!("motor {m} went on to its target"))?;
    }
    t.settle(20)?;
    t.rests_at(&rest)
}

fn stop_one(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let motors: Vec<usize> = t.motors()?.into_iter().take(2).collect();
    let pose = under_way(&mut t, &motors)?;
    let [stopped, other] = motors.as_slice() else { return Ok(()) };
    t.give(Command::Stop { motors: vec![*stopped] })?;
    t.until_done()?;
    let off = |m: usize| (at(&t.last.q, m) - at(&pose, m)).abs();
    see(off(*stopped) > TOLERANCE_RAD, || "the stopped motor went on".into())?;
    see(off(*other) <= TOLERANCE_RAD, || "the other one did not arrive".into())
}

fn amend(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    let home = t.last.q.clone();
    under_way(&mut t, &[m])?;
    let axis = t.board.axes.get(m).cloned().ok_or("no such motor")?;
    let back: Vec<f64> = home.iter().map(|q| q.clamp(axis.min, axis.max)).collect();
    t.give(Command::Move(t.to(&[m], &back)))?;
    let samples = t.until_done()?;
    t.rests_at(&home)?;
    // speeds over windows of a twentieth of a second, and their change from one window to the next
    let gap = Duration::from_millis(50);
    for s in &samples {
        let later = |from: mobee_contract::Time| samples.iter().find(|l| l.at >= from + gap);
        let Some(middle) = later(s.at) else { break };
        let Some(end) = later(middle.at) else { break };
        let one = middle.at.since(s.at).as_secs_f64();
        let two = end.at.since(middle.at).as_secs_f64();
        let v = (at(&middle.q, m) - at(&s.q, m)) / one;
        let w = (at(&end.q, m) - at(&middle.q, m)) / two;
        let most = axis.max_acceleration * (one + two) + TOLERANCE_RAD / one + TOLERANCE_RAD / two;
        see((w - v).abs() <= most, || format!("its speed jumped from {:.2} to {}/s", v / DEG, t.in_units(m, w)))?;
    }
    Ok(())
}

fn to_the_limits(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    let axis = t.board.axes.get(m).cloned().ok_or("no such motor")?;
    for q in [axis.max, axis.min] {
        let full = Move { q: vec![q], speed: Some(vec![axis.max_speed]), ..t.to(&[m], &[]) };
        t.give(Command::Move(full))?;
        let samples = t.until_done()?;
        let passed =
            samples.iter().find(|s| at(&s.q, m) > axis.max + TOLERANCE_RAD || at(&s.q, m) < axis.min - TOLERANCE_RAD);
        see(passed.is_none(), || format!("{} passed its limit", axis.name))?;
        see((at(&t.last.q, m) - q).abs() <= TOLERANCE_RAD, || format!("{} did not reach its limit", axis.name))?;
    }
    Ok(())
}

fn idle(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    let pose = under_way(&mut t, &[m])?;
    t.give(Command::Mode { motors: vec![m], mode: ControlMode::Idle })?;
    t.until_done()?;
    let rest = t.last.q.clone();
    see((at(&rest, m) - at(&pose, m)).abs() > TOLERANCE_RAD, || "it went on to its target".into())?;
    t.settle(20)?;
    t.rests_at(&rest)?;
    see(t.driver.modes().get(m) == Some(&ControlMode::Idle), || "its mode does not read back as idle".into())
}
