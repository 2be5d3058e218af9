//! Groups findings of one kind into one warning: a robot with thirty links should not cause thirty lines.

use mobee_text::{FileError, SourceText};
use std::ops::Range;

/// Findings of one kind, reported together at the location of the first.
#[derive(Debug, Default)]
pub(crate) struct Grouped {
    /// Location of the first finding.
    first: Option<Range<usize>>,
    /// All findings, in the order of detection.
    items: Vec<String>,
}

impl Grouped {
    /// Adds a finding.
    pub fn add(&mut self, at: &Range<usize>, item: impl Into<String>) {
        self.first.get_or_insert_with(|| at.clone());
        self.items.push(item.into());
    }

    /// Adds one warning with all findings, if there are any: `message`, then the list.
    pub fn warn(self, source: &SourceText, message: &str, help: &str, warnings: &mut Vec<FileError>) {
        if let Some(at) = self.first {
            warnings.push(source.warning(at, format!("{message}: {}", self.items.join(", ")), help));
        }
    }
}
