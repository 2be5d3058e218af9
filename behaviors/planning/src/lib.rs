//! Planning: roadmaps and their files, planners, pose search and inverse kinematics, pure.
//!
//! It decides which configurations are reached, and on which paths. It reads no clock, and depends neither on an actor
//! nor on the controller.
//!
//! ```text
//! View ──> walk ──> roadmap ──> neighbors ──> short_way
//!           └────> escape
//! planners: RRT-Connect, AORRTC, shortcuts ──> JointSpace ──> mobee-fast
//! roadmap + scene ──> verdict ──> scored outcomes          walk ──> validation ──> validity ──> blocked edges
//!
//! scene, table ──> table_map ──search──> poses ──> roadmap <──> map_file (JSON)
//! ```
//!
//! Units: radians, meters, seconds; degrees only in settings, named `_deg`.

pub mod group;
pub mod hand_goal;
pub mod inverse_kinematics;
pub mod map_file;
pub mod pair_rules;
pub mod planners;
pub mod roadmap;
pub mod search;
pub mod short_way;
pub mod table_map;
