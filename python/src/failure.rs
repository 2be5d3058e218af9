//! Failures of calls, as `mobee.MobeeError` carries them. No Python here.

use mobee_fast::FastError;
use mobee_import::ImportError;
use mobee_model::{FileError, SceneError};

/// A failed call, in the words of the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Failure {
    /// For programs: stable, one word.
    pub code: &'static str,
    /// The fact, as a sentence.
    pub message: String,
    /// The place: an argument such as `q[3]`, or a file with line and column.
    pub place: Option<String>,
    /// The remedy, as a sentence.
    pub remedy: String,
}

impl Failure {
    /// At no place in particular.
    pub fn new(code: &'static str, message: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { code, message: message.into(), place: None, remedy: remedy.into() }
    }

    /// The same, at a place.
    pub fn at(self, place: impl Into<String>) -> Self {
        Self { place: Some(place.into()), ..self }
    }

    /// A sentence of our libraries that ends with its remedy, behind a semicolon.
    fn of_sentence(code: &'static str, sentence: &str) -> Self {
        let (message, remedy) = sentence.rsplit_once("; ").unwrap_or((sentence, ""));
        Self::new(code, message, remedy)
    }
}

impl From<FileError> for Failure {
    fn from(e: FileError) -> Self {
        let place = match e.line() {
            0 => e.file().to_owned(),
            line => format!("{}:{line}:{}", e.file(), e.column()),
        };
        Self::new("file", e.message(), e.remedy()).at(place)
    }
}

impl From<SceneError> for Failure {
    fn from(e: SceneError) -> Self {
        let code = match e {
            SceneError::Duplicate { .. } => "duplicate",
            SceneError::Unknown { .. } => "unknown",
            SceneError::Persistent { .. } => "persistent",
            SceneError::NotFinite { .. } => "not_finite",
            SceneError::TooMany { .. } => "too_many",
            SceneError::PairRule { .. } => "pair",
        };
        Self::of_sentence(code, &e.to_string())
    }
}

impl From<FastError> for Failure {
    fn from(e: FastError) -> Self {
        let code = if matches!(e, FastError::Clearance(_)) { "clearance" } else { "internal" };
        let (message, remedy) = e
            .to_string()
            .split_once(": ")
            .map_or((e.to_string(), String::new()), |(a, b)| (a.to_owned(), b.to_owned()));
        Self::new(code, message, remedy)
    }
}

impl From<ImportError> for Failure {
    fn from(e: ImportError) -> Self {
        match e {
            ImportError::File(e) => e.into(),
            ImportError::Scene(e) => e.into(),
            ImportError::Unreadable { ref path, ref source } => {
                Self::new("file", format!("cannot read the file: {source}"), "make the file readable for this user")
                    .at(path.display().to_string())
            }
            other => Self::new("file", other.to_string(), "check the URDF and its meshes"),
        }
    }
}
