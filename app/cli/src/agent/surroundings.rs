//! The world for an agent in another process: shapes and classes from its own file, poses by the world's RPC.
//!
//! The RPC reports neither shape nor class of an object. So objects that were created during the run are not seen, and
//! a changed class is not noticed.

use mobee_model::{Edit, Scene};
use mobee_yarp::{Bottle, CallError, Carrier, Network, PortError, RpcClient, Text, Value};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use std::collections::BTreeSet;

/// The connection to the world.
pub struct Surroundings {
    rpc: RpcClient,
    strange: BTreeSet<String>,
}

impl Surroundings {
    /// Connects to the world's port.
    ///
    /// # Errors
    /// If it is not there.
    pub async fn connect(network: &Network, port: &str) -> Result<Surroundings, PortError> {
        let own = format!("{port}/agent{}", std::process::id());
        drop(RpcClient::connect(network, &own, port, Carrier::Tcp).await?);
        let rpc = RpcClient::keep(network, &own, port, Carrier::Tcp);
        Ok(Surroundings { rpc, strange: BTreeSet::new() })
    }

    /// The scene with its objects at their present poses; `None` if nothing changed.
    ///
    /// # Errors
    /// If the world does not answer. The previous scene then remains the best one.
    pub async fn refresh(&mut self, scene: &Scene) -> Result<Option<Scene>, CallError> {
        let listed = self.rpc.call(&request(&["ls"])).await?;
        let names: BTreeSet<String> = listed.iter().filter_map(|v| v.as_text().map(|t| t.into_owned())).collect();
        let mut edits = Vec::new();
        for (_, object) in scene.objects() {
            let name = object.name.clone();
            if !names.contains(&name) {
                edits.push(Edit::Remove { name });
                continue;
            }
            let reply = self.rpc.call(&request(&["get", &name])).await?;
            match pose(&reply) {
                Some(pose) if !near(&pose, &object.pose) => edits.push(Edit::Move { name, pose }),
                _ => {}
            }
        }
        for name in names {
            if scene.object(&name).is_none() && self.strange.insert(name.clone()) {
                eprintln!("the object {name} is not in this file's world: its shape is not known, and it is not seen");
            }
        }
        let mut edited: Option<Scene> = None;
        for edit in edits {
            // ignore edits that the local world refuses
            if let Ok(next) = edited.as_ref().unwrap_or(scene).edit(&edit) {
                edited = Some(next);
            }
        }
        Ok(edited)
    }
}

fn request(words: &[&str]) -> Bottle {
    words.iter().map(|w| Value::String(Text(w.as_bytes().to_vec()))).collect()
}

fn near(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    let apart = (a.translation.vector - b.translation.vector).norm();
    apart < 1e-6 && a.rotation.angle_to(&b.rotation) < 1e-6
}

/// An object's pose from the answer to `get`: a sentence and sixteen numbers, a 4x4 matrix column by column.
fn pose(reply: &Bottle) -> Option<Isometry3<f64>> {
    let numbers: Vec<f64> = reply.iter().filter_map(Value::as_f64).collect();
    let m: [f64; 16] = numbers.try_into().ok()?;
    if !m.iter().all(|v| v.is_finite()) {
        return None;
    }
    let [a, b, c, _, d, e, f, _, g, h, i, _, x, y, z, _] = m;
    let turn = Rotation3::from_matrix(&Matrix3::new(a, d, g, b, e, h, c, f, i));
    Some(Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_rotation_matrix(&turn)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_read_column_by_column() {
        let mut reply = request(&["Object sph1 found."]);
        for v in [0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 4.0, 5.0, 6.0, 1.0] {
            reply.push(Value::Float64(v));
        }
        let got = pose(&reply).unwrap();
        let want = UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        assert!(near(&got, &Isometry3::from_parts(Translation3::new(4.0, 5.0, 6.0), want)), "{got:?}");
        assert_eq!(pose(&request(&["Object sph1 not found."])), None);
    }
}
