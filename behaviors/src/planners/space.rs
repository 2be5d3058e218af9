//! The joint space of a group of motors in a scene: where straight lines are judged.

use super::{NoPath, PathEnd, PlanningProblem, apart, between};
use crate::group::allowed;
use crate::short_way::JointMetric;
use mobee_contract::{Axis, View};
use mobee_fast::{EdgeVerdict, FastError, FastScene};
use mobee_model::{Motor, Scene};
use rand::Rng;
use std::f64::consts::TAU;

/// Poses that are looked at on a line, per radian of it.
const SAMPLES_PER_RAD: f64 = 32.0;
/// A line with more intervals than this that are not proved at a time goes close along something.
const EASY_INTERVALS: usize = 32;
/// How far outside its limits a motor may be by rounding, rad.
const ROUNDING: f64 = 1e-9;

/// The motors of a space, whatever stands around them.
#[derive(Clone)]
struct MotorGroup {
    robot: usize,
    /// Pairs that are as near as this or nearer are not free, m.
    clearance: f64,
    /// Indices into `Robot::motors`.
    motors: Vec<usize>,
    /// The same motors with the limits of robot and board.
    joints: Vec<Motor>,
    metric: JointMetric,
    /// Weight of each coordinate, per rad of encoder: a meter of a prismatic joint counts as a radian of a revolute one.
    weights: Vec<f64>,
    /// Column of each motor in a configuration of the whole scene.
    columns: Vec<usize>,
}

/// The poses of a group of motors, while everything else stands where it is.
///
/// Compiles its scene once ([`FastScene`], some ten milliseconds for a humanoid), so keep it for as long as the scene is the same:
/// [`JointSpace::fits`]. Only pairs of shapes that the robot has part in count: what others touch is their matter.
pub struct JointSpace {
    fast: FastScene,
    group: MotorGroup,
    epoch: u64,
    /// Configuration of the whole scene while the group is not there, rad of encoder.
    rest: Vec<f64>,
    /// Places that no line may come near, by experience: a pose, and how near, rad.
    avoided: Vec<(Vec<f64>, f64)>,
    /// Where motors are, of those that are drawn nowhere else.
    held: Vec<Option<f64>>,
    evaluations: u64,
    edges: Vec<f64>,
    verdicts: Vec<EdgeVerdict>,
    free: Vec<bool>,
}

impl JointSpace {
    /// The space of an agent's robot, as its view has it, with so much more room than the view's clearance, meters.
    ///
    /// # Errors
    /// A clearance that is none.
    pub fn of(view: &View, motors: &[usize], room: f64) -> Result<JointSpace, FastError> {
        Self::new(&view.scene, view.robot, &view.poses, motors, &view.axes, view.clearance + room)
    }

    /// The space of these motors of one robot of a scene.
    ///
    /// # Arguments
    /// * `poses`: of all robots, rad of encoder; what has no entry is at home.
    /// * `motors`: indices into `Robot::motors`; those that the robot has not are left out.
    /// * `axes`: the robot's board, whose limits may be narrower than the model's; may be empty.
    /// * `clearance`: nearer than this, or as near, meters, is not free.
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
        let columns = motors.iter().map(|m| before + m).collect();
        let group = MotorGroup { robot, clearance, motors, joints, metric, weights, columns };
        Ok(Self::over(fast, group, scene, poses))
    }

    /// The same motors among other obstacles: what was proved of the robots is used again, so this is several times as quick as
    /// [`JointSpace::new`]. Nothing is avoided or held any more.
    ///
    /// # Errors
    /// None but for those of [`JointSpace::new`].
    pub fn among<P: AsRef<[f64]>>(&self, scene: &Scene, poses: &[P]) -> Result<JointSpace, FastError> {
        let fast = self.fast.among(scene, has_part(scene, self.group.robot))?;
        Ok(Self::over(fast, self.group.clone(), scene, poses))
    }

    fn over<P: AsRef<[f64]>>(fast: FastScene, group: MotorGroup, scene: &Scene, poses: &[P]) -> JointSpace {
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

    /// The space of a view, as [`JointSpace::of`] makes it: the one that was kept where that [fits](JointSpace::fits), or one that is made
    /// with what that one has of the robots.
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
            Some(kept) if kept.is_of(view, motors, room) => kept.among(&view.scene, &view.poses),
            _ => Self::of(view, motors, room),
        }
    }

    /// Whether it is still the space of these motors in this view, as [`JointSpace::of`] makes it, wherever everybody stands.
    pub fn fits(&self, view: &View, motors: &[usize], room: f64) -> bool {
        self.epoch == view.scene.epoch() && self.is_of(view, motors, room)
    }

    /// Whether it is of these motors and this clearance, whatever stands about them.
    fn is_of(&self, view: &View, motors: &[usize], room: f64) -> bool {
        self.group.clearance == view.clearance + room && self.group.robot == view.robot && self.group.motors == motors
    }

    /// Everything that the group does not move is here now. A motor that rests at its limit may read a little more, which no line can
    /// be blamed for.
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

    /// Distances between poses of the group.
    pub fn metric(&self) -> &JointMetric {
        &self.group.metric
    }

    /// Straight lines judged since it was made.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// The diagonal of its box, one turn for motors without end, rad.
    pub fn extent(&self) -> f64 {
        self.group.joints.iter().map(|m| (m.max - m.min).min(TAU)).map(|way| way * way).sum::<f64>().sqrt()
    }

    /// Keeps motors of the group (indices into `Robot::motors`) where they are to be, rad: a plan between two such poses moves none of
    /// them.
    pub fn hold(&mut self, held: &[(usize, f64)]) {
        let at = |motor: &usize| held.iter().find(|(m, _)| m == motor).map(|(_, q)| *q);
        self.held = self.group.motors.iter().map(at).collect();
    }

    /// What each coordinate counts in the lengths of planners, per rad of encoder: 1 where a joint turns, and where it slides as much
    /// as makes a meter a radian (an encoder's rad of a slide are 57 mm).
    pub fn weights(&self) -> &[f64] {
        &self.group.weights
    }

    /// Length of the straight line between two poses as they are, turns included, by the weights: rad and m.
    pub fn weighted(&self, from: &[f64], to: &[f64]) -> f64 {
        let ways = from.iter().zip(to).zip(&self.group.weights).map(|((a, b), weight)| (b - a) * weight);
        ways.map(|way| way * way).sum::<f64>().sqrt()
    }

    /// As [`JointSpace::sample`], into a buffer.
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

    /// As [`JointSpace::toward`], into a buffer.
    pub fn toward_into(&self, from: &[f64], to: &[f64], nearest: &mut Vec<f64>) {
        nearest.clear();
        let ends = from.iter().zip(to);
        nearest
            .extend(self.group.joints.iter().zip(ends).map(|(motor, (from, to))| motor.nearest_equivalent(*from, *to)));
    }

    /// A pose within the limits, all alike likely.
    pub fn sample(&self, rng: &mut impl Rng) -> Vec<f64> {
        let mut pose = Vec::with_capacity(self.group.joints.len());
        self.sample_into(rng, &mut pose);
        pose
    }

    /// A position of a motor of the group, by its index in the group.
    fn draw(&self, i: usize, rng: &mut impl Rng) -> f64 {
        if let Some(Some(held)) = self.held.get(i) {
            return *held;
        }
        let (min, max) = self.group.joints.get(i).map_or((0.0, 0.0), Motor::range);
        if max > min { rng.random_range(min..=max) } else { min }
    }

    /// The pose that is the same as `to` and has the shortest way from `from`, within the limits.
    pub fn toward(&self, from: &[f64], to: &[f64]) -> Vec<f64> {
        let mut nearest = Vec::with_capacity(to.len());
        self.toward_into(from, to, &mut nearest);
        nearest
    }

    /// The first motor of the group that can't be at this pose, an index into `Robot::motors`.
    pub fn outside(&self, q: &[f64]) -> Option<usize> {
        let mut all = self.group.motors.iter().zip(self.group.joints.iter().zip(q));
        all.find(|(_, (m, q))| !(**q >= m.min - ROUNDING && **q <= m.max + ROUNDING)).map(|(m, _)| *m)
    }

    /// Lines that come nearer than `radius` (rad) to this pose are not free from now on, whatever the scene says: something that it does
    /// not show was met there.
    pub fn avoid(&mut self, pose: Vec<f64>, radius: f64) {
        self.avoided.push((pose, radius));
    }

    /// Nothing is avoided any more.
    pub fn forgive(&mut self) {
        self.avoided.clear();
    }

    /// The pose put within the limits, beyond which an encoder may read a little.
    pub fn within(&self, q: &[f64]) -> Vec<f64> {
        q.iter().zip(&self.group.joints).map(|(q, m)| q.max(m.min).min(m.max)).collect()
    }

    /// Judges poses of the group: which are free.
    pub fn free<'a>(&mut self, poses: impl IntoIterator<Item = &'a [f64]>) -> &[bool] {
        self.edges.clear();
        let mut count = 0;
        for pose in poses {
            whole(&mut self.edges, &self.rest, &self.group.columns, pose);
            count += 1;
        }
        if self.fast.free(&self.edges, &mut self.free).is_err() {
            // can't be: they are whole poses
            self.free = vec![false; count];
        }
        self.evaluations += count as u64;
        &self.free
    }

    /// Judges straight lines, one verdict for each, in order. Several at once are hardly dearer than one. A line that is not the short
    /// way of a motor without end, or passes a place that is avoided, is uncertified.
    pub fn certify<'a>(&mut self, edges: impl IntoIterator<Item = (&'a [f64], &'a [f64])>) -> &[EdgeVerdict] {
        let shut = self.load(edges);
        if self.fast.certify(&self.edges, &mut self.verdicts).is_err() {
            // can't be: they are whole poses
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

    /// Writes straight lines as poses of the scene. Answers of each where it may not be driven whatever the scene says, if anywhere.
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

    /// Which of these straight lines are free, as [`JointSpace::certify`] has it, but quicker: where a line is blocked is not found out.
    pub fn free_lines<'a>(&mut self, edges: impl IntoIterator<Item = (&'a [f64], &'a [f64])>) -> Vec<bool> {
        let shut = self.load(edges);
        self.evaluations += shut.len() as u64;
        if self.fast.edges_free(&self.edges, &mut self.free).is_err() {
            // can't be: they are whole poses
            self.free.clear();
        }
        shut.iter().enumerate().map(|(i, shut)| shut.is_none() && self.free.get(i) == Some(&true)).collect()
    }

    /// Whether a straight line is free where it is looked at, and none that [`JointSpace::certify`] shuts whatever the scene says: no
    /// proof, but several times as quick as one. Counts as a line that is judged.
    pub fn samples_free(&mut self, from: &[f64], to: &[f64]) -> bool {
        self.evaluations += 1;
        if self.is_shut(from, to).is_some() {
            return false;
        }
        self.edges.clear();
        whole(&mut self.edges, &self.rest, &self.group.columns, from);
        whole(&mut self.edges, &self.rest, &self.group.columns, to);
        let poses = (self.weighted(from, to) * SAMPLES_PER_RAD).ceil() as usize;
        // can't fail: they are whole poses
        self.fast.samples_free(&self.edges, poses).unwrap_or(false)
    }

    /// Whether a straight line is certified free without much ado: one that goes close along something counts as not free. What is
    /// blocked is mostly seen by samples. Counts as a line that is judged.
    pub fn is_easily_free(&mut self, from: &[f64], to: &[f64]) -> bool {
        // The line is left in the buffer.
        if !self.samples_free(from, to) {
            return false;
        }
        let certified = self.fast.edges_free_within(&self.edges, EASY_INTERVALS, &mut self.free);
        certified.is_ok() && self.free == [true]
    }

    /// Where a straight line may not be driven whatever the scene says, if anywhere.
    fn is_shut(&self, from: &[f64], to: &[f64]) -> Option<f64> {
        // the robot takes the short way, so no other is of use
        let short = |(motor, (from, to)): (&Motor, (&f64, &f64))| motor.nearest_equivalent(*from, *to) == *to;
        if !self.group.joints.iter().zip(from.iter().zip(to)).all(short) {
            return Some(0.0);
        }
        self.avoided.iter().find_map(|(pose, radius)| self.passes(from, to, pose, *radius))
    }

    /// Whether all of these straight lines are free.
    pub fn all_free<'a>(&mut self, edges: impl IntoIterator<Item = (&'a [f64], &'a [f64])>) -> bool {
        self.free_lines(edges).into_iter().all(|free| free)
    }

    /// Where a straight line comes within `radius` of a pose, as a share of it.
    fn passes(&self, from: &[f64], to: &[f64], pose: &[f64], radius: f64) -> Option<f64> {
        let length = apart(from, to);
        let pose = self.toward(&between(from, to, 0.5), pose);
        let along: f64 = from.iter().zip(to).zip(&pose).map(|((a, b), p)| (p - a) * (b - a)).sum();
        let share = if length > 0.0 { (along / (length * length)).clamp(0.0, 1.0) } else { 0.0 };
        (apart(&between(from, to, share), &pose) < radius).then_some(share)
    }

    /// The ends of a problem, the goal in the turn nearest to the start.
    ///
    /// # Errors
    /// What no planner can help: an end that is malformed, outside the limits or not free.
    pub fn ends(&mut self, problem: &PlanningProblem) -> Result<(Vec<f64>, Vec<f64>), NoPath> {
        let n = self.group.motors.len();
        let start = problem.start.clone();
        let goal = self.toward(&start, &problem.goal);
        for (end, given, q) in [(PathEnd::Start, &problem.start, &start), (PathEnd::Goal, &problem.goal, &goal)] {
            if n == 0 || given.len() != n || given.iter().any(|q| !q.is_finite()) {
                return Err(NoPath::Malformed(end));
            }
            if let Some(motor) = self.outside(q) {
                return Err(NoPath::Limits { end, motor });
            }
        }
        let verdicts = self.certify([(start.as_slice(), start.as_slice()), (goal.as_slice(), goal.as_slice())]);
        for (end, verdict) in [PathEnd::Start, PathEnd::Goal].into_iter().zip(verdicts) {
            match verdict {
                EdgeVerdict::Free => {}
                EdgeVerdict::Blocked(obstruction) => return Err(NoPath::Blocked { end, pair: obstruction.pair }),
                EdgeVerdict::Uncertified { .. } => return Err(NoPath::Blocked { end, pair: None }),
            }
        }
        Ok((start, goal))
    }
}

/// Whether a robot has part in a pair of shapes.
fn has_part(scene: &Scene, robot: usize) -> impl Fn(u32, u32) -> bool {
    let own = move |shape: u32| scene.shape_id(shape).and_then(|id| id.robot()) == Some(robot);
    move |a, b| own(a) || own(b)
}

/// Adds a pose of the whole scene: the group's share put in its columns.
fn whole(all: &mut Vec<f64>, rest: &[f64], columns: &[usize], pose: &[f64]) {
    let first = all.len();
    all.extend(rest);
    for (column, q) in columns.iter().zip(pose) {
        if let Some(slot) = all.get_mut(first + column) {
            *slot = *q;
        }
    }
}
