//! Import of robots: URDF, SRDF and meshes, ready to run.
//!
//! ```text
//! robot.urdf ──urdf──> links, meshes ──fit──> shapes ──survey──> disabled pairs, home ──> Robot ──> robot file
//! robot.srdf ──srdf──> pairs, named poses, groups ───────────────────┘
//! ```
//!
//! Units: radians, meters.

mod fit;
mod import;
mod srdf;
mod surface;
mod survey;
mod urdf;

pub use fit::{Fit, FitOptions, Fitted, fit_link};
pub use import::{IMPORT_SEED, ImportError, ImportOptions, Imported, plain_name, ros_package_folders};
pub use srdf::{
    EndEffector, LinkTree, Srdf, SrdfGroup, SrdfState, VirtualJoint, load_link_tree, load_srdf, parse_link_tree,
    parse_srdf,
};
pub use surface::{LinkSurface, Surfaces};
pub use survey::{
    Comparison, ContactCounts, HomePose, PairSurvey, RefitLimits, Refitted, compare, find_disabled_pairs, find_home,
    fit_closer,
};
pub use urdf::{
    UpAxis, UrdfOptions, UrdfRobot, load_mesh, load_surfaces, load_urdf, load_urdf_with_surfaces, parse_urdf,
};
