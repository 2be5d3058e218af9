//! Joints of a simulated arm as bodies: second-order position servos under weight, friction and elastic
//! contact.
//!
//! ```text
//! I q'' = clamp(k (c - q) + d (lead c' - q')) - g(q) - friction + J^T F      c: the board's commanded position
//! ```
//! The board ([`super::Plant`]) shapes the commanded positions, and the arm follows as far as it can: it
//! lags, sags under its weight, overshoots, and pushes obstacles. Integrated by implicit Euler in steps of
//! [`STEP`] on a fixed grid, so that the motion does not depend on the times of readings.

mod external;
mod profile;

pub use external::ArmPhysics;
pub use profile::{ArmNumbers, ArmProfile, BoardRules, DoneRule, EffortReport, Servo, ServoSettings, StopRule};

use super::body::{ArmBody, Pushes, StepClock};
use super::path::State;
use external::ExternalTorques;
use mobee_contract::KindError;
use std::time::Duration;

/// Time between two steps of the integration.
pub const STEP: Duration = Duration::from_millis(1);
/// Number of steps between two evaluations of weight and contacts; in between, distances are linear in the
/// joint positions.
const STEPS_PER_EVALUATION: u64 = 5;
/// Speed below which a joint that does not accelerate rests, rad/s.
const STILL: f64 = 1e-7;

/// State of one joint and its servo.
#[derive(Clone, Debug)]
struct DynamicJoint {
    servo: Servo,
    /// Position, rad, and speed, rad/s.
    q: f64,
    v: f64,
    /// Torque of the servo in the last step, N m.
    effort: f64,
}

/// An arm.
#[derive(Clone, Debug)]
pub struct Dynamics {
    joints: Vec<DynamicJoint>,
    external: Option<ExternalTorques>,
    clock: StepClock,
    /// External torques in the last step, per radian of encoder.
    outside: Vec<f64>,
    pushes: Pushes,
}

impl Dynamics {
    /// Creates an arm at rest at `start`, rad.
    pub fn new(servos: Vec<Servo>, start: &[f64]) -> Dynamics {
        let joint = |(servo, q): (Servo, &f64)| DynamicJoint { servo, q: *q, v: 0.0, effort: 0.0 };
        Dynamics {
            joints: servos.into_iter().zip(start).map(joint).collect(),
            external: None,
            clock: StepClock::new(STEP, start),
            outside: vec![0.0; start.len()],
            pushes: Pushes::default(),
        }
    }
}

impl ArmBody for Dynamics {
    fn set_physics(&mut self, physics: ArmPhysics) -> Result<(), KindError> {
        self.external = ExternalTorques::new(physics);
        // evaluates now, because the next regular evaluation may be some steps away, and an arm without
        // weight would count as resting
        let q = self.positions();
        if let Some(external) = &mut self.external {
            external.look(&q);
        }
        self.clock.wake();
        Ok(())
    }

    fn clock(&mut self) -> &mut StepClock {
        &mut self.clock
    }

    fn step(&mut self, commanded: &[State]) {
        let dt = STEP.as_secs_f64();
        let mut outside = std::mem::take(&mut self.outside);
        outside.fill(0.0);
        if let Some(external) = &mut self.external {
            let (q, v): (Vec<f64>, Vec<f64>) = self.joints.iter().map(|j| (j.q, j.v)).unzip();
            if self.clock.steps().is_multiple_of(STEPS_PER_EVALUATION) && !self.clock.rests() {
                external.look(&q);
            }
            let force = external.torques(&q, &v, &mut outside);
            self.pushes.note(force, STEP);
        }
        let mut still = true;
        for ((joint, state), outside) in self.joints.iter_mut().zip(commanded).zip(&outside) {
            let before = joint.v;
            joint.step(*state, *outside, dt);
            still &= joint.v.abs() < STILL && before.abs() < STILL;
        }
        self.outside = outside;
        self.clock.step(commanded, still);
    }

    fn positions(&self) -> Vec<f64> {
        self.joints.iter().map(|j| j.q).collect()
    }

    fn speeds(&self) -> Vec<f64> {
        self.joints.iter().map(|j| j.v).collect()
    }

    fn efforts(&self) -> Vec<f64> {
        self.joints.iter().map(|j| j.effort / j.servo.unit).collect()
    }

    fn external(&self) -> Vec<f64> {
        self.joints.iter().zip(&self.outside).map(|(j, outside)| outside / j.servo.unit).collect()
    }

    fn pushes(&mut self) -> &mut Pushes {
        &mut self.pushes
    }
}

impl DynamicJoint {
    /// One step of implicit Euler under an external torque; the servo's own torque is limited.
    fn step(&mut self, commanded: State, outside: f64, dt: f64) {
        let Servo { stiffness, damping, torque, inertia, friction, lead, stops, .. } = self.servo;
        let ahead = commanded.q - self.q;
        let wanted = stiffness * ahead + damping * (lead * commanded.v - self.v);
        let free = if wanted.abs() > torque {
            self.effort = torque.copysign(wanted);
            self.v + dt / inertia * (self.effort + outside)
        } else {
            // stiffness and damping act on the state at the end of the step, which is stable for any
            // stiffness
            let push = stiffness * ahead + damping * lead * commanded.v + outside;
            let v = (self.v + dt / inertia * push) / (1.0 + dt / inertia * (damping + dt * stiffness));
            self.effort = stiffness * (ahead - dt * v) + damping * (lead * commanded.v - v);
            v
        };
        // dry friction reduces the speed but never reverses it
        let lost = dt / inertia * friction;
        self.v = if free.abs() <= lost { 0.0 } else { free - lost.copysign(free) };
        let q = self.q + dt * self.v;
        // an end stop removes all speed
        self.q = q.max(stops.0).min(stops.1);
        if self.q != q {
            self.v = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn servo() -> Servo {
        Servo {
            stiffness: 20.0,
            damping: 1.0,
            torque: 3.0,
            inertia: 0.05,
            rotor: 0.02,
            friction: 0.0,
            lead: 1.0,
            unit: 1.0,
            stops: (-1.5, 1.5),
        }
    }

    fn run(arm: &mut Dynamics, secs: f64, c: f64) {
        for _ in 0..(secs / STEP.as_secs_f64()).round() as usize {
            arm.step(&[State::rest(c)]);
        }
    }

    /// Second-order step response: the overshoot matches the damping ratio, and the joint ends at the commanded
    /// position.
    #[test]
    fn a_step_overshoots_as_its_damping_ratio_demands() {
        let mut arm = Dynamics::new(vec![servo()], &[0.0]);
        let mut peak = 0.0_f64;
        let zeta = 1.0 / (2.0 * (20.0_f64 * 0.05).sqrt());
        for _ in 0..4000 {
            arm.step(&[State::rest(0.1)]);
            peak = peak.max(arm.positions()[0]);
        }
        let expected = 0.1 * (1.0 + (-std::f64::consts::PI * zeta / (1.0 - zeta * zeta).sqrt()).exp());
        assert!((peak - expected).abs() < 0.002, "{peak} and {expected}");
        assert!((arm.positions()[0] - 0.1).abs() < 1e-5);
        assert!(arm.clock().is_settled(&[0.1]));
    }

    #[test]
    fn the_torque_is_limited_and_dry_friction_holds() {
        let mut arm = Dynamics::new(vec![servo()], &[0.0]);
        arm.step(&[State::rest(100.0)]);
        assert_eq!(arm.efforts(), [3.0]);
        let mut stuck = Dynamics::new(vec![Servo { friction: 0.5, ..servo() }], &[0.0]);
        run(&mut stuck, 2.0, 0.02);
        assert_eq!(stuck.positions(), [0.0], "0.4 N m do not overcome 0.5");
        run(&mut stuck, 2.0, 0.1);
        let q = stuck.positions()[0];
        assert!(q > 0.05 && (0.1 - q) * 20.0 <= 0.5 + 1e-9, "{q}");
    }

    #[test]
    fn an_end_stop_holds_whatever_pushes() {
        let mut arm = Dynamics::new(vec![servo()], &[1.4]);
        run(&mut arm, 2.0, 100.0);
        assert_eq!((arm.positions()[0], arm.speeds()[0]), (1.5, 0.0));
        run(&mut arm, 4.0, 1.0);
        assert!((arm.positions()[0] - 1.0).abs() < 1e-4, "it comes off again");
    }

    /// The integration stays stable for stiff servos.
    #[test]
    fn a_stiff_servo_is_stable() {
        let stiff = Servo { stiffness: 1e6, damping: 1e4, torque: 1e9, inertia: 0.001, ..servo() };
        let mut arm = Dynamics::new(vec![stiff], &[0.0]);
        run(&mut arm, 1.0, 1.0);
        assert!((arm.positions()[0] - 1.0).abs() < 1e-6);
    }
}
