//! Converts tokens to a robot: the tree, its parts and motors, constraints and markers.
//!
//! One pass without look-ahead. Forward references (of a constraint to later motors, of a motor to its index in the
//! part) are stored as written and resolved at the end of the file.

mod elements;

use super::constraint::Member;
use super::element::{Element, Warnings};
use super::motion::MotorMotion;
use super::pair_list::PairList;
use super::xml::{Token, Tokens};
use super::{geometry, pairs};
use crate::{Clause, Marker, Motor, Node, NodeKind, NodePairs, Part, Robot};
use mobee_text::{FileError, Loaded, SourceText};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The name of the root element, compared without case.
const ROOT: &str = "ZeroPositionKinematicTree";
/// Reads a robot.
///
/// # Errors
/// The first mistake, with location and remedy.
pub(super) fn read(source: &SourceText) -> Result<Loaded<Robot>, FileError> {
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

/// A part under construction. The same name may occur again anywhere in the file and continues the same part.
struct PartBuilder {
    /// Its name in the file; parts of one name are one part.
    name: String,
    /// Per motor index within the part: index into the reader's motors; `None` if only a higher index has been given so
    /// far.
    slots: Vec<Option<usize>>,
    /// The motor that was created first, regardless of its index: Jacobian chains of the part end there.
    first_motor: Option<usize>,
    /// Its first link or joint.
    root_node: Option<usize>,
    /// Its constraints, in motor indices of the part: the motors may follow later in the file.
    clauses: Vec<Vec<Member>>,
    /// The part that was current when this one was created; restored as current at its end.
    around: Option<usize>,
}

/// The state that the end of an open element restores.
enum OpenElement {
    Part { part: usize, element: Element },
    Motor { before: Option<usize> },
    Node { before: Option<usize> },
    Clause { element: Element },
    Pairs,
    Other,
}

/// State of the reader: the robot so far, and the open elements.
///
/// The format is stateful. A joint moves with the enclosing open motor and belongs to the *current* part, which is not
/// always the enclosing one: the end of a part restores the part that enclosed its *first* occurrence. So part, motor
/// and node are three fields that elements set and restore, independent of the nesting of the file.
#[derive(Default)]
struct RobotReader {
    /// The robot's name, once the root element has been read.
    name: Option<String>,
    /// Parts in order of first appearance.
    parts: Vec<PartBuilder>,
    /// Motors in order of creation; [`RobotReader::finish`] sorts them in the order of configurations.
    motors: Vec<Motor>,
    /// Per motor: its motion as given by its own attributes.
    motions: Vec<MotorMotion>,
    /// Nodes in order of their start tags.
    nodes: Vec<Node>,
    /// Markers in order of appearance.
    markers: Vec<Marker>,
    /// The state that the open elements restore at their ends, the innermost last.
    open: Vec<OpenElement>,
    /// The current part, an index into `parts`.
    part: Option<usize>,
    /// The current motor, an index into `motors` (in order of creation).
    motor: Option<usize>,
    /// The parent of the next node.
    node: Option<usize>,
    /// Names of nodes so far.
    node_names: BTreeSet<Arc<str>>,
    /// The disabled pairs, once there is a `pairs` element.
    left_out: Option<PairList>,
    /// Links without collision shapes.
    bare: Vec<String>,
    /// Element of the first of them.
    first_bare: Option<Element>,
    /// The clause of the open `constraintList`.
    clause: Option<Vec<Member>>,
    /// Warnings so far.
    warnings: Warnings,
    /// Number of shapes of all nodes.
    shapes: usize,
}

impl RobotReader {
    /// Handles the start of an element. Unknown ones are skipped with a warning, but their contents are read.
    fn start(&mut self, e: Element) -> Result<(), FileError> {
        if self.open.is_empty() {
            self.root(&e)?;
            self.open.push(OpenElement::Other);
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
            "leaveout" | "near" => self.listed_pair(e)?,
            "bare" => self.bare(e)?,
            name => match geometry::shape_attributes(name) {
                Some(sizes) => self.shape(&e, sizes)?,
                None => {
                    let help = "known are bodypart, motor, joint, link, sphere, cylinder, box, capsule, marker, \
                                constraintList, constraint, pairs, leaveOut, near and bare";
                    let message = format!("<{}> is not known; it is ignored", e.written);
                    self.warnings.add(|| e.warning_at("", message, help));
                    OpenElement::Other
                }
            },
        };
        self.open.push(open);
        Ok(())
    }

    /// Handles the end of the innermost element: restores the state, and checks what can only be checked as a whole.
    fn end(&mut self) -> Result<(), FileError> {
        match self.open.pop() {
            Some(OpenElement::Part { part, element }) => {
                let part = &self.parts[part];
                if let Some(gap) = part.slots.iter().position(Option::is_none) {
                    return Err(element.error(
                        format!("part `{}` has no motor with index {gap}", part.name),
                        format!("number its motors 0 to {} without a gap (attribute idx)", part.slots.len() - 1),
                    ));
                }
                self.part = part.around;
            }
            Some(OpenElement::Motor { before }) => self.motor = before,
            Some(OpenElement::Node { before }) => self.node = before,
            Some(OpenElement::Clause { element }) => {
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
            Some(OpenElement::Pairs | OpenElement::Other) | None => {}
        }
        Ok(())
    }

    /// Checks the root element: another one indicates another kind of file, which the remedy names.
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

    /// Sorts the motors, resolves the constraints and builds the pair tables.
    fn finish(mut self, source: &SourceText) -> Result<Loaded<Robot>, FileError> {
        // Motors are ordered by part and index, regardless of the order of creation: `order[new] = old`.
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
        if let Some(first) = self.first_bare {
            let names: Vec<String> = self.bare.iter().map(|name| format!("`{name}`")).collect();
            let message = format!("without a shape that collides, nothing ever touches: {}", names.join(", "));
            let help = "put shapes into their <link>s and remove their <bare>, or convert the URDF again with --visual";
            self.warnings.add(|| first.warning_at("link", message, help));
        }
        let left_out = self.left_out.map(|list| list.resolve(&self.nodes)).transpose()?;
        let mut robot = Robot {
            name,
            parts,
            motors,
            nodes: self.nodes,
            markers: self.markers,
            pairs,
            left_out: None,
            near: Vec::new(),
            bare: self.bare,
        };
        if let Some(list) = left_out {
            list.apply(&mut robot, &mut self.warnings);
        }
        Ok(Loaded { value: robot, warnings: self.warnings.0 })
    }
}
