//! RPC of a robot's part: its joints, its markers and its frame. The encoding of requests belongs to a
//! bridge; YARP's is `mobee_bridge_yarp::part`.

use mobee_model::{Marker, Robot};
use nalgebra::{Isometry3, Point3};

/// State of a part at the time of a query.
pub struct PartView<'a> {
    /// Robot of the part.
    pub robot: &'a Robot,
    /// Index of the part in the robot.
    pub part: usize,
    /// Base of the robot: `world_from_robot`.
    pub base: Isometry3<f64>,
    /// Configuration of the robot, rad.
    pub q: &'a [f64],
    /// Velocities commanded to the part's joints, deg/s.
    pub commanded: &'a [f64],
}

/// A query to a part.
#[derive(Clone, Debug, PartialEq)]
pub enum PartRequest {
    /// Names of its markers.
    Markers,
    /// Pose of the marker of this name.
    Marker(String),
    /// Number of its joints.
    Joints,
    /// True if no joint is commanded to go faster than this, deg/s.
    IsStill(f64),
    /// Converts a point, m, from the world to the frame of the part's root.
    ToLocal([f64; 3]),
    /// Converts a point, m, from the frame of the part's root to the world.
    ToGlobal([f64; 3]),
    /// Clears the trail of this marker; accepted for compatibility with the original, without effect.
    ClearTrail(String),
}

/// A part's answer.
#[derive(Clone, Debug, PartialEq)]
pub enum PartReply {
    /// Names of markers.
    Markers(Vec<String>),
    /// A marker, world frame.
    Marker {
        /// Position, m.
        position: [f64; 3],
        /// Unit normal.
        normal: [f64; 3],
    },
    /// A number of joints.
    Joints(usize),
    /// True if the part is still.
    IsStill(bool),
    /// A point, m.
    Point([f64; 3]),
    /// There was no trail.
    Cleared,
}

/// Reason why a part gives no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartRefusal {
    /// There is no such request.
    Unknown,
    /// An argument of the request is missing or invalid.
    Malformed,
    /// The part has no marker of this name.
    NoMarker,
    /// The part has no root, and so no frame.
    NoRoot,
}

/// Answers a query.
///
/// # Errors
/// The reason why there is no answer.
pub fn answer(request: &PartRequest, view: &PartView) -> Result<PartReply, PartRefusal> {
    Ok(match request {
        PartRequest::Markers => PartReply::Markers(markers(view).map(|m| m.name.clone()).collect()),
        PartRequest::Marker(name) => {
            let marker = marker(name, view)?;
            let frame = *frames(view).get(marker.node).ok_or(PartRefusal::NoMarker)?;
            let normal = frame.rotation * *marker.normal;
            PartReply::Marker { position: frame.translation.vector.into(), normal: normal.into() }
        }
        PartRequest::Joints => PartReply::Joints(view.robot.parts.get(view.part).map_or(0, |p| p.motors.len())),
        PartRequest::IsStill(most) => PartReply::IsStill(view.commanded.iter().all(|v| v.abs() <= *most)),
        PartRequest::ToLocal(at) => PartReply::Point(root(view)?.inverse_transform_point(&Point3::from(*at)).into()),
        PartRequest::ToGlobal(at) => PartReply::Point(root(view)?.transform_point(&Point3::from(*at)).into()),
        PartRequest::ClearTrail(name) => {
            marker(name, view)?;
            PartReply::Cleared
        }
    })
}

/// Positions of a part's joints as shares of their ranges, as published by its state port.
pub fn shares(view: &PartView) -> Vec<f64> {
    let motors = view.robot.parts.get(view.part).map(|p| p.motors.clone()).unwrap_or_default();
    let share = |i: usize| {
        let motor = view.robot.motors.get(i)?;
        let q = view.q.get(i)?;
        let range = motor.max - motor.min;
        Some(if range > 0.0 { (q - motor.min) / range } else { 0.0 })
    };
    motors.filter_map(share).collect()
}

fn markers<'a>(view: &'a PartView) -> impl Iterator<Item = &'a Marker> {
    view.robot.markers.iter().filter(|m| m.part == view.part)
}

fn marker<'a>(name: &str, view: &'a PartView) -> Result<&'a Marker, PartRefusal> {
    markers(view).find(|m| m.name == name).ok_or(PartRefusal::NoMarker)
}

fn frames(view: &PartView) -> Vec<Isometry3<f64>> {
    let mut frames = Vec::with_capacity(view.robot.nodes.len());
    view.robot.forward_from(&view.base, view.q, &mut frames);
    frames
}

/// `world_from_root` of the part.
fn root(view: &PartView) -> Result<Isometry3<f64>, PartRefusal> {
    let root = view.robot.parts.get(view.part).and_then(|p| p.root_node).ok_or(PartRefusal::NoRoot)?;
    frames(view).get(root).copied().ok_or(PartRefusal::NoRoot)
}
