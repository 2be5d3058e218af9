//! Weight of an arm whose servos report their own load, learned from its readings.
//!
//! The load of such a servo includes the weight of the arm, which changes with the configuration. The weight's
//! torques are linear in the mass and the first moment of mass of each link (Atkeson, An and Hollerbach, 1986), and
//! friction in its coefficients. A Kalman filter estimates all of them from the loads of free motions:
//!
//! ```text
//! load = weight(q) - friction(q') + external torque            what the estimate leaves unexplained is external
//! ```
//! So a contact shows while it is small beside the weight ([`crate::effort`]), and the sag of the arm in any configuration
//! is known before the arm is there ([`crate::hold_offset`]).

use crate::Rules;
use mobee_contract::{Axis, Pose, Sample, Time};
use mobee_model::{Robot, Skeleton};
use nalgebra::{DMatrix, DVector, Isometry3, Point3, Vector3};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Standard gravity, m/s^2.
const GRAVITY: f64 = 9.81;
/// Parameters of a link: its mass, and three first moments.
const PER_LINK: usize = 4;
/// Parameters of a motor: dry and viscous friction.
const PER_MOTOR: usize = 2;
/// Speed at which half of the dry friction acts, rad/s.
const FRICTION_SPEED: f64 = 0.02;
/// Time over which speeds are measured.
const SPEED_WINDOW: Duration = Duration::from_millis(80);
/// Motion after which the next reading is used, rad: readings of one configuration repeat one error.
const STEP: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// Standard deviations of the unexplained torque, as shares of the threshold of a contact: at rest, where dry friction
/// may hold the joint, and in motion, where inertia acts as well.
const DEVIATIONS: (f64, f64) = (0.05, 0.15);
/// Least unexplained torque of a contact, as a share of the same threshold.
const LEAST_SHARE: f64 = 0.2;
/// Least unexplained torque of a contact, in root mean squares of the unexplained torques of free motions.
const LEAST_RMS: f64 = 4.0;
/// Share of one reading in that mean.
const MEAN_SHARE: f64 = 0.02;
/// Growth of the variances with each reading, as a share of those at the beginning: payloads change.
const DRIFT: f64 = 1e-5;

/// Torque of a motor that the arm's weight and friction do not explain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unexplained {
    /// The torque, N m.
    pub torque: f64,
    /// Magnitude from which something pushes the motor, N m.
    pub limit: f64,
}

/// Estimate of an arm's weight and friction.
#[derive(Clone, Debug)]
pub struct LoadModel {
    axes: Arc<[Axis]>,
    skeleton: Skeleton,
    /// One node of each moving frame.
    links: Vec<usize>,
    estimate: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Growth of the variances per reading.
    drift: DVector<f64>,
    /// Mean square of each motor's unexplained torque in free motions.
    squares: Vec<f64>,
    /// Readings of the last [`SPEED_WINDOW`], oldest first.
    readings: VecDeque<(Time, Pose)>,
    /// Configuration of the last reading that was used.
    used: Pose,
}

impl LoadModel {
    /// Creates the estimate for a robot under these rules; `None` if its board compensates the weight, or reports no
    /// load.
    pub fn new(rules: &Rules, robot: &Robot) -> Option<LoadModel> {
        let axes = rules.axes.clone();
        let most = axes.iter().filter(|axis| is_loaded(axis)).map(|axis| axis.contact_effort).fold(0.0, f64::max);
        if most <= 0.0 || axes.len() != robot.motors.len() {
            return None;
        }
        // Bases stand upright, so that their places do not matter.
        let skeleton = Skeleton::new(robot, Isometry3::identity());
        let node = |frame: usize| skeleton.frame.iter().position(|of| *of == frame);
        let links: Vec<usize> = (1..skeleton.frames()).filter_map(node).collect();
        let reach = robot.reach().into_iter().fold(0.1, f64::max);
        let mass = 2.0 * most / (GRAVITY * reach);
        let link = [mass, 0.25 * mass * reach, 0.25 * mass * reach, 0.25 * mass * reach];
        let friction = axes.iter().flat_map(|axis| [0.3 * axis.contact_effort; PER_MOTOR]);
        let spread = links.iter().flat_map(|_| link).chain(friction).map(|s| s * s);
        let variances = DVector::from_iterator(PER_LINK * links.len() + PER_MOTOR * axes.len(), spread);
        Some(LoadModel {
            skeleton,
            links,
            estimate: DVector::zeros(variances.len()),
            covariance: DMatrix::from_diagonal(&variances),
            drift: variances * DRIFT,
            squares: vec![0.0; axes.len()],
            readings: VecDeque::new(),
            used: Vec::new().into(),
            axes,
        })
    }

    /// Processes a reading. Returns what it leaves unexplained, per motor; `None` for a motor whose load is not known
    /// well enough in this configuration.
    pub fn read(&mut self, sample: &Sample) -> Arc<[Option<Unexplained>]> {
        if sample.external.len() != self.axes.len() || sample.q.len() != self.axes.len() {
            return Arc::default();
        }
        let speeds = self.speeds(sample);
        let rows = self.rows(&sample.q, &speeds);
        let rests = sample.done.iter().all(|done| *done) && speeds.iter().all(|v| v.abs() < FRICTION_SPEED);
        let far = |(a, b): (&f64, &f64)| (a - b).abs() > STEP;
        let uses = self.used.len() != sample.q.len() || self.used.iter().zip(sample.q.iter()).any(far);
        let mut found = Vec::with_capacity(rows.len());
        for (m, (row, torque)) in rows.iter().zip(&sample.external).enumerate() {
            let Some(axis) = self.axes.get(m).filter(|axis| is_loaded(axis) && torque.is_finite()) else {
                found.push(None);
                continue;
            };
            let unexplained = torque - row.dot(&self.estimate);
            let deviation = self.deviation(row);
            let known = self.limit(m);
            let limit = known + 2.0 * deviation;
            found.push((deviation < 0.5 * known).then_some(Unexplained { torque: unexplained, limit }));
            if uses && (rests || unexplained.abs() < limit + deviation) {
                let noise = axis.contact_effort * if rests { DEVIATIONS.0 } else { DEVIATIONS.1 };
                // an arm at rest may have been loaded, or may touch something
                let beyond = unexplained.abs() > limit + deviation;
                let noise = if beyond { noise.max(unexplained.abs()) } else { noise };
                self.correct(row, unexplained, noise * noise);
                if let Some(mean) = self.squares.get_mut(m).filter(|_| !beyond && deviation < 0.5 * known) {
                    *mean += MEAN_SHARE * (unexplained * unexplained - *mean);
                }
            }
        }
        if uses {
            self.used = sample.q.clone();
            for (i, drift) in self.drift.iter().enumerate() {
                if let Some(variance) = self.covariance.get_mut((i, i)) {
                    *variance += drift;
                }
            }
        }
        found.into()
    }

    /// Torques of the weight in this configuration, N m; `None` for a motor for which they are not known well enough.
    pub fn weight(&self, q: &[f64]) -> Vec<Option<f64>> {
        let rows = self.rows(q, &vec![0.0; q.len()]);
        let weight = |(m, row): (usize, &DVector<f64>)| {
            let loaded = self.axes.get(m).is_some_and(is_loaded);
            (loaded && self.deviation(row) < 0.5 * self.limit(m)).then(|| row.dot(&self.estimate))
        };
        rows.iter().enumerate().map(weight).collect()
    }

    /// Magnitude of an unexplained torque from which something pushes this motor, if its load is known exactly, N m.
    fn limit(&self, motor: usize) -> f64 {
        let effort = self.axes.get(motor).map_or(f64::INFINITY, |axis| axis.contact_effort);
        let rms = self.squares.get(motor).map_or(0.0, |mean| mean.sqrt());
        (LEAST_SHARE * effort).max(LEAST_RMS * rms)
    }

    fn deviation(&self, row: &DVector<f64>) -> f64 {
        row.dot(&(&self.covariance * row)).max(0.0).sqrt()
    }

    /// Corrects the estimate by a torque that it left unexplained, of this variance (Kalman, 1960).
    fn correct(&mut self, row: &DVector<f64>, unexplained: f64, variance: f64) {
        let along = &self.covariance * row;
        let gain = &along / (row.dot(&along) + variance);
        self.estimate += &gain * unexplained;
        self.covariance -= &gain * along.transpose();
    }

    /// Speeds of the motors, rad/s.
    fn speeds(&mut self, sample: &Sample) -> Vec<f64> {
        while self.readings.get(1).is_some_and(|(at, _)| *at + SPEED_WINDOW <= sample.at) {
            self.readings.pop_front();
        }
        self.readings.push_back((sample.at, sample.q.clone()));
        let Some((at, before)) = self.readings.front() else { return Vec::new() };
        let secs = sample.at.since(*at).as_secs_f64().max(1e-3);
        sample.q.iter().zip(before.iter()).map(|(q, before)| (q - before) / secs).collect()
    }

    /// Derivatives of each motor's load with respect to the parameters.
    fn rows(&self, q: &[f64], speeds: &[f64]) -> Vec<DVector<f64>> {
        let mut frames = Vec::new();
        self.skeleton.place(q, &mut frames);
        let mut rows = vec![DVector::zeros(self.estimate.len()); self.axes.len()];
        let mut origin = vec![0.0; self.axes.len()];
        let mut offset = origin.clone();
        for (link, node) in self.links.iter().enumerate() {
            let Some(frame) = self.skeleton.frame.get(*node).and_then(|f| frames.get(*f)) else { continue };
            let down = -Vector3::z() * GRAVITY;
            let at = Point3::from(frame.translation.vector);
            origin.fill(0.0);
            self.skeleton.add_torques(&frames, *node, &at, &down, &mut origin);
            set(&mut rows, PER_LINK * link, &origin);
            for (k, axis) in [Vector3::x(), Vector3::y(), Vector3::z()].iter().enumerate() {
                offset.iter_mut().zip(&origin).for_each(|(offset, origin)| *offset = -origin);
                self.skeleton.add_torques(&frames, *node, &(at + frame.rotation * axis), &down, &mut offset);
                set(&mut rows, PER_LINK * link + 1 + k, &offset);
            }
        }
        let first = PER_LINK * self.links.len();
        for (m, (row, v)) in rows.iter_mut().zip(speeds).enumerate() {
            for (k, x) in [-v / (v.abs() + FRICTION_SPEED), -v].into_iter().enumerate() {
                row.get_mut(first + PER_MOTOR * m + k).into_iter().for_each(|place| *place = x);
            }
        }
        rows
    }
}

/// Sets one column.
fn set(rows: &mut [DVector<f64>], column: usize, values: &[f64]) {
    for (row, value) in rows.iter_mut().zip(values) {
        row.get_mut(column).into_iter().for_each(|place| *place = *value);
    }
}

/// Returns whether the load of this motor includes the arm's weight.
fn is_loaded(axis: &Axis) -> bool {
    let rated = axis.contact_effort > 0.0 && axis.contact_effort < Axis::UNRATED;
    axis.hold_error > 0.0 && rated && axis.motion.is_turn()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::ControllerSettings;
    use mobee_contract::Board;
    use mobee_model::parse_robot;

    const ARM: &str = include_str!("../../../configs/robots/so101.xml");
    const THRESHOLD: f64 = 1.74;
    const FRICTION: f64 = 0.05;

    /// Pseudo-random numbers from 0 to 1.
    pub(crate) fn uniform(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// An SO-101 whose servos report their load, and may rest this far beside their commanded positions, rad.
    pub(crate) fn arm(hold_error: f64) -> (Robot, Rules) {
        let robot = parse_robot("so101.xml", ARM).unwrap().value;
        let axis = |m: &mobee_model::Motor| Axis {
            min: m.min,
            max: m.max,
            max_speed: 1.0,
            max_acceleration: 4.0,
            hold_error,
            contact_effort: THRESHOLD,
            stop_sinks: true,
            ..Axis::default()
        };
        let axes = robot.motors.iter().map(axis).collect();
        let board = Board { axes, period: Duration::from_millis(10), latency: Duration::ZERO, position_direct: true };
        let rules = Rules::new("r", vec![], &ControllerSettings::default(), &board);
        (robot, rules)
    }

    /// Torques of links of 100 g whose centers are 4 cm off their joints, N m.
    pub(crate) fn weight(skeleton: &Skeleton, q: &[f64]) -> Vec<f64> {
        let mut torques = vec![0.0; q.len()];
        let mut frames = Vec::new();
        skeleton.place(q, &mut frames);
        for frame in 1..frames.len() {
            let node = skeleton.frame.iter().position(|of| *of == frame).unwrap();
            let center = frames[frame] * Point3::new(0.02, 0.03, -0.02);
            skeleton.add_torques(&frames, node, &center, &(-Vector3::z() * 0.981), &mut torques);
        }
        torques
    }

    /// Moves the arm from target to target for this number of readings, 20 a second, with this external torque on the
    /// second motor. Returns the greatest share of its limit that a motor's unexplained torque had, and the number of
    /// readings with a known load of that motor.
    fn moves(model: &mut LoadModel, robot: &Robot, (from, readings): (u64, u64), push: f64) -> (f64, usize) {
        let skeleton = Skeleton::new(robot, Isometry3::identity());
        let mut state = from + 1;
        let mut q: Vec<f64> = robot.motors.iter().map(|m| m.home).collect();
        let mut target = q.clone();
        let (mut greatest, mut known) = (0.0_f64, 0);
        for k in from..from + readings {
            if k % 40 == 0 {
                target = robot.motors.iter().map(|m| m.min + (m.max - m.min) * uniform(&mut state)).collect();
            }
            let speeds: Vec<f64> = q.iter().zip(&target).map(|(q, to)| (to - q).clamp(-0.5, 0.5)).collect();
            q.iter_mut().zip(&speeds).for_each(|(q, v)| *q += 0.05 * v);
            let mut external = weight(&skeleton, &q);
            external[1] += push;
            for (torque, v) in external.iter_mut().zip(&speeds) {
                *torque -= FRICTION * v / (v.abs() + 1e-3) + 0.1 * (uniform(&mut state) - 0.5);
            }
            let at = Time::ZERO + Duration::from_millis(50) * u32::try_from(k).unwrap();
            let done = vec![false; q.len()];
            let found = model.read(&Sample { at, q: q.clone().into(), external, done, ..Sample::default() });
            if let Some(of) = found[1] {
                known += 1;
                greatest = greatest.max(of.torque.abs() / of.limit);
            }
        }
        (greatest, known)
    }

    /// After a minute of free motions the weight is known in configurations in which the arm never was, and a push
    /// of two fifths of the threshold stands out.
    #[test]
    fn the_weight_is_learned_and_a_light_push_stands_out() {
        let (robot, rules) = arm(0.1);
        let mut model = LoadModel::new(&rules, &robot).unwrap();
        let known: Vec<bool> = model.weight(&[0.0; 6]).iter().map(Option::is_some).collect();
        assert_eq!(known[..2], [true, false], "the vertical axis carries no weight, the next one an unknown one");
        moves(&mut model, &robot, (0, 1200), 0.0);
        let skeleton = Skeleton::new(&robot, Isometry3::identity());
        let mut state = 99;
        for _ in 0..50 {
            let q: Vec<f64> = robot.motors.iter().map(|m| m.min + (m.max - m.min) * uniform(&mut state)).collect();
            for (m, (found, is)) in model.weight(&q).iter().zip(weight(&skeleton, &q)).enumerate() {
                assert!((found.unwrap() - is).abs() < 0.03, "motor {m}: {found:?} and {is}");
            }
        }
        let (free, known) = moves(&mut model, &robot, (1200, 600), 0.0);
        assert!(free < 0.8 && known == 600, "{free}, {known}");
        let (pushed, known) = moves(&mut model, &robot, (1800, 10), 0.7);
        assert!(pushed > 1.0 && known > 0, "{pushed}, {known}");
    }

    #[test]
    fn a_board_that_compensates_the_weight_has_no_such_model() {
        let (robot, rules) = arm(0.0);
        assert!(LoadModel::new(&rules, &robot).is_none());
    }
}
