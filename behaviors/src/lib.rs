//! What robots do: roadmaps, planners and agents, pure.
//!
//! Owns everything that decides where to go. Accepts a [`View`](mobee_contract::View) and how the last motion ended; answers
//! with an [`Intent`](mobee_contract::Intent). It knows no clock, no actor, and nothing of the controller: that a motion was rolled
//! back is for an agent just a motion that failed.
//!
//! ```text
//! View, MotionEnd ──> agents ──> walk ──> roadmap ──> neighbors
//!                        │         └────> escape
//!                        └──> Intent, Note, Snapshot          verdict: roadmap + scene ──> who was right
//! ```
//!
//! Agents are kinds, registered where they are defined: `explorer`, `roadmap`, `scripted`, `random`. A program must name this
//! crate (`use mobee_behaviors as _;`), or the linker drops them.
//!
//! Units: radians, metres, seconds; degrees only in settings, named `_deg`.

pub mod agents;
pub mod planners;
pub mod roadmap;
