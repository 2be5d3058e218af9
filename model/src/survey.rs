//! Statistics of a robot's shapes at random poses: pairs of links that can be disabled, false contacts (the fitted
//! shapes touch but the meshes do not), and a collision-free home.
//!
//! ```text
//! Robot + surfaces ──random poses──> Comparison ──> where to fit closer
//!                                └─> spared_pairs ──> Robot::leave_out
//! Robot ──find_home──> a collision-free configuration
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
