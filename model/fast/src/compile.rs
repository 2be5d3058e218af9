//! Compiles a scene to a program.
//!
//! ```text
//! skeletons ──> frames ──┐                             groups of solids, balls, regions
//! colliders ─────────────┼──> pairs that can meet ──> steps, most decisive pairs first
//! ```

use crate::bound::{REFERENCE, TESTS, U};
use crate::chain::{LaneFrame, follow};
use crate::levers::{Mover, Movers};
use crate::limits::constraints;
use crate::program::{Ball, BallAndBox, InnerCapsules, PairTest, Program, ProgramSolid, SolidForm, SolidGroup};
use crate::proof::Proofs;
use crate::regions::{SubtreeRegion, branches, regions};
use crate::steps::{BoundSizes, StepLayout};
use crate::sweep::{Sphere, in_world, least_distance};
use mobee_model::{Collider, IndexPair, InnerCapsule, Scene, Shape};
use nalgebra::{Isometry3, Point3, Vector3};
use std::ops::Range;

/// A program, and the data for reordering its steps.
pub(crate) struct Compiled {
    pub program: Program,
    pub layout: StepLayout,
    /// Number of pairs that were omitted because they can never meet.
    pub pruned: usize,
    /// The moving things, and the frames as they were chosen.
    pub movers: Movers,
}

/// A solid in its lane frame, with error bounds.
pub(crate) struct Sized {
    pub frame: usize,
    pub pose: Isometry3<f64>,
    pub shape: Shape,
    /// Bound of the displacement of any of its points by rounding, meters.
    error: f64,
    /// Error bound of its axes, spectral norm.
    turn: f64,
    /// True if only a hull within the shape is solid.
    hull: bool,
    /// A capsule inside the solid part.
    inner: InnerCapsule,
}

impl Sized {
    pub fn ball(&self) -> Sphere {
        Sphere { center: self.pose.translation.vector, radius: self.shape.bounding_radius() }
    }

    fn size(&self) -> BoundSizes {
        let capsule = self.shape.bounding_capsule();
        let ball = self.shape.bounding_radius();
        let turn = self.is_box().then_some(self.turn);
        BoundSizes { ball, half: capsule.half_axis.norm(), radius: capsule.radius, error: self.error, turn }
    }

    /// Balls that contain the extreme points of its core. For a shape with a hull they contain those of the shape,
    /// since a hull within a round shape moves when the shape rotates about its own axis.
    fn ends(&self) -> Vec<Sphere> {
        let at = |v: Vector3<f64>, radius: f64| Sphere { center: (self.pose * Point3::from(v)).coords, radius };
        let signs = [1.0, -1.0];
        let round = |radius: f64| if self.hull { radius } else { 0.0 };
        match self.shape {
            Shape::Sphere { radius } => vec![at(Vector3::zeros(), round(radius))],
            Shape::Capsule { radius, height } => {
                signs.map(|s| at(Vector3::y() * (s * height / 2.0), round(radius))).to_vec()
            }
            Shape::Cylinder { radius, height } => signs.map(|s| at(Vector3::y() * (s * height / 2.0), radius)).to_vec(),
            Shape::Box { size } => {
                let corner = |i: usize| Vector3::from_fn(|k, _| signs[(i >> k) & 1] * size[k] / 2.0);
                (0..8).map(|i| at(corner(i), 0.0)).collect()
            }
        }
    }
}

/// Maximum number of stored balls around groups.
const MAX_GROUP_BALLS: usize = 512;

/// Facts about the robots of a scene alone, independent of the obstacles; for one clearance.
#[derive(Clone, Debug, Default)]
pub(crate) struct RobotFacts {
    /// The frames of the robots and the world.
    frames: Vec<LaneFrame>,
    /// Sorted pairs of the robots' solids, each with a flag that is true if the pair can meet.
    pub pairs: Vec<(IndexPair, bool)>,
    /// Per solid of a robot: a ball that contains it at every pose; world frame.
    swept: Vec<Sphere>,
    /// Hands and fingers, with the robots' solids and pairs for which they were computed.
    hands: Option<Hands>,
    /// Balls around the groups of solids of the robots.
    group_balls: Vec<(Vec<usize>, Sphere)>,
    /// Of the pairs that can meet: the number of lanes that each decided when the order of tests was determined.
    pub decided: Vec<(IndexPair, u32)>,
}

/// Regions and their branches, with the data they depend on.
#[derive(Clone, Debug)]
struct Hands {
    order: Vec<usize>,
    pairs: Vec<(usize, usize)>,
    regions: Vec<SubtreeRegion>,
    branches: Vec<SubtreeRegion>,
}

impl RobotFacts {
    /// The hands and fingers of the robots; computed again if the solids or pairs differ from the stored ones.
    fn hands(
        &mut self,
        frames: &[LaneFrame],
        groups: &[Range<usize>],
        order: &[usize],
        sized: &[Sized],
        pairs: &[(usize, usize)],
    ) -> (Vec<SubtreeRegion>, Vec<SubtreeRegion>) {
        let robots = self.swept.len();
        let own_order: Vec<usize> = order.iter().copied().filter(|s| *s < robots).collect();
        let own_pairs: Vec<(usize, usize)> = pairs.iter().copied().filter(|(_, b)| *b < robots).collect();
        if let Some(known) = self.hands.as_ref().filter(|h| h.order == own_order && h.pairs == own_pairs) {
            return (known.regions.clone(), known.branches.clone());
        }
        let regions = regions(frames, groups, order, sized, pairs);
        let branches = branches(frames, &regions, order, sized);
        let found = (regions.clone(), branches.clone());
        self.hands = Some(Hands { order: own_order, pairs: own_pairs, regions, branches });
        found
    }

    /// The ball around the solids of a group, in the frame of the solids.
    fn group_ball(&mut self, solids: &[usize], sized: &[Sized]) -> Sphere {
        if let Some((_, ball)) = self.group_balls.iter().find(|(known, _)| known == solids) {
            return *ball;
        }
        let balls: Vec<Sphere> = solids.iter().map(|s| sized[*s].ball()).collect();
        let ball = Sphere::around(&balls);
        if solids.iter().all(|s| *s < self.swept.len()) {
            // Obstacles determine which solids can meet anything, so a group may have many variants over time.
            if self.group_balls.len() >= MAX_GROUP_BALLS {
                self.group_balls.clear();
            }
            self.group_balls.push((solids.to_vec(), ball));
        }
        ball
    }

    /// True if a pair can meet; `None` if it is not stored.
    fn can_meet(&self, pair: IndexPair) -> Option<bool> {
        let at = self.pairs.binary_search_by_key(&pair, |(pair, _)| *pair).ok()?;
        self.pairs.get(at).map(|(_, meet)| *meet)
    }

    /// The number of lanes that a pair decided; `None` if it is not stored.
    pub fn decided(&self, pair: IndexPair) -> Option<u32> {
        let at = self.decided.binary_search_by_key(&pair, |(pair, _)| *pair).ok()?;
        self.decided.get(at).map(|(_, lanes)| *lanes)
    }
}

/// Compiles some pairs of a scene for one clearance, meters. Missing facts are computed and added.
pub(crate) fn compile(scene: &Scene, selected: &[IndexPair], clearance: f64, facts: &mut RobotFacts) -> Compiled {
    if facts.frames.is_empty() {
        facts.frames = frames(scene);
    }
    let frames = facts.frames.clone();
    let colliders: Vec<&Collider> = scene.colliders().collect();
    let sized: Vec<Sized> = colliders.iter().map(|c| sized(c, &frames)).collect();
    let (pairs, pruned) = pairs_that_can_meet(selected, &sized, &frames, clearance, facts);
    let mut used = vec![false; sized.len()];
    pairs.iter().for_each(|(a, b)| (used[*a], used[*b]) = (true, true));
    let mut order: Vec<usize> = (0..sized.len()).filter(|s| used[*s]).collect();
    order.sort_by_key(|s| sized[*s].frame);
    let groups = groups(&order, &sized, &frames);
    let (regions, branches) = facts.hands(&frames, &groups, &order, &sized, &pairs);
    let mut program = Program { frames: frames.len(), ..Program::default() };
    place_frames(&mut program, &frames, &branches, &order, &sized);
    constraints(&mut program, scene);
    place_solids(&mut program, &order, &sized, &groups, &frames);
    let mut layout = StepLayout::new(&groups, clearance);
    for range in &groups {
        let ball = facts.group_ball(&order[range.clone()], &sized);
        let frame = sized[order[range.start]].frame;
        let region = regions.iter().position(|r| r.has[frame]);
        add_ball(&mut program, &mut layout, &frames, (frame, ball), Some(region));
    }
    for region in &regions {
        add_ball(&mut program, &mut layout, &frames, (region.root, region.ball), None);
    }
    for branch in &branches {
        add_ball(&mut program, &mut layout, &frames, (branch.root, branch.ball), None);
        layout.add_branch(groups.iter().map(|g| branch.has[sized[order[g.start]].frame]));
    }
    list_balls(&mut program);
    let mut place = vec![0; sized.len()];
    order.iter().enumerate().for_each(|(i, s)| place[*s] = i);
    for &(a, b) in &pairs {
        let ids = (a as u32, b as u32);
        // Coarser tests use the general clearance, which is not lower.
        let clearance = scene.pair_clearance(ids, clearance);
        let test = pair_test((place[a], &sized[a]), (place[b], &sized[b]), ids, clearance);
        program.pairs.push(test);
    }
    layout.solids = order.iter().map(|s| sized[*s].size()).collect();
    layout.write(&mut program, &[]);
    let mut movers = Movers::new(frames);
    for range in &groups {
        let solids: Vec<&Sized> = order[range.clone()].iter().map(|s| &sized[*s]).collect();
        let center = program.balls[movers.movers.len()].center.map(f64::from).into();
        let ends = solids.iter().flat_map(|s| s.ends()).chain([Sphere { center, radius: 0.0 }]).collect();
        movers.movers.push(Mover { frame: solids[0].frame, ends });
    }
    // A rotation about its center does not change a ball.
    movers.movers.extend(
        regions.iter().chain(&branches).map(|r| Mover { frame: r.root, ends: vec![Sphere { radius: 0.0, ..r.ball }] }),
    );
    program.extents = vec![0.0; program.balls.len()];
    program.extents.extend(order.iter().map(|s| {
        let ends = sized[*s].ends();
        let far = |end: &Sphere| (end.center - sized[*s].pose.translation.vector).norm() + end.radius;
        (ends.iter().map(far).fold(0.0, f64::max) * (1.0 + 4.0 * U)) as f32
    }));
    movers.movers.extend(order.iter().map(|s| Mover { frame: sized[*s].frame, ends: sized[*s].ends() }));
    Compiled { program, layout, pruned, movers }
}

/// The frames of all robots and the world, numbered as in the scene.
fn frames(scene: &Scene) -> Vec<LaneFrame> {
    let mut frames = Vec::new();
    let mut motors = 0;
    for (skeleton, robot) in scene.skeletons().iter().zip(scene.robots()) {
        follow(skeleton, motors, &mut frames);
        motors += robot.motors.len();
    }
    frames.push(LaneFrame::world());
    frames
}

fn sized(collider: &Collider, frames: &[LaneFrame]) -> Sized {
    let frame = &frames[collider.frame];
    let pose = frame.choice.inverse() * collider.pose;
    let error = frame.bound.solid(pose.translation.vector.norm(), collider.shape.bounding_radius());
    let hull = collider.hull().is_some();
    let inner = collider.inner_capsule();
    Sized { frame: collider.frame, pose, shape: collider.shape, error, turn: frame.bound.axes(), hull, inner }
}

/// The pairs except those that are proved to stay apart, and the number of the latter.
fn pairs_that_can_meet(
    selected: &[IndexPair],
    sized: &[Sized],
    frames: &[LaneFrame],
    clearance: f64,
    facts: &mut RobotFacts,
) -> (Vec<(usize, usize)>, usize) {
    // With a tolerance for the rounding of this computation and of the reference.
    let distance = clearance + REFERENCE;
    // Obstacles come last, on the frame of the world.
    let world = frames.len() - 1;
    let robots = sized.iter().position(|s| s.frame == world).unwrap_or(sized.len());
    if facts.swept.len() != robots {
        facts.swept = sized[..robots].iter().map(|s| in_world(frames, s.frame, s.ball())).collect();
    }
    let obstacles: Vec<Sphere> = sized[robots..].iter().map(|s| in_world(frames, s.frame, s.ball())).collect();
    let mut proofs = Proofs::new(frames, sized, distance);
    let mut found = Vec::new();
    let mut pairs = Vec::new();
    for &pair in selected {
        let p = pair.0 as usize;
        let q = pair.1 as usize;
        let a = &sized[p];
        let b = &sized[q];
        let obstacle = q.checked_sub(robots).and_then(|o| obstacles.get(o));
        let meet = if let (Some(swept), Some(obstacle)) = (facts.swept.get(p), obstacle) {
            (swept.center - obstacle.center).norm() - swept.radius - obstacle.radius <= distance
        } else if let Some(known) = facts.can_meet(pair) {
            known
        } else {
            let meet =
                least_distance(frames, (a.frame, a.ball()), (b.frame, b.ball())) <= distance && !proofs.apart(p, q);
            found.push((pair, meet));
            meet
        };
        if meet {
            pairs.push((p, q));
        }
    }
    if !found.is_empty() {
        facts.pairs.extend(found);
        facts.pairs.sort_unstable();
    }
    let pruned = selected.len() - pairs.len();
    (pairs, pruned)
}

/// Ranges of `order` (solids sorted by frame): the solids of one moving frame form a group; each fixed solid is a group
/// of its own, since these may be anywhere.
fn groups(order: &[usize], sized: &[Sized], frames: &[LaneFrame]) -> Vec<Range<usize>> {
    let mut groups: Vec<Range<usize>> = Vec::new();
    for (i, s) in order.iter().enumerate() {
        let frame = sized[*s].frame;
        match groups.last_mut() {
            Some(last) if sized[order[last.start]].frame == frame && frames[frame].carried.is_some() => {
                last.end = i + 1
            }
            _ => groups.push(i..i + 1),
        }
    }
    groups
}

/// Adds the joints that carry solids: first those that are always placed, then branch by branch.
fn place_frames(
    program: &mut Program,
    frames: &[LaneFrame],
    branches: &[SubtreeRegion],
    order: &[usize],
    sized: &[Sized],
) {
    let mut live = vec![false; frames.len()];
    for s in order {
        live[sized[*s].frame] = true;
    }
    for (f, frame) in frames.iter().enumerate().rev() {
        match &frame.carried {
            Some(carried) => live[carried.parent] |= live[f],
            None => program.fixed_frames.push((f, columns(&frame.fixed))),
        }
    }
    let region = |f: usize| branches.iter().position(|b| b.has[f]).map_or(0, |b| b + 1);
    for r in 0..=branches.len() {
        let first = program.joints.len();
        let own = frames.iter().enumerate().filter(|(f, _)| live[*f] && region(*f) == r);
        program.joints.extend(own.filter_map(|(_, frame)| frame.carried.as_ref()).map(|c| c.joint.clone()));
        program.regions.push(first..program.joints.len());
    }
}

/// The axes x, y, z and the origin of a pose.
fn columns(pose: &Isometry3<f64>) -> [f32; 12] {
    let numbers = pose.to_homogeneous();
    std::array::from_fn(|i| numbers[(i % 3, i / 3)] as f32)
}

fn place_solids(
    program: &mut Program,
    order: &[usize],
    sized: &[Sized],
    groups: &[Range<usize>],
    frames: &[LaneFrame],
) {
    for solid in order.iter().map(|s| &sized[*s]) {
        let (axes, form) = form(&solid.shape, inset(solid));
        let axes: Vec<[f32; 3]> = axes.iter().map(|axis| single(&(solid.pose.rotation * axis))).collect();
        let first_axis = program.axes;
        program.axes += axes.len();
        let center = single(&solid.pose.translation.vector);
        program.solids.push(ProgramSolid { frame: solid.frame, center, axes, first_axis, form });
    }
    for range in groups {
        let fixed = frames[sized[order[range.start]].frame].carried.is_none();
        program.groups.push(SolidGroup { solids: range.clone(), fixed });
    }
}

fn single(v: &Vector3<f64>) -> [f32; 3] {
    v.map(|x| x as f32).into()
}

/// Difference in size between a shape and its core, meters: larger than any rounding error, so that intersecting cores
/// prove an overlap, but at most half of the shape's smallest half extent.
fn inset(solid: &Sized) -> f64 {
    let thin = match solid.shape {
        Shape::Sphere { .. } | Shape::Capsule { .. } => return 0.0,
        Shape::Cylinder { radius, height } => radius.min(height / 2.0),
        Shape::Box { size } => size.min() / 2.0,
    };
    (4.0 * (solid.error + REFERENCE)).min(thin / 2.0)
}

/// Axes and sizes of a shape.
fn form(shape: &Shape, inset: f64) -> (Vec<Vector3<f64>>, SolidForm) {
    let y = vec![Vector3::y()];
    match *shape {
        Shape::Sphere { radius } => (y, SolidForm::Round { half: 0.0, radius: radius as f32 }),
        Shape::Capsule { radius, height } => {
            (y, SolidForm::Round { half: (height / 2.0) as f32, radius: radius as f32 })
        }
        Shape::Cylinder { radius, height } => {
            (y, SolidForm::Cylinder { half: (height / 2.0) as f32, radius: radius as f32, inset: inset as f32 })
        }
        Shape::Box { size } => {
            let long = size.imax();
            let order = [long, (long + 1) % 3, (long + 2) % 3];
            let axes = order.map(|i| Vector3::ith(i, 1.0)).to_vec();
            (axes, SolidForm::Box { half: order.map(|i| (size[i] / 2.0) as f32), inset: inset as f32 })
        }
    }
}

fn add_ball(
    program: &mut Program,
    layout: &mut StepLayout,
    frames: &[LaneFrame],
    (frame, ball): (usize, Sphere),
    group: Option<Option<usize>>,
) {
    program.balls.push(Ball { frame, center: single(&ball.center) });
    let error = frames[frame].bound.solid(ball.center.norm(), 0.0);
    layout.add_ball(ball.radius, error, group);
}

/// Lists the balls of each frame.
fn list_balls(program: &mut Program) {
    program.ball_order = (0..program.balls.len()).collect();
    program.ball_order.sort_by_key(|b| program.balls[*b].frame);
    let frame = |b: &usize| program.balls[*b].frame;
    program.frame_balls = (0..program.frames)
        .map(|f| {
            let order = &program.ball_order;
            order.partition_point(|b| frame(b) < f)..order.partition_point(|b| frame(b) <= f)
        })
        .collect();
}

/// Computes the thresholds of a pair.
fn pair_test(a: (usize, &Sized), b: (usize, &Sized), ids: (u32, u32), clearance: f64) -> PairTest {
    let [(left, x), (right, y)] = [a, b];
    let round = [x, y].map(|s| matches!(s.shape, Shape::Sphere { .. } | Shape::Capsule { .. }));
    let is_round = round[0] && round[1];
    let balls = x.ball().radius + y.ball().radius;
    let band = x.error + y.error + TESTS * (balls + clearance) + if is_round { 1e-9 } else { REFERENCE };
    let capsules = [x, y].map(|s| s.shape.bounding_capsule());
    let radii: f64 = capsules.iter().map(|c| c.radius).sum();
    // Depth of the cores of `distance.rs` inside their shapes.
    let inside: f64 =
        [x, y].map(|s| if s.is_round() { s.shape.bounding_capsule().radius } else { inset(s) }).iter().sum();
    let round_radii: f64 =
        [x, y].map(|s| if s.is_round() { s.shape.bounding_capsule().radius } else { 0.0 }).iter().sum();
    let up = |x: f64| (x * (1.0 + 4.0 * U)) as f32;
    let ball_and_box = ((x.is_ball() && y.is_box()) || (x.is_box() && y.is_ball())) && !x.hull && !y.hull;
    // The ball's center may be farther from the box than the box's own size.
    let turn = if x.is_box() { x.turn } else { y.turn };
    let measured = band + turn * (balls + clearance);
    PairTest {
        a: left,
        b: right,
        ids,
        ball_squared: up((balls + clearance + band).powi(2)),
        half: capsules.map(|c| c.half_axis.norm() as f32),
        outer: up(radii + clearance + band),
        inner: ((inside + clearance - band) * (1.0 - 4.0 * U)) as f32,
        apart: up(round_radii + clearance + band),
        round: is_round,
        ball_and_box: ball_and_box.then(|| BallAndBox {
            inner: ((round_radii + clearance - measured) * (1.0 - 4.0 * U)) as f32,
            apart: up(round_radii + clearance + measured),
        }),
        held: (x.hull || y.hull).then(|| InnerCapsules {
            half: [0, 1].map(|i| ([x, y][i].inner.share * capsules[i].half_axis.norm()) as f32),
            inner: ((x.inner.radius + y.inner.radius + clearance - band) * (1.0 - 4.0 * U)) as f32,
        }),
    }
}

impl Sized {
    fn is_round(&self) -> bool {
        matches!(self.shape, Shape::Sphere { .. } | Shape::Capsule { .. })
    }

    fn is_box(&self) -> bool {
        matches!(self.shape, Shape::Box { .. })
    }

    fn is_ball(&self) -> bool {
        matches!(self.shape, Shape::Sphere { .. })
    }
}
