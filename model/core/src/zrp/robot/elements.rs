//! The effect of each element of a robot file on the robot and on the state of the reader.

use super::{OpenElement, PartBuilder, ROOT, RobotReader};
use crate::hull::Hulls;
use crate::zrp::constraint::Member;
use crate::zrp::element::{COLOR, Element};
use crate::zrp::geometry;
use crate::zrp::motion::{self, MotorMotion, limits};
use crate::{Marker, Motor, Node, NodeKind};
use mobee_text::FileError;
use nalgebra::{Unit, Vector3};
use std::sync::Arc;

/// Maximum number of nodes: the pair tables grow quadratically.
const MAX_NODES: usize = 2048;
/// Maximum number of shapes of all nodes together.
const MAX_SHAPES: usize = 4096;
/// Maximum number of parts, of motors, of markers and of links without shapes, each.
const MAX_NAMES: usize = 4096;
/// Maximum number of motor slots per part.
const MAX_SLOTS: i64 = 4096;

/// Common attributes of `link` and `joint`: name, direction, length, the radii of their own shapes, and flags.
const NODE: &[&str] = &["name", "x", "y", "z", "length", "radius", "field", "noSelfCollision", "capsule"];

impl RobotReader {
    /// Makes a part current: a new one, or the existing one of that name.
    pub(super) fn bodypart(&mut self, element: Element) -> Result<OpenElement, FileError> {
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
        Ok(OpenElement::Part { part, element })
    }

    /// The current part, or an error at an element that needs one.
    pub(super) fn current_part(&self, e: &Element) -> Result<usize, FileError> {
        self.part.ok_or_else(|| {
            e.error(
                format!("<{}> is outside any body part", e.written),
                "put it into a <bodypart name=\"...\">; after a part's end the part around its first mention goes on",
            )
        })
    }

    /// Makes a motor current: a new one, or the existing one of that name. Only the limits at its first occurrence
    /// count.
    ///
    /// Its limits are encoder units in the file and converted to rad of encoder; the default is -1 to 1 unit.
    pub(super) fn motor(&mut self, e: &Element) -> Result<OpenElement, FileError> {
        e.warn_unknown(&[&["name", "idx", "minPos", "maxPos", "home", "maxSpeed"], motion::MOTOR], &mut self.warnings);
        let part = self.current_part(e)?;
        let name = e.name_attr()?;
        let before = self.motor;
        if let Some(known) = self.motors.iter().position(|m| m.name == name) {
            self.motor = Some(known);
            return Ok(OpenElement::Motor { before });
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
        // The index is the motor's position in its part, not in the file: motors may be written in any order, and motor
        // 3 of a control board must be the same joint in each case.
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
        let max_speed = motion::speed_of_motor(e)?;
        // The first motor in the file, not that of index 0: Jacobian chains end there, as in the original.
        let is_part_root = builder.first_motor.is_none();
        builder.first_motor.get_or_insert(index);
        self.motors.push(Motor {
            name,
            part,
            min: min.to_radians(),
            max: max.to_radians(),
            home: home.clamp(min, max).to_radians(),
            motion: motion.stated(),
            max_speed,
            continuous: motion.continuous,
            joints: Vec::new(),
            is_part_root,
        });
        self.motions.push(motion);
        self.motor = Some(index);
        Ok(OpenElement::Motor { before })
    }

    /// Adds a link or a joint: a node below the current one, with the shapes defined by `radius` and `field`.
    pub(super) fn tree_node(&mut self, e: &Element) -> Result<OpenElement, FileError> {
        let is_joint = e.name == "joint";
        let own: &[&str] = if is_joint { &["type", "minPos", "maxPos"] } else { &[] };
        e.warn_unknown(&[NODE, COLOR, own], &mut self.warnings);
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
        // `length` overrides that of the direction, and a negative one reverses the direction. Zero counts as missing,
        // since the node would have no axis.
        let length = e.number("length")?.filter(|h| h.abs() > geometry::ZERO);
        let height = length.map_or(direction.norm(), f64::abs);
        let axis: Vector3<f64> = length.map_or(direction, |h| *unit * h);
        let kind = if is_joint {
            self.joint(e, if length.is_some_and(|h| h < 0.0) { -unit } else { unit }, height)?
        } else {
            NodeKind::Link { offset: axis }
        };
        // The cylinder of a link extends from its start to its end; that of a joint is centered at its origin.
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
            hulls: Hulls::new(),
            fields: e.optional_size("field")?.map(automatic).into_iter().collect(),
            color: e.color()?,
            no_self_collision: e.flag("noSelfCollision", &mut self.warnings),
            near_root: false,
        });
        self.parts[part].root_node.get_or_insert(index);
        let before = self.node.replace(index);
        Ok(OpenElement::Node { before })
    }

    /// The name of a link or joint, if it has one.
    pub(super) fn node_name(&mut self, e: &Element) -> Result<Option<Arc<str>>, FileError> {
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

    /// The motion of a joint: `axis` in its own frame; limits in degrees or meters, which are the positions at the
    /// motor's limits, not independent limits.
    pub(super) fn joint(&mut self, e: &Element, axis: Unit<Vector3<f64>>, length: f64) -> Result<NodeKind, FileError> {
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

    /// Adds a shape to the current node: solid, or part of the force field.
    pub(super) fn shape(&mut self, e: &Element, sizes: &'static [&'static str]) -> Result<OpenElement, FileError> {
        e.warn_unknown(&[sizes, geometry::POSE, geometry::HULL, &["field"]], &mut self.warnings);
        let Some(node) = self.node else {
            let message = format!("<{}> is outside any link or joint", e.written);
            return Err(e.error(message, "put it into the <link> or <joint> that carries it"));
        };
        let primitive = geometry::primitive(e)?;
        let field = e.flag("field", &mut self.warnings);
        let hull = geometry::hull(e, &primitive)?;
        if field && hull.is_some() {
            let help = "leave out `hull` and `hullRadius`: they are for shapes that collide";
            return Err(e.error_at("hull", "a shape of the force field has no hull", help));
        }
        let node = &mut self.nodes[node];
        if let Some(hull) = hull {
            node.hulls.insert(node.solids.len(), Arc::new(hull));
        }
        let list = if field { &mut node.fields } else { &mut node.solids };
        if self.shapes >= MAX_SHAPES {
            let message = format!("the robot has more than {MAX_SHAPES} shapes");
            return Err(e.error(message, "cover what is small by one larger shape"));
        }
        list.push(primitive);
        self.shapes += 1;
        Ok(OpenElement::Other)
    }

    /// Adds a marker at the origin of the current node. It belongs to the current part, which may differ from the
    /// node's.
    pub(super) fn marker(&mut self, e: &Element) -> Result<OpenElement, FileError> {
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
        Ok(OpenElement::Other)
    }

    /// Opens a `constraintList`: a disjunction, whose members follow.
    pub(super) fn clause(&mut self, element: Element) -> OpenElement {
        if self.part.is_none() {
            let message = "<constraintList> is outside any body part; it is ignored";
            self.warnings.add(|| element.warning_at("", message, "put it into the part whose motors it is about"));
        }
        self.clause = Some(Vec::new());
        OpenElement::Clause { element }
    }

    /// Adds one half-space to the open clause.
    pub(super) fn constraint(&mut self, e: Element) -> Result<OpenElement, FileError> {
        e.warn_unknown(&[Member::ATTRIBUTES], &mut self.warnings);
        let Some(clause) = &mut self.clause else {
            return Err(e.error("<constraint> is outside a constraintList", "put it into a <constraintList>"));
        };
        clause.push(Member::read(e)?);
        Ok(OpenElement::Other)
    }

    /// Opens or continues the list of disabled pairs.
    pub(super) fn pairs(&mut self, e: &Element) -> Result<OpenElement, FileError> {
        e.warn_unknown(&[], &mut self.warnings);
        if self.open.len() != 1 {
            let help = format!("put it directly into <{ROOT}>: it is about the whole robot");
            return Err(e.error("<pairs> is within another element", help));
        }
        self.left_out.get_or_insert_default();
        Ok(OpenElement::Pairs)
    }

    /// Adds a link without a collision shape in its URDF; all of them are listed in one warning at the end.
    pub(super) fn bare(&mut self, e: Element) -> Result<OpenElement, FileError> {
        e.warn_unknown(&[&["link"]], &mut self.warnings);
        if self.open.len() != 1 {
            return Err(e.error("<bare> is within another element", format!("put it directly into <{ROOT}>")));
        }
        let Some(link) = e.get("link").map(|a| a.value.trim().to_owned()).filter(|name| !name.is_empty()) else {
            return Err(e.error_at("link", "<bare> names no link", "write <bare link=\"...\"/>, or remove it"));
        };
        room_for_one(&e, self.bare.len())?;
        self.bare.push(link);
        self.first_bare.get_or_insert(e);
        Ok(OpenElement::Other)
    }

    /// Adds one pair that is disabled, or has a clearance of its own.
    pub(super) fn listed_pair(&mut self, e: Element) -> Result<OpenElement, FileError> {
        match (&mut self.left_out, self.open.last()) {
            (Some(list), Some(OpenElement::Pairs)) => list.push(e, &mut self.warnings)?,
            _ => {
                let message = format!("<{}> is outside <pairs>", e.written);
                return Err(e.error(message, "put it into a <pairs> element"));
            }
        }
        Ok(OpenElement::Other)
    }
}

/// Checks that one more element fits: a file of many gigabytes must not become as many names.
fn room_for_one(e: &Element, present: usize) -> Result<(), FileError> {
    if present < MAX_NAMES {
        return Ok(());
    }
    Err(e.error(
        format!("the robot has more than {MAX_NAMES} of <{}>", e.written),
        "leave out those that are not needed",
    ))
}
