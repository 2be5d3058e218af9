//! I3: after a rollback the robot rests within tolerance of the safe pose that was last taken or last moved.
//!
//! For an agent with a map that configuration is a vertex, with two exceptions: the safe pose was moved in
//! mid-motion, or the robot was not on the map when the motion began. The robot is on the map once a commit has
//! reached a vertex or a rollback has ended at one. It is off the map at the start, after a motion that ends
//! elsewhere, and while the agent CONNECTs (Algorithm 1).

use super::{FoundViolations, Invariant, near};
use crate::journal::JournalLine;
use mobee_contract::distance;
use mobee_contract::{Event, MotorUnits, Note, Outcome, Pose};
use std::collections::BTreeMap;

#[derive(Default)]
pub(super) struct HomeIsAVertex {
    robots: BTreeMap<String, Home>,
}

#[derive(Default)]
struct Home {
    units: MotorUnits,
    tolerance: f64,
    safe: Option<Pose>,
    moved: bool,
    vertices: Vec<Vec<f64>>,
    on_map: bool,
}

impl Home {
    fn is_vertex(&self, q: &[f64]) -> bool {
        self.vertices.iter().any(|v| near(v, q, self.tolerance))
    }

    fn rolled_back(&self, robot: &str, q: &[f64], safe: Option<&Pose>, found: &mut FoundViolations<'_>) {
        let Some(safe) = safe else {
            return found.report(format!("{robot}: rolled back without a safe pose"));
        };
        if self.safe.as_ref() != Some(safe) {
            found.report(format!("{robot}: rolled back to a pose that was not the last safe pose"));
        }
        if !near(q, safe, self.tolerance) {
            found.report(format!("{robot}: rests {} from its safe pose", self.units.told(distance(q, safe), 3)));
        }
        if self.on_map && !self.moved && !self.is_vertex(safe) {
            let nearest = self.vertices.iter().map(|v| distance(v, safe)).fold(f64::INFINITY, f64::min);
            let nearest = self.units.told(nearest, 3);
            found.report(format!("{robot}: rolled back to a pose {nearest} from the nearest vertex"));
        }
    }
}

impl Invariant for HomeIsAVertex {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, motors, sliding, tolerance, .. } => {
                let home = self.robots.entry(robot.clone()).or_default();
                home.units = MotorUnits::new(motors.len(), sliding);
                home.tolerance = *tolerance;
            }
            Event::SafePose { robot, q, .. } => {
                self.robots.entry(robot.clone()).or_default().safe = Some(q.clone());
            }
            Event::SafePoseMoved { robot, q, .. } => {
                let home = self.robots.entry(robot.clone()).or_default();
                home.safe = Some(q.clone());
                home.moved = true;
            }
            Event::Commit { robot, .. } => self.robots.entry(robot.clone()).or_default().moved = false,
            Event::Note { robot, note: Note::Vertex { q, .. } } => {
                self.robots.entry(robot.clone()).or_default().vertices.push(q.clone());
            }
            Event::Outcome { robot, outcome, q, safe, .. } => {
                let home = self.robots.entry(robot.clone()).or_default();
                if *outcome == Outcome::RolledBack {
                    home.rolled_back(robot, q, safe.as_ref(), found);
                }
                home.on_map = *outcome != Outcome::Faulted && home.is_vertex(q);
            }
            _ => {}
        }
    }
}
