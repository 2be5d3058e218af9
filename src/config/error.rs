//! A complaint about something the user wrote: what, where, and what to do.

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode};
use std::fmt;
use std::ops::Range;

/// A complaint about a file or an argument.
#[derive(Debug)]
pub struct ConfigError {
    message: String,
    help: String,
    place: Option<Box<(NamedSource<String>, Range<usize>)>>,
}

impl ConfigError {
    /// A complaint that has no place in a file.
    pub fn plain(message: impl Into<String>, help: impl Into<String>) -> ConfigError {
        ConfigError { message: message.into(), help: help.into(), place: None }
    }

    /// A complaint about a span of a file.
    pub fn at(
        name: &str,
        text: &str,
        span: Range<usize>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> ConfigError {
        let span = span.start.min(text.len())..span.end.min(text.len());
        ConfigError {
            message: message.into(),
            help: help.into(),
            place: Some(Box::new((NamedSource::new(name, text.to_owned()), span))),
        }
    }

    /// The same with another remedy.
    #[must_use]
    pub fn with_help(self, help: impl Into<String>) -> ConfigError {
        ConfigError { help: help.into(), ..self }
    }

    /// What is wrong, in one sentence.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// What to do about it.
    pub fn help_text(&self) -> &str {
        &self.help
    }

    /// The file's name, if there is a place.
    pub fn file(&self) -> Option<&str> {
        self.place.as_deref().map(|(source, _)| source.name())
    }

    /// Line and column (from 1) of the place, if there is one.
    pub fn line_column(&self) -> Option<(usize, usize)> {
        let (source, span) = self.place.as_deref()?;
        let before = source.inner().get(..span.start)?;
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
        Some((line, column))
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for ConfigError {}

impl Diagnostic for ConfigError {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        (!self.help.is_empty()).then(|| Box::new(&self.help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.place.as_deref().map(|(s, _)| s as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let (_, span) = self.place.as_deref()?;
        Some(Box::new(std::iter::once(LabeledSpan::new(Some("here".into()), span.start, span.len().max(1)))))
    }
}
