//! Errors as diagnostics of `miette`.

use super::{Excerpt, FileError};
use miette::{
    Diagnostic, LabeledSpan, MietteError, MietteSpanContents, Severity, SourceCode, SourceSpan, SpanContents,
};
use std::fmt;

impl Diagnostic for FileError {
    fn severity(&self) -> Option<Severity> {
        Some(if self.is_warning() { Severity::Warning } else { Severity::Error })
    }
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        Some(Box::new(&self.0.help))
    }
    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.0.place.as_ref().map(|place| place as &dyn SourceCode)
    }
    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = self.0.place.as_ref()?.place();
        Some(Box::new(std::iter::once(LabeledSpan::new(Some("here".into()), span.start, span.len()))))
    }
}

impl SourceCode for Excerpt {
    fn read_span<'a>(
        &'a self,
        span: &SourceSpan,
        before: usize,
        after: usize,
    ) -> Result<Box<dyn SpanContents<'a> + 'a>, MietteError> {
        let (text, first) = self.lines();
        let found = text.as_bytes().read_span(span, before, after)?;
        // The reported position is the one in the file, not the one in this excerpt.
        let column = if found.column() == 0 { 0 } else { self.column() - 1 };
        let line = first + found.line();
        let count = found.line_count();
        let data = found.data();
        let span = *found.span();
        let name = self.name().to_owned();
        Ok(Box::new(MietteSpanContents::new_named(name, data, span, line, column, count)))
    }
}
