//! Behaviors: roadmaps, planners and agents, pure.
//!
//! Contains everything that decides where to go. An agent takes a [`View`](mobee_contract::View)
//! and the outcome of its last motion, and returns an [`Intent`](mobee_contract::Intent). It reads
//! no clock and depends neither on an actor nor on the controller: to an agent, a motion that was
//! rolled back is simply a motion that failed.
//!
//! ```text
//! View, MotionEnd ──> agents ──> walk ──> roadmap ──> neighbors ──> short_way
//!                        │         └────> escape
//!                        ├──> planners: RRT-Connect, shortcuts ──> JointSpace ──> mobee-fast
//!                        └──> Intent, Note, Snapshot          verdict: roadmap + scene ──> scored outcomes
//!                                         walk ──> validation ──> validity: roadmap + scene ──> blocked edges
//!
//! scene, table ──> table_map ──search──> poses ──> roadmap <──> map_file (JSON)
//! ```
//!
//! Agents are kinds, registered where they are defined: `explorer`, `roadmap`, `plan`, `reach`,
//! `scripted`, `random`, `jog`. So are [`detectors`] (`color` and `cgp`, which are trained on
//! images, `tag` and `onnx`) and [`locators`] (`triangulate`, `network`, `ensemble`, `calibrated`).
//! A program must name this crate (`use mobee_behaviors as _;`), or the linker drops the
//! registrations.
//!
//! Units: radians, meters, seconds; degrees only in settings, named `_deg`.

pub mod agents;
pub mod detectors;
pub mod group;
pub mod hand_goal;
pub mod inverse_kinematics;
pub mod learned_file;
pub mod locators;
pub mod map_file;
pub mod pair_rules;
pub mod planners;
pub mod roadmap;
pub mod search;
pub mod short_way;
pub mod table_map;
