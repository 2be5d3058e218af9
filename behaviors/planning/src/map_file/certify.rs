//! Certification of all edges of a map at once.

use super::{Certified, MapFile, StoredVerdict, world_digest};
use mobee_fast::{EdgeVerdict, FastError, FastScene, Obstruction};
use mobee_model::{Robot, Scene, ShapeId};

/// Number of edges certified in one call.
const BATCH: usize = 1024;

/// Certifies every edge of a map, and stores the verdicts and the conditions under which they hold.
///
/// # Arguments
/// * `scene`: the map's robot, alone, in the world.
/// * `clearance`: minimum distance between shapes, meters: the reflex's margin plus 2 mm.
/// * `show`: called with the completed share.
///
/// # Errors
/// A scene that can't be compiled for the clearance, or poses of another robot.
pub fn certify(map: &mut MapFile, scene: &Scene, clearance: f64, show: &mut dyn FnMut(f64)) -> Result<(), FastError> {
    let mut fast = FastScene::new(scene, clearance)?;
    let robot = scene.robots().first();
    let mut poses = Vec::new();
    let mut verdicts = Vec::new();
    let vertices = &map.vertices;
    let count = map.edges.len().max(1);
    for (batch, edges) in map.edges.chunks_mut(BATCH).enumerate() {
        show((batch * BATCH) as f64 / count as f64);
        poses.clear();
        for edge in edges.iter() {
            let q = |id: u32| vertices.get(id as usize).map_or(&[][..], |v| &v.q_rad);
            let from = q(edge.from);
            let to = q(edge.to);
            poses.extend(from);
            // The short way round, as it is driven.
            poses.extend(robot.map_or_else(|| to.to_vec(), |r| Robot::nearest_equivalent(r, from, to)));
        }
        fast.certify(&poses, &mut verdicts)?;
        for (edge, verdict) in edges.iter_mut().zip(&verdicts) {
            edge.verdict = Some(stored(verdict, scene));
        }
    }
    map.certified = Some(Certified { world_sha256: world_digest(scene), clearance_m: clearance });
    map.round();
    Ok(())
}

fn stored(verdict: &EdgeVerdict, scene: &Scene) -> StoredVerdict {
    match verdict {
        EdgeVerdict::Free => StoredVerdict::Free,
        EdgeVerdict::Uncertified { at } => StoredVerdict::Uncertified { at: *at },
        EdgeVerdict::Blocked(Obstruction { at, pair }) => {
            let object = pair.and_then(|(_, second)| match second {
                ShapeId::Object { object, .. } => scene.objects().find(|(id, _)| *id == object),
                ShapeId::Robot { .. } => None,
            });
            StoredVerdict::Blocked {
                at: *at,
                between: pair.map(|(a, b)| [scene.shape_name(a), scene.shape_name(b)]),
                object: object.map(|(_, o)| o.name.clone()),
            }
        }
    }
}
