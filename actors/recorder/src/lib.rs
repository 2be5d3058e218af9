//! Recording of a run's state with Rerun: a tap on its own thread, never in the control path.
//!
//! Defines the appearance of a run: robots as solid shapes, the world's objects, trails of the hands, the
//! roadmap in the world and flat, joint plots, state lanes and an event log, and the layout that shows them.
//! Accepts [`Entry`](mobee_contract::Entry)s as a [`Sink`](mobee_contract::Sink); writes one `.rrd` file or
//! sends to a live viewer. Promises to be cheap (a 20 Hz frame costs microseconds), and that the file of a
//! killed run is readable up to about its last second.
//!
//! ```text
//! Entry::Pose  ── angles that changed ──> columns, 2048 frames at once ─┐
//! Entry::Scene ── what differs ─────────> shapes, objects ─────────────┼─> recording.rrd
//! Entry::Event ── words, lanes, roadmap ─> rows ───────────────────────┘
//! ```
//!
//! Besides runs it records robot models for inspection after a conversion: [`view_model`]; and roadmaps:
//! [`view_map`].
//!
//! This is the only crate that depends on Rerun.

mod blueprint;
mod body;
mod contents;
mod disk;
mod draw;
mod eyes;
mod front;
mod layout;
mod legend;
mod map_view;
mod model_view;
mod objects;
mod palette;
mod poses;
mod recorder;
mod recording;
mod roadmap;
mod shadow;
mod shapes;
pub mod staged;
mod stream;
mod surface;
mod traces;
mod words;

pub use contents::Contents;
pub use map_view::{MapLines, MapView, view_map};
pub use model_view::{ModelView, NearLinks, SeenModel, view_model};
pub use poses::RecordedPoses;
pub use recorder::Recorder;
pub use recording::{PoseName, RecorderError, Recording, Settings};
