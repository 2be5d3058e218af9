//! Tokens to a robot: the tree, its parts and motors, constraints and markers.
//!
//! Reading is one pass without look-ahead. What refers forward (a constraint to motors that follow, a motor to its place in the
//! part) is kept as written and resolved at the end of the file, where all is known.

use super::constraint::Member;
use super::element::{Element, Warnings};
use super::left_out::PairList;
use super::motion::{self, MotorMotion};
use super::xml::{Token, Tokens};
use super::{geometry, pairs};
use crate::error::{FileError, Loaded, Source};
use crate::{Clause, Marker, Motor, Node, NodeKind, NodePairs, Part, Robot};
use nalgebra::{Unit, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// More nodes are refused: the pair tables grow with the square.
const MAX_NODES: usize = 2048;
/// More shapes of all nodes together are refused.
const MAX_SHAPES: usize = 4096;
/// More parts, motors or markers are refused, of each kind.
const MAX_NAMES: usize = 4096;
/// Motor slots per part.
const MAX_SLOTS: i64 = 4096;

/// The name of the outermost element, as the format writes it; compared without case.
const ROOT: &str = "ZeroPositionKinematicTree";
/// What `link` and `joint` have in common: name, direction, length, the radii of their own shapes, and flags.
const NODE: &[&str] = &["name", "x", "y", "z", "length", "radius", "field", "noSelfCollision", "capsule"];

/// Reads a robot.
///
/// # Errors
/// The first mistake, with its place and a remedy.
pub(super) fn read(source: &Source) -> Result<Loaded<Robot>, FileError> {
    let mut tokens = Tokens::new(source);
    let mut reader = RobotReader::default();
    while let Some(token) = tokens.next()? {
        match token {
            Token::Start(element) => reader.start(element)?,
            Token::End => reader.end()?,
        }
    }
    reader.finish(source)
}

/// A part as far as it is read. The same name may come up again anywhere in the file and goes on with the same part.
struct PartBuilder {
    /// What the file calls it; parts of one name are one part.
    name: String,
    /// By motor index within the part; `None` where a higher index was given before this one.
    /// Indices into the reader's motors.
    slots: Vec<Option<usize>>,
    /// The motor that was created first, whatever its index: Jacobian chains of the part end there.
    first_motor: Option<usize>,
    /// Its first link or joint.
    root_node: Option<usize>,
    /// Its constraints, still in motor indices of the part: the motors may follow later in the file.
    clauses: Vec<Vec<Member>>,
    /// The part that was current when this one was created; current again at its end.
    around: Option<usize>,
}

/// What an open element changes back at its end.
enum Open {
    Part { part: usize, element: Element },
    Motor { before: Option<usize> },
    Node { before: Option<usize> },
    Clause { element: Element },
    Pairs,
    Other,
}

/// The state of reading, element by element: what is read so far, and what is open.
///
/// The format is stateful. A joint turns with the motor that is open around it and belongs to the part that is *current*, which
/// is not always the part around it: where a part ends, the part around its *first* mention goes on. So these
/// are three fields that elements set and restore, and not the nesting of the file.
#[derive(Default)]
struct RobotReader {
    /// The robot's name, once the outermost element has been read.
    name: Option<String>,
    /// In order of first appearance.
    parts: Vec<PartBuilder>,
    /// In order of creation; [`RobotReader::finish`] puts them in pose order.
    motors: Vec<Motor>,
    /// Per motor, how it was found out what its encoder counts.
    motions: Vec<MotorMotion>,
    /// In order of their start tags.
    nodes: Vec<Node>,
    /// In order of appearance.
    markers: Vec<Marker>,
    /// What the open elements change back at their ends, the innermost last.
    open: Vec<Open>,
    /// The current part, an index into `parts`.
    part: Option<usize>,
    /// The current motor, an index into `motors` (in order of creation, which is not pose order).
    motor: Option<usize>,
    /// The node that the next one hangs on.
    node: Option<usize>,
    /// Names of nodes so far.
    node_names: BTreeSet<Arc<str>>,
    /// The pairs that are left out, once there is a `pairs` element.
    left_out: Option<PairList>,
    /// The clause of the open `constraintList`.
    clause: Option<Vec<Member>>,
    /// What was odd so far.
    warnings: Warnings,
    /// Shapes of all nodes.
    shapes: usize,
}

impl RobotReader {
    /// An element begins. Unknown ones are told of and skipped, their contents are read all the same.
    fn start(&mut self, e: Element) -> Result<(), FileError> {
        if self.open.is_empty() {
            self.root(&e)?;
            self.open.push(Open::Other);
            return Ok(());
        }
        let open = match e.name.as_str() {
            "bodypart" => self.bodypart(e)?,
            "motor" => self.motor(&e)?,
            "joint" | "link" => self.tree_node(&e)?,
            "marker" => self.marker(&e)?,
            "constraintlist" => self.clause(e),
            "constraint" => self.constraint(e)?,
            "pairs" => self.pairs(&e)?,
            "leaveout" => self.leave_out(e)?,
            name => match geometry::shape_attributes(name) {
                Some(sizes) => self.shape(&e, sizes)?,
                None => {
                    let help = "known are bodypart, motor, joint, link, sphere, cylinder, box, capsule, marker, \
                                constraintList, constraint, pairs and leaveOut";
                    let message = format!("<{}> is not known; it is ignored", e.written);
                    self.warnings.add(|| e.warning_at("", message, help));
                    Open::Other
                }
            },
        };
        self.open.push(open);
        Ok(())
    }

    /// The innermost element ends: what it set is restored, and what can only be judged as a whole is judged.
    fn end(&mut self) -> Result<(), FileError> {
        match self.open.pop() {
            Some(Open::Part { part, element }) => {
                let part = &self.parts[part];
                if let Some(gap) = part.slots.iter().position(Option::is_none) {
                    return Err(element.error(
                        format!("part `{}` has no motor with index {gap}", part.name),
                        format!("number its motors 0 to {} without a gap (attribute idx)", part.slots.len() - 1),
                    ));
                }
                self.part = part.around;
            }
            Some(Open::Motor { before }) => self.motor = before,
            Some(Open::Node { before }) => self.node = before,
            Some(Open::Clause { element }) => {
                let clause = self.clause.take().unwrap_or_default();
                match self.part {
                    None => {}
                    Some(_) if clause.is_empty() => {
                        let help = "put at least one <constraint a=\"...\" q=\"...\" b=\"...\"/> into it, or remove it";
                        return Err(element.error("an empty constraintList can never be satisfied", help));
                    }
                    Some(part) => self.parts[part].clauses.push(clause),
                }
            }
            Some(Open::Pairs | Open::Other) | None => {}
        }
        Ok(())
    }

    /// The outermost element: another one means that this is another kind of file, and the help says which.
    fn root(&mut self, e: &Element) -> Result<(), FileError> {
        if !e.name.eq_ignore_ascii_case(ROOT) {
            let help = match e.name.as_str() {
                "worldlist" => "this is a world file; give it as the world, not as a robot".to_owned(),
                "robot" => "this looks like a URDF; turn it into ZRP with `mobee model convert`".to_owned(),
                _ => format!("a robot file begins with <{ROOT} version=\"1.0\" robotName=\"...\">"),
            };
            return Err(e.error(format!("<{}> does not begin a robot file", e.written), help));
        }
        if let Some(version) = e.get("version").filter(|v| v.value.trim() != "1.0") {
            let message = format!("version \"{}\" of the format is not known", version.value);
            return Err(e.error_at("version", message, "write version=\"1.0\""));
        }
        e.warn_unknown(&[&["version", "robotName"]], &mut self.warnings);
        self.name = e.get("robotName").map(|a| a.value.trim().to_owned()).filter(|n| !n.is_empty());
        if self.name.is_none() {
            let help = "write robotName=\"...\"";
            self.warnings.add(|| e.warning_at("robotName", "the robot has no name; it is called `robot`", help));
        }
        Ok(())
    }

    /// Makes a part current, a new one or one that is known by its name.
    fn bodypart(&mut self, element: Element) -> Result<Open, FileError> {
        element.warn_unknown(&[&["name"]], &mut self.warnings);
        let name = element.name_attr()?;
        let known = self.parts.iter().position(|p| p.name == name);
        if known.is_none() {
            room_for_one(&element, self.parts.len())?;
        }
        let part = known.unwrap_or_else(|| {
            self.parts.push(PartBuilder {
                name,
                slots: Vec::new(),
                first_motor: None,
                root_node: None,
                clauses: Vec::new(),
                around: self.part,
            });
            self.parts.len() - 1
        });
        self.part = Some(part);
        Ok(Open::Part { part, element })
    }

    /// The current part, or an error at an element that needs one.
    fn current_part(&self, e: &Element) -> Result<usize, FileError> {
        self.part.ok_or_else(|| {
            e.error(
                format!("<{}> is outside any body part", e.written),
                "put it into a <bodypart name=\"...\">; after a part's end the part around its first mention goes on",
            )
        })
    }

    /// Makes a motor current, a new one or one that is known by its name. Only its first mention has limits that count.
    ///
    /// Its limits are encoder units in the file and rad from here on; without any it goes from -1 to 1 unit.
    fn motor(&mut self, e: &Element) -> Result<Open, FileError> {
        e.warn_unknown(&[&["name", "idx", "minPos", "maxPos", "home"], motion::MOTOR], &mut self.warnings);
        let part = self.current_part(e)?;
        let name = e.name_attr()?;
        let before = self.motor;
        if let Some(known) = self.motors.iter().position(|m| m.name == name) {
            self.motor = Some(known);
            return Ok(Open::Motor { before });
        }
        room_for_one(e, self.motors.len())?;
        let (min, max) = limits(e, "the motor", -1.0, 1.0)?;
        let home = e.number_or_zero("home")?;
        if (home < min || home > max) && e.get("home").is_some() {
            let message = format!("home {home} is outside the limits {min} to {max}; the nearer limit is taken");
            self.warnings.add(|| e.warning_at("home", message, "give a home position within minPos and maxPos"));
        }
        let index = self.motors.len();
        let builder = &mut self.parts[part];
        // The index is the motor's place in its part, not in the file: motors may be written in any order, and a board that
        // is asked for motor 3 must mean the same joint whoever wrote the file.
        let slot = e.integer("idx")?.unwrap_or(-1);
        if slot < -1 {
            let message = format!("motor index {slot} is below 0");
            return Err(e.error_at(
                "idx",
                message,
                "count the motors of a part from 0; -1 stands for the next that is free",
            ));
        }
        if slot >= MAX_SLOTS {
            return Err(e.error_at(
                "idx",
                format!("motor index {slot} is too large"),
                "count the motors of a part from 0",
            ));
        }
        match usize::try_from(slot) {
            Err(_) => builder.slots.push(Some(index)),
            Ok(slot) => {
                if builder.slots.len() <= slot {
                    builder.slots.resize(slot + 1, None);
                }
                if let Some(other) = builder.slots[slot].replace(index) {
                    let other = &self.motors[other].name;
                    let message = format!("index {slot} of part `{}` is taken by motor `{other}`", builder.name);
                    return Err(e.error_at("idx", message, "give each motor of a part its own idx"));
                }
            }
        }
        let motion = MotorMotion::read(e, &mut self.warnings)?;
        // The first in the file, not the one of index 0: chains of the Jacobian end at it, as in the original.
        let is_part_root = builder.first_motor.is_none();
        builder.first_motor.get_or_insert(index);
        self.motors.push(Motor {
            name,
            part,
            min: min.to_radians(),
            max: max.to_radians(),
            home: home.clamp(min, max).to_radians(),
            motion: motion.stated(),
            continuous: motion.continuous,
            joints: Vec::new(),
            is_part_root,
        });
        self.motions.push(motion);
        self.motor = Some(index);
        Ok(Open::Motor { before })
    }

    /// A link or a joint: a node below the current one, with the shapes that its `radius` and `field` stand for.
    fn tree_node(&mut self, e: &Element) -> Result<Open, FileError> {
        let is_joint = e.name == "joint";
        let own: &[&str] = if is_joint { &["type", "minPos", "maxPos"] } else { &[] };
        e.warn_unknown(&[NODE, own], &mut self.warnings);
        let part = self.current_part(e)?;
        let index = self.nodes.len();
        if index >= MAX_NODES {
            let message = format!("the robot has more than {MAX_NODES} links and joints");
            return Err(e.error(message, "leave out what does not move or collide"));
        }
        let direction = e.vector(["x", "y", "z"])?;
        let Some(unit) = Unit::try_new(direction, geometry::ZERO) else {
            return Err(e.error(
                format!("<{}> has no direction: x, y and z are all 0", e.written),
                "give at least one of x, y, z; leave the node out if it does nothing",
            ));
        };
        // `length` overrules the direction's own, and a negative one turns the direction round. One that is zero is as good
        // as none, or the node would have no axis.
        let length = e.number("length")?.filter(|h| h.abs() > geometry::ZERO);
        let height = length.map_or(direction.norm(), f64::abs);
        let axis: Vector3<f64> = length.map_or(direction, |h| *unit * h);
        let kind = if is_joint {
            self.joint(e, if length.is_some_and(|h| h < 0.0) { -unit } else { unit }, height)?
        } else {
            NodeKind::Link { offset: axis }
        };
        // The own cylinder of a link reaches from its start to its end; that of a joint lies about its origin.
        let center = if is_joint { Vector3::zeros() } else { axis / 2.0 };
        let name = self.node_name(e)?;
        let capsule = e.flag("capsule", &mut self.warnings);
        let automatic = |radius: f64| geometry::automatic(radius, height, &axis, center, capsule);
        self.nodes.push(Node {
            name,
            parent: self.node,
            part,
            kind,
            solids: e.optional_size("radius")?.map(automatic).into_iter().collect(),
            fields: e.optional_size("field")?.map(automatic).into_iter().collect(),
            no_self_collision: e.flag("noSelfCollision", &mut self.warnings),
            near_root: false,
        });
        self.parts[part].root_node.get_or_insert(index);
        let before = self.node.replace(index);
        Ok(Open::Node { before })
    }

    /// The name of a link or joint, if it has one.
    fn node_name(&mut self, e: &Element) -> Result<Option<Arc<str>>, FileError> {
        if e.get("name").is_none() {
            return Ok(None);
        }
        let name: Arc<str> = e.name_attr()?.into();
        if !self.node_names.insert(name.clone()) {
            let message = format!("there is a link or joint `{name}` already");
            return Err(e.error_at("name", message, "give each link and joint of a robot its own name, or none"));
        }
        Ok(Some(name))
    }

    /// What a joint moves about or along and how far: `axis` in its own frame, limits in degrees or meters, which are positions at
    /// the motor's limits and not limits of their own.
    fn joint(&mut self, e: &Element, axis: Unit<Vector3<f64>>, length: f64) -> Result<NodeKind, FileError> {
        let motion = motion::of_joint(e)?;
        let Some(index) = self.motor else {
            return Err(e.error("<joint> is outside any motor", "put it into a <motor name=\"...\">"));
        };
        let (min, max) = motion::limits_of_joint(e, motion, &mut self.warnings)?;
        let motor = &mut self.motors[index];
        self.motions[index].joins(e, motor, motion, (min, max))?;
        motor.joints.push(self.nodes.len());
        Ok(NodeKind::Joint { motion, axis, motor: index, min, max, length })
    }

    /// A shape on the current node: solid, or part of the force field.
    fn shape(&mut self, e: &Element, sizes: &'static [&'static str]) -> Result<Open, FileError> {
        e.warn_unknown(&[sizes, geometry::POSE, &["field"]], &mut self.warnings);
        let Some(node) = self.node else {
            let message = format!("<{}> is outside any link or joint", e.written);
            return Err(e.error(message, "put it into the <link> or <joint> that carries it"));
        };
        let primitive = geometry::primitive(e)?;
        let field = e.flag("field", &mut self.warnings);
        let node = &mut self.nodes[node];
        let list = if field { &mut node.fields } else { &mut node.solids };
        if self.shapes >= MAX_SHAPES {
            let message = format!("the robot has more than {MAX_SHAPES} shapes");
            return Err(e.error(message, "cover what is small by one larger shape"));
        }
        list.push(primitive);
        self.shapes += 1;
        Ok(Open::Other)
    }

    /// A marker at the origin of the current node. It belongs to the current part, which need not be the node's.
    fn marker(&mut self, e: &Element) -> Result<Open, FileError> {
        e.warn_unknown(&[&["name", "nx", "ny", "nz", "tracer"]], &mut self.warnings);
        let part = self.current_part(e)?;
        let Some(node) = self.node else {
            let help = "put it into the <link> or <joint> that carries it";
            return Err(e.error("<marker> is outside any link or joint", help));
        };
        let name = e.name_attr()?;
        if self.markers.iter().any(|m| m.name == name) {
            let message = format!("there is a marker `{name}` already");
            return Err(e.error_at("name", message, "give each marker of a robot its own name"));
        }
        room_for_one(e, self.markers.len())?;
        let normal = Unit::try_new(e.vector(["nx", "ny", "nz"])?, geometry::ZERO).unwrap_or(Vector3::x_axis());
        let tracer = e.integer("tracer")?.unwrap_or(5).clamp(1, 10_000) as u32;
        self.markers.push(Marker { name, node, part, normal, tracer });
        Ok(Open::Other)
    }

    /// A `constraintList` opens: a disjunction, whose members follow.
    fn clause(&mut self, element: Element) -> Open {
        if self.part.is_none() {
            let message = "<constraintList> is outside any body part; it is ignored";
            self.warnings.add(|| element.warning_at("", message, "put it into the part whose motors it is about"));
        }
        self.clause = Some(Vec::new());
        Open::Clause { element }
    }

    /// One half-space of the open clause.
    fn constraint(&mut self, e: Element) -> Result<Open, FileError> {
        e.warn_unknown(&[Member::ATTRIBUTES], &mut self.warnings);
        let Some(clause) = &mut self.clause else {
            return Err(e.error("<constraint> is outside a constraintList", "put it into a <constraintList>"));
        };
        clause.push(Member::read(e)?);
        Ok(Open::Other)
    }

    /// The list of pairs that are left out begins, or goes on.
    fn pairs(&mut self, e: &Element) -> Result<Open, FileError> {
        e.warn_unknown(&[], &mut self.warnings);
        if self.open.len() != 1 {
            let help = format!("put it directly into <{ROOT}>: it is about the whole robot");
            return Err(e.error("<pairs> is within another element", help));
        }
        self.left_out.get_or_insert_default();
        Ok(Open::Pairs)
    }

    /// One pair that is left out.
    fn leave_out(&mut self, e: Element) -> Result<Open, FileError> {
        match (&mut self.left_out, self.open.last()) {
            (Some(list), Some(Open::Pairs)) => list.push(e, &mut self.warnings)?,
            _ => return Err(e.error("<leaveOut> is outside <pairs>", "put it into a <pairs> element")),
        }
        Ok(Open::Other)
    }

    /// Puts the motors in pose order, resolves the constraints and makes the pair tables.
    fn finish(mut self, source: &Source) -> Result<Loaded<Robot>, FileError> {
        // Pose order is part by part and by index, whatever the order of creation: `order[new] = old`.
        let mut order = Vec::with_capacity(self.motors.len());
        let mut parts = Vec::with_capacity(self.parts.len());
        for part in &self.parts {
            let start = order.len();
            order.extend(part.slots.iter().flatten().copied());
            let motors = start..order.len();
            let mut clauses = Vec::with_capacity(part.clauses.len());
            for clause in &part.clauses {
                let members: Result<_, _> = clause.iter().map(|m| m.resolve(&part.name, motors.clone())).collect();
                clauses.push(Clause(members?));
            }
            parts.push(Part { name: part.name.clone(), motors, root_node: part.root_node, clauses });
        }
        if self.nodes.is_empty() {
            let help = "a robot has at least one <link> or <joint> in a <bodypart>";
            return Err(source.error(0..0, "the robot has no links and no joints", help));
        }
        let place: BTreeMap<usize, usize> = order.iter().enumerate().map(|(new, old)| (*old, new)).collect();
        for node in &mut self.nodes {
            if let NodeKind::Joint { motor, .. } = &mut node.kind {
                *motor = place[motor];
            }
        }
        for (node, near) in pairs::near_root(&self.nodes).into_iter().enumerate() {
            self.nodes[node].near_root = near;
        }
        let pairs: NodePairs = pairs::node_pairs(&self.nodes);
        let motors = order.iter().map(|i| self.motors[*i].clone()).collect();
        let name = self.name.unwrap_or_else(|| "robot".to_owned());
        let left_out = self.left_out.map(|list| list.resolve(&self.nodes)).transpose()?;
        let mut robot = Robot { name, parts, motors, nodes: self.nodes, markers: self.markers, pairs, left_out: None };
        if let Some(list) = left_out {
            robot.leave_out(list);
        }
        Ok(Loaded { value: robot, warnings: self.warnings.0 })
    }
}

/// Both limits as written: `minPos` and `maxPos`, each with its default.
pub(super) fn limits(e: &Element, what: &str, min: f64, max: f64) -> Result<(f64, f64), FileError> {
    let min = e.number("minPos")?.unwrap_or(min);
    let max = e.number("maxPos")?.unwrap_or(max);
    if min > max {
        let attr = if e.get("minPos").is_some() { "minPos" } else { "maxPos" };
        return Err(e.error_at(
            attr,
            format!("limits reversed: {what} has minPos {min} above maxPos {max}"),
            "give both limits, the smaller as minPos",
        ));
    }
    Ok((min, max))
}

/// Refuses one more than fits: a file of many gigabytes must not become as many names.
fn room_for_one(e: &Element, present: usize) -> Result<(), FileError> {
    if present < MAX_NAMES {
        return Ok(());
    }
    Err(e.error(
        format!("the robot has more than {MAX_NAMES} of <{}>", e.written),
        "leave out those that are not needed",
    ))
}
