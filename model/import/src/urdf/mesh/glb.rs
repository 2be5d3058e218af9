//! glTF 2.0 in one file (`.glb`): the triangles in its scene, transformed by the scene's nodes.
//!
//! glTF is in meters, with y up. As with COLLADA, coordinates are used unchanged, as in the programs in which URDF
//! files are displayed; for the exceptions see `upright`.

use super::{MAX_TRIANGLES, Parsed, add_triangle};
use mobee_model::Mesh;
use nalgebra::{Matrix4, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;

/// Types of chunks: JSON and binary data.
const JSON: u32 = 0x4E4F_534A;
const BINARY: u32 = 0x004E_4942;
/// Maximum nesting depth of nodes: a cycle would not end.
const MAX_DEPTH: usize = 50;
/// Maximum number of instances of nodes and meshes, with repeated instances counted again.
const MAX_INSTANCES: usize = 10_000;
/// Maximum number of vertices of all instances together.
const MAX_VERTICES: usize = 3 * MAX_TRIANGLES;
/// Component types with their size in bytes: `u8`, `u16`, `u32`, `f32`.
const NUMBERS: [(u32, usize); 4] = [(5121, 1), (5123, 2), (5125, 4), (5126, 4)];
const FLOAT: u32 = 5126;
/// The value of elements of a sparse accessor without a view.
static ZEROS: [u8; 12] = [0; 12];

/// The parts of the JSON that are used.
#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct GlbDocument {
    scene: Option<usize>,
    scenes: Vec<Nodes>,
    nodes: Vec<GlbNode>,
    meshes: Vec<Primitives>,
    accessors: Vec<Accessor>,
    buffer_views: Vec<BufferView>,
    buffers: Vec<Buffer>,
    extensions_required: Vec<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Nodes {
    nodes: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct GlbNode {
    children: Vec<usize>,
    mesh: Option<usize>,
    skin: Option<usize>,
    /// Column-major.
    matrix: Option<[f64; 16]>,
    translation: [f64; 3],
    /// x, y, z, w.
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
    extensions: BTreeMap<String, IgnoredAny>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Primitives {
    primitives: Vec<GlbPrimitive>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct GlbPrimitive {
    attributes: Attributes,
    indices: Option<usize>,
    mode: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    byte_offset: usize,
    component_type: u32,
    count: usize,
    r#type: String,
    sparse: Option<Sparse>,
}

/// The elements of an accessor that differ from its view.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Sparse {
    count: usize,
    /// Their indices.
    indices: SparsePart,
    /// Their values.
    values: SparsePart,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct SparsePart {
    buffer_view: usize,
    byte_offset: usize,
    component_type: u32,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Buffer {
    /// Location of its data, if it is not in this file.
    uri: Option<IgnoredAny>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

/// Reads a glTF file with an embedded buffer.
///
/// # Errors
/// The reason, as the end of a sentence.
pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, String> {
    let word = |at: usize| bytes.get(at..at + 4).and_then(|w| Some(u32::from_le_bytes(w.try_into().ok()?)));
    if bytes.get(..4) != Some(b"glTF") || word(4) != Some(2) {
        return Err("is no binary glTF of version 2".to_owned());
    }
    if word(8).is_some_and(|claimed| claimed as usize > bytes.len()) {
        return Err(format!("is cut off: it claims {} bytes and has {}", word(8).unwrap_or_default(), bytes.len()));
    }
    let mut at = 12;
    let mut json = None;
    let mut binary = &[][..];
    while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
        let end = (at + 8).checked_add(length as usize).filter(|end| *end <= bytes.len());
        let end = end.ok_or_else(|| format!("is cut off: the chunk at byte {at} claims {length} bytes"))?;
        match kind {
            JSON if json.is_none() => json = bytes.get(at + 8..end),
            BINARY if binary.is_empty() => binary = bytes.get(at + 8..end).unwrap_or_default(),
            _ => {}
        }
        at = end;
    }
    let document: GlbDocument = serde_json::from_slice(json.ok_or("has no JSON in it")?)
        .map_err(|e| format!("has JSON that is no glTF: {}", mobee_text::printable(&e.to_string())))?;
    // Extensions for materials and textures are irrelevant.
    document.extensions_required.iter().try_for_each(|e| refuse_extension(e))?;
    let mut scene = GlbReader { document: &document, binary, mesh: Mesh::default(), instances: 0 };
    let origin = Matrix4::identity();
    match document.scenes.get(document.scene.unwrap_or(0)) {
        Some(shown) => shown.nodes.iter().try_for_each(|node| scene.node(*node, &origin, 0))?,
        None if document.scene.is_some() => return Err("shows a scene that is not there".to_owned()),
        None if document.nodes.is_empty() => {
            (0..document.meshes.len()).try_for_each(|mesh| scene.show(mesh, &origin))?;
        }
        None => {
            let mut below = vec![false; document.nodes.len()];
            let children = document.nodes.iter().flat_map(|node| &node.children);
            children.for_each(|i| below.get_mut(*i).into_iter().for_each(|b| *b = true));
            let roots = (0..below.len()).filter(|i| !below[*i]);
            roots.into_iter().try_for_each(|node| scene.node(node, &origin, 0))?;
        }
    }
    // glTF defines y as up.
    Ok(Parsed { mesh: scene.mesh, y_up: true, notes: Vec::new() })
}

/// Rejects extensions that change the positions of triangles: compression, quantization and instancing.
fn refuse_extension(name: &str) -> Result<(), String> {
    if !name.contains("mesh") {
        return Ok(());
    }
    Err(format!("needs `{}`: export it without compression and instancing", mobee_text::printable(name)))
}

impl GlbNode {
    /// `parent_from_node`.
    fn place(&self) -> Matrix4<f64> {
        if let Some(columns) = self.matrix {
            return Matrix4::from_column_slice(&columns);
        }
        let [x, y, z, w] = self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let turn = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-12).unwrap_or_default();
        let scale = Vector3::from(self.scale.unwrap_or([1.0; 3]));
        let at = Translation3::from(Vector3::from(self.translation));
        at.to_homogeneous() * turn.to_homogeneous() * Matrix4::new_nonuniform_scaling(&scale)
    }
}

/// State of the reader.
struct GlbReader<'d> {
    document: &'d GlbDocument,
    /// The buffer of the file.
    binary: &'d [u8],
    /// The surface so far, meters.
    mesh: Mesh,
    instances: usize,
}

impl GlbReader<'_> {
    fn count(&mut self) -> Result<(), String> {
        self.instances += 1;
        if self.instances > MAX_INSTANCES {
            return Err(format!("shows more than {MAX_INSTANCES} instances"));
        }
        Ok(())
    }

    /// Adds a node and all nodes below it. `above` is the transform from its parent's frame to the mesh's.
    fn node(&mut self, index: usize, above: &Matrix4<f64>, depth: usize) -> Result<(), String> {
        self.count()?;
        if depth > MAX_DEPTH {
            return Err(format!("has nodes nested more than {MAX_DEPTH} deep"));
        }
        let node = self.document.nodes.get(index).ok_or_else(|| format!("shows node {index}, which is not there"))?;
        node.extensions.keys().try_for_each(|e| refuse_extension(e))?;
        if node.skin.is_some() {
            return Err("has a skin that bones move: export it as a plain mesh".to_owned());
        }
        let here = above * node.place();
        if let Some(mesh) = node.mesh {
            self.show(mesh, &here)?;
        }
        node.children.iter().try_for_each(|child| self.node(*child, &here, depth + 1))
    }

    /// Adds the triangles of a mesh. Points and lines are skipped.
    fn show(&mut self, index: usize, place: &Matrix4<f64>) -> Result<(), String> {
        self.count()?;
        let mesh = self.document.meshes.get(index).ok_or_else(|| format!("shows mesh {index}, which is not there"))?;
        for primitive in &mesh.primitives {
            let mode = match primitive.mode.unwrap_or(4) {
                0..=3 => continue,
                mode @ 4..=6 => mode,
                other => return Err(format!("has mesh {index} in the unknown mode {other}")),
            };
            let position =
                primitive.attributes.position.ok_or_else(|| format!("has mesh {index} without positions"))?;
            let first = self.mesh.vertices.len();
            let (kind, places) = self.elements(position, "VEC3")?;
            if kind != FLOAT {
                return Err(
                    "has vertices that are no floating-point numbers: export it without quantization".to_owned()
                );
            }
            let number = |bytes: &[u8], i: usize| {
                let word = bytes.get(4 * i..4 * i + 4).and_then(|w| w.try_into().ok()).unwrap_or([0; 4]);
                f64::from(f32::from_le_bytes(word))
            };
            let new: Vec<Vector3<f64>> = places
                .iter()
                .map(|p| place.transform_point(&Point3::new(number(p, 0), number(p, 1), number(p, 2))).coords)
                .collect();
            let corners: Vec<u32> = match primitive.indices {
                None => (0..new.len() as u32).collect(),
                Some(indices) => self.elements(indices, "SCALAR")?.1.into_iter().map(whole).collect(),
            };
            if let Some(beyond) = corners.iter().find(|i| **i as usize >= new.len()) {
                return Err(format!(
                    "has a triangle with corner {beyond}, which is none of its {} vertices",
                    new.len()
                ));
            }
            if first + new.len() > MAX_VERTICES {
                return Err(format!("has more than {MAX_VERTICES} vertices: simplify it"));
            }
            self.mesh.vertices.extend(new);
            let corner = |i: usize| corners.get(i).map(|c| first as u32 + c);
            if mode == 4 && !corners.len().is_multiple_of(3) {
                return Err(format!("is cut off: mesh {index} ends within a triangle"));
            }
            let triangles = match mode {
                4 => corners.len() / 3,
                _ => corners.len().saturating_sub(2),
            };
            for i in 0..triangles {
                let at = match mode {
                    4 => [3 * i, 3 * i + 1, 3 * i + 2],
                    5 => [i, i + 1, i + 2],
                    _ => [0, i + 1, i + 2],
                };
                if let [Some(a), Some(b), Some(c)] = at.map(corner) {
                    add_triangle(&mut self.mesh, [a, b, c])?;
                }
            }
        }
        Ok(())
    }

    /// The component type of an accessor, and the bytes of each of its elements.
    fn elements(&self, index: usize, kind: &str) -> Result<(u32, Vec<&[u8]>), String> {
        let wrong = |what: &str| format!("has an accessor {index} {what}");
        let accessor = self.document.accessors.get(index).ok_or_else(|| wrong("that is not there"))?;
        if accessor.r#type != kind {
            return Err(wrong(&format!("that is no plain list of {kind}")));
        }
        let bytes = |number: u32| NUMBERS.iter().find(|(known, _)| *known == number).map(|(_, bytes)| *bytes);
        let number = accessor.component_type;
        let size = bytes(number).ok_or_else(|| wrong("of unknown numbers"))? * if kind == "VEC3" { 3 } else { 1 };
        let mut all = match (accessor.buffer_view, &accessor.sparse) {
            (Some(view), _) => self.list(view, accessor.byte_offset, size, accessor.count).map_err(|e| wrong(&e))?,
            (None, Some(_)) if accessor.count <= MAX_VERTICES => {
                vec![ZEROS.get(..size).unwrap_or_default(); accessor.count]
            }
            _ => return Err(wrong("without a view")),
        };
        if let Some(Sparse { count, indices, values }) = &accessor.sparse {
            let wide = bytes(indices.component_type).ok_or_else(|| wrong("of unknown numbers"))?;
            let which = self.list(indices.buffer_view, indices.byte_offset, wide, *count).map_err(|e| wrong(&e))?;
            let what = self.list(values.buffer_view, values.byte_offset, size, *count).map_err(|e| wrong(&e))?;
            for (which, what) in which.into_iter().zip(what) {
                *all.get_mut(whole(which) as usize).ok_or_else(|| wrong("that changes what it does not have"))? = what;
            }
        }
        Ok((number, all))
    }

    /// The elements of a view, of `size` bytes each.
    fn list(&self, view: usize, offset: usize, size: usize, count: usize) -> Result<Vec<&[u8]>, String> {
        let view = self.document.buffer_views.get(view).ok_or("without a view")?;
        let elsewhere = self.document.buffers.first().is_some_and(|buffer| buffer.uri.is_some());
        if view.buffer != 0 || elsewhere || self.binary.is_empty() {
            return Err("whose buffer is in another file: export it as one `.glb`".to_owned());
        }
        let stride = view.byte_stride.unwrap_or(size).max(size);
        let bounds = || {
            let view_end = view.byte_offset.checked_add(view.byte_length).filter(|end| *end <= self.binary.len())?;
            let start = view.byte_offset.checked_add(offset)?;
            let last = count.saturating_sub(1).checked_mul(stride)?;
            let end = start.checked_add(last)?.checked_add(if count > 0 { size } else { 0 })?;
            (end <= view_end).then_some(start)
        };
        let start = bounds().ok_or("that reaches beyond its view")?;
        if count > MAX_VERTICES {
            return Err(format!("of more than {MAX_VERTICES} elements: simplify it"));
        }
        let element = |i: usize| self.binary.get(start + i * stride..start + i * stride + size).unwrap_or_default();
        Ok((0..count).map(element).collect())
    }
}

/// Decodes a little-endian unsigned integer of one to four bytes.
fn whole(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |all, byte| (all << 8) | u32::from(*byte))
}
