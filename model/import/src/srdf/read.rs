//! Reader of SRDF text.

use super::resolve::LIMIT_TOLERANCE;
use super::{EndEffector, LinkTree, Srdf, SrdfGroup, SrdfState, VirtualJoint};
use crate::urdf::JointUse;
use crate::urdf::words::{Unused, Words, words};
use mobee_model::JointMotion;
use mobee_text::xml::{self, XmlElement};
use mobee_text::{FileError, Loaded, SourceText};
use std::collections::BTreeSet;
use std::path::Path;

/// Maximum file size, bytes.
const MAX_BYTES: u64 = 16 << 20;
/// Maximum number of warnings; more would not be read.
const MAX_WARNINGS: usize = 100;

/// The elements and attributes that are read.
const WORDS: &[Words] = &[
    words(
        "robot",
        [
            &["name", "version"],
            &[],
            &[
                "group",
                "group_state",
                "disable_collisions",
                "passive_joint",
                "disable_default_collisions",
                "enable_collisions",
            ],
            &["virtual_joint", "end_effector", "link_sphere_approximation", "joint_property"],
        ],
    ),
    words("group", [&["name"], &[], &["joint", "link", "chain", "group"], &[]]),
    words("link", [&["name"], &[], &[], &[]]),
    words("joint", [&["name", "value"], &[], &[], &[]]),
    words("chain", [&["base_link", "tip_link"], &[], &[], &[]]),
    words("group_state", [&["name", "group"], &[], &["joint"], &[]]),
    words("disable_collisions", [&["link1", "link2", "reason"], &[], &[], &[]]),
    words("passive_joint", [&["name"], &[], &[], &[]]),
];

/// Reads an SRDF file; `tree` is that of the robot's URDF.
///
/// # Errors
/// If the file is not an SRDF, or an element lacks a name or a number, with location and remedy. Names that the URDF
/// does not have are warnings: elements that refer to them have no effect.
pub fn load_srdf(path: impl AsRef<Path>, tree: &LinkTree) -> Result<Loaded<Srdf>, FileError> {
    read(&SourceText::read(path.as_ref(), MAX_BYTES)?, tree)
}

/// Reads SRDF text; `name` is the file name for messages.
///
/// # Errors
/// As [`load_srdf`].
pub fn parse_srdf(name: &str, text: &str, tree: &LinkTree) -> Result<Loaded<Srdf>, FileError> {
    read(&SourceText::new(name, text), tree)
}

fn read(source: &SourceText, tree: &LinkTree) -> Result<Loaded<Srdf>, FileError> {
    let root = xml::parse(source)?;
    if root.name != "robot" {
        let message = format!("<{}> does not begin an SRDF", root.name);
        return Err(source.error(root.at, message, "an SRDF begins with <robot name=\"...\">"));
    }
    if let Some(link) = root.children.iter().find(|c| c.name == "link" || c.name.starts_with("xacro:")) {
        let message = format!("<{}> directly in <robot>: this is no SRDF", link.name);
        let help = "give the robot's .srdf file; expand one that is written for xacro with `xacro FILE > robot.srdf`";
        return Err(source.error(link.at.clone(), message, help));
    }
    let passive = root.all("passive_joint").filter_map(|p| p.get("name")).map(str::to_owned).collect();
    let mut reading =
        SrdfReader { source, tree, passive, warnings: Vec::new(), idle: BTreeSet::new(), srdf: Srdf::default() };
    reading.srdf.name = root.get("name").unwrap_or_default().to_owned();
    for element in &root.children {
        reading.element(element)?;
    }
    reading.check_groups(&root);
    let unused = Unused::of(&root, WORDS, |_| false);
    reading.srdf.notes.extend(unused.line("SRDF"));
    unused.warn(source, "SRDF", &mut reading.warnings);
    if !reading.idle.is_empty() {
        let names: Vec<String> = reading.idle.iter().map(|name| format!("`{name}`")).collect();
        reading.srdf.notes.push(format!("not used of the SRDF's poses: joints without a motor: {}", names.join(", ")));
    }
    Ok(Loaded { value: reading.srdf, warnings: reading.warnings })
}

/// State of the reader.
struct SrdfReader<'a> {
    source: &'a SourceText,
    tree: &'a LinkTree,
    warnings: Vec<FileError>,
    /// Passive joints.
    passive: BTreeSet<String>,
    /// Joints in poses that no motor drives.
    idle: BTreeSet<String>,
    srdf: Srdf,
}

impl SrdfReader<'_> {
    fn element(&mut self, element: &XmlElement) -> Result<(), FileError> {
        match element.name.as_str() {
            "group" => self.group(element)?,
            "group_state" => self.state(element)?,
            "disable_collisions" => self.pair(element)?,
            "virtual_joint" => {
                let joint = VirtualJoint {
                    name: self.required(element, "name")?,
                    joint_type: self.required(element, "type")?,
                    parent_frame: self.required(element, "parent_frame")?,
                    child_link: self.link(element, "child_link")?,
                };
                self.srdf.virtual_joints.push(joint);
            }
            "end_effector" => {
                let end_effector = EndEffector {
                    name: self.required(element, "name")?,
                    parent_link: self.link(element, "parent_link")?,
                    group: self.required(element, "group")?,
                    parent_group: element.get("parent_group").map(str::to_owned),
                };
                self.srdf.end_effectors.push(end_effector);
            }
            "passive_joint" => {
                let joint = self.joint(element, "name")?;
                self.srdf.passive_joints.push(joint);
            }
            // A user who writes such an element expects an effect. Other unknown elements belong to other programs.
            name if name.starts_with("disable") || name.starts_with("enable") => {
                self.warn(element, format!("<{name}> has no effect"), "name each pair in <disable_collisions>");
            }
            _ => {}
        }
        Ok(())
    }

    fn group(&mut self, element: &XmlElement) -> Result<(), FileError> {
        let mut group = SrdfGroup { name: self.required(element, "name")?, ..SrdfGroup::default() };
        if self.srdf.groups.iter().any(|g| g.name == group.name) {
            let message = format!("there is a group `{}` already", group.name);
            return Err(self.source.error(element.at.clone(), message, "give each one a name of its own"));
        }
        for member in &element.children {
            match member.name.as_str() {
                "joint" => group.joints.push(self.joint(member, "name")?),
                "link" => group.links.push(self.link(member, "name")?),
                "chain" => group.chains.extend(self.chain(member, &group.name)?),
                "group" => group.groups.push(self.required(member, "name")?),
                _ => {}
            }
        }
        self.srdf.groups.push(group);
        Ok(())
    }

    /// A chain of a group; `None`, with a warning, if the URDF does not have its links.
    fn chain(&mut self, element: &XmlElement, group: &str) -> Result<Option<(String, String)>, FileError> {
        let base = self.link(element, "base_link")?;
        let tip = self.link(element, "tip_link")?;
        if !self.tree.has_link(&base) || !self.tree.has_link(&tip) {
            let message = format!("group `{group}` is without its chain from `{base}` to `{tip}`");
            self.warn(element, message, "correct the names of its links");
            return Ok(None);
        }
        let (message, help) = match self.tree.chain(&base, &tip) {
            Some(joints) if !joints.is_empty() => return Ok(Some((base, tip))),
            Some(_) => ("has no joint".to_owned(), "name the last link of the chain as tip_link".to_owned()),
            None if self.tree.chain(&tip, &base).is_some() => (
                format!("runs towards the root: `{base}` hangs on `{tip}`"),
                format!("exchange them: base_link=\"{tip}\" tip_link=\"{base}\""),
            ),
            None => (
                format!("is none: `{tip}` does not hang on `{base}`"),
                "name as base_link a link between the root and the tip".to_owned(),
            ),
        };
        let message = format!("group `{group}`: the chain from `{base}` to `{tip}` {message}");
        Err(self.source.error(element.at.clone(), message, help))
    }

    fn state(&mut self, element: &XmlElement) -> Result<(), FileError> {
        let name = self.required(element, "name")?;
        let group = element.get("group").map(str::to_owned);
        let mut state = SrdfState { name, group, ..SrdfState::default() };
        for joint in element.all("joint") {
            let name = self.joint(joint, "name")?;
            let text = self.required(joint, "value")?;
            let numbers: Option<Vec<f64>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
            let Some(numbers) = numbers.filter(|n| n.iter().all(|v| v.is_finite())) else {
                let message = format!("the position of `{name}` is `{text}`, which is not a finite number");
                return Err(self.source.error(joint.at.clone(), message, "write radians, or meters if it slides"));
            };
            if numbers.len() != 1 && self.tree.has_joint(&name) {
                let message = format!("the position of `{name}` is `{text}`: it has one number, so it is not used");
                self.warn(joint, message, "write one number");
            }
            if state.positions.insert(name.clone(), numbers).is_some() {
                let message = format!("pose `{}` has two positions of `{name}`", state.name);
                return Err(self.source.error(joint.at.clone(), message, "leave one of them"));
            }
        }
        self.check_state(element, &state);
        self.srdf.states.push(state);
        Ok(())
    }

    /// Warns about positions of a pose that have no effect: those beyond limits, and those that differ from another
    /// pose of the same name.
    fn check_state(&mut self, element: &XmlElement, state: &SrdfState) {
        let mut beyond = Vec::new();
        let mut twice = Vec::new();
        for (joint, q) in state.positions.iter().filter_map(|(joint, q)| Some((joint, *q.first()?))) {
            match self.tree.joint(joint) {
                Some(JointUse::Moves { motion, min, max })
                    if !self.passive.contains(joint) && (q < min - LIMIT_TOLERANCE || q > max + LIMIT_TOLERANCE) =>
                {
                    let limit = if q < min { min } else { max };
                    beyond.push(format!(
                        "`{joint}` at {}, not {}",
                        format_position(motion, limit),
                        format_position(motion, q)
                    ));
                }
                Some(JointUse::Still | JointUse::Follows) => drop(self.idle.insert(joint.clone())),
                _ => {}
            }
            let before = self.srdf.states.iter().filter(|s| s.name == state.name);
            let mut before = before.filter_map(|s| s.positions.get(joint)?.first());
            if before.next().is_some_and(|first| (first - q).abs() > LIMIT_TOLERANCE) {
                twice.push(format!("`{joint}`"));
            }
        }
        let name = &state.name;
        if !beyond.is_empty() {
            let message =
                format!("pose `{name}` is beyond limits, which are taken in its place: {}", beyond.join(", "));
            self.warn(element, message, "write positions within the limits, in radians or meters");
        }
        if !twice.is_empty() {
            let message = format!("an earlier pose `{name}` has other positions, which count: {}", twice.join(", "));
            self.warn(element, message, "give poses that differ names of their own");
        }
    }

    fn pair(&mut self, element: &XmlElement) -> Result<(), FileError> {
        let a = self.link(element, "link1")?;
        let b = self.link(element, "link2")?;
        let reason = element.get("reason").unwrap_or_default().to_owned();
        self.srdf.disabled.insert(if a <= b { (a, b) } else { (b, a) }, reason);
        Ok(())
    }

    /// Warns about references to groups that do not exist.
    fn check_groups(&mut self, root: &XmlElement) {
        let exists = |name: &str| self.srdf.groups.iter().any(|g| g.name == name);
        let mut missing = Vec::new();
        for element in &root.children {
            let names = match element.name.as_str() {
                "group" => element.all("group").filter_map(|g| g.get("name")).collect(),
                "group_state" | "end_effector" => element.get("group").into_iter().collect::<Vec<_>>(),
                _ => Vec::new(),
            };
            missing.extend(names.into_iter().filter(|n| !exists(n)).map(|n| (element, n)));
        }
        for (element, name) in missing {
            self.warn(element, format!("there is no group `{name}`"), "correct the name, or add the group");
        }
    }

    /// The name of a link; warns if the URDF does not have it.
    fn link(&mut self, element: &XmlElement, attribute: &str) -> Result<String, FileError> {
        let name = self.required(element, attribute)?;
        if !self.tree.has_link(&name) {
            self.warn(element, format!("the URDF has no link `{name}`"), "correct the name, or remove it");
        }
        Ok(name)
    }

    /// The name of a joint; warns if it is neither a joint of the URDF nor a virtual joint of this file.
    fn joint(&mut self, element: &XmlElement, attribute: &str) -> Result<String, FileError> {
        let name = self.required(element, attribute)?;
        if !self.tree.has_joint(&name) && !self.srdf.virtual_joints.iter().any(|j| j.name == name) {
            self.warn(element, format!("the URDF has no joint `{name}`"), "correct the name, or remove it");
        }
        Ok(name)
    }

    fn required(&self, element: &XmlElement, name: &str) -> Result<String, FileError> {
        element.get(name).filter(|v| !v.is_empty()).map(str::to_owned).ok_or_else(|| {
            let message = format!("<{}> without `{name}`", element.name);
            self.source.error(element.at.clone(), message, format!("write {name}=\"...\" into its tag"))
        })
    }

    fn warn(&mut self, element: &XmlElement, message: String, help: &str) {
        if self.warnings.len() < MAX_WARNINGS {
            self.warnings.push(self.source.warning(element.at.clone(), message, help));
        }
    }
}

/// Formats a position of a joint for messages.
fn format_position(motion: JointMotion, position: f64) -> String {
    match motion {
        JointMotion::Turn => format!("{:.1} deg", position.to_degrees()),
        JointMotion::Slide => format!("{:.1} mm", position * 1e3),
    }
}
