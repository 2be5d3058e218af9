//! A first pass over the text: where each link and joint stands, and whether the XML is sane at all.
//!
//! The crate that reads URDF knows no places and sets no bounds. Both are had here, at the price of reading the text twice.

use crate::error::{FileError, Source};
use crate::printable::hidden_in;
use quick_xml::events::Event;
use quick_xml::{Reader, XmlVersion};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

/// Deeper nesting is refused; a URDF needs five levels.
const MAX_DEPTH: usize = 50;
/// More elements are refused; the robots that are sold have some thousands.
const MAX_ELEMENTS: usize = 40_000;
/// More links are refused.
pub(super) const MAX_LINKS: usize = 1000;

/// Where things stand in the text.
pub(super) struct Places {
    /// The outermost tag.
    pub robot: Range<usize>,
    /// Start tags by kind (`link` or `joint`) and name.
    elements: BTreeMap<(String, String), Range<usize>>,
}

impl Places {
    /// The start tag of a `link` or `joint`; the `robot` if there is none.
    pub fn of(&self, kind: &str, name: &str) -> Range<usize> {
        self.elements.get(&(kind.to_owned(), name.to_owned())).unwrap_or(&self.robot).clone()
    }
}

/// Walks over the text once, before anybody builds anything from it.
///
/// # Errors
/// If the XML is not well-formed or not a URDF, is too deep or too long, declares a document type, or holds hidden characters.
pub(super) fn scan(source: &Source) -> Result<Places, FileError> {
    let mut reader = Reader::from_str(source.text());
    reader.config_mut().expand_empty_elements = true;
    let mut places = Places { robot: 0..0, elements: BTreeMap::new() };
    let mut open: Vec<Range<usize>> = Vec::new();
    let mut seen_root = false;
    let mut elements = 0_usize;
    loop {
        let before = reader.buffer_position() as usize;
        let event = reader.read_event().map_err(|e| {
            let at = (reader.error_position() as usize).min(source.text().len());
            source.error(at..at, format!("this is not well-formed XML: {e}"), "mend the XML here or just before")
        })?;
        let at = before..reader.buffer_position() as usize;
        match event {
            Event::Eof => break,
            // Entities are declared there, and a few lines of them can stand for gigabytes.
            Event::DocType(_) => {
                return Err(source.error(at, "a URDF has no document type", "remove the <!DOCTYPE ...>"));
            }
            Event::End(_) => drop(open.pop()),
            Event::Start(tag) => {
                elements += 1;
                if elements > MAX_ELEMENTS {
                    let message = format!("the file has more than {MAX_ELEMENTS} elements");
                    return Err(source.error(at, message, "leave out what does not collide, or merge links"));
                }
                let name = tag.name().into_inner().to_owned();
                // Names go to terminals, logs and file names later on: what hides in them is refused here, once.
                let values =
                    tag.attributes().flatten().filter_map(|a| a.normalized_value(XmlVersion::Implicit1_0).ok());
                if let Some(what) = values.map(Cow::into_owned).find_map(|value| hidden_in(&value)) {
                    return Err(source.error(at, what, "use only visible characters in names and values"));
                }
                match open.len() {
                    0 if name != "robot" => {
                        let help = match name.to_ascii_lowercase().as_str() {
                            "zeropositionkinematictree" => "this is a ZRP file already; it needs no conversion",
                            _ if name.starts_with("xacro") => "run xacro on the file first",
                            _ => "a URDF begins with <robot name=\"...\">",
                        };
                        return Err(source.error(at, format!("<{name}> does not begin a URDF"), help));
                    }
                    0 if seen_root => {
                        return Err(source.error(at, "a second outermost element", "keep a single <robot>"));
                    }
                    0 => (seen_root, places.robot) = (true, at.clone()),
                    1 if name.starts_with("xacro:") => {
                        return Err(source.error(at, format!("<{name}> is a macro"), "run xacro on the file first"));
                    }
                    1 if name == "link" || name == "joint" => {
                        let id = tag.attributes().flatten().find(|a| a.key.into_inner() == "name");
                        let id = id.map(|a| a.value.trim().to_owned()).unwrap_or_default();
                        if id.is_empty() {
                            let message = format!("a {name} without a name");
                            return Err(source.error(at, message, "give it an attribute name=\"...\""));
                        }
                        if places.elements.len() >= 2 * MAX_LINKS {
                            let message = format!("more than {MAX_LINKS} links with their joints can't be converted");
                            return Err(source.error(at, message, "split the robot, or merge fixed links"));
                        }
                        if places.elements.insert((name.clone(), id.clone()), at.clone()).is_some() {
                            let message = format!("there is a {name} `{id}` already");
                            return Err(source.error(at, message, "give each one a name of its own"));
                        }
                    }
                    depth if depth >= MAX_DEPTH => {
                        let message = format!("elements are nested more than {MAX_DEPTH} deep");
                        return Err(source.error(at, message, "a URDF needs five levels; check where elements end"));
                    }
                    _ => {}
                }
                open.push(at);
            }
            _ => {}
        }
    }
    match open.pop() {
        Some(at) => Err(source.error(at, "this element is never closed", "close it where it ends")),
        None if !seen_root => {
            Err(source.error(0..0, "the file has no element", "a URDF begins with <robot name=\"...\">"))
        }
        None => Ok(places),
    }
}
