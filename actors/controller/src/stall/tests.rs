//! A motor that follows in its own way, or does not: what is taken for a stall, and how soon.

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

/// A way of getting there: where a motor is on a way of one degree, at a part of its time.
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
    told: Errands,
    ms: u64,
    noise: u64,
    /// How many times the usual noise.
    loud: f64,
}

impl Run {
    fn new() -> Run {
        let rules = rules();
        let watch = StallWatch::new(&rules).unwrap();
        let mut run = Run { rules, watch, told: Errands::default(), ms: 0, noise: 1, loud: 1.0 };
        (0..20).for_each(|_| assert_eq!(run.read(0.0), None));
        run
    }

    /// Evenly within a sixtieth of a degree, or so many times that.
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
        self.watch.read(&mut self.told, &pulse, &self.rules)
    }

    fn hear(&mut self, command: &Command) {
        self.watch.hear(&mut self.told, command, Time(self.ms * 1_000_000), &self.rules);
    }

    fn go(&mut self, deg: f64, speed: f64) {
        let (q, speed) = (vec![deg.to_radians()], Some(vec![speed.to_radians()]));
        let acceleration = Some(vec![200_f64.to_radians()]);
        self.told = Errands::default();
        self.hear(&Command::Move(Move { motors: vec![0], q, relative: false, speed, acceleration }));
    }

    /// A move, whose motor is held from `until` on (degrees): how far its board wanted it beyond as it counted as stalled.
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
        self.watch.learn(&self.told);
        None
    }
}

#[test]
fn who_follows_freely_is_never_stopped() {
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
fn noise_stops_nobody() {
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
fn who_is_held_is_stopped_before_much_is_wanted_of_it() {
    for (profile, faster) in [(minimum_jerk as Profile, 1.0), (trapezoid, 1.5), (gain, 3.0)] {
        for (speed, most) in [(3.0, 6.0), (10.0, 6.5), (30.0, 9.0), (100.0, 18.0)] {
            for until in [0.0, 1.0, 10.0, 40.0, 70.0] {
                let mut run = Run::new();
                let ahead = run.moves(0.0, 90.0, speed, profile, Some(until));
                // who begins more suddenly than a minimum-jerk trajectory is late to be missed
                let begins = until <= 1.0 && profile(0.01) > 1e-4;
                let most = if begins { 90.0 } else { faster * most };
                assert!(ahead.is_some_and(|ahead| ahead < most), "{speed} deg/s, held at {until}: {ahead:?} deg");
            }
        }
    }
}

#[test]
fn the_threshold_is_what_free_motions_show() {
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
    // of the motor that did not move nothing was learned
    assert!((run.watch.threshold(1).to_degrees() - 1.5).abs() < 1e-9);
    // one whose motions stick is given more
    for _ in 0..3 {
        run.moves(30.0, 0.0, 20.0, minimum_jerk, None);
        run.go(40.0, 20.0);
        let sticks = |k: u64| if k < 100 { 0.2 * k as f64 } else { 20.0 + 0.2 * k.saturating_sub(106) as f64 };
        (0..230).for_each(|k| assert_eq!(run.read(sticks(k).min(40.0)), None, "{k}"));
        run.watch.learn(&run.told);
        run.moves(40.0, 30.0, 20.0, minimum_jerk, None);
    }
    assert!(run.watch.threshold(0).to_degrees() > known, "{}", run.watch.threshold(0).to_degrees());
}

/// Readings that are late, missing or the same to the last bit are no sign of anything.
#[test]
fn what_is_not_read_is_no_stall() {
    let mut run = Run::new();
    run.go(60.0, 20.0);
    (0..60).for_each(|k| assert_eq!(run.read(0.2 * k as f64), None));
    let mut same = run.pulse(12.0);
    for k in 1..40 {
        (same.sample.at, same.unchanged) = (Time((run.ms + 10 * k) * 1_000_000), Time(run.ms * 1_000_000));
        assert_eq!(run.watch.read(&mut run.told, &same, &run.rules), None);
    }
    run.ms += 2_000;
    // it came to rest meanwhile, as its lease was over
    (0..10).for_each(|_| assert_eq!(run.read(14.0), None));
}

/// A stream of set-points each period, which a motor follows as its acceleration allows, and is held at `until`.
fn streamed(command: impl Fn(f64) -> Command, wanted: impl Fn(f64) -> f64, until: f64) -> Option<f64> {
    let mut run = Run::new();
    let (mut q, mut v): (f64, f64) = (0.0, 0.0);
    for k in 0..600 {
        let t = 0.01 * f64::from(k);
        if k % 2 == 0 {
            run.hear(&command(t));
        }
        // toward where it was sent 30 ms ago, as fast as its acceleration allows
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
    // there and back again, at these speeds at most
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
fn a_place_that_is_passed_is_told_once() {
    let mut run = Run::new();
    run.moves(0.0, 60.0, 20.0, minimum_jerk, Some(30.0)).unwrap();
    assert_eq!(run.watch.passes(), None);
    run.told = Errands::default();
    (0..100).for_each(|k| assert!(run.read(30.0 - 0.3 * f64::from(k)).is_none() && run.watch.passes().is_none()));
    run.told = Errands::default();
    let mut passed = Vec::new();
    for k in 0..200 {
        assert_eq!(run.read(0.3 * f64::from(k)), None);
        passed.extend(run.watch.passes());
    }
    assert_eq!(passed, [0]);
}
