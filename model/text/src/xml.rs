//! XML as a tree whose elements store their locations, for formats whose readers access elements in any order: URDF,
//! SRDF, COLLADA.

use crate::error::{FileError, SourceText};
use crate::hidden_in;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::ops::Range;

/// Maximum nesting depth; a URDF needs five levels, a COLLADA scene of a robot's link ten.
const MAX_DEPTH: usize = 50;

/// Limits of a document.
pub struct XmlLimits {
    /// Maximum number of elements.
    pub elements: usize,
    /// If true, hidden characters in values and an & that does not start an entity are errors.
    pub visible_only: bool,
}

/// Limits for files whose names are displayed; commercial robots have some thousands of elements.
const LIMITS: XmlLimits = XmlLimits { elements: 40_000, visible_only: true };

/// An element with its contents.
#[derive(Debug)]
pub struct XmlElement {
    /// Its name as written, with its prefix.
    pub name: String,
    /// Location of its start tag, bytes.
    pub at: Range<usize>,
    /// Location of its content between the tags, bytes.
    pub inner: Range<usize>,
    /// Its child elements.
    pub children: Vec<XmlElement>,
    /// Names and unescaped values of its attributes.
    attributes: Vec<(String, String)>,
}

impl XmlElement {
    /// An attribute's value, trimmed.
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

/// Parses a text and returns its root element.
///
/// # Errors
/// If the text is not well-formed, has no or several root elements, is nested too deeply, has too many elements,
/// declares entities, or contains hidden characters in its values.
pub fn parse(source: &SourceText) -> Result<XmlElement, FileError> {
    parse_within(source, &LIMITS)
}

/// As [`parse`], with other limits.
///
/// # Errors
/// As for [`parse`].
pub fn parse_within(source: &SourceText, limits: &XmlLimits) -> Result<XmlElement, FileError> {
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
            // A few lines of entities can expand to gigabytes, or include other files.
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

/// The text of an element's content without its comments; `None` if it contains elements or other markup.
pub fn text_of(content: &str) -> Option<String> {
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

/// Creates an element with its attributes, still without content.
fn start(
    source: &SourceText,
    tag: &BytesStart<'_>,
    at: Range<usize>,
    limits: &XmlLimits,
) -> Result<XmlElement, FileError> {
    let mut attributes = Vec::new();
    for attribute in tag.attributes() {
        let attribute = attribute.map_err(|e| {
            source.error(at.clone(), format!("this is not well-formed XML: {e}"), "write attributes as name=\"value\"")
        })?;
        let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|e| {
            let help = "write & as &amp;, < as &lt;, and define no entities of your own";
            source.error(at.clone(), format!("a value cannot be read: {e}"), help)
        })?;
        // Names appear in terminals, logs and file names later: hidden characters are rejected here.
        if let Some(what) = hidden_in(&value).filter(|_| limits.visible_only) {
            return Err(source.error(at, what, "use only visible characters in names and values"));
        }
        attributes.push((attribute.key.into_inner().to_owned(), value.into_owned()));
    }
    let inner = at.end..at.end;
    Ok(XmlElement { name: tag.name().into_inner().to_owned(), at, inner, children: Vec::new(), attributes })
}
