//! Looking for the object: the eyes are turned to where it is thought to be, and about there until it is seen.

use super::aim::Eyes;
use super::settings::GazePlan;
use crate::group;
use crate::inverse_kinematics::MotorGroup;
use crate::table_map::HandChain;
use mobee_contract::{Intent, Target, Time, View};
use mobee_model::Robot;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Looking about: rings of points, meters, and how many points each has.
const RINGS: [f64; 2] = [0.15, 0.30];
const POINTS: u32 = 6;
/// How far ahead of its eyes a robot looks for what it knows no place of, meters.
const AHEAD: f64 = 0.5;
/// How long it takes a robot without eyes to see something, and how often it is asked for.
pub(super) const PAUSE: Duration = Duration::from_millis(100);

/// How far the looking has come: part of the agent's state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Looking {
    /// What was seen before this does not count.
    since: Time,
    /// When the eyes came to rest where they look now.
    rested: Option<Time>,
    /// When the object was first seen.
    first: Option<Time>,
    /// Places looked at while the object was not seen.
    glances: u32,
}

/// What there is to do.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Look {
    /// This, to see it.
    Do(Intent),
    /// Nothing: its middle is there.
    Seen(Vector3<f64>),
}

/// The eyes and how they are turned.
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

    /// Where each eye is at a pose of the whole robot, and where it looks.
    pub fn eyes(&self, pose: &[f64]) -> impl Iterator<Item = (Point3<f64>, Vector3<f64>)> {
        self.eyes.chains.iter().map(|eye| eye.at(pose)).map(|eye| (eye.at, eye.palm))
    }

    /// How long to look at a place.
    pub fn dwell(&self) -> Duration {
        self.plan.dwell
    }

    /// Turns all eyes to a place.
    pub fn look_at(&self, place: Vector3<f64>, view: &View) -> Intent {
        self.turn(self.eyes.turn(view.pose(), place))
    }

    fn turn(&self, q: Vec<f64>) -> Intent {
        Intent::MoveTo(Target { motors: self.plan.motors.clone(), q, speed: self.plan.speed })
    }

    /// The next of the places to look at: first where the object is thought to be, then about there.
    fn glance(&self, view: &View, thought: Option<Vector3<f64>>, number: u32) -> Option<Vec<f64>> {
        let sweep = self.plan.sweep.len() as u32;
        if sweep > 0 {
            return self.plan.sweep.get((number % sweep) as usize).cloned();
        }
        let middle = thought.or_else(|| self.eyes.ahead(view.pose(), AHEAD))?;
        let number = number % (1 + POINTS * RINGS.len() as u32);
        let ring = number.checked_sub(1).and_then(|n| RINGS.get((n / POINTS) as usize)).copied().unwrap_or(0.0);
        let (sin, cos) = (f64::from(number) * std::f64::consts::TAU / f64::from(POINTS)).sin_cos();
        Some(self.eyes.turn(view.pose(), middle + Vector3::new(cos, sin, 0.0) * ring))
    }
}

/// The limits of robot and board of these motors, one turn of those without end.
pub(super) fn limits(motors: &[usize], robot: &Robot, view: &View) -> Vec<(f64, f64)> {
    let range = |m: &usize| robot.motors.get(*m).map_or((0.0, 0.0), mobee_model::Motor::range);
    motors.iter().map(|m| group::allowed(range(m), view.axes.get(*m))).collect()
}

impl Looking {
    /// Begins to look: only what is seen from now on counts.
    pub fn from(now: Time) -> Looking {
        Looking { since: now, ..Looking::default() }
    }

    /// When the object was first seen.
    pub fn first_seen(&self) -> Option<Time> {
        self.first
    }

    /// Places looked at while the object was not seen.
    pub fn glances(&self) -> u32 {
        self.glances
    }

    /// The robot rests: what to do to see the object, unless it is seen. An object that no sensor keeps is where the scene has it.
    pub fn step(&mut self, object: &str, gaze: Option<&Gaze>, view: &View) -> Look {
        let rested = *self.rested.get_or_insert(view.at);
        let (at, seen) = match (middle(object, view), view.seen(object)) {
            (None, _) => return Look::Do(self.about(gaze, view, None, false)),
            (Some(at), None) => return Look::Seen(at),
            (Some(at), Some(seen)) => (at, seen),
        };
        // what was seen while the eyes turned is good to know, but not where the hand goes by
        if seen.is_stale || seen.at.is_none_or(|t| t < self.since.max(rested)) {
            let lately = seen.at.is_some() && !seen.is_stale;
            return Look::Do(self.about(gaze, view, Some(at), lately));
        }
        self.first.get_or_insert(seen.at.unwrap_or(view.at));
        Look::Seen(at)
    }

    /// The object is not seen: waits for the time that seeing takes, then looks elsewhere. At the beginning that is only worth while if
    /// it was seen lately.
    fn about(&mut self, gaze: Option<&Gaze>, view: &View, thought: Option<Vector3<f64>>, lately: bool) -> Intent {
        let Some(gaze) = gaze else { return Intent::Wait(PAUSE) };
        let waited = view.at.since(self.rested.unwrap_or(view.at));
        if waited < gaze.plan.dwell && (self.glances > 0 || lately) {
            return Intent::Wait(PAUSE);
        }
        let Some(q) = gaze.glance(view, thought, self.glances) else { return Intent::Wait(PAUSE) };
        self.glances = self.glances.wrapping_add(1);
        self.rested = None;
        gaze.turn(q)
    }
}

/// Where the object's middle is, as far as anybody knows, meters.
pub(super) fn middle(object: &str, view: &View) -> Option<Vector3<f64>> {
    let (_, known) = view.scene.object(object)?;
    let seen = view.seen(object).and_then(|seen| seen.place).map(Vector3::from);
    Some(seen.unwrap_or_else(|| known.pose.translation.vector + known.pose.rotation * known.middle()))
}
