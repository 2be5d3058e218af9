//! COLLADA: the surfaces in its scene, transformed by the scene's nodes.
//!
//! The file's unit is applied; its `up_axis` usually is not. This agrees with the programs in which URDF files are
//! displayed and checked: RViz, MoveIt and coal apply a file's unit and the transforms of its nodes, and undo the
//! rotation that their common reader applies for `up_axis`. Files are therefore drawn in the link's axes regardless of
//! their declaration: a third of the COLLADA files of known robots declare `Y_UP`, and rotating these would break most
//! of the robots. For the exceptions see `upright`.

use super::{MAX_TRIANGLES, Parsed, add_polygon, add_triangle, decoded};
use mobee_model::Mesh;
use mobee_text::SourceText;
use mobee_text::xml::{self, XmlElement, XmlLimits};
use nalgebra::{Matrix4, Point3, Rotation3, Translation3, Unit, Vector3};
use percent_encoding::percent_decode_str;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Maximum number of instances of nodes and geometries: a few nodes that instantiate each other twice can create any
/// number.
const MAX_INSTANCES: usize = 10_000;
/// Maximum nesting depth of nodes, including instances.
const MAX_DEPTH: usize = 50;
/// Maximum number of vertices of all instances together.
const MAX_VERTICES: usize = 3 * MAX_TRIANGLES;
/// Maximum amount of text of geometries and of their lists, in bytes, with repeated instances counted again.
const MAX_SHOWN: usize = 512 << 20;
/// Limits of the XML parser: a file may have one element per polygon, and names may contain hidden characters.
const LIMITS: XmlLimits = XmlLimits { elements: 2 * MAX_TRIANGLES, visible_only: false };
/// The kinds of elements that others refer to, each with its own ids.
const REFERRED_TO: [&str; 6] = ["visual_scene", "node", "geometry", "vertices", "source", "float_array"];

/// Reads a COLLADA file.
///
/// # Errors
/// The reason, as the end of a sentence.
pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, String> {
    let source = SourceText::new("mesh", &decoded(bytes));
    let root = xml::parse_within(&source, &LIMITS).map_err(|e| {
        let unreadable = format!("cannot be read: line {}: {}", e.line(), e.message());
        match std::str::from_utf8(bytes) {
            Ok(_) => unreadable,
            Err(not_text) => format!("is not UTF-8 text at byte {}, and {unreadable}", not_text.valid_up_to() + 1),
        }
    })?;
    if root.name != "COLLADA" {
        return Err(format!("is no COLLADA file: it begins with <{}>", root.name));
    }
    let mut ids = BTreeMap::new();
    collect_ids(&root, &mut ids);
    let mut scene = DaeReader { text: source.text(), ids, mesh: Mesh::default(), instances: 0, left: MAX_SHOWN };
    let unit = scene.unit(&root)?;
    match scene.shown(&root)? {
        Some(shown) => scene.nodes(shown, &unit, 0)?,
        None => {
            for geometry in root.all("library_geometries").flat_map(|l| l.all("geometry")) {
                scene.geometry(geometry, &unit)?;
            }
        }
    }
    let up = root.child("asset").and_then(|a| a.child("up_axis")).map(|u| source.text()[u.inner.clone()].trim());
    Ok(Parsed { mesh: scene.mesh, y_up: up == Some("Y_UP"), notes: Vec::new() })
}

/// Elements by kind and `id`; `None` if several of a kind have the same id.
type Ids<'d> = BTreeMap<(&'d str, &'d str), Option<&'d XmlElement>>;

/// Collects all elements that others may refer to.
fn collect_ids<'d>(element: &'d XmlElement, ids: &mut Ids<'d>) {
    collect_id(element, ids);
    element.children.iter().for_each(|c| collect_ids(c, ids));
}

/// Adds an element, if others may refer to it.
fn collect_id<'d>(element: &'d XmlElement, ids: &mut Ids<'d>) {
    if let Some(id) = element.get("id")
        && REFERRED_TO.contains(&element.name.as_str())
    {
        ids.entry((&element.name, id)).and_modify(|first| *first = None).or_insert(Some(element));
    }
}

/// State of the reader.
struct DaeReader<'d> {
    /// The file.
    text: &'d str,
    /// The elements that others refer to.
    ids: Ids<'d>,
    /// The surface so far, meters.
    mesh: Mesh,
    /// Number of instances so far.
    instances: usize,
    /// Remaining amount of text that may be read, bytes.
    left: usize,
}

impl<'d> DaeReader<'d> {
    /// The element of a kind that an attribute such as `url="#id"` refers to, within this file.
    fn target(&self, element: &XmlElement, attribute: &str, kind: &str) -> Option<&'d XmlElement> {
        let id = element.get(attribute)?.strip_prefix('#')?;
        let decoded = percent_decode_str(id).decode_utf8_lossy();
        [id, &decoded].into_iter().find_map(|id| self.ids.get(&(kind, id)).copied().flatten())
    }

    /// As [`Self::target`], for a mandatory reference.
    fn refer(&self, element: &XmlElement, attribute: &str, kind: &str) -> Result<&'d XmlElement, String> {
        self.target(element, attribute, kind).ok_or_else(|| {
            let what = element.get(attribute).unwrap_or_default();
            format!("refers to `{what}` in {}, and no <{kind}> of the file has that id alone", self.tag(element))
        })
    }

    /// An element with its line, for messages.
    fn tag(&self, element: &XmlElement) -> String {
        let before = self.text.get(..element.at.start).unwrap_or_default();
        format!("<{}> in line {}", element.name, before.matches('\n').count() + 1)
    }

    /// The scene to show, if the file has any.
    fn shown(&self, root: &'d XmlElement) -> Result<Option<&'d XmlElement>, String> {
        let scenes: Vec<_> = root.all("library_visual_scenes").flat_map(|l| l.all("visual_scene")).collect();
        let instance = root.child("scene").and_then(|s| s.child("instance_visual_scene"));
        match (instance.and_then(|i| self.target(i, "url", "visual_scene")), scenes.as_slice()) {
            (Some(scene), _) => Ok(Some(scene)),
            (None, []) => Ok(None),
            (None, [only]) => Ok(Some(only)),
            (None, several) => Err(format!("has {} scenes, and its <scene> names none of them", several.len())),
        }
    }

    /// The transform from the file's unit to meters.
    fn unit(&self, root: &XmlElement) -> Result<Matrix4<f64>, String> {
        let unit = root.child("asset").and_then(|a| a.child("unit")).and_then(|u| u.get("meter"));
        let meter = unit.map_or(Some(1.0), |u| u.parse::<f64>().ok()).filter(|m| m.is_finite() && *m > 0.0);
        meter.map(Matrix4::new_scaling).ok_or_else(|| "has a unit that is not a number above zero".to_owned())
    }

    /// Adds all nodes within an element. `to_meters` is the transform from its frame to the mesh's.
    fn nodes(&mut self, parent: &'d XmlElement, to_meters: &Matrix4<f64>, depth: usize) -> Result<(), String> {
        if depth > MAX_DEPTH {
            return Err(format!("has nodes nested more than {MAX_DEPTH} deep"));
        }
        for child in &parent.children {
            match child.name.as_str() {
                "node" => self.node(child, to_meters, depth)?,
                "instance_node" => {
                    self.count()?;
                    let node = self.refer(child, "url", "node")?;
                    self.node(node, to_meters, depth)?;
                }
                "instance_geometry" => {
                    self.count()?;
                    let geometry = self.refer(child, "url", "geometry")?;
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

    /// A node's transforms, in order: the last one is applied first.
    fn transform(&mut self, node: &XmlElement) -> Result<Matrix4<f64>, String> {
        let mut transform = Matrix4::identity();
        for child in &node.children {
            let name = child.name.as_str();
            if !matches!(name, "matrix" | "translate" | "rotate" | "scale" | "lookat" | "skew") {
                continue;
            }
            let numbers: Vec<f64> = self.numbers(child)?;
            transform *= match (name, numbers.as_slice()) {
                ("matrix", rows) if rows.len() == 16 => Matrix4::from_row_slice(rows),
                ("translate", &[x, y, z]) => Translation3::new(x, y, z).to_homogeneous(),
                ("scale", &[x, y, z]) => Matrix4::new_nonuniform_scaling(&Vector3::new(x, y, z)),
                ("rotate", &[x, y, z, degrees]) => match Unit::try_new(Vector3::new(x, y, z), 1e-12) {
                    Some(axis) => Rotation3::from_axis_angle(&axis, degrees.to_radians()).to_homogeneous(),
                    None => Matrix4::identity(),
                },
                ("lookat", &[ex, ey, ez, tx, ty, tz, ux, uy, uz]) => {
                    look_at(&Vector3::new(ex, ey, ez), &Vector3::new(tx, ty, tz), &Vector3::new(ux, uy, uz))
                }
                ("skew", _) => {
                    return Err(format!("has a {}, which is not read: apply the transforms of nodes", self.tag(child)));
                }
                _ => return Err(format!("has a {} that cannot be read", self.tag(child))),
            };
        }
        Ok(transform)
    }

    /// Subtracts the text of an element from the remaining amount.
    fn charge(&mut self, element: &XmlElement) -> Result<(), String> {
        let left = self.left.checked_sub(element.inner.len());
        self.left = left.ok_or("shows too much: the same large lists again and again")?;
        Ok(())
    }

    /// The text of an element, without comments.
    fn content(&mut self, element: &XmlElement) -> Result<Cow<'d, str>, String> {
        self.charge(element)?;
        let text = self.text.get(element.inner.clone()).unwrap_or_default();
        if !text.contains(['<', '&']) {
            return Ok(Cow::Borrowed(text));
        }
        let content = xml::text_of(text).map(Cow::Owned);
        content.ok_or_else(|| format!("has a {} of other things than text", self.tag(element)))
    }

    /// The numbers of an element.
    fn numbers<T: std::str::FromStr>(&mut self, element: &XmlElement) -> Result<Vec<T>, String> {
        let numbers: Option<Vec<T>> = self.content(element)?.split_ascii_whitespace().map(|w| w.parse().ok()).collect();
        numbers.ok_or_else(|| format!("has a {} of other things than numbers", self.tag(element)))
    }

    /// A count that an element declares; `None` if there is none.
    fn stated(&self, element: &XmlElement, name: &str) -> Result<Option<usize>, String> {
        let number =
            |text: &str| text.parse().map_err(|_| format!("has an unreadable {name} of {}", self.tag(element)));
        element.get(name).map(number).transpose()
    }

    /// Adds a geometry's surfaces; lines and curves have none.
    fn geometry(&mut self, geometry: &'d XmlElement, to_meters: &Matrix4<f64>) -> Result<(), String> {
        if let Some(other) = geometry.child("convex_mesh").or_else(|| geometry.child("brep")) {
            return Err(format!("has a {}, which is not a mesh of polygons", self.tag(other)));
        }
        // The surfaces of a geometry usually share one list of positions.
        let mut placed: Option<(&XmlElement, u32, u32)> = None;
        let Some(mesh) = geometry.child("mesh") else { return Ok(()) };
        self.charge(mesh)?;
        let mut own = Ids::new();
        mesh.children.iter().for_each(|child| collect_id(child, &mut own));
        for surface in &mesh.children {
            if !matches!(surface.name.as_str(), "triangles" | "polylist" | "polygons" | "trifans" | "tristrips") {
                continue;
            }
            let lists = || surface.all("p").chain(surface.all("ph").filter_map(|holed| holed.child("p")));
            if lists().next().is_none() && self.stated(surface, "count")?.unwrap_or(0) == 0 {
                continue;
            }
            let layout = self.layout(&own, surface)?;
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
            let mut polygons = Vec::new();
            for list in lists() {
                polygons.push(self.corners(list, &layout, first, count)?);
            }
            self.surface(surface, polygons)?;
        }
        Ok(())
    }

    /// The layout of a surface's lists. References are searched among the sources of its own mesh first.
    fn layout(&self, own: &Ids<'d>, surface: &XmlElement) -> Result<SourceLayout<'d>, String> {
        let offset = |input: &XmlElement| input.get("offset").unwrap_or("0").parse::<usize>().ok().filter(|o| *o < 64);
        let bad = || format!("has a {} without readable inputs", self.tag(surface));
        let refer = |input: &XmlElement, kind: &'static str| {
            let id = input.get("source").and_then(|s| s.strip_prefix('#'));
            let found = id.and_then(|id| own.get(&(kind, id)).copied().flatten());
            found.map_or_else(|| self.refer(input, "source", kind), Ok)
        };
        let mut layout = None;
        let mut stride = 0;
        for input in surface.all("input") {
            let offset = offset(input).ok_or_else(bad)?;
            stride = stride.max(offset + 1);
            if input.get("semantic") == Some("VERTEX") {
                let vertices = refer(input, "vertices")?;
                let position = vertices.all("input").find(|i| i.get("semantic") == Some("POSITION")).ok_or_else(bad)?;
                layout = Some((offset, refer(position, "source")?));
            }
        }
        let (offset, source) = layout.ok_or_else(bad)?;
        Ok(SourceLayout { offset, stride, source })
    }

    /// Adds a source's positions to the mesh's vertices.
    fn positions(&mut self, source: &'d XmlElement, to_meters: &Matrix4<f64>) -> Result<(), String> {
        let accessor = source.child("technique_common").and_then(|t| t.child("accessor"));
        let of_other = accessor.and_then(|a| self.target(a, "source", "float_array"));
        let array = source.child("float_array").or(of_other).ok_or("has positions that are not a list of numbers")?;
        let numbers: Vec<f64> = self.numbers(array)?;
        let stated = |name| accessor.map_or(Ok(None), |a| self.stated(a, name));
        let offset = stated("offset")?.unwrap_or(0);
        let stride = stated("stride")?.unwrap_or(3);
        if !(3..64).contains(&stride) {
            return Err("has positions that are not three numbers each".to_owned());
        }
        let places = stated("count")?.unwrap_or(0);
        let reach = places.saturating_sub(1).saturating_mul(stride).saturating_add(offset).saturating_add(3);
        let claimed = self.stated(array, "count")?.unwrap_or(0).max(if places > 0 { reach } else { 0 });
        if numbers.len() < claimed {
            let list = self.tag(array);
            let there = numbers.len();
            return Err(format!("is cut off: {list} should have {claimed} numbers and has {there}"));
        }
        let named = |name| accessor?.all("param").position(|p| p.get("name") == Some(name));
        let [x, y, z] = match (named("X"), named("Y"), named("Z")) {
            (Some(x), Some(y), Some(z)) if x.max(y).max(z) < stride => [x, y, z],
            _ => [0, 1, 2],
        };
        let place = |c: &[f64]| Some(Point3::new(*c.get(x)?, *c.get(y)?, *c.get(z)?));
        let places = numbers.get(offset..).unwrap_or_default().chunks(stride).filter_map(place);
        let places = places.map(|place| to_meters.transform_point(&place).coords);
        self.mesh.vertices.extend(places.take(MAX_VERTICES + 1 - self.mesh.vertices.len()));
        if self.mesh.vertices.len() > MAX_VERTICES {
            return Err(format!("has more than {MAX_VERTICES} vertices: simplify it"));
        }
        Ok(())
    }

    /// The corners in a list of a surface, whose positions are the `count` vertices starting at `first`.
    fn corners(
        &mut self,
        list: &XmlElement,
        layout: &SourceLayout<'_>,
        first: u32,
        count: u32,
    ) -> Result<Vec<u32>, String> {
        let content = self.content(list)?;
        let mut words = 0_usize;
        let mut corners = Vec::new();
        for (i, word) in content.split_ascii_whitespace().enumerate() {
            words = i + 1;
            if i % layout.stride == layout.offset {
                corners.push(word.parse::<u32>().ok().filter(|i| *i < count).map(|i| first + i).ok_or_else(|| {
                    let word: String = word.chars().take(20).collect();
                    format!("has a corner `{word}` that is none of its {count} vertices, of {}", self.tag(list))
                })?);
            }
        }
        if !words.is_multiple_of(layout.stride) {
            return Err(format!("is cut off: {} ends within a corner", self.tag(list)));
        }
        Ok(corners)
    }

    /// Adds the triangles of a surface, from the corners in each of its lists.
    fn surface(&mut self, surface: &XmlElement, lists: Vec<Vec<u32>>) -> Result<(), String> {
        let before = self.mesh.triangles.len();
        let wrong = |this: &Self, what: &str| Err(format!("is cut off: {} {what}", this.tag(surface)));
        let made = match surface.name.as_str() {
            "triangles" => {
                let all = lists.concat();
                if !all.len().is_multiple_of(3) {
                    return wrong(self, "ends within a triangle");
                }
                all.chunks_exact(3).try_for_each(|t| add_triangle(&mut self.mesh, [t[0], t[1], t[2]]))?;
                all.len() / 3
            }
            "polylist" => {
                let sizes: Vec<usize> = surface.child("vcount").map_or(Ok(Vec::new()), |sizes| self.numbers(sizes))?;
                let all = lists.concat();
                let mut rest = all.as_slice();
                for size in &sizes {
                    let Some((polygon, others)) = rest.split_at_checked(*size) else {
                        return wrong(self, "has a polygon with too few corners");
                    };
                    add_polygon(&mut self.mesh, polygon)?;
                    rest = others;
                }
                if !rest.is_empty() {
                    return wrong(self, "has more corners than its <vcount> states");
                }
                sizes.len()
            }
            "tristrips" => {
                let strip = |mesh: &mut Mesh, list: &Vec<u32>| {
                    list.windows(3).try_for_each(|t| add_triangle(mesh, [t[0], t[1], t[2]]))
                };
                lists.iter().try_for_each(|list| strip(&mut self.mesh, list))?;
                // Some programs count strips, and some triangles.
                lists.len().max(self.mesh.triangles.len() - before)
            }
            // Polygons and fans are one list each.
            _ => {
                lists.iter().try_for_each(|list| add_polygon(&mut self.mesh, list))?;
                lists.len().max(if surface.name == "trifans" { self.mesh.triangles.len() - before } else { 0 })
            }
        };
        match self.stated(surface, "count")? {
            Some(count) if count > made => wrong(self, &format!("should have {count} and has {made}")),
            _ => Ok(()),
        }
    }
}

/// Transform of an object at `eye` that looks at `target` along its -z axis, with its y axis toward `up`. Not finite
/// for degenerate input, which is frequent for cameras; they have no surface.
fn look_at(eye: &Vector3<f64>, target: &Vector3<f64>, up: &Vector3<f64>) -> Matrix4<f64> {
    let back = (eye - target).normalize();
    let right = up.cross(&back).normalize();
    let turn = Rotation3::from_basis_unchecked(&[right, back.cross(&right), back]);
    Translation3::from(*eye).to_homogeneous() * turn.to_homogeneous()
}

/// Layout of a surface's lists of numbers.
struct SourceLayout<'d> {
    /// Index of the position within the numbers of a corner.
    offset: usize,
    /// Count of numbers per corner.
    stride: usize,
    /// The source of the positions.
    source: &'d XmlElement,
}
