//! Where an eye is on its robot, and what it is housed in.

use mobee_contract::{CameraMount, KindError, suggestion};
use mobee_model::{Robot, Shape, distance};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Shapes of the robot that are nearer to the eye than this while it is at home are its housing, meters.
const HOUSING: f64 = 0.015;

/// An eye on a robot.
#[derive(Clone, Debug)]
pub struct Mount {
    /// The node that carries it.
    node: usize,
    /// `node_from_eye`.
    pose: Isometry3<f64>,
    /// The shapes that house it, which it does not see: node and shape.
    housing: Vec<(usize, usize)>,
}

impl Mount {
    /// At a marker, which looks along its normal. The picture's upper side is where the model's z axis points while all motors are at
    /// zero; where the eye looks along that, it is where the x axis points.
    ///
    /// # Arguments
    /// * `offset_m`: from the marker, in the eye's own frame (x right, y down, z forward), meters.
    /// * `rotation_deg`: then turned by these about that frame's x, y and z axis, in this order, degrees.
    ///
    /// # Errors
    /// If the robot has no such marker.
    pub fn new(robot: &Robot, marker: &str, offset_m: [f64; 3], rotation_deg: [f64; 3]) -> Result<Mount, KindError> {
        let Some(found) = robot.marker(marker) else {
            let names: Vec<&str> = robot.markers.iter().map(|m| m.name.as_str()).collect();
            let what = format!("robot {} has no marker {marker}", robot.name);
            return Err(KindError::new("marker", what, suggestion(marker, "marker", &names)));
        };
        let z = found.normal.into_inner();
        // frames of robot models are never turned while the motors are at zero, so this is the world's up
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

    /// The same in the words of the contract, on the robot of this index.
    pub fn told(&self, robot: usize) -> CameraMount {
        let (at, turn) = (self.pose.translation.vector, self.pose.rotation);
        let rotation = [turn.w, turn.i, turn.j, turn.k];
        CameraMount { robot, node: self.node, position: at.into(), rotation }
    }

    /// Whether a shape of the robot houses the eye.
    pub fn is_housed_in(&self, node: usize, shape: usize) -> bool {
        self.housing.contains(&(node, shape))
    }
}
