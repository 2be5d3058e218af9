//! COLLADA: the surfaces that its scene shows, each where the scene's nodes put it.
//!
//! The file's unit counts, its `up_axis` as a rule does not. So it is in what people look at and check URDF with: RViz, MoveIt and
//! coal take a file's unit and the transforms of its nodes, and undo the turn that their common reader makes for `up_axis`. Files are
//! therefore drawn in the link's axes whatever they declare; a third of the COLLADA files of known robots say `Y_UP`, and
//! turning those would break most of the robots. For the others see `upright`.

use super::{MAX_TRIANGLES, add_polygon, add_triangle};
use crate::Mesh;
use crate::error::Source;
use crate::xml::{self, XmlElement};
use nalgebra::{Matrix4, Point3, Rotation3, Translation3, Unit, Vector3};
use std::collections::BTreeMap;

/// More instances of nodes and geometries are refused: a few nodes that show each other twice make any number.
const MAX_INSTANCES: usize = 10_000;
/// Nodes may be nested so deep, by instances as well.
const MAX_DEPTH: usize = 50;
/// More vertices of all instances together are refused.
const MAX_VERTICES: usize = 3 * MAX_TRIANGLES;
/// How much text of lists may be read, those counted again that are shown again, bytes.
const MAX_LISTS: usize = 256 << 20;

/// Reads a COLLADA file; also answers whether it declares that y is up.
///
/// # Errors
/// What is wrong with it, as the end of a sentence.
pub(super) fn parse(bytes: &[u8]) -> Result<(Mesh, bool), String> {
    let text = std::str::from_utf8(bytes).map_err(|e| format!("is not UTF-8 text at byte {}", e.valid_up_to() + 1))?;
    let source = Source::new("mesh", text.strip_prefix('\u{feff}').unwrap_or(text));
    let root = xml::parse(&source).map_err(|e| format!("cannot be read: line {}: {}", e.line(), e.message()))?;
    if root.name != "COLLADA" {
        return Err(format!("is no COLLADA file: it begins with <{}>", root.name));
    }
    let mut ids = BTreeMap::new();
    collect_ids(&root, &mut ids);
    let mut scene = Scene { text: source.text(), ids, mesh: Mesh::default(), instances: 0, left: MAX_LISTS };
    let unit = scene.unit(&root)?;
    let shown = root.child("scene").and_then(|s| s.child("instance_visual_scene")).and_then(|i| scene.target(i, "url"));
    let library = || root.child("library_visual_scenes")?.child("visual_scene");
    match shown.or_else(library) {
        Some(shown) => scene.nodes(shown, &unit, 0)?,
        None => {
            for geometry in root.all("library_geometries").flat_map(|l| l.all("geometry")) {
                scene.geometry(geometry, &unit)?;
            }
        }
    }
    let up = root.child("asset").and_then(|a| a.child("up_axis")).map(|u| source.text()[u.inner.clone()].trim());
    Ok((scene.mesh, up == Some("Y_UP")))
}

/// All elements that have an `id`.
fn collect_ids<'d>(element: &'d XmlElement, ids: &mut BTreeMap<&'d str, &'d XmlElement>) {
    if let Some(id) = element.get("id") {
        ids.entry(id).or_insert(element);
    }
    element.children.iter().for_each(|c| collect_ids(c, ids));
}

/// What is shown so far, and where the rest is found.
struct Scene<'d> {
    /// The file.
    text: &'d str,
    /// Its elements that others refer to.
    ids: BTreeMap<&'d str, &'d XmlElement>,
    /// What is shown so far, meters.
    mesh: Mesh,
    /// How many instances were made.
    instances: usize,
    /// How much text of lists may still be read, bytes.
    left: usize,
}

impl<'d> Scene<'d> {
    /// The element that an attribute such as `url="#id"` refers to, within this file.
    fn target(&self, element: &XmlElement, attribute: &str) -> Option<&'d XmlElement> {
        self.ids.get(element.get(attribute)?.strip_prefix('#')?).copied()
    }

    /// As [`Self::target`], for what must be there.
    fn refer(&self, element: &XmlElement, attribute: &str) -> Result<&'d XmlElement, String> {
        self.target(element, attribute).ok_or_else(|| {
            let what = element.get(attribute).unwrap_or_default();
            format!("refers to `{what}` in <{}>, which is not in the file", element.name)
        })
    }

    /// From the file's unit to meters.
    fn unit(&self, root: &XmlElement) -> Result<Matrix4<f64>, String> {
        let unit = root.child("asset").and_then(|a| a.child("unit")).and_then(|u| u.get("meter"));
        let meter = unit.map_or(Some(1.0), |u| u.parse::<f64>().ok()).filter(|m| m.is_finite() && *m > 0.0);
        meter.map(Matrix4::new_scaling).ok_or_else(|| "has a unit that is not a number above zero".to_owned())
    }

    /// Shows all nodes within an element. `to_meters` leads from its frame to the mesh's.
    fn nodes(&mut self, parent: &'d XmlElement, to_meters: &Matrix4<f64>, depth: usize) -> Result<(), String> {
        if depth > MAX_DEPTH {
            return Err(format!("has nodes nested more than {MAX_DEPTH} deep"));
        }
        for child in &parent.children {
            match child.name.as_str() {
                "node" => self.node(child, to_meters, depth)?,
                "instance_node" => {
                    self.count()?;
                    let node = self.refer(child, "url")?;
                    self.node(node, to_meters, depth)?;
                }
                "instance_geometry" => {
                    self.count()?;
                    let geometry = self.refer(child, "url")?;
                    self.geometry(geometry, to_meters)?;
                }
                "instance_controller" => return Err("has a skin that bones move: export it as a plain mesh".to_owned()),
                _ => {}
            }
        }
        Ok(())
    }

    fn node(&mut self, node: &'d XmlElement, to_meters: &Matrix4<f64>, depth: usize) -> Result<(), String> {
        let here = to_meters * self.transform(node)?;
        self.nodes(node, &here, depth + 1)
    }

    fn count(&mut self) -> Result<(), String> {
        self.instances += 1;
        if self.instances > MAX_INSTANCES {
            return Err(format!("shows more than {MAX_INSTANCES} instances"));
        }
        Ok(())
    }

    /// A node's transforms, in their order: the last one acts first.
    fn transform(&mut self, node: &XmlElement) -> Result<Matrix4<f64>, String> {
        let mut transform = Matrix4::identity();
        for child in &node.children {
            let name = child.name.as_str();
            if !matches!(name, "matrix" | "translate" | "rotate" | "scale" | "lookat" | "skew") {
                continue;
            }
            let numbers = self.numbers(child)?;
            transform *= match (name, numbers.as_slice()) {
                ("matrix", rows) if rows.len() == 16 => Matrix4::from_row_slice(rows),
                ("translate", &[x, y, z]) => Translation3::new(x, y, z).to_homogeneous(),
                ("scale", &[x, y, z]) => Matrix4::new_nonuniform_scaling(&Vector3::new(x, y, z)),
                ("rotate", &[x, y, z, degrees]) => match Unit::try_new(Vector3::new(x, y, z), 1e-12) {
                    Some(axis) => Rotation3::from_axis_angle(&axis, degrees.to_radians()).to_homogeneous(),
                    None => Matrix4::identity(),
                },
                _ => return Err(format!("has a <{name}> that cannot be read")),
            };
        }
        Ok(transform)
    }

    /// The words that an element contains.
    fn words(&mut self, element: &XmlElement) -> Result<impl Iterator<Item = &'d str> + use<'d>, String> {
        let left = self.left.checked_sub(element.inner.len());
        self.left = left.ok_or("shows too much: the same large lists again and again")?;
        Ok(self.text.get(element.inner.clone()).unwrap_or_default().split_ascii_whitespace())
    }

    /// The numbers that an element contains.
    fn numbers(&mut self, element: &XmlElement) -> Result<Vec<f64>, String> {
        let numbers: Option<Vec<f64>> = self.words(element)?.map(|w| w.parse().ok()).collect();
        numbers.ok_or_else(|| format!("has a <{}> of other things than numbers", element.name))
    }

    /// Adds a geometry's surfaces.
    fn geometry(&mut self, geometry: &'d XmlElement, to_meters: &Matrix4<f64>) -> Result<(), String> {
        let Some(mesh) = geometry.child("mesh") else {
            return Err("has a geometry that is not a mesh of polygons".to_owned());
        };
        // Several surfaces of a geometry mostly share one list of positions.
        let mut placed: Option<(&XmlElement, u32, u32)> = None;
        for surface in &mesh.children {
            if !matches!(surface.name.as_str(), "triangles" | "polylist" | "polygons" | "trifans" | "tristrips") {
                continue;
            }
            let layout = self.layout(surface)?;
            let (first, count) = match placed {
                Some((source, first, count)) if std::ptr::eq(source, layout.source) => (first, count),
                _ => {
                    let first = self.mesh.vertices.len() as u32;
                    self.positions(layout.source, to_meters)?;
                    let count = self.mesh.vertices.len() as u32 - first;
                    placed = Some((layout.source, first, count));
                    (first, count)
                }
            };
            self.surface(surface, &layout, first, count)?;
        }
        Ok(())
    }

    /// Where a surface finds its positions.
    fn layout(&self, surface: &XmlElement) -> Result<Layout<'d>, String> {
        let offset = |input: &XmlElement| input.get("offset").unwrap_or("0").parse::<usize>().ok().filter(|o| *o < 64);
        let bad = || format!("has a <{}> without readable inputs", surface.name);
        let mut layout = None;
        let mut stride = 0;
        for input in surface.all("input") {
            let offset = offset(input).ok_or_else(bad)?;
            stride = stride.max(offset + 1);
            if input.get("semantic") == Some("VERTEX") {
                let vertices = self.refer(input, "source")?;
                let position = vertices.all("input").find(|i| i.get("semantic") == Some("POSITION")).ok_or_else(bad)?;
                layout = Some((offset, self.refer(position, "source")?));
            }
        }
        let (offset, source) = layout.ok_or_else(bad)?;
        Ok(Layout { offset, stride, source })
    }

    /// Adds a source's positions to the mesh's vertices.
    fn positions(&mut self, source: &XmlElement, to_meters: &Matrix4<f64>) -> Result<(), String> {
        let array = source.child("float_array").ok_or("has positions that are not a list of numbers")?;
        let numbers = self.numbers(array)?;
        let accessor = source.child("technique_common").and_then(|t| t.child("accessor"));
        let size = |name: &str, default: usize| {
            let text = accessor.and_then(|a| a.get(name));
            text.map_or(Some(default), |t| t.parse().ok()).ok_or_else(|| format!("has an unreadable {name}"))
        };
        let (offset, stride) = (size("offset", 0)?, size("stride", 3)?);
        if !(3..64).contains(&stride) {
            return Err("has positions that are not three numbers each".to_owned());
        }
        let places = numbers.get(offset..).unwrap_or_default().chunks(stride).filter(|c| c.len() >= 3);
        let place = |c: &[f64]| to_meters.transform_point(&Point3::new(c[0], c[1], c[2])).coords;
        self.mesh.vertices.extend(places.map(place).take(MAX_VERTICES + 1 - self.mesh.vertices.len()));
        if self.mesh.vertices.len() > MAX_VERTICES {
            return Err(format!("has more than {MAX_VERTICES} vertices: simplify it"));
        }
        Ok(())
    }

    /// Adds the triangles of a surface, whose positions are `count` vertices from `first`.
    fn surface(&mut self, surface: &XmlElement, layout: &Layout<'_>, first: u32, count: u32) -> Result<(), String> {
        let lists = surface.all("p").chain(surface.all("ph").filter_map(|holed| holed.child("p")));
        let mut sizes = match surface.child("vcount") {
            Some(sizes) => Some(self.numbers(sizes)?.into_iter().map(|n| n as usize)),
            None => None,
        };
        for list in lists {
            let corner = |word: &str| match word.parse::<u32>() {
                Ok(i) if i < count => Ok(first + i),
                _ => Err(format!(
                    "has a corner `{}` that is none of its {count} vertices",
                    word.get(..20).unwrap_or(word)
                )),
            };
            let mut corners = self.words(list)?.skip(layout.offset).step_by(layout.stride).map(corner);
            match surface.name.as_str() {
                "triangles" => {
                    let all = corners.collect::<Result<Vec<u32>, String>>()?;
                    all.chunks_exact(3).try_for_each(|t| add_triangle(&mut self.mesh, [t[0], t[1], t[2]]))?;
                }
                "polylist" => {
                    for size in sizes.as_mut().into_iter().flatten() {
                        let polygon: Vec<u32> = corners.by_ref().take(size).collect::<Result<_, _>>()?;
                        if polygon.len() < size {
                            return Err("is cut off: a polygon has too few corners".to_owned());
                        }
                        add_polygon(&mut self.mesh, &polygon)?;
                    }
                }
                "tristrips" => {
                    let all = corners.collect::<Result<Vec<u32>, String>>()?;
                    all.windows(3).try_for_each(|t| add_triangle(&mut self.mesh, [t[0], t[1], t[2]]))?;
                }
                // polygons and fans are one list each
                _ => add_polygon(&mut self.mesh, &corners.collect::<Result<Vec<u32>, String>>()?)?,
            }
        }
        Ok(())
    }
}

/// How a surface's list of numbers is read.
struct Layout<'d> {
    /// Which number of each corner is its position.
    offset: usize,
    /// How many numbers each corner has.
    stride: usize,
    /// Where the positions are.
    source: &'d XmlElement,
}
