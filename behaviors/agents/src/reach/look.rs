//! Search for the object: the eyes are turned to its estimated position, then to positions around
//! it, until it is detected.

use super::aim::Eyes;
use super::settings::GazePlan;
use mobee_contract::{Intent, Target, Time, View};
use mobee_model::Robot;
use mobee_planning::group;
use mobee_planning::inverse_kinematics::MotorGroup;
use mobee_planning::table_map::HandChain;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Radii of the rings of gaze targets around the estimated position, meters.
const RING_RADII_M: [f64; 2] = [0.15, 0.30];
/// Number of gaze targets on each ring.
const POINTS_PER_RING: u32 = 6;
/// Distance of the first gaze target from the eyes if the object has no estimated position, meters.
const DEFAULT_DISTANCE_M: f64 = 0.5;
/// Time between polls for a detection.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// State of a search: part of the agent's state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Looking {
    /// Detections before this time do not count.
    since: Time,
    /// Time at which the eyes came to rest in their current direction.
    rested: Option<Time>,
    /// Time of the first detection.
    first: Option<Time>,
    /// Number of gaze targets without a detection.
    glances: u32,
}

/// Result of a step of the search.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum LookResult {
    /// The next intent of the search.
    Do(Intent),
    /// The object was detected: its center, world frame, meters.
    Seen(Vector3<f64>),
}

/// The eyes, and the plan of their motions.
pub(super) struct Gaze {
    plan: GazePlan,
    eyes: Eyes,
}

impl Gaze {
    pub fn new(plan: GazePlan, robot: &Robot, view: &View) -> Gaze {
        let chain = |eye: &usize| {
            let normal = robot.markers.get(*eye)?.normal;
            Some(HandChain::of_robot(&view.scene, view.robot, *eye, normal))
        };
        let limits = limits(&plan.motors, robot, view);
        let group = MotorGroup { motors: plan.motors.clone(), limits };
        let chains = plan.eyes.iter().filter_map(chain).collect();
        Gaze { plan, eyes: Eyes { chains, group } }
    }

    /// Returns the position and viewing direction of each eye at a configuration of the whole
    /// robot, world frame.
    pub fn eyes(&self, pose: &[f64]) -> impl Iterator<Item = (Point3<f64>, Vector3<f64>)> {
        self.eyes.chains.iter().map(|eye| eye.at(pose)).map(|eye| (eye.at, eye.palm))
    }

    /// Returns the time to look at a gaze target.
    pub fn dwell(&self) -> Duration {
        self.plan.dwell
    }

    /// Returns the motion that points all eyes at a position.
    pub fn look_at(&self, place: Vector3<f64>, view: &View) -> Intent {
        self.turn(self.eyes.turn(view.pose(), place))
    }

    fn turn(&self, q: Vec<f64>) -> Intent {
        Intent::MoveTo(Target { motors: self.plan.motors.clone(), q, speed: self.plan.speed })
    }

    /// Returns the positions of the gaze motors for a gaze target: first the estimated position,
    /// then positions around it.
    fn glance(&self, view: &View, thought: Option<Vector3<f64>>, number: u32) -> Option<Vec<f64>> {
        let sweep = self.plan.sweep.len() as u32;
        if sweep > 0 {
            return self.plan.sweep.get((number % sweep) as usize).cloned();
        }
        let middle = thought.or_else(|| self.eyes.ahead(view.pose(), DEFAULT_DISTANCE_M))?;
        let number = number % (1 + POINTS_PER_RING * RING_RADII_M.len() as u32);
        let ring = number
            .checked_sub(1)
            .and_then(|n| RING_RADII_M.get((n / POINTS_PER_RING) as usize))
            .copied()
            .unwrap_or(0.0);
        let (sin, cos) = (f64::from(number) * std::f64::consts::TAU / f64::from(POINTS_PER_RING)).sin_cos();
        Some(self.eyes.turn(view.pose(), middle + Vector3::new(cos, sin, 0.0) * ring))
    }
}

/// Returns the position limits of these motors by robot and board, rad; one turn for continuous
/// joints.
pub(super) fn limits(motors: &[usize], robot: &Robot, view: &View) -> Vec<(f64, f64)> {
    let range = |m: &usize| robot.motors.get(*m).map_or((0.0, 0.0), mobee_model::Motor::range);
    motors.iter().map(|m| group::allowed(range(m), view.axes.get(*m))).collect()
}

impl Looking {
    /// Starts a search: only detections from now on count.
    pub fn from(now: Time) -> Looking {
        Looking { since: now, ..Looking::default() }
    }

    /// Time of the first detection of the object.
    pub fn first_seen(&self) -> Option<Time> {
        self.first
    }

    /// Number of gaze targets without a detection.
    pub fn glances(&self) -> u32 {
        self.glances
    }

    /// Advances the search while the robot rests. For an object without a sensor, the scene's
    /// position is used.
    pub fn step(&mut self, object: &str, gaze: Option<&Gaze>, view: &View) -> LookResult {
        let rested = *self.rested.get_or_insert(view.at);
        let (at, seen) = match (middle(object, view), view.seen(object)) {
            (None, _) => return LookResult::Do(self.about(gaze, view, None, false)),
            (Some(at), None) => return LookResult::Seen(at),
            (Some(at), Some(seen)) => (at, seen),
        };
        // A detection from a moving camera is good enough for the model, but not for a target of
        // the hand.
        if seen.is_stale || seen.at.is_none_or(|t| t < self.since.max(rested)) {
            let lately = seen.at.is_some() && !seen.is_stale;
            return LookResult::Do(self.about(gaze, view, Some(at), lately));
        }
        self.first.get_or_insert(seen.at.unwrap_or(view.at));
        LookResult::Seen(at)
    }

    /// Waits for the dwell time of the plan, then chooses another gaze target. The first wait is
    /// only worthwhile if the object was detected recently.
    fn about(&mut self, gaze: Option<&Gaze>, view: &View, thought: Option<Vector3<f64>>, lately: bool) -> Intent {
        let Some(gaze) = gaze else { return Intent::Wait(POLL_INTERVAL) };
        let waited = view.at.since(self.rested.unwrap_or(view.at));
        if waited < gaze.plan.dwell && (self.glances > 0 || lately) {
            return Intent::Wait(POLL_INTERVAL);
        }
        let Some(q) = gaze.glance(view, thought, self.glances) else { return Intent::Wait(POLL_INTERVAL) };
        self.glances = self.glances.wrapping_add(1);
        self.rested = None;
        gaze.turn(q)
    }
}

/// Returns the best available estimate of the object's center, world frame, meters.
pub(super) fn middle(object: &str, view: &View) -> Option<Vector3<f64>> {
    let (_, known) = view.scene.object(object)?;
    let seen = view.seen(object).and_then(|seen| seen.place).map(Vector3::from);
    Some(seen.unwrap_or_else(|| known.pose.translation.vector + known.pose.rotation * known.middle()))
}
