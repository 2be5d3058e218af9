//! Strict reader of one element's attributes: a missing one has its default, an unreadable one is an error at its
//! location.

use mobee_text::{FileError, SourceText};
use nalgebra::Vector3;
use std::ops::Range;

/// Maximum absolute value of a number: no robot needs larger ones, and their squares are still representable.
const MAX_NUMBER: f64 = 1e6;

/// Minimum size, meters: smaller objects can't be touched, and their squares underflow.
const MIN_SIZE_M: f64 = 1e-9;

/// Maximum number of warnings.
const MAX_WARNINGS: usize = 100;

/// The attributes of a color.
pub(super) const COLOR: &[&str] = &["r", "g", "b"];

/// The warnings of one file. Creating one searches the file for its line, so it is created only if it is stored.
#[derive(Default)]
pub(super) struct Warnings(pub(super) Vec<FileError>);

impl Warnings {
    /// Creates and stores a warning, unless there are too many already.
    pub(super) fn add(&mut self, warning: impl FnOnce() -> FileError) {
        if self.0.len() < MAX_WARNINGS {
            self.0.push(warning());
        }
    }
}

/// An attribute, with the locations of its name and value in the file.
pub(super) struct Attr {
    /// Its name as written; case-sensitive.
    pub(super) name: String,
    /// Its value, unescaped.
    pub(super) value: String,
    /// Location of the name, bytes.
    pub(super) name_at: Range<usize>,
    /// Location of the value, bytes.
    pub(super) at: Range<usize>,
}

/// An element with its attributes; its accessors return a default, the value, or an error at the value.
pub(super) struct Element {
    /// The file, for errors.
    source: SourceText,
    /// Its name as written.
    pub(super) written: String,
    /// Its name in lower case: element names are compared without case.
    pub(super) name: String,
    /// Location of its name, bytes.
    pub(super) at: Range<usize>,
    /// Its attributes in order; names are unique.
    pub(super) attrs: Vec<Attr>,
}

impl Element {
    /// Creates an element without attributes.
    pub(super) fn new(source: SourceText, written: &str, at: Range<usize>) -> Self {
        Self { source, written: written.to_owned(), name: written.to_ascii_lowercase(), at, attrs: Vec::new() }
    }

    /// The attribute of exactly this name.
    pub(super) fn get(&self, name: &str) -> Option<&Attr> {
        self.attrs.iter().find(|a| a.name == name)
    }

    /// An error at this element.
    pub(super) fn error(&self, message: impl Into<String>, help: impl Into<String>) -> FileError {
        self.source.error(self.at.clone(), message, help)
    }

    /// An error at an attribute's value, or at the element if the attribute is missing.
    pub(super) fn error_at(&self, attr: &str, message: impl Into<String>, help: impl Into<String>) -> FileError {
        let at = self.get(attr).map_or(&self.at, |a| &a.at).clone();
        self.source.error(at, message, help)
    }

    /// A warning at an attribute's value, or at the element if the attribute is missing.
    pub(super) fn warning_at(&self, attr: &str, message: impl Into<String>, help: impl Into<String>) -> FileError {
        let at = self.get(attr).map_or(&self.at, |a| &a.at).clone();
        self.source.warning(at, message, help)
    }

    /// Adds warnings about attributes that are not in `known`.
    pub(super) fn warn_unknown(&self, known: &[&[&str]], warnings: &mut Warnings) {
        for a in &self.attrs {
            // Namespaces and schema hints are not part of the format, and can't be typing errors.
            if !known.iter().any(|k| k.contains(&a.name.as_str())) && !a.name.starts_with("xml") {
                let list = known.concat().join(", ");
                let message = format!("<{}> has no attribute `{}`; it is ignored", self.written, a.name);
                let help = format!("its attributes are: {list} (upper and lower case count)");
                warnings.add(|| self.source.warning(a.name_at.clone(), message, help));
            }
        }
    }

    /// A required, non-empty name.
    pub(super) fn name_attr(&self) -> Result<String, FileError> {
        match self.get("name").map(|a| a.value.trim()) {
            Some(name) if !name.is_empty() => Ok(name.to_owned()),
            _ => Err(self.error_at("name", format!("<{}> has no name", self.written), "give it a name=\"...\"")),
        }
    }

    /// A number; `None` if the attribute is missing.
    pub(super) fn number(&self, name: &str) -> Result<Option<f64>, FileError> {
        let Some(attr) = self.get(name) else { return Ok(None) };
        let help = || format!("write a plain number with a decimal point, such as {name}=\"0.05\"");
        match attr.value.trim().parse::<f64>() {
            // "inf" and "nan" parse as numbers, but must not get into a pose.
            Ok(v) if v.is_nan() || v.abs() > MAX_NUMBER => {
                let message = format!("`{name}` is {}, beyond {MAX_NUMBER:e}", attr.value.trim());
                Err(self.error_at(name, message, "lengths are in meters, angles in degrees"))
            }
            Ok(v) => Ok(Some(v)),
            Err(_) => Err(self.error_at(name, format!("`{name}` is not a number: \"{}\"", attr.value), help())),
        }
    }

    /// A number, 0 if the attribute is missing.
    pub(super) fn number_or_zero(&self, name: &str) -> Result<f64, FileError> {
        Ok(self.number(name)?.unwrap_or(0.0))
    }

    /// Three numbers, each 0 if missing.
    pub(super) fn vector(&self, names: [&str; 3]) -> Result<Vector3<f64>, FileError> {
        let [x, y, z] = names;
        Ok(Vector3::new(self.number_or_zero(x)?, self.number_or_zero(y)?, self.number_or_zero(z)?))
    }

    /// A required positive size, meters.
    pub(super) fn size(&self, name: &str) -> Result<f64, FileError> {
        match self.number(name)? {
            Some(v) if v >= MIN_SIZE_M => Ok(v),
            Some(v) => Err(self.error_at(
                name,
                format!(
                    "`{name}` of <{}> is {v}, but must be {}",
                    self.written,
                    if v > 0.0 { "a nanometer or more" } else { "above 0" }
                ),
                "give the size in meters",
            )),
            None => Err(self.error(
                format!("<{}> has no `{name}`", self.written),
                format!("give the size in meters: {name}=\"0.05\""),
            )),
        }
    }

    /// A size, meters; `None` if it is 0 or missing.
    pub(super) fn optional_size(&self, name: &str) -> Result<Option<f64>, FileError> {
        match self.number(name)? {
            Some(v) if v < 0.0 => Err(self.error_at(
                name,
                format!("`{name}` of <{}> is {v}, but must not be negative", self.written),
                "give a size in meters, or 0 for none",
            )),
            other => Ok(other.filter(|v| *v > 0.0)),
        }
    }

    /// A whole number; `None` if the attribute is missing.
    pub(super) fn integer(&self, name: &str) -> Result<Option<i64>, FileError> {
        let Some(attr) = self.get(name) else { return Ok(None) };
        let parsed = attr.value.trim().parse::<i64>();
        parsed.map(Some).map_err(|_| {
            let message = format!("`{name}` is not a whole number: \"{}\"", attr.value);
            self.error_at(name, message, format!("write digits only, such as {name}=\"0\""))
        })
    }

    /// A color from `r`, `g` and `b`, 0 to 255; a missing channel is 0. `None` if all are missing.
    pub(super) fn color(&self) -> Result<Option<[u8; 3]>, FileError> {
        let mut rgb = [0; 3];
        let mut given = false;
        for (channel, name) in rgb.iter_mut().zip(COLOR) {
            if let Some(value) = self.integer(name)? {
                given = true;
                *channel = u8::try_from(value).map_err(|_| {
                    self.error_at(
                        name,
                        format!("`{name}` is {value}, outside 0 to 255"),
                        "give a color as three whole numbers of 0 to 255",
                    )
                })?;
            }
        }
        Ok(given.then_some(rgb))
    }

    /// A blank-separated list of numbers; empty if the attribute is missing.
    pub(super) fn numbers(&self, name: &str) -> Result<Vec<f64>, FileError> {
        let Some(attr) = self.get(name) else { return Ok(Vec::new()) };
        let each = attr.value.split_whitespace().map(|w| match w.parse::<f64>() {
            Ok(v) if v.is_finite() && v.abs() <= MAX_NUMBER => Ok(v),
            _ => Err(self.error_at(
                name,
                format!("`{name}` holds \"{w}\", which is no usable number"),
                format!("write numbers with blanks between them, such as {name}=\"1 -1\""),
            )),
        });
        each.collect()
    }

    /// True if the attribute is `true`; warns if it is neither `true` nor `false`.
    pub(super) fn flag(&self, name: &str, warnings: &mut Warnings) -> bool {
        let Some(attr) = self.get(name) else { return false };
        let value = attr.value.trim();
        if !value.eq_ignore_ascii_case("true") && !value.eq_ignore_ascii_case("false") {
            let message = format!("`{name}` is \"{value}\", which counts as false");
            warnings.add(|| self.warning_at(name, message, "write true or false"));
        }
        value.eq_ignore_ascii_case("true")
    }
}
