//! A complaint about user input: the error, its place, and the remedy.

use mobee_model::{Excerpt, printable, readable};
use std::fmt;
use std::ops::Range;

/// A complaint about a file or an argument.
#[derive(Debug)]
pub struct ConfigError {
    message: String,
    help: String,
    place: Option<Box<Excerpt>>,
}

impl ConfigError {
    /// A complaint that has no place in a file.
    pub fn plain(message: impl Into<String>, help: impl Into<String>) -> ConfigError {
        ConfigError { message: readable(&message.into()), help: readable(&help.into()), place: None }
    }

    /// A complaint about a span of a file.
    pub fn at(
        name: &str,
        text: &str,
        span: Range<usize>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> ConfigError {
        let place = Excerpt::new(&printable(name), text, span);
        ConfigError { place: Some(Box::new(place)), ..ConfigError::plain(message, help) }
    }

    /// The same complaint with another remedy.
    #[must_use]
    pub fn with_help(self, help: impl Into<String>) -> ConfigError {
        ConfigError { help: readable(&help.into()), ..self }
    }

    /// The error, in one sentence.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// The remedy.
    pub fn help_text(&self) -> &str {
        &self.help
    }

    /// The file's name, if there is a place.
    pub fn file(&self) -> Option<&str> {
        self.place.as_deref().map(Excerpt::name)
    }

    /// Line and column (from 1) of the place, if there is one.
    pub fn line_column(&self) -> Option<(usize, usize)> {
        self.place.as_deref().map(|place| (place.line(), place.column()))
    }
}

impl ConfigError {
    /// The excerpt of the file around the place, if there is one.
    #[cfg(feature = "miette")]
    pub(super) fn excerpt(&self) -> Option<&Excerpt> {
        self.place.as_deref()
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for ConfigError {}
