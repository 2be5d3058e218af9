//! Edits of the world that wait for their moment: the experiments' stage directions.

use mobee_contract::Time;
use mobee_controller::distance;
use mobee_model::Edit;

/// When to edit the world.
#[derive(Clone, Debug, PartialEq)]
pub enum CueTrigger {
    /// At a time.
    At(Time),
    /// When this robot rests after its n-th outcome, before its agent plans on.
    AfterOutcomes {
        /// The robot's name.
        robot: String,
        /// How many outcomes.
        n: u64,
    },
    /// When this robot rests at a pose.
    AtPose {
        /// The robot's name.
        robot: String,
        /// The pose, rad.
        q: Vec<f64>,
        /// Greatest distance per motor, rad.
        tolerance: f64,
    },
}

/// An edit and its moment.
#[derive(Clone, Debug, PartialEq)]
pub struct ScriptStep {
    /// When.
    pub when: CueTrigger,
    /// What.
    pub edit: Edit,
}

/// The steps that are still to come.
#[derive(Clone, Debug, Default)]
pub struct Cues {
    steps: Vec<ScriptStep>,
    outcomes: Vec<(String, u64)>,
}

impl Cues {
    /// From a script.
    pub fn new(steps: Vec<ScriptStep>) -> Cues {
        Cues { steps, outcomes: Vec::new() }
    }

    /// What has happened up to a time, with so many outcomes of each robot, does not happen again.
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

    /// An outcome of this robot was given: what is due.
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

    /// Whether a step waits for a pose.
    pub fn wants_poses(&self) -> bool {
        self.steps.iter().any(|s| matches!(s.when, CueTrigger::AtPose { .. }))
    }

    /// This robot rests here: what is due.
    pub fn pose(&mut self, robot: &str, here: &[f64]) -> Vec<Edit> {
        let is = |when: &CueTrigger| match when {
            CueTrigger::AtPose { robot: r, q, tolerance } => r == robot && distance(q, here) <= *tolerance,
            _ => false,
        };
        self.take(is)
    }

    /// It is now: what is due.
    pub fn time(&mut self, now: Time) -> Vec<Edit> {
        self.take(|when| matches!(when, CueTrigger::At(at) if *at <= now))
    }

    /// The next time that a step waits for.
    pub fn next_time(&self) -> Option<Time> {
        self.steps.iter().filter_map(|s| if let CueTrigger::At(at) = s.when { Some(at) } else { None }).min()
    }
}
