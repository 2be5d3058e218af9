//! Mount of a camera on its robot, and its housing.

use mobee_contract::{CameraMount, KindError, suggestion};
use mobee_model::{Robot, Shape, distance};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Distance to the camera, in the home configuration, below which shapes of the robot are its housing,
/// meters.
const HOUSING: f64 = 0.015;

/// A camera on a robot.
#[derive(Clone, Debug)]
pub struct Mount {
    /// Node that carries it.
    node: usize,
    /// `node_from_eye`.
    pose: Isometry3<f64>,
    /// Shapes that house it, which are not rendered: node and shape.
    housing: Vec<(usize, usize)>,
}

impl Mount {
    /// Mounts a camera at a marker, looking along its normal. The image's upper side is toward the model's z
    /// axis while all motors are at zero, or toward the x axis if the camera looks along z.
    ///
    /// # Arguments
    /// * `offset_m`: offset from the marker, in the camera frame (x right, y down, z forward), meters.
    /// * `rotation_deg`: subsequent rotation about that frame's x, y and z axis, in this order, degrees.
    ///
    /// # Errors
    /// The robot has no such marker.
    pub fn new(robot: &Robot, marker: &str, offset_m: [f64; 3], rotation_deg: [f64; 3]) -> Result<Mount, KindError> {
        let Some(found) = robot.marker(marker) else {
            let names: Vec<&str> = robot.markers.iter().map(|m| m.name.as_str()).collect();
            let what = format!("robot {} has no marker {marker}", robot.name);
            return Err(KindError::new("marker", what, suggestion(marker, "marker", &names)));
        };
        let z = found.normal.into_inner();
        // frames of robot models are not rotated while the motors are at zero, so this is the world's up
        let up = if z.z.abs() < 0.999 { Vector3::z() } else { Vector3::x() };
        let y = (z * z.dot(&up) - up).normalize();
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y.cross(&z), y, z]));
        let [roll, pitch, yaw] = rotation_deg.map(f64::to_radians);
        let own =
            Isometry3::from_parts(Vector3::from(offset_m).into(), UnitQuaternion::from_euler_angles(roll, pitch, yaw));
        let pose = Isometry3::from_parts(Vector3::zeros().into(), UnitQuaternion::from_rotation_matrix(&axes)) * own;
        let mut mount = Mount { node: found.node, pose, housing: Vec::new() };
        mount.housing = mount.housing(robot);
        Ok(mount)
    }

    fn housing(&self, robot: &Robot) -> Vec<(usize, usize)> {
        let mut frames = Vec::new();
        robot.forward(&robot.home(), &mut frames);
        let Some(eye) = self.at(&frames) else { return Vec::new() };
        let point = Shape::Sphere { radius: 0.0 };
        let mut near = Vec::new();
        for (n, (node, frame)) in robot.nodes.iter().zip(&frames).enumerate() {
            let is_near =
                |p: &mobee_model::Primitive| distance(&point, &eye, &p.shape, &(frame * p.pose)).distance < HOUSING;
            near.extend(node.solids.iter().enumerate().filter(|(_, p)| is_near(p)).map(|(s, _)| (n, s)));
        }
        near
    }

    /// `world_from_eye`, given `world_from_node` of the robot's nodes.
    pub fn at(&self, world_from_node: &[Isometry3<f64>]) -> Option<Isometry3<f64>> {
        world_from_node.get(self.node).map(|frame| frame * self.pose)
    }

    /// Converts to the contract's type, for the robot of this index.
    pub fn to_contract(&self, robot: usize) -> CameraMount {
        let at = self.pose.translation.vector;
        let turn = self.pose.rotation;
        let rotation = [turn.w, turn.i, turn.j, turn.k];
        CameraMount { robot, node: self.node, position: at.into(), rotation }
    }

    /// True if a shape of the robot houses the camera.
    pub fn is_housed_in(&self, node: usize, shape: usize) -> bool {
        self.housing.contains(&(node, shape))
    }
}
