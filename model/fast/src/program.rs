//! The flat program that a scene is compiled into: data alone, interpreted by `kernel.rs`.
//!
//! Numbers that the lanes use are `f32`; joint positions are computed in `f64` up to sine and cosine.

use mobee_model::IndexPair;
use std::ops::Range;

/// A scene, for one clearance.
#[derive(Clone, Debug, Default)]
pub(crate) struct Program {
    /// Per motor of the scene, robot after robot: its limits, rad of encoder.
    pub limits: Vec<(f64, f64)>,
    /// What poses must satisfy.
    pub clauses: Vec<FlatClause>,
    /// Frames that nothing moves: rows of the rotation's columns, then the origin.
    pub fixed_frames: Vec<(usize, [f32; 12])>,
    /// Number of frames.
    pub frames: usize,
    /// Moving joints, region by region; a joint stands after the one that carries it.
    pub joints: Vec<Joint>,
    /// The joints of each region. The first is placed at every pose, the others, fingers, once they are asked for.
    pub regions: Vec<Range<usize>>,
    /// All solids, group by group.
    pub solids: Vec<Solid>,
    /// Solids on one frame, under one ball.
    pub groups: Vec<Group>,
    /// Balls: one per group, then one per hand, then one per finger.
    pub balls: Vec<Ball>,
    /// Indices of balls by the frame that they are on, `frame_balls[f]` being a range of it.
    pub ball_order: Vec<usize>,
    /// See `ball_order`.
    pub frame_balls: Vec<Range<usize>>,
    /// Number of rows of three for axes of solids.
    pub axes: usize,
    /// Pairs that steps test.
    pub pairs: Vec<PairTest>,
    /// What is asked at every pose, in order: whether two whole units are near, and if so what to do.
    pub units: Vec<UnitTest>,
    /// Where in `units` a block may stop, so that the few lanes left go on with those of other blocks: from none of
    /// them to all.
    pub cuts: Vec<usize>,
    /// What to do, unit by unit.
    pub steps: Vec<Step>,
    /// How far things move: sums of levers times motors' steps. The first is empty: what stands still.
    pub sums: Vec<Range<usize>>,
    /// See `sums`.
    pub levers: Vec<Lever>,
    /// Per unit: how the two move against each other.
    pub unit_motions: Vec<Relative>,
    /// The same per step, for those that compare two things.
    pub step_motions: Vec<Relative>,
    /// Per ball (zero: a ball that turns is the same) and solid: how far its core is from its center, meters.
    pub extents: Vec<f32>,
    /// Per motor: how far anything moves against anything at most, meters per rad of encoder.
    pub reach: Vec<f64>,
    /// Per motor: how wrong a velocity can be in the lanes, meters per rad of encoder.
    pub slips: Vec<f32>,
}

/// What one joint adds to a sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lever {
    pub motor: usize,
    /// Meters per rad of encoder.
    pub reach: f32,
    /// Radians per rad of encoder; none for a slide.
    pub turn: f32,
}

/// How two things move against each other: a sum of levers each, up to the frame that carries both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Relative {
    pub sums: [u32; 2],
    /// That frame, or one that does not move.
    pub common: u32,
}

/// Two units (hands, links, objects) by their balls.
#[derive(Clone, Debug)]
pub(crate) struct UnitTest {
    pub a: usize,
    pub b: usize,
    pub within_squared: f32,
    /// The steps to take if they are near in any lane.
    pub steps: Range<usize>,
}

/// A joint, and the frame that it carries: `parent · shift · turn about z · turn about x`, then the motion.
///
/// Frames are chosen so that every hinge turns about its own z, and z and x turns that are none cost nothing: Denavit
/// and Hartenberg's choice, found by the compiler.
#[derive(Clone, Debug)]
pub(crate) struct Joint {
    pub frame: usize,
    pub parent: usize,
    pub motor: usize,
    /// The motor's lower limit, rad of encoder.
    pub low: f64,
    /// Where the joint stands there, rad or meters.
    pub start: f64,
    /// Radians or meters per rad of encoder.
    pub gain: f64,
    /// In the parent's frame, meters.
    pub shift: [f32; 3],
    pub motion: Motion,
}

#[derive(Clone, Debug)]
pub(crate) enum Motion {
    /// About z, after two constant turns.
    Turn { about_z: Bend, about_x: Bend },
    /// Along a direction of the parent's frame, whose axes it keeps.
    Slide { along: [f32; 3] },
}

/// A constant turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Bend {
    None,
    /// By a right angle: exact, and only a renaming.
    Quarter,
    By {
        cosine: f32,
        sine: f32,
    },
}

/// A convex shape: the part of space within `radius` of a core. Its center and axes are placed together.
#[derive(Clone, Debug)]
pub(crate) struct Solid {
    pub frame: usize,
    /// In the frame.
    pub center: [f32; 3],
    /// Unit axes in the frame, and where their rows begin: one, or three for a box (the longest edge first).
    pub axes: Vec<[f32; 3]>,
    pub first_axis: usize,
    pub form: Form,
}

/// Sizes of a solid, meters. Round shapes are exact; the others have a core that is smaller than they are by
/// `Form::inset` all around.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Form {
    /// Ball (`half` = 0) or capsule.
    Round { half: f32, radius: f32 },
    /// Flat-ended.
    Cylinder { half: f32, radius: f32, inset: f32 },
    /// Half edges.
    Box { half: [f32; 3], inset: f32 },
}

#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub solids: Range<usize>,
    /// Whether nothing moves it, so that it is placed once and for all.
    pub fixed: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct Ball {
    pub frame: usize,
    /// In the frame.
    pub center: [f32; 3],
}

/// A half-space clause: violated where no member is above zero.
#[derive(Clone, Debug)]
pub(crate) struct FlatClause {
    /// Per member: (motor of the scene, units per rad of encoder), and the constant.
    pub members: Vec<(Vec<(usize, f64)>, f64)>,
    /// Nearer to zero than this the reference decides.
    pub doubt: f64,
}

/// Two solids, and the numbers that decide about them, meters (squared where they are named so).
#[derive(Clone, Debug)]
pub(crate) struct PairTest {
    pub a: usize,
    pub b: usize,
    /// Who they are to the reference.
    pub ids: IndexPair,
    /// Centers farther apart than this: free.
    pub ball_squared: f32,
    /// Half lengths of the axes of the capsules that hold them.
    pub half: [f32; 2],
    /// Axes of these capsules farther apart than this: free.
    pub outer: f32,
    /// Cores nearer than this: not free.
    pub inner: f32,
    /// Supports apart by more than this: free.
    pub apart: f32,
    /// Whether the capsules are the shapes themselves.
    pub round: bool,
    /// If one is a ball and the other a box, both without hulls: their distance has a closed form.
    pub ball_and_box: Option<BallAndBox>,
    /// If of a shape only its hull is solid: what is known to be solid of both.
    pub held: Option<Held>,
}

/// Thresholds for the distance of a ball's center and a box, meters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BallAndBox {
    /// Nearer than this: not free.
    pub inner: f32,
    /// Farther than this: free.
    pub apart: f32,
}

/// Capsules within two solids, on the axes of those that hold them: near ones prove a contact.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Held {
    /// Half lengths of their axes, meters.
    pub half: [f32; 2],
    /// Axes nearer than this: not free. Meters.
    pub inner: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Step {
    /// If two centers (balls, then solids) are farther apart than this in every lane that counts: on to step `skip`.
    Near { a: u32, b: u32, within_squared: f32, skip: u32 },
    /// The same of a ball's center and the axis of a solid's capsule, up to this half length, or a box itself.
    Beside { ball: u32, of: u32, half: f32, within_squared: f32, skip: u32 },
    /// Place a region, unless it is.
    Region(usize),
    /// Place the solids of a group, unless they are.
    Group(usize),
    /// Test a pair.
    Pair(usize),
}
