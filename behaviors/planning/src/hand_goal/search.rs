//! Search for joint values: inverse kinematics from home, and from seeded start configurations
//! within the limits.

use crate::group;
use crate::inverse_kinematics::{MotorGroup, PER_METER};
use crate::table_map::HandChain;
use mobee_model::{Scene, ShapeId};
use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// Maximum distance of the hand from its goal, meters.
const MAX_POSITION_ERROR_M: f64 = 1e-4;
/// Maximum orientation error of the hand, rad.
const MAX_ANGLE_ERROR_RAD: f64 = 0.1 * std::f64::consts::PI / 180.0;
/// Maximum number of starts, including home.
const MAX_STARTS: usize = 200;
/// Minimum number of starts if home does not lead to a free solution; of the solutions found, the
/// nearest to home is returned.
const MIN_STARTS: usize = 50;

/// Solutions nearer to each other than this count as one, rad.
const SAME_SOLUTION_RAD: f64 = 1e-3;

/// Goal of the hand, world frame.
#[derive(Clone, Debug)]
pub(super) struct Goal {
    /// Position, meters.
    pub at: Vector3<f64>,
    pub orientation: Orientation,
}

/// Required orientation of the hand.
#[derive(Clone, Debug)]
pub(super) enum Orientation {
    /// Any orientation.
    Any,
    /// This orientation.
    Full(UnitQuaternion<f64>),
    /// The marker's normal in this direction.
    Palm(Unit<Vector3<f64>>),
}

/// A search over the motors that move a hand.
pub(super) struct HandSearch<'a> {
    pub scene: &'a Scene,
    pub robot: usize,
    pub chain: HandChain,
    pub group: MotorGroup,
    pub clearance: f64,
    pub seed: u64,
}

/// Positions of the group's motors, rad, that bring the hand to its goal without a collision.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct HandPosture {
    pub q: Vec<f64>,
    /// Error of position and orientation, meters and rad.
    pub off: (f64, f64),
}

/// Reason why no joint values were found.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shortfall {
    /// The hand can't be brought there.
    OutOfReach {
        /// Error of position and orientation of the nearest configuration, meters and rad.
        off: (f64, f64),
        /// The position can be reached with another orientation.
        position_alone: bool,
    },
    /// It can, but not without a collision.
    NotFree {
        /// Nearest two shapes and their distance, meters, in the configuration that maximizes it;
        /// `None` if a constraint is violated.
        contact: Option<(ShapeId, ShapeId, f64)>,
    },
}

impl HandSearch<'_> {
    /// Returns joint values for a goal: from home if that leads to a free solution, otherwise the
    /// solution nearest to home from the other starts.
    pub fn run(&self, goal: &Goal) -> Result<HandPosture, Shortfall> {
        let mut found = self.search(goal, true)?;
        Ok(found.swap_remove(0))
    }

    /// Returns all different solutions for a goal that the starts lead to, nearest to home first; at least one.
    pub fn all(&self, goal: &Goal) -> Result<Vec<HandPosture>, Shortfall> {
        self.search(goal, false)
    }

    /// Searches from all starts; with `one`, a solution from home ends the search.
    fn search(&self, goal: &Goal, one: bool) -> Result<Vec<HandPosture>, Shortfall> {
        let home = self.home();
        let at_home = self.group.share(&home);
        let far = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        let mut found: Vec<HandPosture> = Vec::new();
        let mut nearest: Option<(f64, (f64, f64))> = None;
        let mut tightest: Option<Option<(ShapeId, ShapeId, f64)>> = None;
        for (i, start) in self.starts(&home).enumerate() {
            if !found.is_empty() && i >= MIN_STARTS {
                break;
            }
            let q = self.group.solve(&start, |pose| self.residual(goal, pose));
            let pose = self.group.whole(&home, &q);
            let off = self.off(goal, &pose);
            if !(off.0 <= MAX_POSITION_ERROR_M && off.1 <= MAX_ANGLE_ERROR_RAD) {
                let miss = (off.0 * PER_METER).hypot(off.1);
                if nearest.is_none_or(|(least, _)| miss < least) {
                    nearest = Some((miss, off));
                }
                continue;
            }
            if !self.scene.robot_free(self.robot, &self.poses(&pose), self.clearance) {
                let contact = self.contact(&pose);
                let room = |c: &Option<(ShapeId, ShapeId, f64)>| c.map_or(f64::NEG_INFINITY, |(.., room)| room);
                if tightest.as_ref().is_none_or(|known| room(&contact) > room(known)) {
                    tightest = Some(contact);
                }
                continue;
            }
            if found.iter().all(|other| far(&other.q, &q).sqrt() > SAME_SOLUTION_RAD) {
                found.push(HandPosture { q, off });
            }
            if one && i == 0 {
                break;
            }
        }
        found.sort_by(|a, b| far(&a.q, &at_home).total_cmp(&far(&b.q, &at_home)));
        match (found.is_empty(), tightest, nearest) {
            (false, ..) => Ok(found),
            (true, Some(contact), _) => Err(Shortfall::NotFree { contact }),
            (true, None, nearest) => {
                let off = nearest.map_or((f64::INFINITY, 0.0), |(_, off)| off);
                Err(Shortfall::OutOfReach { off, position_alone: self.reaches_position(goal) })
            }
        }
    }

    /// Returns whether an oriented goal could be reached if only its position mattered.
    fn reaches_position(&self, goal: &Goal) -> bool {
        let alone = Goal { at: goal.at, orientation: Orientation::Any };
        let home = self.home();
        let reaches = |start: Vec<f64>| {
            let q = self.group.solve(&start, |pose| self.residual(&alone, pose));
            self.off(&alone, &self.group.whole(&home, &q)).0 <= MAX_POSITION_ERROR_M
        };
        !matches!(goal.orientation, Orientation::Any) && self.starts(&home).take(MIN_STARTS).any(reaches)
    }

    /// Generates start configurations: home, then random ones of the group within its limits.
    fn starts(&self, home: &[f64]) -> impl Iterator<Item = Vec<f64>> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let drawn = move || {
            let draw = |(min, max): &(f64, f64)| if max > min { rng.random_range(*min..=*max) } else { *min };
            let q: Vec<f64> = self.group.limits.iter().map(draw).collect();
            self.group.whole(home, &q)
        };
        std::iter::once(home.to_vec()).chain(std::iter::repeat_with(drawn)).take(MAX_STARTS)
    }

    fn home(&self) -> Vec<f64> {
        self.scene.robots().get(self.robot).map(|robot| group::home(robot)).unwrap_or_default()
    }

    /// Computes the residual of a goal; a meter counts as [`PER_METER`] radians.
    fn residual(&self, goal: &Goal, pose: &[f64]) -> Vec<f64> {
        let frame = self.chain.frame(pose);
        let place = (frame.translation.vector - goal.at) * PER_METER;
        let turn = match &goal.orientation {
            Orientation::Any => None,
            Orientation::Full(wanted) => Some((frame.rotation * wanted.inverse()).scaled_axis()),
            Orientation::Palm(wanted) => Some(self.chain.at(pose).palm - **wanted),
        };
        place.iter().chain(turn.iter().flat_map(|turn| turn.iter())).copied().collect()
    }

    /// Returns the error of position and orientation, meters and rad.
    fn off(&self, goal: &Goal, pose: &[f64]) -> (f64, f64) {
        let frame = self.chain.frame(pose);
        let turn = match &goal.orientation {
            Orientation::Any => 0.0,
            Orientation::Full(wanted) => frame.rotation.angle_to(wanted),
            Orientation::Palm(wanted) => self.chain.at(pose).palm.angle(wanted),
        };
        ((frame.translation.vector - goal.at).norm(), turn)
    }

    /// Returns the configurations of all robots: at home, except for this one.
    fn poses(&self, pose: &[f64]) -> Vec<Arc<[f64]>> {
        let mut poses = self.scene.home();
        if let Some(own) = poses.get_mut(self.robot) {
            *own = Arc::from(pose);
        }
        poses
    }

    /// Returns the nearest two shapes at a configuration, one of them the robot's, and their
    /// distance, meters.
    fn contact(&self, pose: &[f64]) -> Option<(ShapeId, ShapeId, f64)> {
        let own = |id: ShapeId| id.robot() == Some(self.robot);
        let all = self.scene.contacts(&self.poses(pose), self.clearance);
        let near = all.into_iter().filter(|c| own(c.pair.0) || own(c.pair.1));
        let nearest = near.min_by(|a, b| a.distance.total_cmp(&b.distance))?;
        Some((nearest.pair.0, nearest.pair.1, nearest.distance))
    }
}
