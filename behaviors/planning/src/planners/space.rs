//! Joint space of a group of motors in a scene, in which straight lines are checked.

use super::{NoPath, PathEnd, PlanEnds, PlanningProblem, apart, between};
use crate::group::allowed;
use crate::short_way::JointMetric;
use mobee_contract::{Axis, View};
use mobee_fast::{EdgeVerdict, FastError, FastScene};
use mobee_model::{Motor, Scene};
use rand::Rng;
use std::f64::consts::TAU;

/// Number of configurations sampled on a line, per radian of its length. Lines that are used are proved, so the samples only
/// have to find most of the blocked ones.
const SAMPLES_PER_RAD: f64 = 16.0;
/// Maximum number of unproved intervals at a time for a line to count as easily certified; a line
/// close to an obstacle has more.
const MAX_EASY_INTERVALS: usize = 32;
/// As [`MAX_EASY_INTERVALS`], for the lines of a path.
const MAX_PATH_INTERVALS: usize = 128;
/// Maximum excess over a motor's limits that counts as rounding, rad.
const ROUNDING_RAD: f64 = 1e-9;

/// The motors of a space, independent of their environment.
#[derive(Clone)]
struct SpaceMotors {
    robot: usize,
    /// Minimum distance, m; a pair at this distance or closer is not free.
    clearance: f64,
    /// Indices into `Robot::motors`.
    motors: Vec<usize>,
    /// The same motors, with the limits of robot and board.
    joints: Vec<Motor>,
    /// Per motor: the range of random positions.
    ranges: Vec<(f64, f64)>,
    metric: JointMetric,
    /// Weight of each coordinate, per rad at the encoder: a meter of a prismatic joint counts as a
    /// radian of a revolute one.
    weights: Vec<f64>,
    /// Column of each motor in a configuration of the whole scene.
    columns: Vec<usize>,
}

/// Configurations of a group of motors while everything else in the scene is fixed.
///
/// Compiles its scene once ([`FastScene`], about ten milliseconds for a humanoid), so reuse it
/// while the scene is unchanged: [`JointSpace::fits`]. Only pairs of shapes that involve the robot
/// are checked.
pub struct JointSpace {
    fast: FastScene,
    group: SpaceMotors,
    epoch: u64,
    /// Configuration of the whole scene without the group's motors, rad at the encoder.
    rest: Vec<f64>,
    /// Configurations that no line may pass, because a motion failed there, each with a radius,
    /// rad.
    avoided: Vec<(Vec<f64>, f64)>,
    /// Fixed positions of motors that are not sampled.
    held: Vec<Option<f64>>,
    evaluations: u64,
    edges: Vec<f64>,
    verdicts: Vec<EdgeVerdict>,
    free: Vec<bool>,
}

impl JointSpace {
    /// Creates the space of an agent's robot from its view, with `room` meters more than the view's
    /// clearance.
    ///
    /// # Errors
    /// An invalid clearance.
    pub fn of(view: &View, motors: &[usize], room: f64) -> Result<JointSpace, FastError> {
        Self::new(&view.scene, view.robot, &view.poses, motors, &view.axes, view.clearance + room)
    }

    /// Creates the space of these motors of one robot of a scene.
    ///
    /// # Arguments
    /// * `poses`: configurations of all robots, rad at the encoder; a robot without an entry is at
    ///   home.
    /// * `motors`: indices into `Robot::motors`; those that the robot does not have are ignored.
    /// * `axes`: axes of the robot's board, with limits that may be narrower than the model's; may
    ///   be empty.
    /// * `clearance`: minimum distance, meters; at it or closer is not free.
    ///
    /// # Errors
    /// A clearance that is negative or not finite.
    pub fn new<P: AsRef<[f64]>>(
        scene: &Scene,
        robot: usize,
        poses: &[P],
        motors: &[usize],
        axes: &[Axis],
        clearance: f64,
    ) -> Result<JointSpace, FastError> {
        let fast = FastScene::of_pairs(scene, clearance, has_part(scene, robot))?;
        let model = scene.robots().get(robot);
        let narrowed = |m: &usize| {
            let motor = model?.motors.get(*m)?;
            let (min, max) = allowed((motor.min, motor.max), axes.get(*m));
            Some((*m, Motor { min, max, ..motor.clone() }))
        };
        let (motors, joints): (Vec<usize>, Vec<Motor>) = motors.iter().filter_map(narrowed).unzip();
        let before: usize = scene.robots().iter().take(robot).map(|r| r.motors.len()).sum();
        let metric = JointMetric::of_each(joints.iter().map(Some));
        let weights = joints.iter().map(|m| 1.0 / m.motion.encoder(1.0)).collect();
        let ranges = joints.iter().map(Motor::range).collect();
        let columns = motors.iter().map(|m| before + m).collect();
        let group = SpaceMotors { robot, clearance, motors, joints, ranges, metric, weights, columns };
        Ok(Self::over(fast, group, scene, poses))
    }

    /// Creates the space of the same motors among other obstacles. It shares the compiled robots and
    /// is therefore a hundred times faster than [`JointSpace::new`]. Avoided configurations and held
    /// motors are reset.
    ///
    /// # Errors
    /// As for [`JointSpace::new`].
    pub fn among<P: AsRef<[f64]>>(&self, scene: &Scene, poses: &[P]) -> Result<JointSpace, FastError> {
        let fast = self.fast.among(scene, has_part(scene, self.group.robot))?;
        Ok(Self::over(fast, self.group.clone(), scene, poses))
    }

    fn over<P: AsRef<[f64]>>(fast: FastScene, group: SpaceMotors, scene: &Scene, poses: &[P]) -> JointSpace {
        let mut space = JointSpace {
            fast,
            group,
            epoch: scene.epoch(),
            rest: Vec::new(),
            avoided: Vec::new(),
            held: Vec::new(),
            evaluations: 0,
            edges: Vec::new(),
            verdicts: Vec::new(),
            free: Vec::new(),
        };
        space.stand(scene, poses);
        space
    }

    /// Returns the space of a view, as [`JointSpace::of`]: the given one if it
    /// [fits](JointSpace::fits), otherwise it with the changed objects replaced.
    ///
    /// # Errors
    /// A clearance that is negative or not finite.
    pub fn renewed(
        kept: Option<JointSpace>,
        view: &View,
        motors: &[usize],
        room: f64,
    ) -> Result<JointSpace, FastError> {
        match kept {
            Some(kept) if kept.fits(view, motors, room) => Ok(kept),
            Some(kept) if kept.is_of(view, motors, room) => {
                let mut fast = kept.fast;
                fast.set_scene(&view.scene, has_part(&view.scene, kept.group.robot))?;
                Ok(Self::over(fast, kept.group, &view.scene, &view.poses))
            }
            _ => Self::of(view, motors, room),
        }
    }

    /// Returns whether it is still the space of these motors in this view, as created by
    /// [`JointSpace::of`], regardless of the robots' configurations.
    pub fn fits(&self, view: &View, motors: &[usize], room: f64) -> bool {
        self.epoch == view.scene.epoch() && self.is_of(view, motors, room)
    }

    /// Returns whether it has these motors and this clearance, regardless of the environment.
    fn is_of(&self, view: &View, motors: &[usize], room: f64) -> bool {
        self.group.clearance == view.clearance + room && self.group.robot == view.robot && self.group.motors == motors
    }

    /// Updates the configuration of everything that the group does not move. A motor at rest at its
    /// limit may read slightly more; it is clamped, because no line is to blame for that.
    pub fn stand<P: AsRef<[f64]>>(&mut self, scene: &Scene, poses: &[P]) {
        self.rest.clear();
        for (r, robot) in scene.robots().iter().enumerate() {
            let pose = poses.get(r).map_or(&[][..], |p| p.as_ref());
            let at = |(m, of): (usize, &Motor)| pose.get(m).copied().unwrap_or(of.home).max(of.min).min(of.max);
            self.rest.extend(robot.motors.iter().enumerate().map(at));
        }
    }

    /// The group: indices into `Robot::motors`.
    pub fn motors(&self) -> &[usize] {
        &self.group.motors
    }

    /// Metric of the group's configurations.
    pub fn metric(&self) -> &JointMetric {
        &self.group.metric
    }

    /// Number of straight lines checked since its creation.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Returns the diagonal of its box, rad; one turn for continuous joints.
    pub fn extent(&self) -> f64 {
        self.group.joints.iter().map(|m| (m.max - m.min).min(TAU)).map(|way| way * way).sum::<f64>().sqrt()
    }

    /// Holds motors of the group (indices into `Robot::motors`) at positions, rad: a plan between
    /// two configurations with these positions moves none of them.
    pub fn hold(&mut self, held: &[(usize, f64)]) {
        let at = |motor: &usize| held.iter().find(|(m, _)| m == motor).map(|(_, q)| *q);
        self.held = self.group.motors.iter().map(at).collect();
    }

    /// Weights of the coordinates in the lengths of planners, per rad at the encoder: 1 for a
    /// revolute joint; for a prismatic joint such that a meter counts as a radian (1 rad at its
    /// encoder is 57 mm).
    pub fn weights(&self) -> &[f64] {
        &self.group.weights
    }

    /// Returns the weighted length of the straight line between two configurations, full turns
    /// included: rad and m.
    pub fn weighted(&self, from: &[f64], to: &[f64]) -> f64 {
        let ways = from.iter().zip(to).zip(&self.group.weights).map(|((a, b), weight)| (b - a) * weight);
        ways.map(|way| way * way).sum::<f64>().sqrt()
    }

    /// Like [`JointSpace::sample`], into a buffer.
    pub fn sample_into(&self, rng: &mut impl Rng, pose: &mut Vec<f64>) {
        pose.clear();
        for i in 0..self.group.joints.len() {
            pose.push(self.draw(i, rng));
        }
    }

    /// Puts the motors that are held to their positions, rad.
    pub(super) fn put_held(&self, pose: &mut [f64]) {
        for (q, held) in pose.iter_mut().zip(&self.held) {
            *q = held.unwrap_or(*q);
        }
    }

    /// Like [`JointSpace::toward`], into a buffer.
    pub fn toward_into(&self, from: &[f64], to: &[f64], nearest: &mut Vec<f64>) {
        nearest.clear();
        let ends = from.iter().zip(to);
        nearest
            .extend(self.group.joints.iter().zip(ends).map(|(motor, (from, to))| motor.nearest_equivalent(*from, *to)));
    }

    /// Draws a configuration uniformly within the limits.
    pub fn sample(&self, rng: &mut impl Rng) -> Vec<f64> {
        let mut pose = Vec::with_capacity(self.group.joints.len());
        self.sample_into(rng, &mut pose);
        pose
    }

    /// Draws a position of a motor of the group, by its index in the group.
    fn draw(&self, i: usize, rng: &mut impl Rng) -> f64 {
        if let Some(Some(held)) = self.held.get(i) {
            return *held;
        }
        let (min, max) = self.group.ranges.get(i).copied().unwrap_or_default();
        (min + (max - min) * rng.random::<f64>()).min(max)
    }

    /// Returns the configuration equivalent to `to` that is closest to `from`, within the limits.
    pub fn toward(&self, from: &[f64], to: &[f64]) -> Vec<f64> {
        let mut nearest = Vec::with_capacity(to.len());
        self.toward_into(from, to, &mut nearest);
        nearest
    }

    /// Returns the first motor of the group that is outside its limits, an index into
    /// `Robot::motors`.
    pub fn outside(&self, q: &[f64]) -> Option<usize> {
        let mut all = self.group.motors.iter().zip(self.group.joints.iter().zip(q));
        all.find(|(_, (m, q))| !(**q >= m.min - ROUNDING_RAD && **q <= m.max + ROUNDING_RAD)).map(|(m, _)| *m)
    }

    /// Makes lines closer than `radius` (rad) to this configuration count as not free, regardless
    /// of the scene: a motion failed there for a reason that the scene does not contain.
    pub fn avoid(&mut self, pose: Vec<f64>, radius: f64) {
        self.avoided.push((pose, radius));
    }

    /// Removes all avoided configurations.
    pub fn forgive(&mut self) {
        self.avoided.clear();
    }

    /// Clamps a configuration to the limits, beyond which an encoder may read slightly.
    pub fn within(&self, q: &[f64]) -> Vec<f64> {
        q.iter().zip(&self.group.joints).map(|(q, m)| q.max(m.min).min(m.max)).collect()
    }

    /// Checks configurations of the group; returns which of them are free.
    pub fn free<'a>(&mut self, poses: impl IntoIterator<Item = &'a [f64]>) -> &[bool] {
        self.edges.clear();
        let mut count = 0;
        for pose in poses {
            whole(&mut self.edges, &self.rest, &self.group.columns, pose);
            count += 1;
        }
        if self.fast.free(&self.edges, &mut self.free).is_err() {
            // Cannot happen: these are whole configurations.
            self.free = vec![false; count];
        }
        self.evaluations += count as u64;
        &self.free
    }

    /// Certifies straight lines and returns one verdict for each, in order. Several at once cost
    /// hardly more than one. A line that is not the short way of a continuous joint, or passes an
    /// avoided configuration, is uncertified.
    pub fn certify<'a>(&mut self, edges: impl IntoIterator<Item = (&'a [f64], &'a [f64])>) -> &[EdgeVerdict] {
        let shut = self.load(edges);
        if self.fast.certify(&self.edges, &mut self.verdicts).is_err() {
            // Cannot happen: these are whole configurations.
            self.verdicts = shut.iter().map(|_| EdgeVerdict::Uncertified { at: 0.0 }).collect();
        }
        for (verdict, shut) in self.verdicts.iter_mut().zip(shut) {
            if let (EdgeVerdict::Free, Some(at)) = (&verdict, shut) {
                *verdict = EdgeVerdict::Uncertified { at };
            }
        }
        self.evaluations += self.verdicts.len() as u64;
        &self.verdicts
    }

    /// Writes straight lines to the buffer as configurations of the scene. Returns, for each, the
    /// share at which it is excluded regardless of the scene, if any.
    fn load<'a>(&mut self, edges: impl IntoIterator<Item = (&'a [f64], &'a [f64])>) -> Vec<Option<f64>> {
        self.edges.clear();
        let mut shut = Vec::new();
        for (from, to) in edges {
            whole(&mut self.edges, &self.rest, &self.group.columns, from);
            whole(&mut self.edges, &self.rest, &self.group.columns, to);
            shut.push(self.is_shut(from, to));
        }
        shut
    }

    /// Returns which of these straight lines are free, as [`JointSpace::certify`], but faster:
    /// obstacles are not located.
    pub fn free_lines<'a>(&mut self, edges: impl IntoIterator<Item = (&'a [f64], &'a [f64])>) -> Vec<bool> {
        self.free_lines_within(edges, usize::MAX)
    }

    /// As [`JointSpace::free_lines`] for the lines of a path; one that is close along an obstacle, which
    /// takes long to certify, counts as not free.
    pub fn path_lines_free<'a>(&mut self, edges: impl IntoIterator<Item = (&'a [f64], &'a [f64])>) -> Vec<bool> {
        self.free_lines_within(edges, MAX_PATH_INTERVALS)
    }

    fn free_lines_within<'a>(
        &mut self,
        edges: impl IntoIterator<Item = (&'a [f64], &'a [f64])>,
        most: usize,
    ) -> Vec<bool> {
        let shut = self.load(edges);
        self.evaluations += shut.len() as u64;
        if self.fast.edges_free_within(&self.edges, most, &mut self.free).is_err() {
            // Cannot happen: these are whole configurations.
            self.free.clear();
        }
        shut.iter().enumerate().map(|(i, shut)| shut.is_none() && self.free.get(i) == Some(&true)).collect()
    }

    /// Returns whether a straight line is free at its samples and not excluded as in
    /// [`JointSpace::certify`]: not a proof, but several times faster than one. Counts as a checked
    /// line.
    pub fn samples_free(&mut self, from: &[f64], to: &[f64]) -> bool {
        self.evaluations += 1;
        if self.is_shut(from, to).is_some() {
            return false;
        }
        self.edges.clear();
        whole(&mut self.edges, &self.rest, &self.group.columns, from);
        whole(&mut self.edges, &self.rest, &self.group.columns, to);
        let poses = (self.weighted(from, to) * SAMPLES_PER_RAD).ceil() as usize;
        // Cannot fail: these are whole configurations.
        self.fast.samples_free(&self.edges, poses).unwrap_or(false)
    }

    /// Returns whether a straight line can be certified free at little cost; one close to an
    /// obstacle counts as not free. Samples detect most blocked lines first. Counts as a checked
    /// line.
    pub fn is_easily_free(&mut self, from: &[f64], to: &[f64]) -> bool {
        // `samples_free` leaves the line in the buffer.
        if !self.samples_free(from, to) {
            return false;
        }
        let certified = self.fast.edges_free_within(&self.edges, MAX_EASY_INTERVALS, &mut self.free);
        certified.is_ok() && self.free == [true]
    }

    /// Returns the share at which a straight line is excluded regardless of the scene, if any.
    fn is_shut(&self, from: &[f64], to: &[f64]) -> Option<f64> {
        // The robot takes the short way, so no other line is valid.
        let short = |(motor, (from, to)): (&Motor, (&f64, &f64))| motor.nearest_equivalent(*from, *to) == *to;
        if !self.group.joints.iter().zip(from.iter().zip(to)).all(short) {
            return Some(0.0);
        }
        self.avoided.iter().find_map(|(pose, radius)| self.passes(from, to, pose, *radius))
    }

    /// Returns whether all of these straight lines are free.
    pub fn all_free<'a>(&mut self, edges: impl IntoIterator<Item = (&'a [f64], &'a [f64])>) -> bool {
        self.free_lines(edges).into_iter().all(|free| free)
    }

    /// Returns the share at which a straight line comes within `radius` of a configuration, if it
    /// does.
    fn passes(&self, from: &[f64], to: &[f64], pose: &[f64], radius: f64) -> Option<f64> {
        let length = apart(from, to);
        let pose = self.toward(&between(from, to, 0.5), pose);
        let along: f64 = from.iter().zip(to).zip(&pose).map(|((a, b), p)| (p - a) * (b - a)).sum();
        let share = if length > 0.0 { (along / (length * length)).clamp(0.0, 1.0) } else { 0.0 };
        (apart(&between(from, to, share), &pose) < radius).then_some(share)
    }

    /// Returns the start of a problem and the goals that a planner can use.
    ///
    /// # Errors
    /// A start, or all goals, that no planner can use: outside the limits or not free; of several goals the first one's
    /// reason is returned. A malformed end, even if other goals can be used.
    pub fn ends(&mut self, problem: &PlanningProblem) -> Result<PlanEnds, NoPath> {
        let start = problem.start.clone();
        self.check_limits(PathEnd::Start, &start)?;
        let mut inside = Vec::new();
        let mut refused = Vec::new();
        for (i, given) in problem.goals.iter().enumerate() {
            let goal = if given.len() == start.len() { self.toward(&start, given) } else { given.clone() };
            match self.check_limits(PathEnd::Goal, &goal) {
                Ok(()) => inside.push((i, goal)),
                Err(why @ NoPath::Malformed(_)) => return Err(why),
                Err(why) => refused.push((i, why)),
            }
        }
        let all = std::iter::once(&start).chain(inside.iter().map(|(_, goal)| goal));
        // All together: that costs hardly more than one.
        let mut verdicts = self.certify(all.map(|q| (q.as_slice(), q.as_slice()))).iter();
        check_verdict(PathEnd::Start, verdicts.next())?;
        let mut goals = Vec::new();
        for ((i, goal), verdict) in inside.into_iter().zip(verdicts) {
            match check_verdict(PathEnd::Goal, Some(verdict)) {
                Ok(()) => goals.push((i, goal)),
                Err(why) => refused.push((i, why)),
            }
        }
        refused.sort_by_key(|(i, _)| *i);
        goals.sort_by(|a, b| self.weighted(&start, &a.1).total_cmp(&self.weighted(&start, &b.1)));
        if goals.is_empty() {
            let first = refused.into_iter().next();
            return Err(first.map_or(NoPath::Malformed(PathEnd::Goal), |(_, why)| why));
        }
        Ok(PlanEnds { start, goals, refused })
    }

    /// Checks that an end of a problem is a configuration within the limits.
    fn check_limits(&self, end: PathEnd, q: &[f64]) -> Result<(), NoPath> {
        let n = self.group.motors.len();
        if n == 0 || q.len() != n || q.iter().any(|q| !q.is_finite()) {
            return Err(NoPath::Malformed(end));
        }
        self.outside(q).map_or(Ok(()), |motor| Err(NoPath::Limits { end, motor }))
    }
}

/// Checks that an end of a problem was certified free.
fn check_verdict(end: PathEnd, verdict: Option<&EdgeVerdict>) -> Result<(), NoPath> {
    match verdict {
        Some(EdgeVerdict::Free) => Ok(()),
        Some(EdgeVerdict::Blocked(obstruction)) => Err(NoPath::Blocked { end, pair: obstruction.pair }),
        _ => Err(NoPath::Blocked { end, pair: None }),
    }
}

/// Returns a predicate for pairs of shapes that involve a robot.
fn has_part(scene: &Scene, robot: usize) -> impl Fn(u32, u32) -> bool {
    let own = move |shape: u32| scene.shape_id(shape).and_then(|id| id.robot()) == Some(robot);
    move |a, b| own(a) || own(b)
}

/// Appends a configuration of the whole scene with the group's positions in its columns.
fn whole(all: &mut Vec<f64>, rest: &[f64], columns: &[usize], pose: &[f64]) {
    let first = all.len();
    all.extend(rest);
    for (column, q) in columns.iter().zip(pose) {
        if let Some(slot) = all.get_mut(first + column) {
            *slot = *q;
        }
    }
}
