//! Behaviors: roadmaps, planners and agents, pure.
//!
//! Owns everything that decides where to go. Accepts a [`View`](mobee_contract::View) and how the last motion ended; answers
//! with an [`Intent`](mobee_contract::Intent). It knows no clock, no actor, and nothing of the controller: to an agent, a motion
//! that was rolled back is just one that failed.
//!
//! ```text
//! View, MotionEnd ──> agents ──> walk ──> roadmap ──> neighbors ──> short_way
//!                        │         └────> escape
//!                        ├──> planners: RRT-Connect, shortcuts ──> JointSpace ──> mobee-fast
//!                        └──> Intent, Note, Snapshot          verdict: roadmap + scene ──> who was right
//!                                         walk ──> validation ──> validity: roadmap + scene ──> which edges are blocked
//!
//! scene, table ──> table_map ──search──> poses ──> roadmap <──> map_file (JSON)
//! ```
//!
//! Agents are kinds, registered where they are defined: `explorer`, `roadmap`, `plan`, `reach`, `scripted`, `random`, `jog`; so are
//! [`detectors`]: `color` and `cgp`, which learn from pictures, `tag` and `onnx`; and [`locators`]: `triangulate`, `network`, `ensemble`, `calibrated`. A program must name this
//! crate (`use mobee_behaviors as _;`), or the linker drops them.
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
pub mod planners;
pub mod roadmap;
pub mod search;
pub mod short_way;
pub mod table_map;
