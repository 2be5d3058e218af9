//! Tables of the used and unused words of a URDF or SRDF: no part of a file is ignored silently.

use super::grouped::Grouped;
use mobee_text::xml::XmlElement;
use mobee_text::{FileError, SourceText};
use std::collections::BTreeMap;
use std::ops::Range;

/// The used words of an element, and the unused ones of the standard.
pub(crate) struct Words {
    /// The element.
    element: &'static str,
    /// Used attributes.
    attributes: &'static [&'static str],
    /// Unused attributes of the standard.
    idle_attributes: &'static [&'static str],
    /// Used child elements.
    children: &'static [&'static str],
    /// Unused child elements of the standard or of well-known programs.
    idle_children: &'static [&'static str],
}

/// Creates a row of the table.
pub(crate) const fn words(
    element: &'static str,
    [attributes, idle_attributes, children, idle_children]: [&'static [&'static str]; 4],
) -> Words {
    Words { element, attributes, idle_attributes, children, idle_children }
}

/// The elements of a URDF that are read, with their words.
pub(super) const URDF: &[Words] = &[
    words(
        "robot",
        [
            &["name", "version"],
            &[],
            &["link", "joint"],
            &["material", "transmission", "gazebo", "sensor", "ros2_control"],
        ],
    ),
    words("link", [&["name"], &[], &["collision", "inertial"], &["visual", "sensor", "contact"]]),
    words("collision", [&[], &["name"], &["origin", "geometry"], &["material", "contact_coefficients", "verbose"]]),
    words("visual", [&[], &["name"], &["origin", "geometry"], &["material"]]),
    words("geometry", [&[], &["name"], &["box", "cylinder", "capsule", "sphere", "mesh"], &[]]),
    words("box", [&["size"], &[], &[], &[]]),
    words("cylinder", [&["radius", "length"], &[], &[], &[]]),
    words("capsule", [&["radius", "length"], &[], &[], &[]]),
    words("sphere", [&["radius"], &[], &[], &[]]),
    words("mesh", [&["filename", "scale"], &[], &[], &[]]),
    words("origin", [&["xyz", "rpy", "quat_xyzw"], &[], &[], &[]]),
    words("inertial", [&[], &[], &["origin", "mass"], &["inertia"]]),
    words("mass", [&["value"], &[], &[], &[]]),
    words(
        "joint",
        [
            &["name", "type"],
            &[],
            &["origin", "parent", "child", "axis", "limit", "mimic", "safety_controller"],
            &["dynamics", "calibration"],
        ],
    ),
    words("parent", [&["link"], &[], &[], &[]]),
    words("child", [&["link"], &[], &[], &[]]),
    words("axis", [&["xyz"], &[], &[], &[]]),
    words("limit", [&["lower", "upper", "velocity"], &["effort", "acceleration", "deceleration", "jerk"], &[], &[]]),
    words("mimic", [&["joint", "multiplier", "offset"], &[], &[], &[]]),
    words("safety_controller", [&["soft_lower_limit", "soft_upper_limit"], &["k_position", "k_velocity"], &[], &[]]),
];

/// Unused words of a file.
#[derive(Debug, Default)]
pub(crate) struct Unused {
    /// Words of the format that MoBeE does not use, with their number of occurrences.
    idle: BTreeMap<String, usize>,
    /// Words that are not in the format: location of the first, and number of occurrences.
    unknown: BTreeMap<String, (Range<usize>, usize)>,
}

impl Unused {
    /// Collects the unused words of a robot. `visual` returns true for links whose visual is used.
    pub fn of(root: &XmlElement, words: &[Words], visual: impl Fn(&XmlElement) -> bool) -> Self {
        let mut unused = Self::default();
        let mut todo = vec![root];
        while let Some(element) = todo.pop() {
            let Some(known) = words.iter().find(|w| w.element == element.name) else { continue };
            for name in element.names().filter(|n| !known.attributes.contains(n) && !n.starts_with("xml")) {
                match known.idle_attributes.contains(&name) {
                    true => unused.idle(format!("{name} of <{}>", element.name)),
                    false => unused.unknown(element, format!("`{name}` of <{}>", element.name)),
                }
            }
            // Limits of a fixed joint have no effect.
            let still = element.name == "joint" && matches!(element.get("type"), Some("fixed" | "floating"));
            for child in &element.children {
                let name = child.name.as_str();
                if still && matches!(name, "axis" | "limit" | "mimic" | "safety_controller") {
                    unused.idle(format!("<{name}> of joints that stand still"));
                } else if known.children.contains(&name) || (name == "visual" && visual(element)) {
                    todo.push(child);
                } else if known.idle_children.contains(&name) || name.contains(':') {
                    unused.idle(format!("<{name}>"));
                } else {
                    unused.unknown(child, format!("<{name}> in <{}>", element.name));
                }
            }
        }
        unused
    }

    fn idle(&mut self, what: String) {
        *self.idle.entry(what).or_default() += 1;
    }

    fn unknown(&mut self, element: &XmlElement, what: String) {
        let entry = self.unknown.entry(what).or_insert_with(|| (element.at.clone(), 0));
        entry.0.start = entry.0.start.min(element.at.start);
        entry.1 += 1;
    }

    /// The unused words of the standard, in one line; `None` if there are none.
    pub fn line(&self, format: &str) -> Option<String> {
        let all: Vec<String> = self.idle.iter().map(|(what, n)| counted(what, *n)).collect();
        (!all.is_empty()).then(|| format!("not used of the {format}: {}", all.join(", ")))
    }

    /// Adds a warning about the words that are not in the format.
    pub fn warn(self, source: &SourceText, format: &str, warnings: &mut Vec<FileError>) {
        let mut unknown: Vec<_> = self.unknown.into_iter().collect();
        unknown.sort_by_key(|(_, (at, _))| at.start);
        let mut all = Grouped::default();
        for (what, (at, n)) in unknown {
            all.add(&at, counted(&what, n));
        }
        let help = "check how they are spelled (upper and lower case count), and whether something depends on them";
        all.warn(source, &format!("not used, as no {format} has these words"), help, warnings);
    }
}

/// A word, with the number of occurrences if there are several.
fn counted(what: &str, n: usize) -> String {
    if n > 1 { format!("{what} ({n} times)") } else { what.to_owned() }
}
