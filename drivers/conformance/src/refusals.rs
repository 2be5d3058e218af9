//! Promises about commands that a board refuses; a refusal changes nothing.

use super::trial::{DEG, DriverTrial, at, see};
use super::{Bench, DriverPromise};
use mobee_contract::{Command, ControlMode, Move};

pub const PROMISES: &[DriverPromise] = &[
    DriverPromise { name: "targets outside the limits are refused, naming the motor", check: limits },
    DriverPromise { name: "numbers that are not finite are refused", check: not_finite },
    DriverPromise { name: "commands that don't fit the board are refused", check: malformed },
    DriverPromise { name: "a refused group move moves none and sets no reference", check: all_or_nothing },
    DriverPromise { name: "set-points are refused in other modes and outside the limits", check: direct },
];

fn limits(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    for m in t.motors()? {
        let Some(axis) = t.board.axes.get(m).cloned() else { continue };
        for q in [axis.min - DEG, axis.max + DEG] {
            let outside = Move { q: vec![q], ..t.to(&[m], &[]) };
            t.refused(Command::Move(outside), &axis.name)?;
            let farther = Move { q: vec![q - at(&t.last.q, m)], relative: true, ..t.to(&[m], &[]) };
            t.refused(Command::Move(farther), &axis.name)?;
        }
    }
    Ok(())
}

fn not_finite(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let m = t.motors()?.first().copied().unwrap_or_default();
    let name = t.board.axes.get(m).map_or(String::new(), |a| a.name.clone());
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let fine = t.to(&[m], &t.away(&[m]));
        t.refused(Command::Move(Move { q: vec![bad], ..fine.clone() }), &name)?;
        t.refused(Command::Move(Move { q: vec![bad], relative: true, ..fine.clone() }), &name)?;
        t.refused(Command::Move(Move { speed: Some(vec![bad]), ..fine.clone() }), &name)?;
        t.refused(Command::Move(Move { acceleration: Some(vec![bad]), ..fine }), &name)?;
        t.refused(Command::Reference { motors: vec![m], speed: vec![bad], acceleration: vec![1.0] }, &name)?;
    }
    t.refused(Command::Reference { motors: vec![m], speed: vec![-1.0], acceleration: vec![1.0] }, &name)
}

fn malformed(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let motors = t.motors()?;
    let n = t.board.axes.len();
    let fine = t.to(&motors, &t.away(&motors));
    let shorter = |list: &[f64]| list.iter().copied().skip(1).collect::<Vec<f64>>();
    let first = motors.first().copied().unwrap_or_default();
    let bad = [
        Move { q: shorter(&fine.q), ..fine.clone() },
        Move { speed: fine.speed.as_deref().map(shorter), ..fine.clone() },
        Move { acceleration: fine.acceleration.as_deref().map(shorter), ..fine.clone() },
        Move { motors: vec![first; motors.len()], ..fine.clone() },
        Move { motors: motors.iter().map(|m| m + n).collect(), ..fine.clone() },
    ];
    for m in bad {
        t.refused(Command::Move(m), "")?;
    }
    t.refused(Command::Stop { motors: vec![n] }, "")?;
    t.refused(Command::Mode { motors: vec![n], mode: ControlMode::Idle }, "")?;
    t.refused(Command::Reference { motors: vec![first], speed: vec![], acceleration: vec![] }, "")?;
    see(t.driver.modes().iter().all(|m| *m == ControlMode::Position), || "a refused mode was set".into())
}

fn all_or_nothing(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let motors = t.motors()?;
    let mut group = t.to(&motors, &t.away(&motors));
    let first = motors.first().copied().unwrap_or_default();
    let (speed, acceleration) = t.reference(first);
    t.give(Command::Reference { motors: vec![first], speed: vec![speed], acceleration: vec![acceleration] })?;
    t.settle(2)?;
    group.speed = Some(vec![0.05 * speed; motors.len()]);
    if let (Some(last), Some(axis)) = (group.q.last_mut(), motors.last().and_then(|m| t.board.axes.get(*m))) {
        *last = axis.max + DEG;
    }
    t.refused(Command::Move(group), "")?;
    let pose = t.away(&[first]);
    let way = (at(&pose, first) - at(&t.last.q, first)).abs();
    let before = t.now();
    t.give(Command::Move(Move { speed: None, acceleration: None, ..t.to(&[first], &pose) }))?;
    t.until_done()?;
    let took = t.now().since(before).as_secs_f64();
    see(took < 5.0 * way / speed + 1.0, || format!("a refused move set its slow reference: {took:.1} s for the next"))
}

fn direct(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let here = t.last.q.to_vec();
    t.refused(Command::Direct { motors: t.all(), q: here.clone() }, "")?;
    if !t.board.position_direct {
        return Ok(());
    }
    let all = t.all();
    t.refused(Command::Mode { motors: vec![], mode: ControlMode::PositionDirect }, "")?;
    t.refused(Command::Direct { motors: vec![], q: vec![] }, "")?;
    t.refused(Command::Direct { motors: all.iter().copied().chain([0]).collect(), q: vec![0.0; all.len() + 1] }, "")?;
    t.give(Command::Mode { motors: t.all(), mode: ControlMode::PositionDirect })?;
    t.until_mode(ControlMode::PositionDirect)?;
    t.refused(Command::Direct { motors: t.all(), q: here.iter().copied().skip(1).collect() }, "")?;
    for m in t.motors()? {
        let Some(axis) = t.board.axes.get(m).cloned() else { continue };
        for bad in [axis.min - DEG, axis.max + DEG, f64::NAN] {
            let q = here.iter().enumerate().map(|(i, q)| if i == m { bad } else { *q }).collect();
            t.refused(Command::Direct { motors: t.all(), q }, &axis.name)?;
        }
    }
    Ok(())
}
