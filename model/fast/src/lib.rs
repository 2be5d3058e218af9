//! *Free or not* for many poses at once: what planners ask a hundred thousand times, sixteen poses at a time.
//!
//! [`FastScene`] compiles a scene once, for one clearance, into a flat program of joints and tests, and runs sixteen
//! poses through it together: one pose per lane of the processor's vector registers.
//!
//! # The promise
//! **Verdicts are the scalar engine's** ([`mobee_model::Scene::free`]). The lanes compute in `f32`, but decide only
//! what is beyond doubt; what their rounding could decide, the scalar engine is asked about, pair by pair.
//!
//! **Edges are proved** ([`FastScene::certify`]): a straight line that is certified free is free at every pose, between
//! samples, too; where it is blocked, the scalar engine agrees.
//!
//! # Method
//! ```text
//! poses ──> angles ──f64──> sine, cosine ──f32──> frames ──> balls ──near──> shapes ──near──> two shapes
//!                                                     touching | free | in doubt ──> scalar engine
//! ```
//! * **Company** (`clauses.rs`, `fast.rs`): constraints are asked before anything is placed, and poses that violate one
//!   take no lane; where few lanes of a block are left at a cut of the program, they go on with those of other blocks.
//! * **Kinematics** (`chain.rs`): constant transforms are folded; each frame is chosen so that its hinge turns about z
//!   and most constant turns vanish or are right angles.
//! * **Pairs** (`sweep.rs`, `proof.rs`): a pair is dropped if the balls that hold its shapes *at every pose within the
//!   limits* are apart, or those of each part of the limits where few joints stand between: a proof, not a sample.
//! * **Balls** (`steps.rs`, `write.rs`): two hands, two links, then two shapes are asked only if their balls meet in a
//!   lane. A finger is not even placed unless the ball that holds it, in the hand's frame, is beside something. What
//!   decided most often in a seeded sample, for what it costs, is asked first.
//! * **Two shapes** (`distance.rs`): capsules and balls by the closed form of two segments; cylinders and boxes by
//!   projections to and fro. Whatever is found is *checked*: two near points prove a contact, a direction that
//!   separates proves that there is none. Of a hull the shape around it and a capsule within it are known; what lies
//!   between is in doubt.
//! * **Rounding** (`bound.rs`): a worst-case bound is carried along each chain while it is compiled, and goes into the
//!   thresholds.
//! * **Edges** (`edges.rs`, `intervals.rs`): intervals of edges in the lanes, each judged at its middle with a bound on what
//!   moves from there to its ends (`motion.rs`, `levers.rs`) as a margin. What is too near is halved, and both halves
//!   are asked about it alone.
//! * **Samples** (`samples.rs`): one line looked at in places, no proof: what a search asks first.
//! * **Instructions** (`isa.rs`): AVX-512, AVX2 or none, chosen at run time; one source, generic over the lanes
//!   (`lanes.rs`).
//!
//! This is the one crate that uses `unsafe`: for vector instructions, in `lanes.rs` and `isa.rs` alone.

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
mod program;
mod proof;
mod reference;
mod regions;
mod samples;
mod steps;
mod sweep;
#[cfg(test)]
mod tests;
mod vector;
mod write;

pub use edges::{EdgeVerdict, Obstruction};
pub use fast::{FastError, FastFigures, FastScene};
pub use isa::InstructionSet;
