//! Controller parameters: the settings of a controller applied to a given board.
//!
//! Settings are in the user's units and may be absent (degrees, seconds as numbers, defaults). Rules are in the units
//! that the cores compare with (radians, durations), all of them present. The conversion is done once, here.

use crate::fields::FieldRules;
use crate::history::is_coarse;
use crate::look_ahead::{FastClearance, braking_clearance};
use crate::settings::{ControllerSettings, Drive};
use mobee_contract::{Axis, Board, Event, MotorUnits, Pose};
use mobee_model::{Clause, Robot};
use std::sync::Arc;
use std::time::Duration;

/// Distance beyond the margin from which a contact ends, meters: encoder noise must not end and begin it repeatedly.
pub const RELEASE: f64 = 0.002;
/// Smallest decrease of a distance that counts as a deeper contact, meters: a touched surface yields a little as the
/// robot starts to move out, and encoders are noisy.
pub const DEEPER: f64 = 0.001;
/// Number of control periods for which a reading stays fresh and a lease lasts, unless the settings state otherwise.
/// With fewer, a late thread closes the filter; with more, an unsupervised robot moves on for longer.
pub const FRESH_PERIODS: u32 = 5;

/// Least tolerance for a reached configuration, in counts of the coarsest encoder.
const MIN_TOLERANCE_COUNTS: f64 = 2.5;

/// Settings and board in internal units: the parameters of the cores.
#[derive(Clone, Debug, PartialEq)]
pub struct Rules {
    /// Name of the robot in events.
    pub robot: String,
    /// Names of the body parts.
    pub parts: Vec<String>,
    /// Motors of the board.
    pub axes: Arc<[Axis]>,
    /// Control period.
    pub period: Duration,
    /// Greatest age of a reading that is still fresh, and the length of a lease.
    pub fresh: Duration,
    /// Greatest delay from a command to its effect, as the board reports it: delay of the board and of the connection
    /// to it, without the delay of the readings.
    pub latency: Duration,
    /// True if the board follows set-points directly.
    pub position_direct: bool,
    /// Margin of the reflex, meters.
    pub margin: f64,
    /// Braking clearance: distance that must remain when the robot has braked, meters. `None`: the reflex does not
    /// look ahead.
    pub reserve: Option<f64>,
    /// Braking clearance of a fast robot, where it is greater than `reserve`.
    pub fast_clearance: FastClearance,
    /// Least lag at which a motor counts as stalled, rad. `None`: stalls are not detected.
    pub stall: Option<f64>,
    /// External torque of a contact from the settings, the same for all motors, N m (N for a prismatic joint).
    /// `None`: the board's value.
    pub contact_nm: Option<f64>,
    /// Greatest distance per motor at which a configuration counts as reached, rad.
    pub tolerance: f64,
    /// Speed below which a motor counts as at rest, rad/s.
    pub rest_speed: f64,
    /// Greatest share of full speed for an escape.
    pub escape_speed: f64,
    /// Longest time without a set-point in a stream.
    pub stream_quiet: Duration,
    /// Time by which a stopped stream is undone.
    pub undo: Duration,
    /// Name of the controller's kind.
    pub kind: &'static str,
    /// True if the reflex acts. If not, contacts are reported and counted, and stop nothing but a retreat.
    pub reflex: bool,
    /// Parameters of the force fields, if motions are driven by forces.
    pub fields: Option<Arc<FieldRules>>,
}

impl Rules {
    /// Computes the rules of a board under these settings.
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
            tolerance: controller.tolerance_deg.to_radians().max(MIN_TOLERANCE_COUNTS * coarsest(&board.axes)),
            rest_speed: controller.rest_speed_deg.to_radians(),
            escape_speed: controller.escape_speed,
            stream_quiet: Duration::from_secs_f64(controller.stream_quiet_s.clamp(1e-2, 1e2)),
            undo: Duration::from_secs_f64(controller.undo_s.clamp(0.0, 1e5)),
            kind: controller.drive.kind(),
            reflex: controller.drive.has_reflex(),
            fields: None,
        }
    }

    /// Adds the parameters that follow from the robot's model: the braking clearance, unless the settings state one,
    /// and the force fields, if the drive uses them.
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

    /// Returns the events that describe this robot to readers of the journal.
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
        let name = self.robot.clone();
        let kind = self.kind.to_owned();
        let default_undo = Duration::from_secs_f64(ControllerSettings::default().undo_s);
        let undo = Some(self.undo).filter(|undo| *undo != default_undo).map(|undo| undo.as_secs_f64());
        let clearance = Some(self.reserve.unwrap_or_default());
        let stops = Some(self.stops_within());
        let controller = Event::Controller { robot: name, kind, reflex: self.reflex, undo, clearance, stops };
        let unused = self.unused().map(|text| Event::Warning { text });
        [robot, controller].into_iter().chain(unused).collect()
    }

    /// Longest time from a reading to the end of the stop that it causes, at full speed, seconds.
    fn stops_within(&self) -> f64 {
        let brakes = |a: &Axis| a.max_speed.abs() / a.max_acceleration.max(1e-6);
        self.reaction().as_secs_f64() + self.axes.iter().map(brakes).fold(0.0, f64::max)
    }

    /// Greatest difference of any motor between two configurations, rad, beyond the motor's hold error under load.
    /// Infinite if their lengths differ.
    pub fn beyond_hold_error(&self, a: &[f64], b: &[f64]) -> f64 {
        let beyond = |(m, (a, b)): (usize, (&f64, &f64))| (a - b).abs() - self.hold_error(m);
        if a.len() != b.len() { f64::INFINITY } else { a.iter().zip(b).enumerate().map(beyond).fold(0.0, f64::max) }
    }

    /// Returns whether the readings of a moving motor may be equal, since its encoder counts are coarse.
    pub fn has_coarse_encoders(&self) -> bool {
        is_coarse(coarsest(&self.axes), self.rest_speed)
    }

    /// Greatest error between this motor's joint at rest and its commanded position, rad.
    pub fn hold_error(&self, motor: usize) -> f64 {
        self.axes.get(motor).map_or(0.0, |axis| axis.hold_error)
    }

    /// External torque from which this motor counts as pushed, N m (N for a prismatic joint). `None`: the board
    /// reports no torque, or the motor is not watched.
    pub fn contact_effort(&self, motor: usize) -> Option<f64> {
        let reported = self.axes.get(motor).map(|axis| axis.contact_effort).filter(|effort| *effort > 0.0)?;
        Some(self.contact_nm.unwrap_or(reported)).filter(|least| *least > 0.0)
    }

    /// Warning, for people, about a setting that has no effect on this board.
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

    /// Returns whether the robot's joints deflect under external forces.
    pub fn gives(&self) -> bool {
        self.axes.iter().any(|axis| axis.deflection > 0.0)
    }

    /// Distance by which a pair may get closer than its least distance so far (`least`) during a retreat or an
    /// escape, m. The sag of an arm whose joints deflect differs between the way there and the retreat: such an arm
    /// may use half of that distance.
    pub fn floor_allowance(&self, least: f64) -> f64 {
        if self.gives() { DEEPER.max(0.5 * least) } else { DEEPER }
    }

    /// Greatest error between this motor's joint and its commanded position while an external force acts on it, rad.
    pub fn pushed_error(&self, motor: usize) -> f64 {
        self.axes.get(motor).map_or(0.0, |axis| axis.hold_error.max(axis.deflection))
    }

    /// Lag of the motors behind a stream of set-points: the board's latency, and the period in which the motors
    /// interpolate to the next set-point.
    pub fn follows(&self) -> Duration {
        self.latency + self.period
    }

    /// Time after which the effect of a command is in the readings: the board's latency, a period until the next
    /// reading is taken, and a period until that reading arrives.
    pub fn reaction(&self) -> Duration {
        self.latency + self.period * 2
    }
}

/// Resolution of the coarsest encoder, rad.
fn coarsest(axes: &[Axis]) -> f64 {
    axes.iter().map(|axis| axis.resolution).fold(0.0, f64::max)
}

/// Clamps a configuration to the motor limits. Readings near a limit may be beyond it by noise; commands never are
/// (I5).
pub fn clamped(q: &[f64], rules: &Rules) -> Pose {
    q.iter().zip(rules.axes.iter()).map(|(q, axis)| within(*q, axis)).collect()
}

/// Clamps the position of one motor to its limits. Accepts limits in reverse order: a clamp must not panic.
pub fn within(q: f64, axis: &Axis) -> f64 {
    q.clamp(axis.min.min(axis.max), axis.max.max(axis.min))
}
