//! What the plant never does, whatever it is told.

use mobee_contract::{Axis, Command, ControlMode, Move, Target, Time};
use mobee_sim::Plant;
use mobee_sim::path::{Bounds, Leg, Profile, State, follow};
use proptest::prelude::*;
use std::time::Duration;

const MOTORS: usize = 3;

fn axes() -> Vec<Axis> {
    let axis = |i: usize| Axis {
        name: format!("m{i}"),
        min: -1.0,
        max: 1.5,
        max_speed: 100f64.to_radians(),
        max_acceleration: 200f64.to_radians(),
        ..Default::default()
    };
    (0..MOTORS).map(axis).collect()
}

/// The first so many motors.
fn first(n: usize) -> Vec<usize> {
    (0..n).collect()
}

fn all_direct(q: f64) -> Command {
    Command::Direct { motors: first(MOTORS), q: vec![q; MOTORS] }
}

#[derive(Clone, Debug)]
enum Act {
    Give(Command),
    Lease(u64),
}

fn acts() -> impl Strategy<Value = Vec<(u64, Act)>> {
    let q = || -1.0..1.5f64;
    let speed = || prop_oneof![Just(0.0), 0.0..0.2f64, 0.0..4.0f64];
    let motion =
        (0..MOTORS, q(), any::<bool>(), prop::option::of((speed(), speed()))).prop_map(|(m, q, relative, r)| {
            let (speed, acceleration) = r.map(|(v, a)| (vec![v], vec![a])).unzip();
            let q = if relative { 0.3 * q } else { q };
            Act::Give(Command::Move(Move { motors: vec![m], q: vec![q], relative, speed, acceleration }))
        });
    let direct =
        prop::collection::vec(q(), 1..=MOTORS).prop_map(|q| Act::Give(Command::Direct { motors: first(q.len()), q }));
    let near = (q(), 0.0..0.1f64).prop_map(|(q, d)| Act::Give(all_direct(q.min(1.4) + d)));
    let velocity =
        (0..MOTORS, -2.0..2.0f64).prop_map(|(m, v)| Act::Give(Command::Velocity { motors: vec![m], speed: vec![v] }));
    let stop =
        (0..=MOTORS).prop_map(|m| Act::Give(Command::Stop { motors: if m < MOTORS { vec![m] } else { vec![] } }));
    let mode = prop_oneof![Just(ControlMode::PositionDirect), Just(ControlMode::Position), Just(ControlMode::Idle)]
        .prop_map(|mode| Act::Give(Command::Mode { motors: first(MOTORS), mode }));
    let lease = (0u64..400).prop_map(Act::Lease);
    let act = prop_oneof![4 => motion, 4 => velocity, 3 => direct, 3 => near, 1 => stop, 2 => mode, 3 => lease];
    prop::collection::vec((prop_oneof![Just(20u64), 0u64..600], act), 1..40)
}

fn near(limit: f64, value: f64) -> bool {
    value.abs() <= limit * (1.0 + 1e-9) + 1e-9
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn limits_hold_under_any_commands(acts in acts(), trapezoidal in any::<bool>()) {
        let profile = if trapezoidal { Profile::Trapezoidal } else { Profile::MinimumJerk };
        let axes = axes();
        let mut plant = Plant::new(axes.clone(), &[0.0; MOTORS], profile);
        let (mut ms, mut leased_until) = (0u64, 0u64);
        plant.lease(Time::ZERO, Time(2_000_000_000));
        leased_until = leased_until.max(2000);
        let mut before: Vec<f64> = plant.positions().collect();
        let mut speed_before = vec![0.0; MOTORS];
        for (wait, act) in acts {
            for _ in 0..wait {
                ms += 1;
                plant.advance(Time(ms * 1_000_000));
                let q: Vec<f64> = plant.positions().collect();
                let v: Vec<f64> = plant.speeds().collect();
                for m in 0..MOTORS {
                    let a = &axes[m];
                    prop_assert!(q[m] >= a.min - 1e-9 && q[m] <= a.max + 1e-9, "position {}", q[m]);
                    prop_assert!(near(a.max_speed, v[m]), "speed {}", v[m]);
                    prop_assert!(near(a.max_speed, (q[m] - before[m]) * 1e3), "step {}", q[m] - before[m]);
                    prop_assert!(near(a.max_acceleration, (v[m] - speed_before[m]) * 1e3), "at {ms} ms: acceleration {}", (v[m] - speed_before[m]) * 1e3);
                    let braked = a.max_speed / a.max_acceleration * 1e3;
                    if ms as f64 > leased_until as f64 + braked + 1.0 {
                        prop_assert!(v[m] == 0.0, "moves without a lease");
                    }
                }
                (before, speed_before) = (q, v);
            }
            let now = Time(ms * 1_000_000);
            match act {
                Act::Lease(more) => {
                    leased_until = ms + more;
                    plant.lease(now, Time(leased_until * 1_000_000));
                }
                // refusals are fine: they must change nothing
                Act::Give(command) => drop(plant.command(now, &command, Duration::from_millis(20))),
            }
        }
    }

    #[test]
    fn a_leg_is_followed_within_speed_and_acceleration(
        q in -1.0..1.0f64, ahead in prop_oneof![Just(0.0), -0.1..0.1f64], share in -1.0..=1.0f64, to in -1.0..1.0f64, interval in 0.01..0.1f64,
    ) {
        let greatest = Bounds { speed: 1.7, acceleration: 3.5 };
        let from = State { q, v: share * greatest.speed, a: 0.0 };
        let path = follow(from, Leg::new(q + ahead, to, interval, greatest), [-10.0, 10.0], greatest);
        for (t, state) in path.joints() {
            prop_assert!(near(greatest.speed, state.v), "speed {} after {t} s", state.v);
            prop_assert!(near(greatest.acceleration, state.a), "acceleration {} after {t} s", state.a);
        }
    }

    #[test]
    fn a_move_in_step_is_a_straight_line(
        from in prop::array::uniform3(-1.0..1.5f64), to in prop::array::uniform3(-1.0..1.5f64), speed in 0.01..1.0f64, trapezoidal in any::<bool>(),
    ) {
        let ways: Vec<f64> = from.iter().zip(&to).map(|(a, b)| (b - a).abs()).collect();
        let longest = ways.iter().copied().fold(0.0, f64::max);
        // motors with next to nothing to do are not slowed down as far as the others would need it
        prop_assume!(ways.iter().all(|w| *w > 0.03 * longest));
        let profile = if trapezoidal { Profile::Trapezoidal } else { Profile::MinimumJerk };
        let mut plant = Plant::new(axes(), &from, profile);
        plant.lease(Time::ZERO, Time(u64::MAX));
        let target = Target { motors: vec![0, 1, 2], q: to.to_vec(), speed };
        plant.command(Time::ZERO, &Command::Move(target.in_step(&from, &axes())), Duration::ZERO).unwrap();
        let mut ms = 0;
        let mut arrived = None;
        while ms < 400_000 && arrived.is_none() {
            ms += 7;
            plant.advance(Time(ms * 1_000_000));
            let q: Vec<f64> = plant.positions().collect();
            let share = (q[0] - from[0]) / (to[0] - from[0]);
            for m in 0..MOTORS {
                prop_assert!((from[m] + share * (to[m] - from[m]) - q[m]).abs() < 1e-9);
            }
            let done = plant.done();
            prop_assert!(done.iter().all(|d| *d == done[0]));
            arrived = done[0].then_some(q);
        }
        prop_assert_eq!(arrived, Some(to.to_vec()));
    }

    #[test]
    fn reference_speed_and_acceleration_hold(
        from in -1.0..1.5f64, to in -1.0..1.5f64, v in 0.01..1.7f64, a in 0.01..3.4f64, trapezoidal in any::<bool>(),
    ) {
        let profile = if trapezoidal { Profile::Trapezoidal } else { Profile::MinimumJerk };
        let mut plant = Plant::new(axes(), &[from; MOTORS], profile);
        plant.lease(Time::ZERO, Time(u64::MAX));
        let there = Move { motors: vec![0], q: vec![to], relative: false, speed: Some(vec![v]), acceleration: Some(vec![a]) };
        plant.command(Time::ZERO, &Command::Move(there), Duration::ZERO).unwrap();
        let (mut before, mut fastest) = (0.0, 0.0f64);
        for tick in 1..60_000u64 {
            plant.advance(Time(tick * 10_000_000));
            let now = plant.speeds().next().unwrap();
            prop_assert!(near(v, now) && near(a, (now - before) * 100.0));
            fastest = fastest.max(now.abs());
            before = now;
            if plant.done()[0] {
                break;
            }
        }
        prop_assert_eq!(plant.positions().next(), Some(to));
        // and it is no slower than it must be: one of the two references is nearly used
        let by_speed = fastest / v;
        let by_acceleration = fastest * fastest / (a * (to - from).abs());
        prop_assert!((to - from).abs() < 0.05 || by_speed > 0.9 || by_acceleration > 0.5, "{by_speed} {by_acceleration}");
    }
}

#[test]
fn a_ramp_of_set_points_is_followed_closely() {
    for rate_deg in [10f64, 40.0, 90.0] {
        let mut plant = Plant::new(axes(), &[-0.9; MOTORS], Profile::MinimumJerk);
        plant.lease(Time::ZERO, Time(u64::MAX));
        let direct = Command::Mode { motors: first(MOTORS), mode: ControlMode::PositionDirect };
        plant.command(Time::ZERO, &direct, Duration::ZERO).unwrap();
        let step = rate_deg.to_radians() * 0.02;
        let mut worst = 0.0f64;
        for tick in 0..50u64 {
            let q = -0.9 + step * tick as f64;
            if q > 1.5 {
                break;
            }
            let now = Time(tick * 20_000_000);
            plant.command(now, &all_direct(q), Duration::ZERO).unwrap();
            for ms in 0..20 {
                plant.advance(now + Duration::from_millis(ms));
                // behind the newest set-point, once up to speed
                if tick as f64 * 0.02 > 0.4 + rate_deg / 50.0 {
                    worst = worst.max((q - plant.positions().next().unwrap()).to_degrees());
                }
            }
        }
        assert!(worst < rate_deg * 0.02 + 0.1, "{rate_deg} deg/s: lags by {worst} deg");
    }
}
