//! Findings of one kind in one warning: a robot with thirty links is not worth thirty lines.

use crate::error::{FileError, Source};
use std::ops::Range;

/// Findings of one kind, reported together at the place of the first.
#[derive(Debug, Default)]
pub(crate) struct Grouped {
    /// Where the first was found.
    first: Option<Range<usize>>,
    /// All of them, in the order in which they were found.
    items: Vec<String>,
}

impl Grouped {
    /// Adds a finding.
    pub fn add(&mut self, at: &Range<usize>, item: impl Into<String>) {
        self.first.get_or_insert_with(|| at.clone());
        self.items.push(item.into());
    }

    /// Warns of all of them, if there are any: `message`, then each.
    pub fn warn(self, source: &Source, message: &str, help: &str, warnings: &mut Vec<FileError>) {
        if let Some(at) = self.first {
            warnings.push(source.warning(at, format!("{message}: {}", self.items.join(", ")), help));
        }
    }
}
