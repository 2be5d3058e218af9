//! Statistics of a robot's shapes at random poses: pairs of links that can be disabled, false contacts (the fitted
//! shapes touch but the meshes do not), and a collision-free home.
//!
//! ```text
//! Robot + surfaces ──random poses──> Comparison ──> where to fit closer
//!                                └─> find_disabled_pairs ──> Robot::leave_out
//! Robot ──find_home──> a collision-free configuration
//! ```

mod compare;
mod false_contacts;
mod fault_assignment;
mod find_disabled;
mod home;
mod refit;
mod refit_hulls;
mod subject;

pub use compare::{Comparison, ContactCounts, compare};
pub(crate) use find_disabled::OWN_CLEARANCES_M;
pub use find_disabled::{PairSurvey, find_disabled_pairs};
pub use home::{HomePose, find_home};
pub use refit::{RefitLimits, Refitted, fit_closer};
use subject::{PlacedShapes, Subject};
