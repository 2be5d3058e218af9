//! The search for joint values: inverse kinematics from home, and from seeded starts within the limits.

use crate::group;
use crate::inverse_kinematics::{MotorGroup, PER_METER};
use crate::table_map::HandChain;
use mobee_model::{Scene, ShapeId};
use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// A pose counts if the hand is so near to its goal, meters, and its orientation, rad.
const POSITION: f64 = 1e-4;
const ANGLE: f64 = 0.1 * std::f64::consts::PI / 180.0;
/// Starts at most, home included, and how many there are at least if home does not lead there: of what they find, the nearest to home is
/// taken.
const MAX_STARTS: usize = 200;
const MIN_STARTS: usize = 50;

/// Where the hand is to be, in the world.
#[derive(Clone, Debug)]
pub(super) struct Goal {
    /// Position, meters.
    pub at: Vector3<f64>,
    pub orientation: Orientation,
}

/// How it is to be turned.
#[derive(Clone, Debug)]
pub(super) enum Orientation {
    /// In any way.
    Any,
    /// Exactly so.
    Full(UnitQuaternion<f64>),
    /// With its normal in this direction.
    Palm(Unit<Vector3<f64>>),
}

/// A hand and the motors that are searched over.
pub(super) struct Search<'a> {
    pub scene: &'a Scene,
    pub robot: usize,
    pub chain: HandChain,
    pub group: MotorGroup,
    pub clearance: f64,
    pub seed: u64,
}

/// Positions of the group's motors with the hand at its goal, freely.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Found {
    pub q: Vec<f64>,
    /// How far position and orientation are off, meters and rad.
    pub off: (f64, f64),
}

/// Why there are none.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shortfall {
    /// The hand can't be brought there.
    OutOfReach {
        /// How far position and orientation of the nearest pose are off, meters and rad.
        off: (f64, f64),
        /// Whether the position can be reached with another orientation.
        position_alone: bool,
    },
    /// It can, but not freely.
    NotFree {
        /// The nearest two shapes and their distance, meters, in the pose where that is greatest; none if a constraint forbids it.
        contact: Option<(ShapeId, ShapeId, f64)>,
    },
}

impl Search<'_> {
    /// Joint values for a goal: from home if that leads there freely, or else the nearest to home of those that other starts lead to.
    pub fn run(&self, goal: &Goal) -> Result<Found, Shortfall> {
        let home = self.home();
        let at_home = self.group.share(&home);
        let far = |q: &[f64]| q.iter().zip(&at_home).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        let mut best: Option<(f64, Found)> = None;
        let mut nearest: Option<(f64, (f64, f64))> = None;
        let mut tightest: Option<Option<(ShapeId, ShapeId, f64)>> = None;
        for (i, start) in self.starts(&home).enumerate() {
            if best.is_some() && i >= MIN_STARTS {
                break;
            }
            let q = self.group.solve(&start, |pose| self.residual(goal, pose));
            let pose = self.group.whole(&home, &q);
            let off = self.off(goal, &pose);
            if !(off.0 <= POSITION && off.1 <= ANGLE) {
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
            if i == 0 {
                return Ok(Found { q, off });
            }
            let way = far(&q);
            if best.as_ref().is_none_or(|(least, _)| way < *least) {
                best = Some((way, Found { q, off }));
            }
        }
        match (best, tightest, nearest) {
            (Some((_, found)), ..) => Ok(found),
            (None, Some(contact), _) => Err(Shortfall::NotFree { contact }),
            (None, None, nearest) => {
                let off = nearest.map_or((f64::INFINITY, 0.0), |(_, off)| off);
                Err(Shortfall::OutOfReach { off, position_alone: self.reaches_position(goal) })
            }
        }
    }

    /// Whether the hand can be brought to the goal's position if its orientation does not matter, which it does in the goal.
    fn reaches_position(&self, goal: &Goal) -> bool {
        let alone = Goal { at: goal.at, orientation: Orientation::Any };
        let home = self.home();
        let reaches = |start: Vec<f64>| {
            let q = self.group.solve(&start, |pose| self.residual(&alone, pose));
            self.off(&alone, &self.group.whole(&home, &q)).0 <= POSITION
        };
        !matches!(goal.orientation, Orientation::Any) && self.starts(&home).take(MIN_STARTS).any(reaches)
    }

    /// Home, and then whole poses with the group anywhere within its limits.
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

    /// What is to become zero: a meter counts [`PER_METER`] radians.
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

    /// How far position and orientation are off, meters and rad.
    fn off(&self, goal: &Goal, pose: &[f64]) -> (f64, f64) {
        let frame = self.chain.frame(pose);
        let turn = match &goal.orientation {
            Orientation::Any => 0.0,
            Orientation::Full(wanted) => frame.rotation.angle_to(wanted),
            Orientation::Palm(wanted) => self.chain.at(pose).palm.angle(wanted),
        };
        ((frame.translation.vector - goal.at).norm(), turn)
    }

    /// All robots at home, this one at a pose.
    fn poses(&self, pose: &[f64]) -> Vec<Arc<[f64]>> {
        let mut poses = self.scene.home();
        if let Some(own) = poses.get_mut(self.robot) {
            *own = Arc::from(pose);
        }
        poses
    }

    /// The nearest two shapes at a pose, one of them the robot's, and their distance.
    fn contact(&self, pose: &[f64]) -> Option<(ShapeId, ShapeId, f64)> {
        let own = |id: ShapeId| id.robot() == Some(self.robot);
        let all = self.scene.contacts(&self.poses(pose), self.clearance);
        let near = all.into_iter().filter(|c| own(c.pair.0) || own(c.pair.1));
        let nearest = near.min_by(|a, b| a.distance.total_cmp(&b.distance))?;
        Some((nearest.pair.0, nearest.pair.1, nearest.distance))
    }
}
