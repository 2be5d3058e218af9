//! Range and speed of joints: limits, soft limits, velocity limits, and warnings about implausible ones.

use super::UrdfOptions;
use super::document::{JointType, Safety, UrdfJoint};
use super::grouped::Grouped;
use super::sizes::DOUBTED_LENGTH_M;
use super::tree::JointDrive;
use mobee_model::JointMotion;
use mobee_text::{FileError, SourceText};
use std::f64::consts::{PI, TAU};

/// Limit of a continuous joint in either direction, rad: the range that an encoder may count.
const CONTINUOUS_LIMIT_RAD: f64 = 100.0 * TAU;
/// Limit of a prismatic joint in either direction, meters; larger limits are treated as unlimited and clamped.
const MAX_PRISMATIC_M: f64 = 100.0;
/// Limit of a revolute joint above which a warning is given, rad.
const DOUBTED_LIMIT_RAD: f64 = 2.0 * TAU + 0.1;
/// Limits beyond this are a notation for "unlimited", rad.
const UNLIMITED_RAD: f64 = 1e5;
/// Angular velocity limit above which a warning is given and the limit is ignored, rad/s.
const DOUBTED_SPEED_RAD_PER_S: f64 = 100.0;
/// Linear velocity limit above which a warning is given and the limit is ignored, m/s.
const DOUBTED_SPEED_M_PER_S: f64 = 10.0;
/// Tolerance for a follower at its limits, rad or meters: rounding in files.
const LIMIT_TOLERANCE: f64 = 1e-5;

/// Motion, range and speed of a joint.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Revolute or prismatic.
    pub motion: JointMotion,
    /// Lower limit, rad or meters.
    pub min: f64,
    /// Upper limit, rad or meters.
    pub max: f64,
    /// True if it is continuous, so that its limits only bound its encoder.
    pub continuous: bool,
    /// Its maximum speed, rad/s or m/s, if the file gives one.
    pub speed: Option<f64>,
}

impl Limits {
    /// Formats both limits for messages.
    fn format_range(&self) -> String {
        // Avoids printing -0.
        let [min, max] = [self.min, self.max].map(|end| end + 0.0);
        match self.motion {
            JointMotion::Turn => format!("{:.1} to {:.1} deg", min.to_degrees(), max.to_degrees()),
            JointMotion::Slide => format!("{:.1} to {:.1} mm", min * 1e3, max * 1e3),
        }
    }
}

/// Reads the limits of joints, and collects warnings about them.
pub(super) struct LimitReader<'a> {
    source: &'a SourceText,
    options: &'a UrdfOptions,
    warnings: &'a mut Vec<FileError>,
    degrees: Grouped,
    far: Grouped,
    fast: Grouped,
    no_speed: Grouped,
    endless: Grouped,
    no_soft: Grouped,
    half_soft: Grouped,
    narrowed: Grouped,
}

impl<'a> LimitReader<'a> {
    /// Creates a reader without findings.
    pub fn new(source: &'a SourceText, options: &'a UrdfOptions, warnings: &'a mut Vec<FileError>) -> Self {
        let [degrees, far, fast, no_speed, endless, no_soft, half_soft, narrowed] = Default::default();
        Self { source, options, warnings, degrees, far, fast, no_speed, endless, no_soft, half_soft, narrowed }
    }

    /// The limits of a joint; `None` if it does not move.
    ///
    /// # Errors
    /// If its type is not supported, or its limits are invalid.
    pub fn read(&mut self, joint: &UrdfJoint) -> Result<Option<Limits>, FileError> {
        let name = &joint.name;
        let limits = match joint.joint_type {
            JointType::Fixed => return Ok(None),
            JointType::Continuous => self.endless(joint)?,
            JointType::Revolute => self.bounded(joint, JointMotion::Turn)?,
            JointType::Prismatic => self.bounded(joint, JointMotion::Slide)?,
            JointType::Floating => {
                // A base that drives or flies is not a motion of the robot itself: the scene defines its pose.
                let help = "MoBeE moves revolute and prismatic joints only";
                self.warn(joint, format!("the floating joint `{name}` stands still"), help);
                return Ok(None);
            }
            JointType::Planar => {
                if !self.options.fix_unsupported {
                    let message = format!("joint `{name}` is planar; ZRP has revolute and prismatic joints only");
                    let help = "make it fixed, or hold all such joints at zero with --fix-unsupported";
                    return Err(self.error(joint, message, help));
                }
                let help = "ZRP has revolute and prismatic joints only";
                self.warn(joint, format!("the planar joint `{name}` is held at zero"), help);
                return Ok(None);
            }
        };
        let speed = self.speed(joint, limits.motion)?;
        let held = self.options.held.get(name).filter(|_| joint.mimic.is_none());
        let at = held.map(|q| q.clamp(limits.min, limits.max));
        let (min, max) = at.map_or((limits.min, limits.max), |q| (q, q));
        Ok(Some(Limits { speed, min, max, ..limits }))
    }

    /// Limits of a continuous joint: unlimited, or its soft limits.
    fn endless(&mut self, joint: &UrdfJoint) -> Result<Limits, FileError> {
        if let Some(limit) = &joint.limit
            && let (Some(lower), Some(upper)) = (limit.lower, limit.upper)
            && lower < upper
            && lower.abs().min(upper.abs()) < UNLIMITED_RAD
        {
            self.endless.add(&joint.at, format!("`{}` ({lower} to {upper})", joint.name));
        }
        let (lo, hi) = self.softened(joint, (f64::NEG_INFINITY, f64::INFINITY))?;
        if lo < hi {
            return Ok(turning(lo, hi));
        }
        // Zeros mean that there are no soft limits: otherwise the joint could not move at all.
        self.no_soft.add(&joint.at, format!("`{}`", joint.name));
        Ok(turning(f64::NEG_INFINITY, f64::INFINITY))
    }

    /// Limits of a revolute or prismatic joint.
    fn bounded(&mut self, joint: &UrdfJoint, motion: JointMotion) -> Result<Limits, FileError> {
        let name = &joint.name;
        let unit = if motion == JointMotion::Turn { "radians" } else { "meters" };
        let Some(limit) = &joint.limit else {
            let help = format!(
                "add <limit lower=\"...\" upper=\"...\"/> in {unit}, or make it continuous if it turns without end"
            );
            return Err(self.error(joint, format!("joint `{name}` moves, and has no limits"), &help));
        };
        let lo = limit.lower.unwrap_or(0.0);
        let hi = limit.upper.unwrap_or(0.0);
        if lo.is_nan() || hi.is_nan() || lo > hi {
            let message = format!("joint `{name}` has the limits {lo} to {hi}");
            return Err(self.error(joint, message, &format!("write numbers in {unit}, the lower one first")));
        }
        let farthest = lo.abs().max(hi.abs());
        match motion {
            JointMotion::Turn if farthest > DOUBTED_LIMIT_RAD && farthest < UNLIMITED_RAD => {
                self.degrees.add(&joint.at, format!("`{name}` ({lo} to {hi})"));
            }
            JointMotion::Slide if farthest > DOUBTED_LENGTH_M => {
                self.far.add(&joint.at, format!("`{name}` ({lo} to {hi} m)"))
            }
            _ => {}
        }
        let (lo, hi) = self.softened(joint, (lo, hi))?;
        if lo == hi && joint.mimic.is_none() {
            let help = "give it a lower limit below the upper one if it moves";
            self.warn(joint, format!("joint `{name}` has no range and is taken as fixed"), help);
        }
        Ok(match motion {
            JointMotion::Turn => turning(lo, hi),
            JointMotion::Slide => {
                let min = lo.clamp(-MAX_PRISMATIC_M, MAX_PRISMATIC_M);
                let max = hi.clamp(-MAX_PRISMATIC_M, MAX_PRISMATIC_M);
                Limits { motion, min, max, continuous: false, speed: None }
            }
        })
    }

    /// The range that soft limits leave.
    fn softened(&mut self, joint: &UrdfJoint, (lo, hi): (f64, f64)) -> Result<(f64, f64), FileError> {
        let Some(Safety { lower, upper, at }) = &joint.safety else { return Ok((lo, hi)) };
        if lower.is_none() && upper.is_none() {
            return Ok((lo, hi));
        }
        if lower.is_none() || upper.is_none() {
            self.half_soft.add(at, format!("`{}`", joint.name));
        }
        let soft_lo = lower.unwrap_or(0.0);
        let soft_hi = upper.unwrap_or(0.0);
        let min = lo.max(soft_lo);
        let max = hi.min(soft_hi);
        // False for NaN.
        if soft_lo <= soft_hi && min <= max {
            return Ok((min, max));
        }
        let message = format!(
            "joint `{}` has the limits {lo} to {hi} and the soft limits {soft_lo} to {soft_hi}: no range is left",
            joint.name
        );
        Err(self.source.error(at.clone(), message, "write soft limits within the limits, the lower one first"))
    }

    /// The maximum speed of a joint; `None` if it has none or an implausible one.
    fn speed(&mut self, joint: &UrdfJoint, motion: JointMotion) -> Result<Option<f64>, FileError> {
        let Some(limit) = &joint.limit else { return Ok(None) };
        let most = if motion == JointMotion::Turn { DOUBTED_SPEED_RAD_PER_S } else { DOUBTED_SPEED_M_PER_S };
        let name = &joint.name;
        match limit.velocity {
            Some(v) if v.is_nan() || v < 0.0 => {
                let message = format!("joint `{name}` has the velocity limit {v}");
                Err(self.error(joint, message, "write a number above 0, in rad/s or m/s"))
            }
            Some(v) if v > most => {
                if v.is_finite() {
                    self.fast.add(&joint.at, format!("`{name}` ({v})"));
                }
                Ok(None)
            }
            Some(v) if v > 0.0 => Ok(Some(v)),
            // The speed of a follower is bounded by that of its leader.
            _ => {
                if joint.mimic.is_none() {
                    self.no_speed.add(&joint.at, format!("`{name}`"));
                }
                Ok(None)
            }
        }
    }

    /// Reduces the range and speed of a leader to those that its follower permits.
    ///
    /// # Errors
    /// If the follower violates its limits at all positions of its leader.
    pub fn follow(
        &mut self,
        (follower, own): (&UrdfJoint, Limits),
        drive: JointDrive,
        leader: (&UrdfJoint, &mut Option<Limits>),
    ) -> Result<(), FileError> {
        let given = follower.limit.as_ref().is_some_and(|l| l.lower.is_some() || l.upper.is_some());
        let ranged = (given || follower.safety.is_some()) && !own.continuous;
        let leads = follower.mimic.as_ref().map_or("", |m| m.joint.as_str());
        let message = format!("joint `{}` is beyond its limits wherever its leader `{leads}` is", follower.name);
        let help = "correct its limits, or the multiplier and offset of its <mimic>";
        let (name, limits) = leader;
        match (drive, limits) {
            (JointDrive::Fixed(at), _)
                if ranged && (at < own.min - LIMIT_TOLERANCE || at > own.max + LIMIT_TOLERANCE) =>
            {
                Err(self.error(follower, message, help))
            }
            (JointDrive::Moves { factor, offset, .. }, Some(limits)) => {
                if let Some(speed) = own.speed.map(|v| v / factor.abs()) {
                    limits.speed = Some(limits.speed.map_or(speed, |v| v.min(speed)));
                }
                let [a, b] = [(own.min - offset) / factor, (own.max - offset) / factor];
                let lo = a.min(b);
                let hi = a.max(b);
                let rounding = LIMIT_TOLERANCE / factor.abs();
                if !ranged || (limits.min >= lo - rounding && limits.max <= hi + rounding) {
                    return Ok(());
                }
                if lo > limits.max + rounding || hi < limits.min - rounding {
                    return Err(self.error(follower, message, help));
                }
                limits.continuous = false;
                (limits.min, limits.max) = (limits.min.max(lo).min(limits.max), limits.max.min(hi).max(limits.min));
                limits.max = limits.max.max(limits.min);
                self.narrowed
                    .add(&follower.at, format!("`{}` to {} by `{}`", name.name, limits.format_range(), follower.name));
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Adds the collected warnings.
    pub fn finish(self) {
        let Self { source, warnings, .. } = self;
        let groups = [
            (
                self.degrees,
                "limits of joints that turn are in radians, and these may be in degrees",
                "write radians: 170 degrees are 2.967",
            ),
            (
                self.far,
                "joints that slide farther than 10 m, perhaps in millimeters (beyond 100 m they end there)",
                "write limits in meters",
            ),
            (
                self.fast,
                "velocity limits so high that they bound nothing, perhaps in degrees or millimeters per second",
                "write rad/s or m/s; without a limit the driver's max_speed_deg_per_s holds alone",
            ),
            (
                self.no_speed,
                "no velocity limit (missing or 0), so that the driver's max_speed_deg_per_s holds alone",
                "write velocity=\"...\" into the <limit>, in rad/s or m/s",
            ),
            (
                self.endless,
                "limits of continuous joints don't bound them",
                "make the joint revolute if its limits are meant",
            ),
            (
                self.no_soft,
                "soft limits of 0 to 0 are not used of continuous joints",
                "write the range that is meant, or leave them out",
            ),
            (
                self.half_soft,
                "of the two soft limits one is missing, which counts as 0, as the standard says",
                "write both soft_lower_limit and soft_upper_limit",
            ),
            (
                self.narrowed,
                "narrowed, so that joints that follow keep their own limits",
                "correct limits, multiplier or offset of the joints that follow if more range is meant",
            ),
        ];
        for (group, message, help) in groups {
            group.warn(source, message, help, warnings);
        }
    }

    fn warn(&mut self, joint: &UrdfJoint, message: String, help: &str) {
        self.warnings.push(self.source.warning(joint.at.clone(), message, help));
    }

    fn error(&self, joint: &UrdfJoint, message: String, help: &str) -> FileError {
        self.source.error(joint.at.clone(), message, help)
    }
}

/// Limits of a rotating joint. Limits beyond a hundred turns mean "unlimited" (URDF 1.2 writes infinity, other files
/// 1e16).
fn turning(lo: f64, hi: f64) -> Limits {
    let low = lo >= -CONTINUOUS_LIMIT_RAD;
    let high = hi <= CONTINUOUS_LIMIT_RAD;
    let (min, max) = match (low, high) {
        (true, true) => (lo, hi),
        (true, false) => (lo, lo + TAU),
        (false, true) => (hi - TAU, hi),
        (false, false) => (-CONTINUOUS_LIMIT_RAD, CONTINUOUS_LIMIT_RAD),
    };
    Limits { motion: JointMotion::Turn, min, max, continuous: !low && !high, speed: None }
}

/// Limits a continuous joint to one turn if another joint follows it by a fractional factor: after a full turn of the
/// leader the follower has another position, so that the leader's positions a turn apart are not equivalent.
pub(super) fn limit_leaders_of_fractional_followers(drives: &[JointDrive], limits: &mut [Option<Limits>]) {
    for drive in drives {
        let JointDrive::Moves { source, factor, .. } = *drive else { continue };
        if let Some(limit) = limits.get_mut(source).and_then(Option::as_mut).filter(|l| l.continuous)
            && factor.fract() != 0.0
        {
            *limit = Limits { min: -PI, max: PI, continuous: false, ..*limit };
        }
    }
}
