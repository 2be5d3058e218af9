//! The world's objects: shown, moved, recolored and removed as the scene is edited.

use crate::body::entity;
use crate::palette::{self, Rgba};
use crate::shapes::{DrawnSolid, Shapes, quaternion, vec3};
use crate::stream::{EntityStream, Written};
use mobee_model::{Object, ObjectClass, Scene, Shape, ShapeId};
use nalgebra::{Isometry3, Vector3};
use rerun::{Clear, FillMode, Points3D, Transform3D};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Objects that are shown.
#[derive(Default)]
pub(crate) struct Objects {
    shown: BTreeMap<u32, (Arc<Object>, Shapes)>,
}

impl Objects {
    /// Writes the differences from the scene shown so far.
    pub(crate) fn update(&mut self, stream: &EntityStream, scene: &Scene) -> Written {
        let now: BTreeMap<u32, &Arc<Object>> = scene.objects().collect();
        let gone: Vec<u32> = self.shown.keys().filter(|id| !now.contains_key(id)).copied().collect();
        for id in gone {
            if let Some((object, _)) = self.shown.remove(&id) {
                stream.log(&path(id, &object), &Clear::recursive())?;
            }
        }
        for (id, object) in now {
            match self.shown.get_mut(&id) {
                Some((old, _)) if Arc::ptr_eq(old, object) || *old == *object => {}
                Some((old, _)) if looks_alike(old, object) => {
                    place(stream, &path(id, object), object)?;
                    *old = Arc::clone(object);
                }
                _ => {
                    let shapes = show(stream, id, object)?;
                    self.shown.insert(id, (Arc::clone(object), shapes));
                }
            }
        }
        Ok(())
    }

    /// All shapes, to be colored.
    pub(crate) fn shapes(&mut self) -> impl Iterator<Item = &mut Shapes> {
        self.shown.values_mut().map(|(_, shapes)| shapes)
    }
}

/// True if only the pose differs.
fn looks_alike(a: &Object, b: &Object) -> bool {
    a.name == b.name && a.class == b.class && a.color == b.color && a.shapes == b.shapes
}

/// Entity of an object; its id distinguishes a removed object from a later one of the same name.
fn path(id: u32, object: &Object) -> String {
    format!("world/objects/{}_{id}", entity(&object.name))
}

fn place(stream: &EntityStream, path: &str, object: &Object) -> Written {
    let Isometry3 { rotation, translation } = object.pose;
    let at = Transform3D::from_translation_rotation(vec3(&translation.vector), quaternion(&rotation));
    stream.log(path, &at)
}

/// Shows an object by its class: solid if it can be touched, transparent if it is a ghost.
fn show(stream: &EntityStream, id: u32, object: &Object) -> Result<Shapes, String> {
    let word = match object.class {
        ObjectClass::Obstacle => object.name.clone(),
        ObjectClass::Target => format!("{} (target)", object.name),
        ObjectClass::Ghost => format!("{} (ghost)", object.name),
    };
    draw(stream, (&path(id, object), id), object, (palette::object(object), word))
}

/// Shows the objects that only the simulated world has. They never change: no contact of the model has their shapes.
pub(crate) fn show_unknown(stream: &EntityStream, objects: &[Object]) -> Written {
    for (id, object) in (0..).zip(objects) {
        let path = format!("world/unknown/{}_{id}", entity(&object.name));
        draw(stream, (&path, id), object, (palette::UNKNOWN, format!("{} (not in the model)", object.name)))?;
    }
    Ok(())
}

/// Draws an object at its pose, with its name.
fn draw(
    stream: &EntityStream,
    (path, id): (&str, u32),
    object: &Object,
    (color, word): (Rgba, String),
) -> Result<Shapes, String> {
    place(stream, path, object)?;
    let fill = match object.class {
        ObjectClass::Obstacle | ObjectClass::Target => FillMode::Solid,
        ObjectClass::Ghost => FillMode::TransparentFillMajorWireframe,
    };
    let solids: Vec<_> = object
        .shapes
        .iter()
        .enumerate()
        .map(|(s, primitive)| DrawnSolid {
            id: ShapeId::Object { object: id, shape: s as u16 },
            primitive,
            hull: None,
            frame_from_node: Isometry3::identity(),
            color,
        })
        .collect();
    let mut shapes = Shapes::default();
    shapes.add(stream, path, &solids, fill)?;
    // The viewer writes a label below its point: below the object, it hides nothing.
    let name = Points3D::new([below(object)]).with_labels([word]).with_show_labels(true).with_radii([0.001]);
    stream.log(&format!("{path}/name"), &name.with_colors([0xC8D0DCFFu32]))?;
    Ok(shapes)
}

/// A point below the object, in its frame, meters.
fn below(object: &Object) -> [f32; 3] {
    let down = object.pose.rotation.inverse() * -Vector3::z();
    let depths = object.shapes.iter().map(|p| {
        let place = p.pose.translation.vector;
        let reach = match p.shape {
            Shape::Sphere { radius } => radius,
            Shape::Box { size } => 0.5 * (p.pose.rotation.inverse() * down).abs().dot(&size),
            Shape::Cylinder { radius, height } | Shape::Capsule { radius, height } => {
                radius + 0.5 * height * (p.pose.rotation * Vector3::y()).dot(&down).abs()
            }
        };
        (place, down.dot(&place) + reach)
    });
    let (place, depth) = depths.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
    vec3(&(place + (depth - down.dot(&place)) * down))
}
