//! The flat program that a scene is compiled to: data only, interpreted by `kernel.rs`.
//!
//! The lanes use `f32`; joint positions are computed in `f64` up to sine and cosine.

use mobee_model::IndexPair;
use std::ops::Range;
use std::sync::Arc;

/// A compiled scene, for one clearance. What the robots need comes first in each list; an object adds a solid and code
/// of its own, and is on the world's frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Program {
    /// Per motor of the scene, robot after robot: its limits, rad of encoder.
    pub limits: Vec<(f64, f64)>,
    /// Constraints that poses must satisfy.
    pub clauses: Arc<[FlatClause]>,
    /// Fixed frames: rows of the rotation's columns, then the origin.
    pub fixed_frames: Vec<(usize, [f32; 12])>,
    /// Number of frames.
    pub frames: usize,
    /// Moving joints, region by region; a joint follows the one that carries it.
    pub joints: Vec<Joint>,
    /// The joints of each region. The first region is placed at every pose, the others, fingers, on demand.
    pub regions: Vec<Range<usize>>,
    /// The robots' solids, group by group, then one per shape of an object; some of the latter may be unused.
    pub solids: Vec<ProgramSolid>,
    /// Number of the robots' solids.
    pub robot_solids: usize,
    /// Per solid: its index for the reference.
    pub colliders: Vec<u32>,
    /// The robots' solids on one frame, enclosed by one ball.
    pub groups: Vec<SolidGroup>,
    /// Balls: one per group, then one per hand, then one per finger.
    pub balls: Vec<Ball>,
    /// Indices of balls sorted by frame; `frame_balls[f]` is a range of it.
    pub ball_order: Vec<usize>,
    /// Per frame: its range in `ball_order`.
    pub frame_balls: Vec<Range<usize>>,
    /// Number of rows of three for axes of solids.
    pub axes: usize,
    /// Steps of the robots' units.
    pub robots: Arc<Code>,
    /// Steps of the objects' units; some may be unused.
    pub objects: Code,
    /// Tests at every pose, in order: two units, with the steps to execute if they are near.
    pub units: Vec<UnitTest>,
    /// Positions in `units` at which a block may stop, so that the few remaining lanes continue with those of other
    /// blocks; the first is 0, the last the number of units.
    pub cuts: Vec<usize>,
    /// Per unit test: its place in the order.
    pub unit_keys: Vec<UnitKey>,
    /// Motion bounds: sums of levers times motors' steps. The first is empty, for fixed things.
    pub sums: Vec<Range<usize>>,
    /// The levers of the `sums`.
    pub levers: Vec<MotorLever>,
    /// Per unit test: relative motion of the two units.
    pub unit_motions: Vec<Relative>,
    /// Per ball (zero, since rotation does not change a ball) and solid: extent of its core from its center, meters.
    pub extents: Vec<f32>,
    /// Per motor: upper bound of any relative motion, meters per rad of encoder.
    pub reach: Vec<f64>,
    /// Per motor: error bound of a velocity in the lanes, meters per rad of encoder.
    pub slips: Vec<f32>,
}

/// Steps of some units, and the pairs that they test.
#[derive(Clone, Debug, Default)]
pub(crate) struct Code {
    /// Pairs that the steps test.
    pub pairs: Vec<PairTest>,
    /// The steps, unit by unit.
    pub steps: Vec<Step>,
    /// Per step: relative motion of the two things it compares, if any.
    pub motions: Vec<Relative>,
}

impl Program {
    /// The code of a unit, and the number of its first pair: those of the robots are numbered first.
    #[inline(always)]
    pub fn code(&self, is_object: bool) -> (&Code, usize) {
        if is_object { (&self.objects, self.robots.pairs.len()) } else { (&self.robots, 0) }
    }

    /// Number of pairs, unused ones included.
    pub fn pairs(&self) -> usize {
        self.robots.pairs.len() + self.objects.pairs.len()
    }

    /// The indices of a pair for the reference.
    pub fn ids(&self, pair: usize) -> IndexPair {
        let (code, first) = self.code(pair >= self.robots.pairs.len());
        self.ids_of(&code.pairs[pair - first])
    }

    fn ids_of(&self, pair: &PairTest) -> IndexPair {
        (self.colliders[pair.a as usize], self.colliders[pair.b as usize])
    }

    /// All pairs that the units test, by their indices for the reference.
    pub fn tested_pairs(&self) -> impl Iterator<Item = IndexPair> {
        self.units.iter().flat_map(|unit| {
            let (code, _) = self.code(unit.is_object);
            code.steps[unit.steps.clone()].iter().filter_map(|step| match step {
                Step::Pair(pair) => Some(self.ids_of(&code.pairs[*pair])),
                _ => None,
            })
        })
    }
}

/// Place of a unit in the order of tests: the most decisive first, then in an order that depends on the scene alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct UnitKey {
    /// Decided lanes relative to the cost.
    pub score: std::cmp::Reverse<u32>,
    /// The object and its shape, `None` for units of the robots.
    pub object: Option<(u32, u16)>,
    /// Number among the units of the robots, or of the object.
    pub number: u32,
}

/// Contribution of one joint to a sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MotorLever {
    pub motor: usize,
    /// Meters per rad of encoder.
    pub reach: f32,
    /// Radians per rad of encoder; zero for a prismatic joint.
    pub turn: f32,
}

/// Relative motion of two things: a sum of levers each, up to the frame that carries both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Relative {
    pub sums: [u32; 2],
    /// The frame that carries both, or a fixed one.
    pub common: u32,
}

/// Test of two units (hands, links, objects) by their balls.
#[derive(Clone, Debug)]
pub(crate) struct UnitTest {
    /// Centers: balls, then solids.
    pub a: usize,
    pub b: usize,
    pub within_squared: f32,
    /// True if the second is an object: then the steps are those of the objects.
    pub is_object: bool,
    /// The steps to execute if they are near in any lane.
    pub steps: Range<usize>,
}

/// A joint, and the frame that it carries: `parent · shift · rotation about z · rotation about x`, then the motion.
///
/// Frames are chosen so that every hinge rotates about its own z, and z and x rotations by zero cost nothing: Denavit
/// and Hartenberg's convention, found by the compiler.
#[derive(Clone, Debug)]
pub(crate) struct Joint {
    pub frame: usize,
    pub parent: usize,
    pub motor: usize,
    /// The motor's lower limit, rad of encoder.
    pub low: f64,
    /// The joint's position there, rad or meters.
    pub start: f64,
    /// Radians or meters per rad of encoder.
    pub gain: f64,
    /// Translation in the parent's frame, meters.
    pub shift: [f32; 3],
    pub motion: Motion,
}

#[derive(Clone, Debug)]
pub(crate) enum Motion {
    /// Rotation about z, after two constant rotations.
    Turn { about_z: Bend, about_x: Bend },
    /// Translation along a direction of the parent's frame, with unchanged axes.
    Slide { along: [f32; 3] },
}

/// A constant rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Bend {
    None,
    /// By a right angle: exact, and only a renaming of axes.
    Quarter,
    By {
        cosine: f32,
        sine: f32,
    },
}

/// A convex shape: all points within `radius` of a core. Its center and axes are placed together.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProgramSolid {
    pub frame: usize,
    /// Center in the frame.
    pub center: [f32; 3],
    /// Unit axes in the frame (the first one only, or all three of a box, the longest edge first), and the index of
    /// their first row.
    pub axes: [[f32; 3]; 3],
    pub first_axis: usize,
    pub form: SolidForm,
}

/// Sizes of a solid, meters. Round shapes are exact; the cores of the others are smaller than the shapes by `inset` on
/// all sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SolidForm {
    /// Ball (`half` = 0) or capsule.
    Round { half: f32, radius: f32 },
    /// Flat-ended cylinder.
    Cylinder { half: f32, radius: f32, inset: f32 },
    /// Half edges.
    Box { half: [f32; 3], inset: f32 },
}

impl ProgramSolid {
    /// The axes that the tests need.
    pub fn used_axes(&self) -> &[[f32; 3]] {
        &self.axes[..if matches!(self.form, SolidForm::Box { .. }) { 3 } else { 1 }]
    }
}

#[derive(Clone, Debug)]
pub(crate) struct SolidGroup {
    pub solids: Range<usize>,
    /// True if no motor moves it, so that it is placed once.
    pub fixed: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct Ball {
    pub frame: usize,
    /// Center in the frame.
    pub center: [f32; 3],
}

/// A half-space clause: violated if no member is above zero.
#[derive(Clone, Debug)]
pub(crate) struct FlatClause {
    /// Per member: (motor of the scene, units per rad of encoder), and the constant.
    pub members: Vec<(Vec<(usize, f64)>, f64)>,
    /// The reference decides if the value is closer to zero than this.
    pub doubt: f64,
}

/// Two solids (an object is the second), and the thresholds for their test, meters (squared if named so).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PairTest {
    pub a: u32,
    pub b: u32,
    /// Free if the centers are farther apart than this.
    pub ball_squared: f32,
    /// Half lengths of the axes of their bounding capsules.
    pub half: [f32; 2],
    /// Free if the axes of these capsules are farther apart than this.
    pub outer: f32,
    /// Not free if the cores are closer than this.
    pub inner: f32,
    /// Free if the supports are apart by more than this.
    pub apart: f32,
    /// True if the capsules are the shapes themselves.
    pub round: bool,
    /// Thresholds if one is a ball and the other a box, both without hulls: their distance has a closed form.
    pub ball_and_box: Option<BallAndBox>,
    /// Inner capsules, if only a hull of either shape is solid.
    pub held: Option<InnerCapsules>,
}

/// Thresholds for the distance of a ball's center and a box, meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BallAndBox {
    /// Not free if closer than this.
    pub inner: f32,
    /// Free if farther than this.
    pub apart: f32,
}

/// Capsules inside two solids, on the axes of their bounding capsules: if these are near, the solids touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct InnerCapsules {
    /// Half lengths of their axes, meters.
    pub half: [f32; 2],
    /// Not free if the axes are closer than this, meters.
    pub inner: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Step {
    /// If two centers (balls, then solids) are farther apart than the threshold in every live lane: jumps to step
    /// `skip`.
    Near { a: u32, b: u32, within_squared: f32, skip: u32 },
    /// As `Near`, for a ball's center and a box, or the axis (of half length `half`) of a solid's capsule.
    Beside { ball: u32, of: u32, half: f32, within_squared: f32, skip: u32 },
    /// Places a region, unless it is placed.
    Region(usize),
    /// Places the solids of a group, unless they are placed.
    Group(usize),
    /// Tests a pair of the same code.
    Pair(usize),
}
