//! Configurations as Python has them, radians and meters, and as the model has them, "rad of encoder". No Python here.

use crate::failure::Failure;
use mobee_model::{JointMotion, Motor, Robot};

/// Tolerance of a joint limit for rounding, rad or m.
const ROUNDING: f64 = 1e-9;
/// A joint without end is put within its limits from as far as this, rad: beyond, rounding is no longer small.
const MAX_TURNED: f64 = 1e6;
/// No more joints are named in a message.
const MOST_NAMED: usize = 12;

/// Treatment of a configuration beyond a joint limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Beyond {
    /// An error: there is no answer for it.
    Refused,
    /// Passed on as it is, for a query that answers for it.
    Passed,
    /// The same, and joints without end are not put within their limits, as the way to there would be another one.
    Straight,
}

/// The joints of a configuration: those of one robot, or of all robots of a scene in their order.
#[derive(Clone, Debug, Default)]
pub(crate) struct JointTable {
    /// Their names, `robot:joint` where there are several robots.
    pub names: Vec<String>,
    motors: Vec<Motor>,
    /// Rad of encoder per rad or meter.
    scale: Vec<f64>,
}

impl JointTable {
    /// Those of these robots.
    pub fn new<'a>(robots: impl IntoIterator<Item = &'a Robot>) -> Self {
        let robots: Vec<&Robot> = robots.into_iter().collect();
        let mut joints = Self::default();
        for robot in &robots {
            for motor in &robot.motors {
                let name = if robots.len() > 1 { format!("{}:{}", robot.name, motor.name) } else { motor.name.clone() };
                joints.names.push(name);
                joints.scale.push(scale(motor.motion));
                joints.motors.push(motor.clone());
            }
        }
        joints
    }

    /// Some of them.
    pub fn among(&self, chosen: &[usize]) -> Self {
        let mut some = Self::default();
        for &joint in chosen {
            let (Some(name), Some(motor)) = (self.names.get(joint), self.motors.get(joint)) else { continue };
            some.names.push(name.clone());
            some.motors.push(motor.clone());
            some.scale.push(self.scale(joint));
        }
        some
    }

    /// Number of joints: how many numbers a configuration has.
    pub fn len(&self) -> usize {
        self.motors.len()
    }

    /// Rad of encoder per rad or meter of a joint.
    pub fn scale(&self, joint: usize) -> f64 {
        self.scale.get(joint).copied().unwrap_or(1.0)
    }

    /// Unit of a joint's position: `rad` or `m`.
    pub fn units(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.motors.iter().map(|m| if m.motion.is_turn() { "rad" } else { "m" })
    }

    /// A number of each motor, rad of encoder, as rad or meters.
    pub fn si(&self, of: impl Fn(&Motor) -> f64) -> Vec<f64> {
        self.motors.iter().zip(&self.scale).map(|(m, s)| of(m) / s).collect()
    }

    /// A pose of the motors, rad of encoder, as a configuration, rad or meters.
    pub fn configuration(&self, pose: &[f64]) -> Vec<f64> {
        pose.iter().zip(&self.scale).map(|(q, s)| q / s).collect()
    }

    /// Converts configurations, one after the other, to rad of encoder in place.
    ///
    /// A position beyond its limit by rounding becomes the limit; a joint without end is put within its limits by whole turns.
    ///
    /// # Arguments
    /// * `first`: number of the first row; `None` for a single configuration. Messages name the row.
    ///
    /// # Errors
    /// A number that is not finite; a joint beyond its limit, unless that is passed.
    pub fn convert(&self, what: &str, rows: &mut [f64], first: Option<usize>, beyond: Beyond) -> Result<(), Failure> {
        let width = self.len().max(1);
        for (r, row) in rows.chunks_mut(width).enumerate() {
            for (j, (q, (motor, scale))) in row.iter_mut().zip(self.motors.iter().zip(&self.scale)).enumerate() {
                if !q.is_finite() {
                    let message = format!("joint {} is {q}", self.name(j));
                    return Err(Failure::new("not_finite", message, "give finite numbers").at(place(what, first, r)));
                }
                let encoder = *q * scale;
                if encoder >= motor.min && encoder <= motor.max {
                    *q = encoder;
                    continue;
                }
                let within = encoder.max(motor.min).min(motor.max);
                let turned = if can_turn(motor, encoder) { motor.nearest_equivalent(within, encoder) } else { encoder };
                *q = match () {
                    () if (encoder - within).abs() <= ROUNDING * scale => within,
                    () if beyond == Beyond::Straight => encoder,
                    () if turned >= motor.min && turned <= motor.max => turned,
                    () if beyond == Beyond::Passed => encoder,
                    () => return Err(self.refusal(j, *q).at(place(what, first, r))),
                };
            }
        }
        Ok(())
    }

    /// Tests which rows, rad or meters, are within the limits, but for rounding and whole turns of joints without end.
    pub fn within(&self, rows: &[f64]) -> Vec<bool> {
        let sound = |(q, (motor, scale)): (&f64, (&Motor, &f64))| {
            let tolerance = ROUNDING * scale;
            let encoder = q * scale;
            can_turn(motor, encoder) || (encoder >= motor.min - tolerance && encoder <= motor.max + tolerance)
        };
        let all = |row: &[f64]| row.iter().zip(self.motors.iter().zip(&self.scale)).all(sound);
        rows.chunks(self.len().max(1)).map(all).collect()
    }

    fn refusal(&self, joint: usize, q: f64) -> Failure {
        let Some((motor, scale)) = self.motors.get(joint).zip(self.scale.get(joint)) else {
            return Failure::new("limits", "a joint is beyond its limits", "");
        };
        let unit = if motor.motion.is_turn() { "rad" } else { "m" };
        let (min, max) = (motor.min / scale, motor.max / scale);
        let message = format!("joint {} at {q:.6} {unit} is beyond its limits, {min:.6} to {max:.6}", self.name(joint));
        Failure::new("limits", message, "stay within lower and upper, by np.clip(q, robot.lower, robot.upper)")
    }

    fn name(&self, joint: usize) -> &str {
        self.names.get(joint).map_or("?", String::as_str)
    }

    /// The joints in words: how many, and which.
    pub fn description(&self) -> String {
        let named = self.names.iter().take(MOST_NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
        let more = if self.names.len() > MOST_NAMED { ", ..." } else { "" };
        format!("{} joints: {named}{more}", self.len())
    }
}

/// Rad of encoder per rad or meter.
fn scale(motion: JointMotion) -> f64 {
    motion.encoder(1.0)
}

/// Tests for a joint without end at a position so near that turns can be counted.
fn can_turn(motor: &Motor, encoder: f64) -> bool {
    motor.continuous && encoder.abs() <= MAX_TURNED
}

/// The argument, with its row if it is one of many.
fn place(what: &str, first: Option<usize>, row: usize) -> String {
    first.map_or_else(|| what.to_owned(), |first| format!("{what}[{}]", first + row))
}
