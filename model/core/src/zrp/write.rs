//! Writes a robot as ZRP XML that reads back to the same robot.
//!
//! All parts with their motors and constraints come first, then the tree, in which parts and motors are entered again
//! by name. So the order of parts, motors, nodes and markers is preserved for any nesting.

mod world;

pub use world::write_world;

use super::geometry;
use crate::{Hull, JointMotion, Marker, Motor, NearPair, Node, NodeKind, Primitive, Robot, Shape};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Writes a robot as a ZRP XML file. Numbers have the fewest digits that read back to the same value; a shape's
/// orientation, written as heading and angle, is preserved within rounding.
///
/// # Example
/// ```
/// use mobee_model::{parse_robot, write_robot};
///
/// let text = r#"<ZeroPositionKinematicTree robotName="bar"><bodypart name="arm">
///     <motor name="elbow" minPos="-90" maxPos="90"><joint z="1" minPos="-90" maxPos="90">
///     <link x="0.4" radius="0.02"/></joint></motor></bodypart></ZeroPositionKinematicTree>"#;
/// let robot = parse_robot("bar.xml", text)?.value;
/// assert_eq!(parse_robot("again.xml", &write_robot(&robot))?.value, robot);
/// # Ok::<(), mobee_model::FileError>(())
/// ```
pub fn write_robot(robot: &Robot) -> String {
    // Nodes and markers are numbered by their positions in the file. To preserve the numbers, a subtree must be written
    // when its lowest number is due, with markers among the nodes.
    let mut children = vec![Vec::new(); robot.nodes.len()];
    let mut roots = Vec::new();
    for (i, node) in robot.nodes.iter().enumerate() {
        node.parent.map_or(&mut roots, |p| &mut children[p]).push(i);
    }
    let mut markers: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    let mut first_marker = vec![usize::MAX; robot.nodes.len()];
    for (i, marker) in robot.markers.iter().enumerate() {
        markers.entry(marker.node).or_default().push(i);
        first_marker[marker.node] = first_marker[marker.node].min(i);
    }
    for (i, node) in robot.nodes.iter().enumerate().rev() {
        if let Some(parent) = node.parent {
            first_marker[parent] = first_marker[parent].min(first_marker[i]);
        }
    }
    let mut writer = ZrpWriter { robot, children, markers, first_marker, out: String::new(), depth: 0, current: None };
    writer.document(&roots);
    writer.out
}

/// State of the writer, and of the reader at this point of the file.
struct ZrpWriter<'a> {
    /// The robot to write.
    robot: &'a Robot,
    /// Per node its children, in ascending order, which is the order in which the reader will number them.
    children: Vec<Vec<usize>>,
    /// Markers by node, in order.
    markers: BTreeMap<usize, Vec<usize>>,
    /// The first marker in each node's subtree.
    first_marker: Vec<usize>,
    /// The text so far.
    out: String,
    /// Indentation level, two blanks each.
    depth: usize,
    /// The part that the reader takes as current here.
    current: Option<usize>,
}

/// Work items, the next on top: a stack instead of recursion, for trees of any depth.
enum PendingItem {
    Node(usize),
    Marker(usize),
    Close(&'static str),
    ClosePart,
}

impl ZrpWriter<'_> {
    /// Writes the complete file.
    fn document(&mut self, roots: &[usize]) {
        self.out.push_str("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
        let name = escape(&self.robot.name);
        self.open(&format!("ZeroPositionKinematicTree version=\"1.0\" robotName=\"{name}\""));
        for part in 0..self.robot.parts.len() {
            self.part(part);
        }
        let mut todo: Vec<PendingItem> = roots.iter().rev().map(|r| PendingItem::Node(*r)).collect();
        while let Some(next) = todo.pop() {
            match next {
                PendingItem::Close(name) => self.close(name),
                PendingItem::ClosePart => self.close_part(),
                PendingItem::Marker(marker) => self.marker(marker),
                PendingItem::Node(node) => self.node(node, &mut todo),
            }
        }
        self.left_out();
        for link in &self.robot.bare {
            self.line(&format!("bare link=\"{}\"", escape(link)));
        }
        self.close("ZeroPositionKinematicTree");
    }

    /// Writes the disabled pairs and those with a clearance of their own, if the robot lists them.
    fn left_out(&mut self) {
        let robot = self.robot;
        let Some(list) = &robot.left_out else { return };
        self.open("pairs");
        let name = |node: usize| robot.nodes.get(node).and_then(|n| n.name.as_deref()).unwrap_or_default();
        for pair in list {
            self.line(&left_out_tag((name(pair.nodes.0), name(pair.nodes.1)), &pair.reason));
        }
        for NearPair { nodes: (a, b), clearance, reason } in &robot.near {
            let [a, b] = [*a, *b].map(|node| escape(name(node)));
            self.line(&format!("near a=\"{a}\" b=\"{b}\" clearance=\"{clearance}\" reason=\"{}\"", escape(reason)));
        }
        self.close("pairs");
    }

    /// Writes a part's motors, the root motor first, and its constraints.
    fn part(&mut self, index: usize) {
        let part = &self.robot.parts[index];
        self.open(&format!("bodypart name=\"{}\"", escape(&part.name)));
        // The reader uses the first motor of a part as its root motor; `idx` preserves the order of motors.
        let mut motors: Vec<usize> = part.motors.clone().collect();
        motors.sort_by_key(|m| !self.robot.motors[*m].is_part_root);
        for m in motors {
            let motor = &self.robot.motors[m];
            self.line(&format!(
                "motor name=\"{}\" idx=\"{}\" minPos=\"{}\" maxPos=\"{}\" home=\"{}\"{}{}",
                escape(&motor.name),
                m - part.motors.start,
                degrees(motor.min),
                degrees(motor.max),
                degrees(motor.home),
                motor.max_speed.map(|v| format!(" maxSpeed=\"{}\"", degrees(v))).unwrap_or_default(),
                motion(self.robot, motor)
            ));
        }
        for clause in &part.clauses {
            self.open("constraintList");
            for member in &clause.0 {
                let a: Vec<String> = member.terms.iter().map(|t| t.1.to_string()).collect();
                let q: Vec<String> = member.terms.iter().map(|t| (t.0 - part.motors.start).to_string()).collect();
                self.line(&format!("constraint a=\"{}\" q=\"{}\" b=\"{}\"", a.join(" "), q.join(" "), member.b));
            }
            self.close("constraintList");
        }
        self.close("bodypart");
    }

    /// Opens a node, writes its shapes and pushes its contents and its end onto the stack. A joint is enclosed by its
    /// motor, a node of another part by that part.
    fn node(&mut self, index: usize, todo: &mut Vec<PendingItem>) {
        let robot = self.robot;
        let node = &robot.nodes[index];
        if self.enter(node.part) {
            todo.push(PendingItem::ClosePart);
        }
        let tag = match &node.kind {
            NodeKind::Link { .. } => "link",
            NodeKind::Joint { motor, .. } => {
                self.open(&format!("motor name=\"{}\"", escape(&robot.motors[*motor].name)));
                todo.push(PendingItem::Close("motor"));
                "joint"
            }
        };
        self.open(&format!("{tag}{}", node_attributes(node)));
        todo.push(PendingItem::Close(tag));
        // The shapes defined by `radius` and `field` in the tag must not be written twice.
        let automatic = automatic_shapes(node);
        for (i, p) in node.solids.iter().enumerate().skip(usize::from(automatic.solid)) {
            self.line(&(primitive(p, false) + &node.hulls.get(&i).map_or(String::new(), |h| hull(h))));
        }
        for p in &node.fields[usize::from(automatic.field)..] {
            self.line(&primitive(p, true));
        }
        let mut own = self.markers.remove(&index).unwrap_or_default().into_iter().peekable();
        let mut content = Vec::new();
        for child in &self.children[index] {
            while let Some(m) = own.next_if(|m| *m < self.first_marker[*child]) {
                content.push(PendingItem::Marker(m));
            }
            content.push(PendingItem::Node(*child));
        }
        content.extend(own.map(PendingItem::Marker));
        todo.extend(content.into_iter().rev());
    }

    /// Writes a marker, enclosed by its own part if that is not the current one.
    fn marker(&mut self, index: usize) {
        let Marker { name, normal, tracer, part, .. } = &self.robot.markers[index];
        let entered = self.enter(*part);
        let normal = vector(normal, ["nx", "ny", "nz"]);
        self.line(&format!("marker name=\"{}\"{normal} tracer=\"{tracer}\"", escape(name)));
        if entered {
            self.close_part();
        }
    }

    /// Makes a part current for the reader; returns true if an element was opened for it.
    fn enter(&mut self, part: usize) -> bool {
        let enters = self.current != Some(part);
        if enters {
            self.open(&format!("bodypart name=\"{}\"", escape(&self.robot.parts[part].name)));
            self.current = Some(part);
        }
        enters
    }

    /// Closes a part that was entered again.
    fn close_part(&mut self) {
        self.close("bodypart");
        // The reader restores the part that enclosed the first occurrence: none, as the list at the top is not nested.
        self.current = None;
    }

    /// Writes a start tag on its own line and indents the following lines.
    fn open(&mut self, tag: &str) {
        self.indent();
        let _ = writeln!(self.out, "<{tag}>");
        self.depth += 1;
    }

    /// Writes an end tag.
    fn close(&mut self, name: &str) {
        self.depth -= 1;
        self.indent();
        let _ = writeln!(self.out, "</{name}>");
    }

    /// Writes an element without contents.
    fn line(&mut self, tag: &str) {
        self.indent();
        let _ = writeln!(self.out, "<{tag}/>");
    }

    /// Writes the indentation.
    fn indent(&mut self) {
        self.out.extend(std::iter::repeat_n("  ", self.depth));
    }
}

/// True for the first solid and the first field of a node if `radius` and `field` define them.
struct Automatic {
    solid: bool,
    field: bool,
}

/// Checks if the reader would create a node's first shapes from its attributes alone, as cylinders along the node's own
/// axis. These can be written in the short notation.
fn automatic_shapes(node: &Node) -> Automatic {
    let (axis, center) = match &node.kind {
        NodeKind::Link { offset } => (*offset, offset / 2.0),
        NodeKind::Joint { axis, length, .. } => (**axis * *length, Vector3::zeros()),
    };
    let is = |p: Option<&Primitive>| match p.map(|p| (p, p.shape)) {
        Some((p, Shape::Cylinder { radius, height })) => {
            let expected = geometry::automatic(radius, height, &axis, center, false);
            // The reader computes the height from the vector; a rounding error in the last digit is irrelevant.
            (height - axis.norm()).abs() < 1e-14 && close(&p.pose, &expected.pose)
        }
        _ => false,
    };
    // A shape with a hull needs its own tag for the hull's attributes.
    let solid = is(node.solids.first()) && !node.hulls.contains_key(&0);
    Automatic { solid, field: is(node.fields.first()) }
}

/// True if two poses are equal within rounding, meters and rad.
fn close(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    (a.translation.vector - b.translation.vector).norm() < 1e-14 && a.rotation.angle_to(&b.rotation) < 1e-14
}

/// The motion attributes of a motor; empty if the reader can derive them from its joints.
fn motion(robot: &Robot, motor: &Motor) -> String {
    let joint_motion = |joint: &usize| match robot.nodes.get(*joint)?.kind {
        NodeKind::Joint { motion, .. } => Some(motion),
        NodeKind::Link { .. } => None,
    };
    let mut joints: Vec<JointMotion> = motor.joints.iter().filter_map(joint_motion).collect();
    joints.dedup();
    let word = match (motor.motion, &joints[..]) {
        (JointMotion::Turn, []) => "",
        (own, [one]) if own == *one => "",
        (JointMotion::Turn, _) => " type=\"revolute\"",
        (JointMotion::Slide, _) => " type=\"prismatic\"",
    };
    format!("{word}{}", if motor.continuous { " continuous=\"true\"" } else { "" })
}

/// The attributes of a link or joint: its name, its axis or offset in meters, its limits in degrees or meters, its own
/// shapes.
fn node_attributes(node: &Node) -> String {
    let mut out = node.name.as_ref().map_or(String::new(), |name| format!(" name=\"{}\"", escape(name)));
    out += &match &node.kind {
        NodeKind::Link { offset } => vector(offset, ["x", "y", "z"]),
        NodeKind::Joint { motion, axis, min, max, length, .. } => {
            let axis = vector(axis, ["x", "y", "z"]);
            let (kind, min, max) = match motion {
                JointMotion::Turn => ("", degrees(*min), degrees(*max)),
                JointMotion::Slide => (" type=\"prismatic\"", min.to_string(), max.to_string()),
            };
            format!("{kind}{axis} length=\"{length}\" minPos=\"{min}\" maxPos=\"{max}\"")
        }
    };
    let automatic = automatic_shapes(node);
    for (name, first) in [
        ("radius", node.solids.first().filter(|_| automatic.solid)),
        ("field", node.fields.first().filter(|_| automatic.field)),
    ] {
        if let Some(Shape::Cylinder { radius, .. }) = first.map(|p| p.shape) {
            let _ = write!(out, " {name}=\"{radius}\"");
        }
    }
    out += &color(node.color);
    if node.no_self_collision {
        out.push_str(" noSelfCollision=\"true\"");
    }
    out
}

/// The attributes of a color; empty without one.
fn color(color: Option<[u8; 3]>) -> String {
    color.map_or(String::new(), |[r, g, b]| format!(" r=\"{r}\" g=\"{g}\" b=\"{b}\""))
}

/// The tag of a shape: sizes in meters, its pose on the node as position, heading and angle in degrees.
fn primitive(p: &Primitive, field: bool) -> String {
    let mut out = match p.shape {
        Shape::Sphere { radius } => format!("sphere radius=\"{radius}\""),
        Shape::Cylinder { radius, height } => format!("cylinder radius=\"{radius}\" height=\"{height}\""),
        Shape::Capsule { radius, height } => format!("capsule radius=\"{radius}\" height=\"{height}\""),
        Shape::Box { size } => format!("box width=\"{}\" height=\"{}\" depth=\"{}\"", size.x, size.y, size.z),
    };
    out.push_str(&vector(&p.pose.translation.vector, ["px", "py", "pz"]));
    let (heading, angle) = heading(&p.pose.rotation);
    if heading != Vector3::y() {
        out.push_str(&vector(&heading, ["hx", "hy", "hz"]));
    }
    if angle != 0.0 {
        let _ = write!(out, " angle=\"{}\"", degrees(angle));
    }
    if field {
        out.push_str(" field=\"true\"");
    }
    out
}

/// The attributes of a hull: its points in meters, on the node.
fn hull(hull: &Hull) -> String {
    let numbers = hull.points().iter().flat_map(|p| p.iter().map(f64::to_string));
    format!(" hull=\"{}\" hullRadius=\"{}\"", numbers.collect::<Vec<_>>().join(" "), hull.radius())
}

/// The heading and angle (rad) that the reader converts to this rotation. The format can't represent a heading along
/// -y: +y is used instead, and the half turn between them changes none of the shapes.
fn heading(rotation: &UnitQuaternion<f64>) -> (Vector3<f64>, f64) {
    let mut rotation = *rotation;
    let mut h = rotation * Vector3::y();
    if h.x.hypot(h.z) <= geometry::ZERO {
        if h.y < 0.0 {
            rotation *= UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        }
        h = Vector3::y();
    }
    // The angle is the rotation about local y that remains after applying the heading.
    let roll = geometry::orientation(&h, 0.0).inverse() * rotation;
    let mut angle = 2.0 * roll.j.atan2(roll.w);
    if angle > std::f64::consts::PI {
        angle -= std::f64::consts::TAU;
    }
    (h, if angle.abs() < 1e-15 { 0.0 } else { angle })
}

/// The components of a vector that are not zero, as attributes.
fn vector(v: &Vector3<f64>, names: [&str; 3]) -> String {
    let mut out = String::new();
    for (value, name) in v.iter().zip(names) {
        if *value != 0.0 {
            let _ = write!(out, " {name}=\"{value}\"");
        }
    }
    out
}

/// An angle in degrees with the fewest digits that read back to the same radians.
fn degrees(radians: f64) -> String {
    // If 30 degrees were written as 30.000000000000004, they would not read back to the same radians, and the file
    // could not be edited by hand: use the shortest number that reads back.
    let exact = radians.to_degrees();
    for digits in 0..17 {
        let short: f64 = format!("{exact:.digits$e}").parse().unwrap_or(exact);
        if short.to_radians() == radians {
            return short.to_string();
        }
    }
    // If rounding in the conversion skipped the number that reads back, it is an adjacent one.
    let near = [exact.next_down(), exact.next_up()];
    near.into_iter().find(|d| d.to_radians() == radians).unwrap_or(exact).to_string()
}

/// The contents of the tag that disables a pair.
pub(crate) fn left_out_tag((a, b): (&str, &str), reason: &str) -> String {
    format!("leaveOut a=\"{}\" b=\"{}\" reason=\"{}\"", escape(a), escape(b), escape(reason))
}

/// Escapes text for an attribute.
fn escape(text: &str) -> String {
    quick_xml::escape::escape(text).into_owned()
}
