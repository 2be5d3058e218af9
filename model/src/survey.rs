//! What random poses tell of a robot's shapes: which pairs of links need no test, how often the fitted shapes touch where the meshes do
//! not, and where the robot can begin.
//!
//! ```text
//! Robot + surfaces ──random poses──> Comparison ──> where to fit closer
//!                                └─> spared_pairs ──> Robot::leave_out
//! Robot ──find_home──> a pose that is free
//! ```

mod claims;
mod closer;
mod compare;
mod falsely;
mod home;
mod hulled;
mod spare;
mod subject;

pub use closer::{Closer, Nearer, fit_closer};
pub use compare::{Comparison, ContactCounts, compare};
pub use home::{HomePose, find_home};
pub use spare::spared_pairs;
use subject::{Placed, Subject};
