//! What a controller's settings mean for a given board: what the cores go by.
//!
//! Settings are what people write (degrees, seconds as numbers, nothing where the default will do); rules are what the
//! cores compare with (radians, durations, all of them known). The translation is here, once.

use crate::fields::FieldRules;
use crate::history::is_coarse;
use crate::look_ahead::{FastClearance, braking_clearance};
use crate::settings::{ControllerSettings, Drive};
use mobee_contract::{Axis, Board, Event, MotorUnits, Pose};
use mobee_model::{Clause, JointMotion, Robot};
use std::sync::Arc;
use std::time::Duration;

/// What a contact must exceed beyond the margin to end, meters: so that the noise of encoders can't end it and begin it
/// by turns.
pub const RELEASE: f64 = 0.002;
/// What counts as deeper, meters: what touches gives a little as the robot starts on its way out, and its encoders are
/// noisy.
pub const DEEPER: f64 = 0.001;
/// Displacement of a sliding joint, a gripper's finger, by the arm's acceleration, m.
const PLAY_M: f64 = 0.002;
/// How many control periods a reading stays fresh, and a lease lasts, unless the settings say otherwise. Fewer, and a
/// thread that comes late closes the filter; more, and a robot goes on for longer when nobody watches it any more.
pub const FRESH_PERIODS: u32 = 5;

/// What counts as reached is no less than so many counts of the coarsest encoder.
const COUNTS: f64 = 2.5;

/// Settings and board in the units of the inside: what the cores go by.
#[derive(Clone, Debug, PartialEq)]
pub struct Rules {
    /// The robot's name, as events carry it.
    pub robot: String,
    /// The names of the body parts.
    pub parts: Vec<String>,
    /// The board's motors.
    pub axes: Arc<[Axis]>,
    /// Control period.
    pub period: Duration,
    /// Greatest age of a reading that is still fresh, and the length of a lease.
    pub fresh: Duration,
    /// Greatest delay from a command to its effect, as the board tells it: that of the board and of the way to it,
    /// without the readings'.
    pub latency: Duration,
    /// Whether the board follows set-points directly.
    pub position_direct: bool,
    /// Margin of the reflex, meters.
    pub margin: f64,
    /// Braking clearance: what must be left when the robot has braked, meters; `None`: the reflex does not look ahead.
    pub reserve: Option<f64>,
    /// The braking clearance while the robot is fast, where that is greater than `reserve`.
    pub fast_clearance: FastClearance,
    /// The least lag at which a motor counts as stalled, rad; `None`: nobody looks.
    pub stall: Option<f64>,
    /// The external torque of a contact, N m (N where a motor slides), as the settings state it for all motors; `None`: as the board states it.
    pub contact_nm: Option<f64>,
    /// Greatest distance per motor at which a pose counts as reached, rad.
    pub tolerance: f64,
    /// Speed below which a motor counts as at rest, rad/s.
    pub rest_speed: f64,
    /// Greatest share of full speed for an escape.
    pub escape_speed: f64,
    /// For how long a stream may be quiet.
    pub stream_quiet: Duration,
    /// By how much a stream that was stopped is undone.
    pub undo: Duration,
    /// The kind of the controller.
    pub kind: &'static str,
    /// Whether the reflex acts. If not, contacts are told and counted, and stop nothing but a retreat.
    pub reflex: bool,
    /// Set if motions are driven by forces.
    pub fields: Option<Arc<FieldRules>>,
}

impl Rules {
    /// The rules for a board under these settings.
    pub fn new(robot: &str, parts: Vec<String>, controller: &ControllerSettings, board: &Board) -> Rules {
        let period = Duration::from_secs_f64(controller.period_s.clamp(1e-3, 1e3));
        let stale = controller.stale_s.map(|s| Duration::from_secs_f64(s.clamp(1e-3, 1e3)));
        Rules {
            robot: robot.to_string(),
            parts,
            axes: board.axes.clone().into(),
            period,
            fresh: stale.unwrap_or(period * FRESH_PERIODS),
            latency: board.latency,
            position_direct: board.position_direct,
            margin: controller.margin_m,
            reserve: controller.reserve_m.filter(|m| *m > 0.0 && controller.drive.has_reflex()),
            fast_clearance: FastClearance::default(),
            stall: controller.stall_deg.map(f64::to_radians),
            contact_nm: controller.contact_nm,
            tolerance: controller.tolerance_deg.to_radians().max(COUNTS * coarsest(&board.axes)),
            rest_speed: controller.rest_speed_deg.to_radians(),
            escape_speed: controller.escape_speed,
            stream_quiet: Duration::from_secs_f64(controller.stream_quiet_s.clamp(1e-2, 1e2)),
            undo: Duration::from_secs_f64(controller.undo_s.clamp(0.0, 1e5)),
            kind: controller.drive.kind(),
            reflex: controller.drive.has_reflex(),
            fields: None,
        }
    }

    /// The same with what follows from the robot's model: the braking clearance, unless the settings state one, and what drives the
    /// robot under forces, if anything does.
    #[must_use]
    pub fn driving(mut self, controller: &ControllerSettings, robot: &Robot) -> Rules {
        if controller.reserve_m.is_none() && self.reflex {
            self.reserve = Some(braking_clearance(robot, &self.axes, self.reaction(), self.margin));
            self.fast_clearance = FastClearance::new(robot, &self.axes, self.reaction());
        }
        match &controller.drive {
            Drive::Straight | Drive::Blind => {}
            Drive::Fields(settings) => self.fields = Some(Arc::new(FieldRules::new(settings, robot, &self))),
        }
        self
    }

    /// The robot of this model as the journal's readers know it.
    pub fn described(&self, robot: &Robot) -> Vec<Event> {
        let constraints = robot.parts.iter().flat_map(|part| &part.clauses);
        let members = |clause: &Clause| clause.0.iter().map(|half| (half.terms.clone(), half.b)).collect();
        let constraints = constraints.map(members).collect();
        let of = |f: fn(&Axis) -> f64| self.axes.iter().map(f).collect();
        let robot = Event::Robot {
            robot: self.robot.clone(),
            motors: self.axes.iter().map(|a| a.name.clone()).collect(),
            sliding: MotorUnits::of_axes(&self.axes).sliding().to_vec(),
            min: of(|a| a.min),
            max: of(|a| a.max),
            max_speed: of(|a| a.max_speed),
            period: self.period.as_secs_f64(),
            fresh: self.fresh.as_secs_f64(),
            margin: self.margin,
            tolerance: self.tolerance,
            rest_speed: self.rest_speed,
            resolution: if self.has_coarse_encoders() { coarsest(&self.axes) } else { 0.0 },
            hold_error: self.axes.iter().map(|axis| axis.hold_error).fold(0.0, f64::max),
            deflection: self.axes.iter().map(|axis| axis.deflection).fold(0.0, f64::max),
            constraints,
        };
        let (name, kind) = (self.robot.clone(), self.kind.to_owned());
        let usual = Duration::from_secs_f64(ControllerSettings::default().undo_s);
        let undo = Some(self.undo).filter(|undo| *undo != usual).map(|undo| undo.as_secs_f64());
        let (clearance, stops) = (Some(self.reserve.unwrap_or_default()), Some(self.stops_within()));
        let controller = Event::Controller { robot: name, kind, reflex: self.reflex, undo, clearance, stops };
        let unused = self.unused().map(|text| Event::Warning { text });
        [robot, controller].into_iter().chain(unused).collect()
    }

    /// Longest time from a reading until the robot has stopped for it, at full speed, seconds.
    fn stops_within(&self) -> f64 {
        let brakes = |a: &Axis| a.max_speed.abs() / a.max_acceleration.max(1e-6);
        self.reaction().as_secs_f64() + self.axes.iter().map(brakes).fold(0.0, f64::max)
    }

    /// The greatest difference of any motor between two poses, rad, beyond what its load may move it by at rest.
    pub fn beyond_hold_error(&self, a: &[f64], b: &[f64]) -> f64 {
        let beyond = |(m, (a, b)): (usize, (&f64, &f64))| (a - b).abs() - self.hold_error(m);
        if a.len() != b.len() { f64::INFINITY } else { a.iter().zip(b).enumerate().map(beyond).fold(0.0, f64::max) }
    }

    /// Whether the readings of a motor may be equal though it moves: by whole counts of an encoder.
    pub fn has_coarse_encoders(&self) -> bool {
        is_coarse(coarsest(&self.axes), self.rest_speed)
    }

    /// By how much this motor's joint may rest beside its commanded position, rad.
    pub fn hold_error(&self, motor: usize) -> f64 {
        self.axes.get(motor).map_or(0.0, |axis| axis.hold_error)
    }

    /// The external torque from which on something pushes this motor, N m (N where it slides); `None`: its board reports none, or it is not
    /// watched.
    pub fn contact_effort(&self, motor: usize) -> Option<f64> {
        let reported = self.axes.get(motor).map(|axis| axis.contact_effort).filter(|effort| *effort > 0.0)?;
        Some(self.contact_nm.unwrap_or(reported)).filter(|least| *least > 0.0)
    }

    /// A setting that has no effect on this board, for people.
    pub fn unused(&self) -> Option<String> {
        let reports = self.axes.iter().any(|axis| axis.contact_effort > 0.0);
        let stated = self.contact_nm.is_some_and(|nm| nm > 0.0);
        (stated && !reports).then(|| {
            format!(
                "{}: `controller.contact_nm` is not used: its board reports no torque, load or current; remove it, or set `stall_deg`",
                self.robot
            )
        })
    }

    /// Whether the robot's joints give way where something pushes them.
    pub fn gives(&self) -> bool {
        self.axes.iter().any(|axis| axis.deflection > 0.0)
    }

    /// Distance by which a pair may get closer than its least distance so far (`least`) during a retreat or an escape, m. The sag of an arm
    /// whose joints give way differs between the way there and the retreat: such an arm may use up half of that distance.
    pub fn floor_allowance(&self, least: f64) -> f64 {
        if self.gives() { DEEPER.max(0.5 * least) } else { DEEPER }
    }

    /// By how much this motor's joint may be beside its commanded position while something pushes it, rad.
    pub fn pushed_error(&self, motor: usize) -> f64 {
        self.axes.get(motor).map_or(0.0, |axis| axis.hold_error.max(axis.deflection))
    }

    /// How far the motors are behind a stream of set-points: that of the board, and a period, in which they go from one to the next.
    pub fn follows(&self) -> Duration {
        self.latency + self.period
    }

    /// How long after a command its effect is surely in the readings: the board's latency, a period until the next
    /// reading is taken, and another in which that is on its way.
    pub fn reaction(&self) -> Duration {
        self.latency + self.period * 2
    }
}

/// The play of a joint, rad of encoder: none where it turns, 2 mm where it slides.
pub fn play(motion: JointMotion) -> f64 {
    if motion.is_turn() { 0.0 } else { motion.encoder(PLAY_M) }
}

/// The resolution of the coarsest encoder, rad.
fn coarsest(axes: &[Axis]) -> f64 {
    axes.iter().map(|axis| axis.resolution).fold(0.0, f64::max)
}

/// The greatest difference of any motor between two poses, rad. Infinite if they don't belong to one robot: whatever is
/// compared with it is too far, and nothing counts as reached by mistake.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    if a.len() != b.len() {
        return f64::INFINITY;
    }
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Readings near a limit may lie beyond it by the noise; commands never do (I5).
pub fn clamped(q: &[f64], rules: &Rules) -> Pose {
    q.iter().zip(rules.axes.iter()).map(|(q, axis)| within(*q, axis)).collect()
}

/// The same of one motor. A board whose limits are the wrong way round has them all the same: a clamp must not panic.
pub fn within(q: f64, axis: &Axis) -> f64 {
    q.clamp(axis.min.min(axis.max), axis.max.max(axis.min))
}
