//! Collision tests of many poses at once for planners, sixteen poses at a time.
//!
//! [`FastScene`] compiles a scene once, for one clearance, into a flat program of joints and tests, and runs sixteen
//! poses through it together: one pose per lane of the processor's vector registers.
//!
//! # The promise
//! **Verdicts equal those of the scalar engine** ([`mobee_model::Scene::free`]). The lanes compute in `f32`, but decide
//! only what is beyond doubt; if rounding could decide a pair, the scalar engine is called for it.
//!
//! **Edges are proved** ([`FastScene::certify`]): a straight line that is certified free is free at every pose, not
//! only at samples. If it is blocked, the scalar engine agrees.
//!
//! # Method
//! ```text
//! poses ──> angles ──f64──> sine, cosine ──f32──> frames ──> balls ──near──> shapes ──near──> two shapes
//!                                                     touching | free | in doubt ──> scalar engine
//! ```
//! * **Blocks** (`clauses.rs`, `fast.rs`): constraints are tested before anything is placed, and poses that violate one
//!   occupy no lane. If few lanes of a block are left at a cut of the program, they continue together with those of
//!   other blocks.
//! * **Kinematics** (`chain.rs`): constant transforms are folded. Each frame is chosen so that its hinge rotates about
//!   z and most constant rotations vanish or are right angles.
//! * **Pairs** (`sweep.rs`, `proof.rs`): a pair is dropped if the balls that contain its shapes *at every pose within
//!   the limits* are apart, or, with few joints between the two, those for each part of the limits: a proof, not a
//!   sample.
//! * **Balls** (`steps.rs`, `write.rs`): two hands, two links, then two shapes are tested only if their balls meet in a
//!   lane. A finger is not even placed unless the ball that contains it, in the hand's frame, is near something. The
//!   tests that decided most often in a seeded sample, relative to their cost, come first.
//! * **Objects** (`robots.rs`, `objects.rs`): the robots are compiled once. Each shape of an object adds units of its
//!   own, rated by the unit's positions at sample poses; a changed object replaces only these.
//! * **Two shapes** (`distance.rs`): capsules and balls by the closed form of two segments; cylinders and boxes by
//!   alternating projections. Each result is *verified*: two near points prove a contact, a separating direction
//!   disproves it. For a hull the surrounding shape and an inner capsule are tested; the cases between are in
//!   doubt.
//! * **Rounding** (`bound.rs`): a worst-case bound is propagated along each chain during compilation, and included in
//!   the thresholds.
//! * **Edges** (`edges.rs`, `intervals.rs`): intervals of edges in the lanes, each tested at its midpoint with a bound
//!   of the motion from there to its ends (`motion.rs`, `levers.rs`) as a margin. An interval with pairs that are too
//!   close is bisected, and both halves are tested for these pairs only.
//! * **Samples** (`samples.rs`): a line tested at some poses, not a proof: a first test for searches.
//! * **Instructions** (`isa.rs`): AVX-512, AVX2 or none, selected at run time; one source, generic over the lanes
//!   (`lanes.rs`).
//!
//! This is the only crate that uses `unsafe`: for vector instructions, in `lanes.rs` and `isa.rs` only.

mod bound;
mod chain;
mod clauses;
mod compile;
mod distance;
mod edge_block;
mod edges;
mod fast;
mod intervals;
mod isa;
mod kernel;
mod lanes;
mod levers;
mod limits;
mod motion;
mod objects;
mod program;
mod proof;
mod reference;
mod regions;
mod robots;
mod samples;
mod solids;
mod steps;
mod sweep;
#[cfg(test)]
mod tests;
mod vector;
mod write;

pub use edges::{EdgeVerdict, Obstruction};
pub use fast::{FastError, FastFigures, FastScene};
pub use isa::InstructionSet;
