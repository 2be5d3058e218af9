//! XML as a tree whose elements know their places, for formats in which readers look things up in any order: URDF, SRDF, COLLADA.

use crate::error::{FileError, Source};
use crate::printable::hidden_in;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::ops::Range;

/// Deeper nesting is refused; a URDF needs five levels, a COLLADA scene of a robot's link ten.
const MAX_DEPTH: usize = 50;

/// What a document may hold.
pub(crate) struct XmlLimits {
    /// More elements are refused.
    pub elements: usize,
    /// Whether hidden characters in values are refused, and an & that begins no entity.
    pub visible_only: bool,
}

/// For files whose names end up elsewhere; the robots that are sold have some thousands of elements.
const LIMITS: XmlLimits = XmlLimits { elements: 40_000, visible_only: true };

/// An element with all that is in it.
#[derive(Debug)]
pub(crate) struct XmlElement {
    /// As written, with its prefix.
    pub name: String,
    /// Where its start tag stands, bytes.
    pub at: Range<usize>,
    /// Where its content stands: what is between its tags, bytes.
    pub inner: Range<usize>,
    /// The elements directly within it.
    pub children: Vec<XmlElement>,
    /// Names and unescaped values.
    attributes: Vec<(String, String)>,
}

impl XmlElement {
    /// An attribute's value without the spaces around it.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(n, _)| n == name).map(|(_, value)| value.trim())
    }

    /// The first child of this name.
    pub fn child(&self, name: &str) -> Option<&XmlElement> {
        self.children.iter().find(|c| c.name == name)
    }

    /// All children of this name.
    pub fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a XmlElement> {
        self.children.iter().filter(move |c| c.name == name)
    }

    /// The names of its attributes.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.attributes.iter().map(|(name, _)| name.as_str())
    }

    /// The values of its attributes.
    pub fn values(&self) -> impl Iterator<Item = &str> {
        self.attributes.iter().map(|(_, value)| value.as_str())
    }
}

/// The outermost element of a text.
///
/// # Errors
/// If the text is not well-formed, has no element or several outermost ones, is nested too deep, has too many elements, declares
/// entities, or holds hidden characters in its values.
pub(crate) fn parse(source: &Source) -> Result<XmlElement, FileError> {
    parse_within(source, &LIMITS)
}

/// As [`parse`], within other limits.
///
/// # Errors
/// As for [`parse`].
pub(crate) fn parse_within(source: &Source, limits: &XmlLimits) -> Result<XmlElement, FileError> {
    let mut reader = Reader::from_str(source.text());
    reader.config_mut().expand_empty_elements = true;
    reader.config_mut().allow_dangling_amp = !limits.visible_only;
    let mut open: Vec<XmlElement> = Vec::new();
    let mut root = None;
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
            // A few lines of entities can stand for gigabytes, or for other files.
            Event::DocType(declared) if ["<!ENTITY", "<!ATTLIST"].iter().any(|d| declared.contains(d)) => {
                let message = "a document type that declares entities or attributes is not read";
                return Err(source.error(at, message, "remove the <!DOCTYPE ...>"));
            }
            Event::Start(tag) => {
                elements += 1;
                if elements > limits.elements {
                    let message = format!("the file has more than {} elements", limits.elements);
                    return Err(source.error(at, message, "leave out what does not collide, or merge links"));
                }
                if open.len() >= MAX_DEPTH {
                    let message = format!("elements are nested more than {MAX_DEPTH} deep");
                    return Err(source.error(at, message, "check where elements end"));
                }
                if open.is_empty() && root.is_some() {
                    return Err(source.error(at, "a second outermost element", "keep a single outermost element"));
                }
                open.push(start(source, &tag, at, limits)?);
            }
            Event::End(_) => {
                let Some(mut element) = open.pop() else { continue };
                element.inner = element.at.end..before.max(element.at.end);
                match open.last_mut() {
                    Some(parent) => parent.children.push(element),
                    None => root = Some(element),
                }
            }
            _ => {}
        }
    }
    match open.pop() {
        Some(element) => Err(source.error(element.at, "this element is never closed", "close it where it ends")),
        None => root.ok_or_else(|| source.error(0..0, "the file has no element", "check that it is the file you mean")),
    }
}

/// The text of an element's content without its comments; none if there are elements in it, or what is no text.
pub(crate) fn text_of(content: &str) -> Option<String> {
    let mut reader = Reader::from_str(content);
    let mut text = String::new();
    loop {
        match reader.read_event().ok()? {
            Event::Eof => return Some(text),
            Event::Text(part) => text.push_str(&part),
            Event::CData(part) => text.push_str(&part),
            Event::GeneralRef(character) => text.push(character.resolve_char_ref().ok()??),
            Event::Comment(_) | Event::PI(_) => {}
            _ => return None,
        }
    }
}

/// An element that has only its attributes yet.
fn start(source: &Source, tag: &BytesStart<'_>, at: Range<usize>, limits: &XmlLimits) -> Result<XmlElement, FileError> {
    let mut attributes = Vec::new();
    for attribute in tag.attributes() {
        let attribute = attribute.map_err(|e| {
            source.error(at.clone(), format!("this is not well-formed XML: {e}"), "write attributes as name=\"value\"")
        })?;
        let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|e| {
            let help = "write & as &amp;, < as &lt;, and define no entities of your own";
            source.error(at.clone(), format!("a value cannot be read: {e}"), help)
        })?;
        // Names go to terminals, logs and file names later on: what hides in them is refused here, once.
        if let Some(what) = hidden_in(&value).filter(|_| limits.visible_only) {
            return Err(source.error(at, what, "use only visible characters in names and values"));
        }
        attributes.push((attribute.key.into_inner().to_owned(), value.into_owned()));
    }
    let inner = at.end..at.end;
    Ok(XmlElement { name: tag.name().into_inner().to_owned(), at, inner, children: Vec::new(), attributes })
}
