//! Compiles the robots of a scene to a program, to which objects are added (`objects.rs`).
//!
//! ```text
//! skeletons ──> frames ──┐                             groups of solids, balls, regions
//! colliders ─────────────┼──> pairs that can meet ──> steps, most decisive pairs first
//! ```

use crate::bound::{REFERENCE, U};
use crate::chain::{LaneFrame, follow};
use crate::levers::{Mover, Movers};
use crate::limits::constraints;
use crate::program::{Ball, Code, Program, SolidGroup};
use crate::proof::Proofs;
use crate::regions::{SubtreeRegion, branches, regions};
use crate::solids::{Sized, pair_test, single};
use crate::steps::StepLayout;
use crate::sweep::{Sphere, in_world, least_distance};
use mobee_model::{IndexPair, Scene};
use nalgebra::Isometry3;
use std::ops::Range;
use std::sync::Arc;

/// A program of robots, and the data for reordering its steps.
pub(crate) struct Compiled {
    pub program: Program,
    pub layout: StepLayout,
    /// Number of pairs that were omitted because they can never meet.
    pub pruned: usize,
    /// The moving things, and the frames as they were chosen.
    pub movers: Movers,
    /// Per solid of the program: the collider.
    pub order: Vec<usize>,
}

/// Facts about the robots of a scene, independent of the obstacles and of the pairs to test; for one clearance.
#[derive(Debug, Default)]
pub(crate) struct RobotFacts {
    /// The frames of the robots and the world.
    pub frames: Vec<LaneFrame>,
    /// The robots' solids, as in the scene.
    pub sized: Vec<Sized>,
    /// Per solid: a ball that contains it at every pose; world frame.
    pub swept: Vec<Sphere>,
    /// Sorted pairs of the robots' solids, each with a flag that is true if the pair can meet.
    meet: Vec<(IndexPair, bool)>,
}

impl RobotFacts {
    pub fn new(scene: &Scene) -> Self {
        let frames = frames(scene);
        let sized: Vec<Sized> =
            scene.colliders().take(scene.robot_colliders()).map(|c| Sized::new(c, &frames)).collect();
        let swept = sized.iter().map(|s| in_world(&frames, s.frame, s.ball())).collect();
        RobotFacts { frames, sized, swept, meet: Vec::new() }
    }

    /// True if a pair can meet; `None` if it is not stored.
    fn can_meet(&self, pair: IndexPair) -> Option<bool> {
        let at = self.meet.binary_search_by_key(&pair, |(pair, _)| *pair).ok()?;
        self.meet.get(at).map(|(_, meet)| *meet)
    }

    /// The pairs of the robots except those that are proved to stay apart.
    fn pairs_that_can_meet(&mut self, selected: &[IndexPair], clearance: f64) -> Vec<(usize, usize)> {
        // With a tolerance for the rounding of this computation and of the reference.
        let distance = clearance + REFERENCE;
        let mut proofs = Proofs::new(&self.frames, &self.sized, distance);
        let mut found = Vec::new();
        let mut pairs = Vec::new();
        for &pair in selected {
            let (p, q) = (pair.0 as usize, pair.1 as usize);
            let meet = self.can_meet(pair).unwrap_or_else(|| {
                let [a, b] = [p, q].map(|s| (self.sized[s].frame, self.sized[s].ball()));
                let meet = least_distance(&self.frames, a, b) <= distance && !proofs.apart(p, q);
                found.push((pair, meet));
                meet
            });
            pairs.extend(meet.then_some((p, q)));
        }
        if !found.is_empty() {
            self.meet.extend(found);
            self.meet.sort_unstable();
        }
        pairs
    }
}

/// Compiles some pairs of the robots of a scene for one clearance, meters. Missing facts are computed and added.
///
/// # Arguments
/// * `tested`: solids that are tested against objects, without these pairs.
pub(crate) fn compile(
    scene: &Scene,
    selected: &[IndexPair],
    tested: &[u32],
    clearance: f64,
    facts: &mut RobotFacts,
) -> Compiled {
    let pairs = facts.pairs_that_can_meet(selected, clearance);
    let (frames, sized) = (&facts.frames, &facts.sized);
    let mut used = vec![false; sized.len()];
    pairs.iter().for_each(|(a, b)| (used[*a], used[*b]) = (true, true));
    tested.iter().for_each(|s| used[*s as usize] = true);
    let mut order: Vec<usize> = (0..sized.len()).filter(|s| used[*s]).collect();
    order.sort_by_key(|s| sized[*s].frame);
    let groups = groups(&order, sized, frames);
    let regions = regions(frames, &groups, &order, sized, &pairs);
    let branches = branches(frames, &regions, &order, sized);
    let mut program = Program { frames: frames.len(), ..Program::default() };
    place_frames(&mut program, frames, &branches, &order, sized);
    constraints(&mut program, scene);
    place_solids(&mut program, &order, sized, &groups, frames);
    let mut layout = StepLayout::new(&groups, clearance);
    for range in &groups {
        let balls: Vec<Sphere> = order[range.clone()].iter().map(|s| sized[*s].ball()).collect();
        let frame = sized[order[range.start]].frame;
        let region = regions.iter().position(|r| r.has[frame]);
        add_ball(&mut program, &mut layout, frames, (frame, Sphere::around(&balls)), Some(region));
    }
    for region in &regions {
        add_ball(&mut program, &mut layout, frames, (region.root, region.ball), None);
    }
    for branch in &branches {
        add_ball(&mut program, &mut layout, frames, (branch.root, branch.ball), None);
        layout.add_branch(groups.iter().map(|g| branch.has[sized[order[g.start]].frame]));
    }
    list_balls(&mut program);
    let mut place = vec![0; sized.len()];
    order.iter().enumerate().for_each(|(i, s)| place[*s] = i);
    let sides: Vec<_> = sized.iter().map(Sized::side).collect();
    let tests = pairs.iter().map(|&(a, b)| {
        // Coarser tests use the general clearance, which is not lower.
        let clearance = scene.pair_clearance((a as u32, b as u32), clearance);
        pair_test((place[a], &sides[a]), (place[b], &sides[b]), clearance)
    });
    program.robots = Arc::new(Code { pairs: tests.collect(), ..Code::default() });
    layout.solids = order.iter().map(|s| sized[*s].size()).collect();
    layout.write(&mut program, &[]);
    let movers = movers(&mut program, facts, &groups, &order, regions.iter().chain(&branches));
    Compiled { program, layout, pruned: selected.len() - pairs.len(), movers, order }
}

/// The moving things of a program; also sets the extents of their cores.
fn movers<'a>(
    program: &mut Program,
    facts: &RobotFacts,
    groups: &[Range<usize>],
    order: &[usize],
    subtrees: impl Iterator<Item = &'a SubtreeRegion>,
) -> Movers {
    let sized = &facts.sized;
    let mut movers = Movers::new(facts.frames.clone());
    for range in groups {
        let solids: Vec<&Sized> = order[range.clone()].iter().map(|s| &sized[*s]).collect();
        let center = program.balls[movers.movers.len()].center.map(f64::from).into();
        let ends = solids.iter().flat_map(|s| s.ends()).chain([Sphere { center, radius: 0.0 }]).collect();
        movers.movers.push(Mover { frame: solids[0].frame, ends });
    }
    // A rotation about its center does not change a ball.
    movers.movers.extend(subtrees.map(|r| Mover { frame: r.root, ends: vec![Sphere { radius: 0.0, ..r.ball }] }));
    program.extents = vec![0.0; program.balls.len()];
    program.extents.extend(order.iter().map(|s| {
        let ends = sized[*s].ends();
        let far = |end: &Sphere| (end.center - sized[*s].pose.translation.vector).norm() + end.radius;
        (ends.iter().map(far).fold(0.0, f64::max) * (1.0 + 4.0 * U)) as f32
    }));
    movers.movers.extend(order.iter().map(|s| Mover { frame: sized[*s].frame, ends: sized[*s].ends() }));
    movers
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
        program.solids.push(solid.placed(program.axes));
        program.axes += if solid.is_box() { 3 } else { 1 };
    }
    program.robot_solids = program.solids.len();
    program.colliders = order.iter().map(|s| *s as u32).collect();
    for range in groups {
        let fixed = frames[sized[order[range.start]].frame].carried.is_none();
        program.groups.push(SolidGroup { solids: range.clone(), fixed });
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
