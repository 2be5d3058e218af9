//! Solid shapes, batched by kind: one entity has all capsules in one frame.

use crate::palette::{self, Rgba};
use crate::stream::{EntityStream, Written};
use crate::surface::mesh3d;
use mobee_model::{Contact, Hull, Primitive, Shape, ShapeId};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rerun::components::AlbedoFactor;
use rerun::{AsComponents, Boxes3D, Capsules3D, Cylinders3D, Ellipsoids3D, FillMode, Mesh3D};
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

/// Mask that makes a color transparent, so that the mesh within is visible.
const SEE_THROUGH: Rgba = 0xFFFF_FF90;

/// Degree of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum ContactDegree {
    /// Closer than the margin.
    Near,
    /// At distance zero or below.
    Hard,
}

/// Shapes of these contacts, each with its worst contact.
pub(crate) fn touched<'a>(contacts: impl IntoIterator<Item = &'a Contact>) -> BTreeMap<ShapeId, ContactDegree> {
    let mut touched: BTreeMap<ShapeId, ContactDegree> = BTreeMap::new();
    for contact in contacts {
        let touch = if contact.distance > 0.0 { ContactDegree::Near } else { ContactDegree::Hard };
        for id in [contact.pair.0, contact.pair.1] {
            let worst = touched.entry(id).or_insert(touch);
            *worst = touch.max(*worst);
        }
    }
    touched
}

/// All shapes of one robot or object, with the data to color them.
#[derive(Default)]
pub(crate) struct Shapes {
    batches: Vec<Batch>,
    /// Batches and instances of each shape.
    index: BTreeMap<ShapeId, Vec<(usize, usize)>>,
}

struct Batch {
    path: String,
    paint: ColorForm,
    base: Vec<Rgba>,
    shown: Vec<Rgba>,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum BatchKind {
    Boxes,
    Capsules,
    Cylinders,
    Spheres,
}

/// Form in which the colors of an entity are written.
#[derive(Clone, Copy)]
enum ColorForm {
    /// One color for each shape of this kind.
    Shapes(BatchKind),
    /// One color for a single hull.
    Hull,
}

/// One shape: its id, its geometry, its pose in the frame, and its color.
pub(crate) struct DrawnSolid<'a> {
    pub(crate) id: ShapeId,
    pub(crate) primitive: &'a Primitive,
    /// Hull to be drawn within it.
    pub(crate) hull: Option<&'a Hull>,
    pub(crate) frame_from_node: Isometry3<f64>,
    pub(crate) color: Rgba,
}

impl Shapes {
    /// Writes shapes in the frame of the entity `frame`, and stores them.
    ///
    /// Their colors are temporal, because static data would hide every later change of the same component.
    pub(crate) fn add(
        &mut self,
        stream: &EntityStream,
        frame: &str,
        solids: &[DrawnSolid<'_>],
        fill: FillMode,
    ) -> Written {
        let mut kinds: BTreeMap<(BatchKind, bool), Vec<&DrawnSolid<'_>>> = BTreeMap::new();
        for solid in solids {
            kinds.entry((BatchKind::of(&solid.primitive.shape), solid.hull.is_some())).or_default().push(solid);
        }
        for ((kind, hulled), solids) in kinds {
            let (path, fill) = match hulled {
                true => (format!("{frame}/{}_around_hulls", kind.word()), FillMode::MajorWireframe),
                false => (format!("{frame}/{}", kind.word()), fill),
            };
            stream.log(&path, kind.geometry(&solids, fill).as_ref())?;
            self.batch(stream, (path, ColorForm::Shapes(kind)), &solids)?;
        }
        let see_through = fill == FillMode::TransparentFillMajorWireframe;
        for (solid, hull) in solids.iter().filter_map(|s| Some((s, s.hull?))) {
            let ShapeId::Robot { node, shape, .. } = solid.id else { continue };
            let path = format!("{frame}/hulls/{node}_{shape}");
            stream.log_static(&path, &mesh3d(&hull.mesh(), &solid.frame_from_node))?;
            let color = if see_through { solid.color & SEE_THROUGH } else { solid.color };
            self.batch(stream, (path, ColorForm::Hull), &[&DrawnSolid { color, ..*solid }])?;
        }
        Ok(())
    }

    /// Colors the shapes of an entity, and stores them.
    fn batch(
        &mut self,
        stream: &EntityStream,
        (path, paint): (String, ColorForm),
        solids: &[&DrawnSolid<'_>],
    ) -> Written {
        let base: Vec<_> = solids.iter().map(|s| s.color).collect();
        stream.log(&path, paint.colors(&base).as_ref())?;
        for (i, solid) in solids.iter().enumerate() {
            self.index.entry(solid.id).or_default().push((self.batches.len(), i));
        }
        self.batches.push(Batch { path, paint, shown: base.clone(), base });
        Ok(())
    }

    /// Gives every shape its own color, except those in contact; writes the changes.
    pub(crate) fn paint(&mut self, stream: &EntityStream, touched: &BTreeMap<ShapeId, ContactDegree>) -> Written {
        let mut wanted: Vec<Vec<Rgba>> = self.batches.iter().map(|b| b.base.clone()).collect();
        for (id, touch) in touched {
            for (b, i) in self.index.get(id).into_iter().flatten() {
                let Some(color) = wanted.get_mut(*b).and_then(|batch| batch.get_mut(*i)) else { continue };
                *color = match touch {
                    ContactDegree::Near => palette::NEAR,
                    ContactDegree::Hard => palette::HARD,
                };
            }
        }
        for (batch, wanted) in self.batches.iter_mut().zip(wanted) {
            if batch.shown != wanted {
                stream.log(&batch.path, batch.paint.colors(&wanted).as_ref())?;
                batch.shown = wanted;
            }
        }
        Ok(())
    }
}

impl BatchKind {
    fn of(shape: &Shape) -> BatchKind {
        match shape {
            Shape::Sphere { .. } => BatchKind::Spheres,
            Shape::Cylinder { .. } => BatchKind::Cylinders,
            Shape::Box { .. } => BatchKind::Boxes,
            Shape::Capsule { .. } => BatchKind::Capsules,
        }
    }

    fn word(self) -> &'static str {
        match self {
            BatchKind::Boxes => "boxes",
            BatchKind::Capsules => "capsules",
            BatchKind::Cylinders => "cylinders",
            BatchKind::Spheres => "spheres",
        }
    }

    /// Archetype with sizes and poses. Rerun's cylinders and capsules lie along z, and its capsules start at
    /// the origin; ours lie along y and are centered.
    fn geometry(self, solids: &[&DrawnSolid<'_>], fill: FillMode) -> Box<dyn AsComponents> {
        let mut sizes = Vec::new();
        let mut lengths = Vec::new();
        let mut radii = Vec::new();
        let mut places = Vec::new();
        let mut turns = Vec::new();
        for solid in solids {
            let mut pose = solid.frame_from_node * solid.primitive.pose;
            match solid.primitive.shape {
                Shape::Sphere { radius } => sizes.push([radius as f32; 3]),
                Shape::Box { size } => sizes.push((size * 0.5).cast::<f32>().into()),
                Shape::Cylinder { radius, height } => {
                    pose *= y_from_z();
                    lengths.push(height as f32);
                    radii.push(radius as f32);
                }
                Shape::Capsule { radius, height } => {
                    pose = pose * Translation3::new(0.0, -0.5 * height, 0.0) * y_from_z();
                    lengths.push(height as f32);
                    radii.push(radius as f32);
                }
            }
            places.push(vec3(&pose.translation.vector));
            turns.push(quaternion(&pose.rotation));
        }
        match self {
            BatchKind::Boxes => Box::new(
                Boxes3D::from_half_sizes(sizes).with_centers(places).with_quaternions(turns).with_fill_mode(fill),
            ),
            BatchKind::Spheres => Box::new(
                Ellipsoids3D::from_half_sizes(sizes).with_centers(places).with_quaternions(turns).with_fill_mode(fill),
            ),
            BatchKind::Cylinders => Box::new(
                Cylinders3D::from_lengths_and_radii(lengths, radii)
                    .with_centers(places)
                    .with_quaternions(turns)
                    .with_fill_mode(fill),
            ),
            BatchKind::Capsules => Box::new(
                Capsules3D::from_lengths_and_radii(lengths, radii)
                    .with_translations(places)
                    .with_quaternions(turns)
                    .with_fill_mode(fill),
            ),
        }
    }
}

impl ColorForm {
    fn colors(self, colors: &[Rgba]) -> Box<dyn AsComponents> {
        let colors = colors.iter().copied();
        match self {
            ColorForm::Shapes(BatchKind::Boxes) => Box::new(Boxes3D::update_fields().with_colors(colors)),
            ColorForm::Shapes(BatchKind::Spheres) => Box::new(Ellipsoids3D::update_fields().with_colors(colors)),
            ColorForm::Shapes(BatchKind::Cylinders) => Box::new(Cylinders3D::update_fields().with_colors(colors)),
            ColorForm::Shapes(BatchKind::Capsules) => Box::new(Capsules3D::update_fields().with_colors(colors)),
            ColorForm::Hull => {
                let color = colors.last().unwrap_or(palette::MESH);
                Box::new(Mesh3D::update_fields().with_albedo_factor(AlbedoFactor(color.into())))
            }
        }
    }
}

/// Rotation from the z axis to the y axis.
fn y_from_z() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -FRAC_PI_2)
}

/// Converts a vector for Rerun.
pub(crate) fn vec3(v: &Vector3<f64>) -> [f32; 3] {
    v.cast::<f32>().into()
}

/// Converts a rotation for Rerun.
pub(crate) fn quaternion(q: &UnitQuaternion<f64>) -> rerun::Quaternion {
    rerun::Quaternion::from_xyzw([q.i as f32, q.j as f32, q.k as f32, q.w as f32])
}
