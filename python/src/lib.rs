//! The Python package `mobee`: models, kinematics, collision queries, certified edges, runs with agents, detectors
//! and drivers in Python, environments.
//!
//! ```text
//! Python ──arrays, place──> checked numbers ──joints──> rad of encoder ──> model, fast engine ──> results ──> Python
//! run on a thread of its own ──relay──Question──> session ──serve──> agent in Python ──intent──> Reply ──> run
//! detector, locator ──sense_relay──Sense──> session ──sense_serve──> detector, locator in Python ──> Reply ──> run
//! policy in Python ──following──set-point──> follow, a service of the run ──stream──> run
//! driver actor ──callback_line──> positions ──driver_line──> driver in Python ──sample──> callback_line ──> driver actor
//! ```
//!
//! The files without Python never name the interpreter, so a run has no thread that waits for its lock: `attach`, `failure`, `joints`,
//! `pose`, `chain`, `inverse`, `timing`; `relay`, `sense_relay`, `sense_slots`, `session`, `slots`, `motion_book`, `follow`, `callback_arm`,
//! `callback_line`. Of these `failure`, `joints`, `pose`, `chain` and `inverse` are tested by `tests/`, all others by pytest. No call panics,
//! whatever its arguments; long ones give up the interpreter's lock and end after Ctrl-C (`wait`).
//!
//! Units toward Python: radians, or meters for prismatic joints; the model counts "rad of encoder" (`mobee_model::Motor`).

mod arrays;
mod attach;
mod callback_arm;
mod callback_line;
mod chain;
mod conform;
mod drawing;
mod driver_line;
mod failure;
mod follow;
mod following;
mod given;
mod intent;
mod inverse;
mod joints;
mod load;
mod motion_book;
mod place;
mod plan;
mod pose;
mod raise;
mod relay;
mod results;
mod roadmap;
mod robot;
mod run;
mod scene;
mod sense_relay;
mod sense_serve;
mod sense_slots;
mod serve;
mod session;
mod shapes;
mod slots;
mod steps;
mod timing;
mod view;
mod wait;

mod world;

use pyo3::prelude::*;

/// The compiled part of `mobee`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::conform::{keep_promise, promises};
    #[pymodule_export]
    use crate::drawing::{shape_poses, shapes_of};
    #[pymodule_export]
    use crate::driver_line::PyDriverLine;
    #[pymodule_export]
    use crate::following::PyFollowing;
    #[pymodule_export]
    use crate::load::load;
    #[pymodule_export]
    use crate::plan::{PyNoPlan, PyPlan, PyTrajectory};
    #[pymodule_export]
    use crate::results::{PyBlocked, PyContact, PyFree, PyIk, PyUnproved};
    #[pymodule_export]
    use crate::roadmap::PyRoadmap;
    #[pymodule_export]
    use crate::robot::PyRobot;
    #[pymodule_export]
    use crate::run::{PyJournalLines, check_run, conduct, robots_of};
    #[pymodule_export]
    use crate::scene::PyScene;
    #[pymodule_export]
    use crate::shapes::{PyBox, PyCapsule, PyCylinder, PyHull, PyMesh, PyShape, PySphere};
    #[pymodule_export]
    use crate::steps::PySteps;
    #[pymodule_export]
    use crate::view::{PyView, PyWorldObject};
    #[pymodule_export]
    use crate::world::PyWorld;
}
