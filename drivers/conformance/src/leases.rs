//! Promises about the lease, and about boards that outlive their drivers.

use super::motions::{stopping_path, under_way};
use super::trial::{DEG, DriverTrial, TOLERANCE_RAD, at, see};
use super::{Bench, DriverPromise};
use mobee_contract::{Command, ControlMode, DriverFault};

pub const PROMISES: &[DriverPromise] = &[
    DriverPromise { name: "nothing moves without a lease", check: no_lease },
    DriverPromise { name: "at the end of its lease the board brakes, and stays at rest under the next", check: expiry },
    DriverPromise { name: "set-points move nothing once the lease has ended", check: stream_without_lease },
    DriverPromise { name: "the newest lease counts", check: shortened },
    DriverPromise { name: "a board outlives its driver: it keeps position, mode and count", check: restart },
    DriverPromise { name: "a board whose driver is gone stops when its lease ends", check: orphan },
];

fn no_lease(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::connect(bench, false)?;
    let here = t.last.q.clone();
    let motors = t.motors()?;
    t.refused(Command::Move(t.to(&motors, &t.away(&motors))), "")?;
    // commands that move nothing need no lease
    t.give(Command::Stop { motors: vec![] })?;
    t.give(Command::Mode { motors: t.all(), mode: ControlMode::Position })?;
    t.settle(20)?;
    t.rests_at(&here)
}

fn expiry(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let motors = t.motors()?;
    let pose = under_way(&mut t, &motors)?;
    let now = t.now();
    let held = 5 * t.board.period;
    t.driver.lease(now, now + held);
    t.keeps_lease = false;
    let at_command = t.last.q.clone();
    t.until_done()?;
    let rest = t.last.q.clone();
    for m in &motors {
        let most = stopping_path(&t, *m) + t.reference(*m).0 * held.as_secs_f64();
        let way = (at(&rest, *m) - at(&at_command, *m)).abs();
        see(way <= most, || format!("motor {m} went on for {}, at most {:.2}", t.in_units(*m, way), most / DEG))?;
        see((at(&rest, *m) - at(&pose, *m)).abs() > TOLERANCE_RAD, || format!("motor {m} went on to its target"))?;
    }
    t.refused(Command::Move(t.to(&motors, &pose)), "")?;
    t.keeps_lease = true;
    t.settle(50)?;
    t.rests_at(&rest).map_err(|e| format!("under a new lease it went on by itself: {e}"))?;
    t.give(Command::Move(t.to(&motors, &pose)))?;
    t.until_done()?;
    t.rests_at(&pose)
}

fn stream_without_lease(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    if !t.board.position_direct {
        return Ok(());
    }
    t.give(Command::Mode { motors: t.all(), mode: ControlMode::PositionDirect })?;
    t.until_mode(ControlMode::PositionDirect)?;
    t.keeps_lease = false;
    let now = t.now();
    let here = t.last.q.clone();
    t.driver.lease(now, now + t.board.period);
    t.run(3 * t.board.period)?;
    let pose = t.away(&t.motors()?);
    for _ in 0..20 {
        let now = t.now();
        if !matches!(
            t.driver.command(now, &Command::Direct { motors: t.all(), q: pose.clone() }),
            Err(DriverFault::Refused(_))
        ) {
            return Err("a set-point without a lease was not refused".into());
        }
        t.step()?;
    }
    t.rests_at(&here)
}

fn shortened(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let motors = t.motors()?;
    let pose = under_way(&mut t, &motors)?;
    t.keeps_lease = false;
    let now = t.now();
    t.driver.lease(now, now + 10_000 * t.board.period);
    t.step()?;
    let now = t.now();
    t.driver.lease(now, now);
    t.until_done()?;
    let arrived = motors.iter().find(|m| (at(&t.last.q, **m) - at(&pose, **m)).abs() <= TOLERANCE_RAD);
    see(arrived.is_none(), || format!("motor {arrived:?} went on to its target under the older lease"))
}

fn restart(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let motors = t.motors()?;
    let pose = t.away(&motors);
    t.give(Command::Move(t.to(&motors, &pose)))?;
    t.until_done()?;
    let mode = if t.board.position_direct { ControlMode::PositionDirect } else { ControlMode::Idle };
    t.give(Command::Mode { motors: t.all(), mode })?;
    t.until_mode(mode)?;
    let before = t.last.clone();
    t.reconnect()?;
    see(t.last.seq >= before.seq, || format!("reading {} came after {}", t.last.seq, before.seq))?;
    t.rests_at(&pose)?;
    t.settle(20)?;
    t.rests_at(&pose)?;
    see(t.driver.modes().iter().all(|m| *m == mode), || "it forgot its modes".into())
}

fn orphan(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let motors = t.motors()?;
    let pose = under_way(&mut t, &motors)?;
    t.keeps_lease = false;
    let now = t.now();
    let at_command = t.last.q.clone();
    t.driver.lease(now, now + 5 * t.board.period);
    t.reconnect()?;
    t.until_done()?;
    for m in motors {
        let most = stopping_path(&t, m) + t.reference(m).0 * (5 * t.board.period).as_secs_f64();
        let way = (at(&t.last.q, m) - at(&at_command, m)).abs();
        see(way <= most && (at(&t.last.q, m) - at(&pose, m)).abs() > TOLERANCE_RAD, || format!("motor {m} went on"))?;
    }
    Ok(())
}
