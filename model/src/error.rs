//! Errors in the files that users write: file, line, column, a caret and a remedy.

use miette::{Diagnostic, LabeledSpan, NamedSource, Severity, SourceCode};
use std::{fmt, ops::Range, path::Path, sync::Arc};

/// The text of a file together with the name that messages call it by.
#[derive(Clone, Debug)]
pub(crate) struct Source(Arc<NamedSource<String>>);

impl Source {
    pub(crate) fn new(name: &str, text: &str) -> Self {
        Self(Arc::new(NamedSource::new(name, text.to_owned())))
    }

    /// Reads a file that must be UTF-8 of at most `limit` bytes.
    pub(crate) fn read(path: &Path, limit: u64) -> Result<Self, FileError> {
        let name = path.display().to_string();
        let no_file = |message: String, help: &str| {
            FileError::new(&Self::new(&name, ""), None, message, help.to_owned(), Severity::Error)
        };
        let about = |e: std::io::Error| {
            let help = match e.kind() {
                std::io::ErrorKind::NotFound => "check the path; it is relative to the folder the program runs in",
                std::io::ErrorKind::PermissionDenied => "make the file readable for this user",
                _ => "check that the path names a readable file",
            };
            no_file(format!("cannot read the file: {e}"), help)
        };
        let meta = std::fs::metadata(path).map_err(about)?;
        if !meta.is_file() {
            return Err(no_file("this is not a file".into(), "give the path of a file, not of a folder"));
        }
        if meta.len() > limit {
            return Err(no_file(
                format!("the file has {} bytes, more than the {limit} that are read", meta.len()),
                "check that this is the file you mean; split very large models",
            ));
        }
        let bytes = std::fs::read(path).map_err(about)?;
        match String::from_utf8(bytes) {
            Ok(text) => Ok(Self::new(&name, &text)),
            Err(e) => {
                let at = e.utf8_error().valid_up_to();
                let text = String::from_utf8_lossy(e.as_bytes()).into_owned();
                let help = "save the file in the encoding UTF-8".to_owned();
                Err(Self::new(&name, &text).error(at..at, "this byte is not UTF-8 text", help))
            }
        }
    }

    pub(crate) fn name(&self) -> &str {
        self.0.name()
    }

    pub(crate) fn text(&self) -> &str {
        self.0.inner()
    }

    /// An error at a place of this file.
    pub(crate) fn error(&self, at: Range<usize>, message: impl Into<String>, help: impl Into<String>) -> FileError {
        FileError::new(self, Some(at), message.into(), help.into(), Severity::Error)
    }

    /// A warning at a place of this file.
    pub(crate) fn warning(&self, at: Range<usize>, message: impl Into<String>, help: impl Into<String>) -> FileError {
        FileError::new(self, Some(at), message.into(), help.into(), Severity::Warning)
    }
}

/// What is wrong (or, as a warning, odd) in a file that a user wrote: where it is and how to mend it.
///
/// `Display` prints `file:line:column: message`; as a [`Diagnostic`] it has the source text, a caret and a help line.
#[derive(Clone)]
pub struct FileError(Box<Inner>);

#[derive(Clone, Debug)]
struct Inner {
    source: Source,
    span: Option<Range<usize>>,
    line: usize,
    column: usize,
    message: String,
    help: String,
    severity: Severity,
}

impl FileError {
    fn new(source: &Source, span: Option<Range<usize>>, message: String, help: String, severity: Severity) -> Self {
        let text = source.text();
        let mut at = span.as_ref().map_or(0, |s| s.start).min(text.len());
        while !text.is_char_boundary(at) {
            at -= 1;
        }
        let before = &text[..at];
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        let (line, column) = match span {
            Some(_) => (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1),
            None => (0, 0),
        };
        let span = span.map(|s| at..s.end.clamp(at, text.len()));
        Self(Box::new(Inner { source: source.clone(), span, line, column, message, help, severity }))
    }

    /// The file, as it was named to the loader.
    pub fn file(&self) -> &str {
        self.0.source.name()
    }
    /// The line, counted from 1; 0 if the file could not be read at all.
    pub fn line(&self) -> usize {
        self.0.line
    }
    /// The column in characters, counted from 1; 0 if the file could not be read at all.
    pub fn column(&self) -> usize {
        self.0.column
    }
    /// What is wrong.
    pub fn message(&self) -> &str {
        &self.0.message
    }
    /// What to do about it.
    pub fn remedy(&self) -> &str {
        &self.0.help
    }
    /// Whether the file was loaded all the same.
    pub fn is_warning(&self) -> bool {
        self.0.severity == Severity::Warning
    }
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.span {
            Some(_) => write!(f, "{}:{}:{}: {}", self.file(), self.line(), self.column(), self.message()),
            None => write!(f, "{}: {}", self.file(), self.message()),
        }
    }
}

impl fmt::Debug for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self} ({})", self.0.help)
    }
}

impl std::error::Error for FileError {}

impl Diagnostic for FileError {
    fn severity(&self) -> Option<Severity> {
        Some(self.0.severity)
    }
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        Some(Box::new(&self.0.help))
    }
    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.0.span.as_ref().map(|_| &*self.0.source.0 as &dyn SourceCode)
    }
    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = self.0.span.clone()?;
        Some(Box::new(std::iter::once(LabeledSpan::new(Some("here".into()), span.start, span.len()))))
    }
}

/// Something read from a file, and what was odd about the file.
#[derive(Clone, Debug)]
pub struct Loaded<T> {
    /// What the file describes.
    pub value: T,
    /// Places that were ignored or silently mended, at most 100.
    pub warnings: Vec<FileError>,
}
