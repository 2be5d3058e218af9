//! All complaints about a configuration at once, in the order in which they were found.

use super::ConfigError;
use mobee_model::FileError;
use std::fmt;

/// Maximum number of complaints reported at once: a user fixes no more before the next try.
pub(super) const MAX_COMPLAINTS: usize = 50;

/// A complaint about the configuration, or about a robot's or world's file that it names.
#[derive(Debug)]
pub enum Complaint {
    /// About the configuration.
    Config(ConfigError),
    /// About a model file.
    Model(FileError),
}

impl Complaint {
    /// The remedy.
    pub fn remedy(&self) -> &str {
        match self {
            Complaint::Config(e) => e.help_text(),
            Complaint::Model(e) => e.remedy(),
        }
    }

    /// The file it is about, with line and column (from 1), if it has a place.
    pub fn place(&self) -> Option<(&str, usize, usize)> {
        match self {
            Complaint::Config(e) => e.file().zip(e.line_column()).map(|(file, (line, column))| (file, line, column)),
            Complaint::Model(e) => (e.line() > 0).then(|| (e.file(), e.line(), e.column())),
        }
    }
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Complaint::Config(e) => e.fmt(f),
            Complaint::Model(e) => e.fmt(f),
        }
    }
}

impl From<ConfigError> for Complaint {
    fn from(e: ConfigError) -> Complaint {
        Complaint::Config(e)
    }
}

impl From<FileError> for Complaint {
    fn from(e: FileError) -> Complaint {
        Complaint::Model(e)
    }
}

/// All complaints about a configuration. Shown as one complaint if there is only one, else as a list.
#[derive(Debug, Default)]
pub struct Complaints(Vec<Complaint>);

impl Complaints {
    /// Adds one, if fewer than `MAX_COMPLAINTS` are stored.
    pub fn push(&mut self, e: impl Into<Complaint>) {
        if !self.is_full() {
            self.0.push(e.into());
        }
    }

    /// Adds all of another list, up to `MAX_COMPLAINTS`.
    pub fn append(&mut self, other: Complaints) {
        other.0.into_iter().for_each(|e| self.push(e));
    }

    /// True if no more complaints are stored.
    pub fn is_full(&self) -> bool {
        self.0.len() >= MAX_COMPLAINTS
    }

    /// The value of a good result; `None` if it is a complaint, which is stored.
    pub fn keep<T>(&mut self, result: Result<T, impl Into<Complaints>>) -> Option<T> {
        result.map_err(|e| self.append(e.into())).ok()
    }

    /// True if there is no complaint.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The complaints, in the order in which they were found.
    pub fn iter(&self) -> impl Iterator<Item = &Complaint> {
        self.0.iter()
    }

    /// The value if nothing is wrong.
    ///
    /// # Errors
    /// All of these complaints, if there are any.
    pub fn none_or<T>(self, value: T) -> Result<T, Complaints> {
        if self.0.is_empty() { Ok(value) } else { Err(self) }
    }

    /// The complaints, of which there must be at least one.
    pub fn of_something(self) -> Complaints {
        debug_assert!(!self.is_empty(), "nothing can be missing without a complaint");
        self
    }

    /// The complaint, if there is only one.
    pub(super) fn only(&self) -> Option<&Complaint> {
        match self.0.as_slice() {
            [one] => Some(one),
            _ => None,
        }
    }
}

impl From<ConfigError> for Complaints {
    fn from(e: ConfigError) -> Complaints {
        Complaints(vec![e.into()])
    }
}

impl From<FileError> for Complaints {
    fn from(e: FileError) -> Complaints {
        Complaints(vec![e.into()])
    }
}

impl fmt::Display for Complaints {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.only() {
            Some(one) => fmt::Display::fmt(one, f),
            None if self.is_full() => write!(f, "many things are wrong; these are the first {MAX_COMPLAINTS}"),
            None => write!(f, "{} things are wrong", self.0.len()),
        }
    }
}

impl std::error::Error for Complaints {}
