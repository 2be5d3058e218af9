//! Edits of the world that wait for a trigger: the script of an experiment.

use mobee_contract::{Time, distance};
use mobee_model::Edit;

/// Trigger of an edit.
#[derive(Clone, Debug, PartialEq)]
pub enum CueTrigger {
    /// At a time of the run.
    At(Time),
    /// At rest of this robot after its n-th outcome, before its agent plans again.
    AfterOutcomes {
        /// Name of the robot.
        robot: String,
        /// Number of outcomes.
        n: u64,
    },
    /// At rest of this robot in a configuration.
    AtPose {
        /// Name of the robot.
        robot: String,
        /// The configuration, rad.
        q: Vec<f64>,
        /// Greatest distance per motor, rad.
        tolerance: f64,
    },
}

/// An edit and its trigger.
#[derive(Clone, Debug, PartialEq)]
pub struct ScriptStep {
    /// Trigger.
    pub when: CueTrigger,
    /// Edit.
    pub edit: Edit,
}

/// Steps that are still to be executed.
#[derive(Clone, Debug, Default)]
pub struct Cues {
    steps: Vec<ScriptStep>,
    outcomes: Vec<(String, u64)>,
}

impl Cues {
    /// Creates the cues of a script.
    pub fn new(steps: Vec<ScriptStep>) -> Cues {
        Cues { steps, outcomes: Vec::new() }
    }

    /// Drops the steps up to a time and up to this number of outcomes of each robot: they have been executed.
    pub(crate) fn skip<'a>(&mut self, at: Time, outcomes: impl Iterator<Item = (&'a str, u64)>) {
        self.time(at);
        for (robot, count) in outcomes {
            (0..count).for_each(|_| drop(self.outcome(robot)));
        }
    }

    fn take(&mut self, due: impl Fn(&CueTrigger) -> bool) -> Vec<Edit> {
        let (now, later) = std::mem::take(&mut self.steps).into_iter().partition(|s| due(&s.when));
        self.steps = later;
        let now: Vec<ScriptStep> = now;
        now.into_iter().map(|s| s.edit).collect()
    }

    /// Counts an outcome of this robot, and returns the edits that are due.
    pub fn outcome(&mut self, robot: &str) -> Vec<Edit> {
        let count = match self.outcomes.iter_mut().find(|(r, _)| r == robot) {
            Some((_, n)) => {
                *n += 1;
                *n
            }
            None => {
                self.outcomes.push((robot.to_string(), 1));
                1
            }
        };
        self.take(|when| matches!(when, CueTrigger::AfterOutcomes { robot: r, n } if r == robot && *n <= count))
    }

    /// True if a step waits for a configuration.
    pub fn wants_poses(&self) -> bool {
        self.steps.iter().any(|s| matches!(s.when, CueTrigger::AtPose { .. }))
    }

    /// Returns the edits that are due for a robot at rest in this configuration.
    pub fn pose(&mut self, robot: &str, here: &[f64]) -> Vec<Edit> {
        let is = |when: &CueTrigger| match when {
            CueTrigger::AtPose { robot: r, q, tolerance } => r == robot && distance(q, here) <= *tolerance,
            _ => false,
        };
        self.take(is)
    }

    /// Returns the edits that are due at this time.
    pub fn time(&mut self, now: Time) -> Vec<Edit> {
        self.take(|when| matches!(when, CueTrigger::At(at) if *at <= now))
    }

    /// Time of the next step that waits for one.
    pub fn next_time(&self) -> Option<Time> {
        self.steps.iter().filter_map(|s| if let CueTrigger::At(at) = s.when { Some(at) } else { None }).min()
    }
}
