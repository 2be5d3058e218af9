//! Promises about the board and its readings.

use super::trial::{DriverTrial, at, see};
use super::{Bench, DriverPromise};

pub const PROMISES: &[DriverPromise] = &[
    DriverPromise { name: "the board describes itself", check: describes_itself },
    DriverPromise { name: "readings come at the board's rate, counted, each once", check: steady_readings },
    DriverPromise { name: "a reading that nobody fetched is lost and counted", check: lost_readings },
];

/// Number of readings checked.
const READINGS: u32 = 50;

fn describes_itself(bench: &mut dyn Bench) -> Result<(), String> {
    let t = DriverTrial::begin(bench)?;
    let n = t.board.axes.len();
    see(n > 0, || "it has no axes".into())?;
    see(!t.board.period.is_zero(), || "its period is zero".into())?;
    for a in &t.board.axes {
        see(a.min.is_finite() && a.max.is_finite() && a.min < a.max, || format!("limits of {}", a.name))?;
        see(a.max_speed.is_finite() && a.max_speed > 0.0, || format!("greatest speed of {}", a.name))?;
        see(a.max_acceleration.is_finite() && a.max_acceleration > 0.0, || format!("acceleration of {}", a.name))?;
    }
    see(t.last.q.len() == n && t.last.done.len() == n, || "a reading has not one value per axis".into())?;
    see(t.driver.modes().len() == n, || "there is not one mode per axis".into())?;
    see(t.last.q.iter().all(|q| q.is_finite()), || "a reading is not finite".into())?;
    see(t.last.done.iter().all(|d| *d), || "a board nobody commanded is not done".into())
}

fn steady_readings(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let mut spaces = Vec::new();
    let mut gaps = Vec::new();
    for _ in 0..READINGS {
        let before = t.last.clone();
        t.next()?;
        let s = &t.last;
        see(s.seq > before.seq, || format!("reading {} follows {}", s.seq, before.seq))?;
        if s.seq > before.seq + 1 {
            gaps.push(format!("reading {} follows {}", s.seq, before.seq));
        }
        spaces.push(s.at.since(before.at).as_secs_f64());
        see(s.at > before.at && s.at <= t.now(), || format!("read at {}, after {}, now {}", s.at, before.at, t.now()))?;
        let again = t.fetch()?;
        see(again.is_none_or(|s| s.seq > t.last.seq), || "the same reading was given twice".into())?;
        see(t.driver.next_sample(t.now()) > t.now(), || "after a reading the next one is not due later".into())?;
    }
    let lost = gaps.len() as f64 / f64::from(READINGS);
    see(lost <= t.bench.disturbed(), || gaps.join(", "))?;
    spaces.sort_by(f64::total_cmp);
    let usual = at(&spaces, spaces.len() / 2);
    let period = t.board.period.as_secs_f64();
    see((usual / period - 1.0).abs() < 0.1, || format!("a reading every {usual:.4} s, promised every {period:.4} s"))
}

fn lost_readings(bench: &mut dyn Bench) -> Result<(), String> {
    let mut t = DriverTrial::begin(bench)?;
    let before = t.last.clone();
    let then = t.now() + 10 * t.board.period;
    t.bench.wait_until(then);
    t.next()?;
    let age = t.now().since(t.last.at);
    let period = t.board.period;
    see(t.last.seq >= before.seq + 9, || format!("10 periods later came reading {} after {}", t.last.seq, before.seq))?;
    // one period of age, one in transit, and half of one for jitter
    see(age <= 2 * period + period / 2, || format!("the newest reading is {age:?} old"))
}
