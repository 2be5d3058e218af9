//! Errors in users' files: file, line, column, a caret and a remedy.

#[cfg(feature = "miette")]
mod diagnostic;
mod excerpt;

pub use excerpt::Excerpt;

use crate::file;
use crate::{printable, readable};
use std::{fmt, ops::Range, path::Path, sync::Arc};

/// The text of a file and its name in messages.
#[derive(Clone, Debug)]
pub struct SourceText(Arc<(String, String)>);

impl SourceText {
    /// Creates a source from a text and the file name for messages.
    pub fn new(name: &str, text: &str) -> Self {
        Self(Arc::new((name.to_owned(), text.to_owned())))
    }

    /// Reads a file that must be UTF-8 of at most `limit` bytes.
    pub fn read(path: &Path, limit: u64) -> Result<Self, FileError> {
        let name = path.display().to_string();
        let no_file =
            |message: String, help: &str| FileError::new(&Self::new(&name, ""), None, message, help.to_owned(), false);
        let about = |e: std::io::Error| {
            let help = match e.kind() {
                std::io::ErrorKind::NotFound => "check the path; it is relative to the folder the program runs in",
                std::io::ErrorKind::PermissionDenied => "make the file readable for this user",
                std::io::ErrorKind::IsADirectory => "give the path of a file, not of a folder",
                std::io::ErrorKind::FileTooLarge => "check that this is the file you mean; split very large models",
                _ => "check that the path names a readable file",
            };
            no_file(format!("cannot read the file: {e}"), help)
        };
        let bytes = file::read(path, limit).map_err(about)?;
        file::text(bytes).map(|text| Self::new(&name, &text)).map_err(|(not_text, bytes)| {
            // Decoded with replacement characters, to show the position; the text before it is valid, so the byte
            // offset is unchanged.
            let text = String::from_utf8_lossy(&bytes);
            let message = format!("this byte, {}", not_text.what);
            Self::new(&name, &text).error(not_text.at..not_text.at, message, file::SAVE_AS_UTF8)
        })
    }

    /// The file name for messages.
    pub fn name(&self) -> &str {
        &self.0.0
    }

    /// The complete text.
    pub fn text(&self) -> &str {
        &self.0.1
    }

    /// Creates an error at a range of bytes of this file.
    pub fn error(&self, at: Range<usize>, message: impl Into<String>, help: impl Into<String>) -> FileError {
        FileError::new(self, Some(at), message.into(), help.into(), false)
    }

    /// Creates a warning at a range of bytes of this file.
    pub fn warning(&self, at: Range<usize>, message: impl Into<String>, help: impl Into<String>) -> FileError {
        FileError::new(self, Some(at), message.into(), help.into(), true)
    }
}

/// An error (or, as a warning, an oddity) in a user's file: its position, a message and a remedy.
///
/// `Display` prints `file:line:column: message`; with the feature `miette` it is a diagnostic with the source text, a caret and a help line.
///
/// # Example
/// ```
/// use mobee_text::{SourceText, xml};
///
/// let error = xml::parse(&SourceText::new("arm.urdf", "<robot>\n<link>\n</robot>")).expect_err("a link without its end");
/// assert_eq!((error.line(), error.is_warning()), (3, false));
/// assert!(error.to_string().starts_with("arm.urdf:3:"), "{error}");
/// ```
#[derive(Clone)]
pub struct FileError(Box<ErrorContents>);

/// Contents of a [`FileError`]. Boxed, so that a `Result` with it is no larger than a pointer in the successful case.
#[derive(Clone, Debug)]
struct ErrorContents {
    /// The file name as given to the loader, printable.
    file: String,
    /// Position and text; `None` if the file could not be read at all.
    place: Option<Excerpt>,
    /// The message, printable and shortened.
    message: String,
    /// The remedy, printable and shortened.
    help: String,
    /// True if the file was loaded nevertheless.
    is_warning: bool,
}

impl FileError {
    /// Makes the message printable, as it may quote the file. All messages pass through here.
    fn new(source: &SourceText, span: Option<Range<usize>>, message: String, help: String, is_warning: bool) -> Self {
        let file = printable(source.name()).into_owned();
        let place = span.map(|span| Excerpt::new(&file, source.text(), span));
        let message = readable(&message);
        let help = readable(&help);
        Self(Box::new(ErrorContents { file, place, message, help, is_warning }))
    }

    /// The file name as given to the loader, printable.
    pub fn file(&self) -> &str {
        &self.0.file
    }
    /// The line, counted from 1; 0 if the file could not be read at all.
    pub fn line(&self) -> usize {
        self.0.place.as_ref().map_or(0, Excerpt::line)
    }
    /// The column in characters, counted from 1; 0 if the file could not be read at all.
    pub fn column(&self) -> usize {
        self.0.place.as_ref().map_or(0, Excerpt::column)
    }
    /// Description of the error.
    pub fn message(&self) -> &str {
        &self.0.message
    }
    /// Suggested remedy.
    pub fn remedy(&self) -> &str {
        &self.0.help
    }
    /// True if the file was loaded nevertheless.
    pub fn is_warning(&self) -> bool {
        self.0.is_warning
    }
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.place {
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

/// A value read from a file, and warnings about the file. Callers must show the warnings: they are the only notice of,
/// for example, a mistyped attribute.
#[derive(Clone, Debug)]
pub struct Loaded<T> {
    /// The value that the file describes.
    pub value: T,
    /// Warnings about parts that were ignored or corrected, at most 100.
    pub warnings: Vec<FileError>,
}
