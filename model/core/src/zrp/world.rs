//! Converts tokens to the objects of a world.
//!
//! An object has a name, a class, a pose and any number of shapes. Worlds are flat: objects have no parents.

use super::element::{COLOR, Element, Warnings};
use super::geometry;
use super::xml::{Token, Tokens};
use crate::{Object, ObjectClass};
use mobee_text::{FileError, Loaded, SourceText};
use std::collections::BTreeSet;

/// The name of the root element, compared without case.
const ROOT: &str = "WorldList";
/// Maximum number of objects.
const MAX_OBJECTS: usize = 10_000;
/// Maximum number of shapes of all objects together.
const MAX_SHAPES: usize = 20_000;

/// Reads the objects of a world.
///
/// # Errors
/// The first mistake, with location and remedy.
pub(super) fn read(source: &SourceText) -> Result<Loaded<Vec<Object>>, FileError> {
    let mut tokens = Tokens::new(source);
    let mut reader = WorldReader::default();
    let mut depth = 0_usize;
    while let Some(token) = tokens.next()? {
        match token {
            Token::Start(e) => {
                if depth == 0 {
                    reader.root(&e)?;
                } else {
                    reader.element(&e, depth)?;
                }
                depth += 1;
            }
            Token::End => {
                depth = depth.saturating_sub(1);
                if reader.open_at == Some(depth) {
                    reader.open_at = None;
                }
            }
        }
    }
    Ok(Loaded { value: reader.objects, warnings: reader.warnings.0 })
}

/// State of the reader: the objects so far, and the open one.
#[derive(Default)]
struct WorldReader {
    /// Objects in the order of the file; the last one may still be open.
    objects: Vec<Object>,
    /// The names of all objects: edits refer to objects by name, so names must be unique.
    names: BTreeSet<String>,
    /// Number of names generated for objects without one.
    unnamed: usize,
    /// Number of shapes of all objects.
    shapes: usize,
    /// The depth of the open `object`, the last of `objects`.
    open_at: Option<usize>,
    /// Warnings so far.
    warnings: Warnings,
}

impl WorldReader {
    /// Checks the root element: another one indicates another kind of file.
    fn root(&mut self, e: &Element) -> Result<(), FileError> {
        if !e.name.eq_ignore_ascii_case(ROOT) {
            let help = match e.name.as_str() {
                "zeropositionkinematictree" => {
                    "this is a robot file; give it as the robot, not as the world".to_owned()
                }
                _ => format!("a world file begins with <{ROOT} version=\"1.0\">"),
            };
            return Err(e.error(format!("<{}> does not begin a world file", e.written), help));
        }
        if let Some(version) = e.get("version").filter(|v| !["", "1.0"].contains(&v.value.trim())) {
            let message = format!("version \"{}\" of the format is not known", version.value);
            return Err(e.error_at("version", message, "write version=\"1.0\""));
        }
        e.warn_unknown(&[&["version"]], &mut self.warnings);
        Ok(())
    }

    /// Adds an object, or a shape of the open one. `depth` is the number of enclosing elements.
    fn element(&mut self, e: &Element, depth: usize) -> Result<(), FileError> {
        if e.name == "object" {
            if self.open_at.is_some() {
                return Err(e.error("an object stands within an object", "close the outer one before: </object>"));
            }
            if self.objects.len() >= MAX_OBJECTS {
                let message = format!("the world has more than {MAX_OBJECTS} objects");
                return Err(e.error(message, "leave out what no robot can reach, or put many shapes into one object"));
            }
            let object = self.object(e)?;
            self.objects.push(object);
            self.open_at = Some(depth);
            return Ok(());
        }
        let Some(sizes) = geometry::shape_attributes(&e.name) else {
            let message = format!("<{}> is not known; it is ignored", e.written);
            let help = "known are object, sphere, cylinder, box and capsule";
            self.warnings.add(|| e.warning_at("", message, help));
            return Ok(());
        };
        e.warn_unknown(&[sizes, geometry::POSE], &mut self.warnings);
        match self.objects.last_mut().filter(|_| self.open_at.is_some()) {
            None => Err(e.error(format!("<{}> is outside any object", e.written), "put it into an <object>")),
            Some(_) if self.shapes >= MAX_SHAPES => {
                let message = format!("the world has more than {MAX_SHAPES} shapes");
                Err(e.error(message, "leave out what no robot can reach, or replace many small shapes by a large one"))
            }
            Some(object) => {
                self.shapes += 1;
                object.shapes.push(geometry::primitive(e)?);
                Ok(())
            }
        }
    }

    /// Reads the attributes of an object. Without a type it is an obstacle, the safe choice.
    fn object(&mut self, e: &Element) -> Result<Object, FileError> {
        let own: &[&str] = &["name", "type", "persistent"];
        e.warn_unknown(&[own, COLOR, geometry::POSE], &mut self.warnings);
        let class = match e.get("type").map_or("", |t| t.value.trim()) {
            "" => ObjectClass::Obstacle,
            word => ObjectClass::of_word(word).ok_or_else(|| {
                let message = format!("\"{word}\" is not an object type");
                e.error_at("type", message, "write obstacle, target or ghost (or obs, tgt, gho)")
            })?,
        };
        let name = match e.get("name").map_or("", |n| n.value.trim()) {
            // A generated name may already be in use.
            "" => loop {
                self.unnamed += 1;
                let name = format!("object{}", self.unnamed);
                if !self.names.contains(&name) {
                    break name;
                }
            },
            name => name.to_owned(),
        };
        if !self.names.insert(name.clone()) {
            let message = format!("there is an object `{name}` already");
            return Err(e.error_at("name", message, "give each object its own name"));
        }
        let persistent = e.integer("persistent")?.unwrap_or(0) != 0;
        Ok(Object { name, class, persistent, pose: geometry::pose(e)?, shapes: Vec::new(), color: e.color()? })
    }
}
