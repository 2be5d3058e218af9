//! A motor that follows with its own profile, or does not follow: detection of stalls, and its delay.

use super::*;
use crate::ControllerSettings;
use mobee_contract::{Axis, Board, Move, Sample};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(10);
const BOUND: f64 = 0.5;

fn rules() -> Rules {
    let axis = |name: &str| {
        let (min, max) = (f64::to_radians(-170.0), f64::to_radians(170.0));
        Axis {
            name: name.into(),
            min,
            max,
            max_speed: 100_f64.to_radians(),
            max_acceleration: 200_f64.to_radians(),
            ..Default::default()
        }
    };
    let latency = Duration::from_millis(20);
    let board = Board { axes: vec![axis("a"), axis("b")], period: PERIOD, latency, position_direct: true };
    let settings = ControllerSettings { stall_deg: Some(BOUND), ..ControllerSettings::default() };
    Rules::new("robot", Vec::new(), &settings, &board)
}

/// Profile of a move: position on a path of one degree, at a share of its duration.
type Profile = fn(f64) -> f64;

fn minimum_jerk(part: f64) -> f64 {
    part.powi(3) * (10.0 - 15.0 * part + 6.0 * part * part)
}
fn trapezoid(part: f64) -> f64 {
    let edge = |t: f64| t * t / (2.0 * 0.25 * 0.75);
    match part {
        t if t < 0.25 => edge(t),
        t if t > 0.75 => 1.0 - edge(1.0 - t),
        t => (t - 0.125) / 0.75,
    }
}
fn gain(part: f64) -> f64 {
    1.0 - (-6.0 * part).exp()
}

/// One robot whose first motor moves, in degrees and milliseconds.
struct Run {
    rules: Rules,
    watch: StallWatch,
    commands: TrackedCommands,
    ms: u64,
    noise: u64,
    /// Factor on the usual noise.
    loud: f64,
}

impl Run {
    fn new() -> Run {
        let rules = rules();
        let watch = StallWatch::new(&rules).unwrap();
        let mut run = Run { rules, watch, commands: TrackedCommands::default(), ms: 0, noise: 1, loud: 1.0 };
        (0..20).for_each(|_| assert_eq!(run.read(0.0), None));
        run
    }

    /// Uniform noise within a sixtieth of a degree, times that factor.
    fn noise(&mut self) -> f64 {
        self.noise = self.noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.noise >> 40) as f64 / f64::from(1 << 23) - 1.0) / 60.0 * self.loud
    }

    fn pulse(&mut self, deg: f64) -> Pulse {
        self.ms += 10;
        let q = [deg + self.noise(), self.noise()].map(f64::to_radians);
        let sample = Sample {
            seq: self.ms,
            at: Time(self.ms * 1_000_000),
            q: q.to_vec().into(),
            done: vec![false; 2],
            ..Sample::default()
        };
        Pulse::new(sample, &Vec::new().into())
    }

    fn read(&mut self, deg: f64) -> Option<Stalled> {
        let pulse = self.pulse(deg);
        self.watch.read(&mut self.commands, &pulse, &self.rules)
    }

    fn track(&mut self, command: &Command) {
        self.watch.track(&mut self.commands, command, Time(self.ms * 1_000_000), &self.rules);
    }

    fn go(&mut self, deg: f64, speed: f64) {
        let (q, speed) = (vec![deg.to_radians()], Some(vec![speed.to_radians()]));
        let acceleration = Some(vec![200_f64.to_radians()]);
        self.commands = TrackedCommands::default();
        self.track(&Command::Move(Move { motors: vec![0], q, relative: false, speed, acceleration }));
    }

    /// A move whose motor is held from `until` on (degrees): lead of the board's reference when it counted as
    /// stalled.
    fn moves(&mut self, from: f64, to: f64, speed: f64, profile: Profile, until: Option<f64>) -> Option<f64> {
        self.go(to, speed);
        let way = (to - from).abs();
        let secs = (1.875 * way / speed).max((5.774 * way / 200.0_f64).sqrt());
        for k in 1..=(100.0 * (secs + 0.5)) as u64 {
            let part = ((0.01 * k as f64 - 0.02) / secs).clamp(0.0, 1.0);
            let wanted = from + (to - from) * profile(part);
            let is = until.map_or(wanted, |q| if to > from { wanted.min(q) } else { wanted.max(q) });
            if let Some(Stalled { motor, .. }) = self.read(is) {
                assert_eq!(motor, 0);
                return Some((wanted - is).abs());
            }
        }
        self.watch.learn(&self.commands);
        None
    }
}

#[test]
fn a_motor_that_follows_freely_is_never_stopped() {
    for profile in [minimum_jerk, trapezoid, gain] {
        for speed in [1.0, 3.0, 10.0, 30.0, 100.0] {
            let mut run = Run::new();
            for (from, to) in
                [(0.0, 2.0), (2.0, 20.0), (20.0, -60.0), (-60.0, -59.0), (-59.0, 0.0), (0.0, 90.0), (90.0, 0.0)]
            {
                assert_eq!(run.moves(from, to, speed, profile, None), None, "{speed} deg/s from {from} to {to}");
            }
            let threshold = run.watch.threshold(0).to_degrees();
            assert!(threshold < 1.0, "{speed} deg/s: its threshold is {threshold} deg");
        }
    }
}

/// Slow motors are hardly faster than their encoders' noise: that makes no ghost run ahead of them.
#[test]
fn noise_stops_no_motor() {
    for seed in 0..30 {
        let mut run = Run::new();
        (run.noise, run.loud) = (seed, 3.0);
        for (from, to, speed) in
            [(0.0, 6.0, 0.8), (6.0, -14.0, 1.5), (-14.0, 20.0, 3.0), (20.0, 0.0, 8.0), (0.0, 12.0, 1.0)]
        {
            assert_eq!(
                run.moves(from, to, speed, minimum_jerk, None),
                None,
                "{seed}: {speed} deg/s from {from} to {to}"
            );
        }
    }
}

#[test]
fn a_held_motor_is_stopped_at_a_small_lag() {
    for (profile, faster) in [(minimum_jerk as Profile, 1.0), (trapezoid, 1.5), (gain, 3.0)] {
        for (speed, most) in [(3.0, 6.0), (10.0, 6.5), (30.0, 9.0), (100.0, 18.0)] {
            for until in [0.0, 1.0, 10.0, 40.0, 70.0] {
                let mut run = Run::new();
                let ahead = run.moves(0.0, 90.0, speed, profile, Some(until));
                // a motor that begins more suddenly than a minimum-jerk trajectory is detected late
                let begins = until <= 1.0 && profile(0.01) > 1e-4;
                let most = if begins { 90.0 } else { faster * most };
                assert!(ahead.is_some_and(|ahead| ahead < most), "{speed} deg/s, held at {until}: {ahead:?} deg");
            }
        }
    }
}

#[test]
fn the_threshold_follows_from_free_motions() {
    let mut run = Run::new();
    let at_first = run.watch.threshold(0).to_degrees();
    assert!((at_first - 1.5).abs() < 1e-9, "{at_first}");
    let held = |run: &mut Run| run.moves(0.0, 60.0, 20.0, minimum_jerk, Some(30.0)).unwrap();
    let before = held(&mut run);
    for _ in 0..5 {
        run.moves(0.0, 20.0, 20.0, minimum_jerk, None);
        run.moves(20.0, 0.0, 20.0, minimum_jerk, None);
    }
    let known = run.watch.threshold(0).to_degrees();
    assert!((BOUND..0.6).contains(&known), "{known}");
    let after = held(&mut run);
    assert!(after < 0.6 * before, "{after} deg, {before} deg before");
    // nothing was learned of the motor that did not move
    assert!((run.watch.threshold(1).to_degrees() - 1.5).abs() < 1e-9);
    // a motor that sticks gets a higher threshold
    for _ in 0..3 {
        run.moves(30.0, 0.0, 20.0, minimum_jerk, None);
        run.go(40.0, 20.0);
        let sticks = |k: u64| if k < 100 { 0.2 * k as f64 } else { 20.0 + 0.2 * k.saturating_sub(106) as f64 };
        (0..230).for_each(|k| assert_eq!(run.read(sticks(k).min(40.0)), None, "{k}"));
        run.watch.learn(&run.commands);
        run.moves(40.0, 30.0, 20.0, minimum_jerk, None);
    }
    assert!(run.watch.threshold(0).to_degrees() > known, "{}", run.watch.threshold(0).to_degrees());
}

/// Late, missing or bit-identical readings indicate nothing.
#[test]
fn missing_readings_are_no_stall() {
    let mut run = Run::new();
    run.go(60.0, 20.0);
    (0..60).for_each(|k| assert_eq!(run.read(0.2 * k as f64), None));
    let mut same = run.pulse(12.0);
    for k in 1..40 {
        (same.sample.at, same.unchanged) = (Time((run.ms + 10 * k) * 1_000_000), Time(run.ms * 1_000_000));
        assert_eq!(run.watch.read(&mut run.commands, &same, &run.rules), None);
    }
    run.ms += 2_000;
    // it came to rest in the gap, as its lease had expired
    (0..10).for_each(|_| assert_eq!(run.read(14.0), None));
}

/// A machine that pauses for 0.3 s may pause its simulated board as well. The motor goes on as if nothing had happened, or is
/// held meanwhile, which shows afterwards.
#[test]
fn a_ghost_waits_while_readings_are_missing() {
    let after = |held: bool| {
        let mut run = Run::new();
        run.rules.fresh = Duration::from_millis(500);
        (0..6).for_each(|_| {
            _ = run.moves(0.0, 20.0, 20.0, minimum_jerk, None).or(run.moves(20.0, 0.0, 20.0, gain, None))
        });
        run.go(60.0, 60.0);
        (0..50).for_each(|k| assert_eq!(run.read(0.6 * k as f64), None));
        run.ms += 300;
        (50..90).find(|k| run.read(if held { 30.0 } else { 0.6 * *k as f64 }).is_some())
    };
    assert_eq!(after(false), None);
    assert!(after(true).is_some_and(|k| k < 80), "{:?}", after(true));
}

/// A stream with a set-point each period, which a motor follows as its acceleration allows; it is held at `until`.
fn streamed(command: impl Fn(f64) -> Command, wanted: impl Fn(f64) -> f64, until: f64) -> Option<f64> {
    let mut run = Run::new();
    let (mut q, mut v): (f64, f64) = (0.0, 0.0);
    for k in 0..600 {
        let t = 0.01 * f64::from(k);
        if k % 2 == 0 {
            run.track(&command(t));
        }
        // toward its set-point of 30 ms ago, as fast as its acceleration allows
        let target = wanted((t - 0.03).max(0.0));
        let best = (target - q) / 0.05;
        let stops = (2.0 * 150.0 * (target - q).abs()).sqrt();
        v = best.clamp(-stops, stops).clamp(v - 2.0, v + 2.0);
        q = (q + 0.01 * v).min(until);
        v = if q == until { 0.0 } else { v };
        if run.read(q).is_some() {
            return Some(wanted(t) - q);
        }
    }
    None
}

#[test]
fn streams_are_followed_or_not() {
    // back and forth, at these speeds at most
    for speed in [5.0, 20.0, 60.0] {
        let wave = move |t: f64| 40.0 * (1.0 - (t * speed / 40.0).cos());
        let direct = move |t: f64| Command::Direct { motors: vec![0], q: vec![wave(t).to_radians()] };
        assert_eq!(streamed(direct, wave, 1e3), None, "{speed}");
        let pace = move |t: f64| speed * (t * speed / 40.0).sin();
        let velocity = move |t: f64| Command::Velocity { motors: vec![0], speed: vec![pace(t).to_radians()] };
        assert_eq!(streamed(velocity, wave, 1e3), None, "{speed}");
        let line = move |t: f64| speed * t;
        let direct = move |t: f64| Command::Direct { motors: vec![0], q: vec![line(t).to_radians()] };
        assert_eq!(streamed(direct, line, 1e3).filter(|_| speed < 30.0), None, "{speed}");
        let most = 4.0 + 0.4 * speed + 0.03 * speed * speed;
        let ahead = streamed(direct, line, 10.0);
        assert!(ahead.is_some_and(|ahead| ahead < most), "{speed}: {ahead:?} deg");
        let velocity = move |_| Command::Velocity { motors: vec![0], speed: vec![speed.to_radians()] };
        let ahead = streamed(velocity, line, 10.0);
        assert!(ahead.is_some_and(|ahead| ahead < most), "{speed}: {ahead:?} deg");
    }
}

#[test]
fn a_passed_stall_is_reported_once() {
    let mut run = Run::new();
    run.moves(0.0, 60.0, 20.0, minimum_jerk, Some(30.0)).unwrap();
    assert_eq!(run.watch.passes(), None);
    run.commands = TrackedCommands::default();
    (0..100).for_each(|k| assert!(run.read(30.0 - 0.3 * f64::from(k)).is_none() && run.watch.passes().is_none()));
    run.commands = TrackedCommands::default();
    let mut passed = Vec::new();
    for k in 0..200 {
        assert_eq!(run.read(0.3 * f64::from(k)), None);
        passed.extend(run.watch.passes());
    }
    assert_eq!(passed, [0]);
}
