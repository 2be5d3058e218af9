//! Excerpt of a file, shown with an error. A file may be a single line of many megabytes, or contain terminal control
//! characters: an excerpt is short and plain text.

use crate::{digits, is_hidden};
use std::ops::Range;

/// Maximum length of a line, characters; longer lines are cut.
const MAX_LINE_CHARS: usize = 240;
/// Characters shown before the position in a line that is cut.
const CONTEXT_CHARS: usize = 80;
/// Maximum number of lines; of a longer span the first lines are shown.
const MAX_LINES: usize = 8;
/// Marks a place where a line was cut.
const CUT: char = '…';

/// A position in a file: its line and column, and the surrounding text.
#[derive(Clone, Debug)]
pub struct Excerpt {
    /// The file name for messages.
    name: String,
    /// A few lines, printable, cut to width.
    text: String,
    /// Range of the marked bytes within `text`.
    place: Range<usize>,
    /// Number in the file of the first line of `text`, from 0.
    #[cfg_attr(not(feature = "miette"), expect(dead_code, reason = "only diagnostics show it"))]
    first: usize,
    /// Line of the position in the file, from 1.
    line: usize,
    /// Column of the position in the file, characters, from 1.
    column: usize,
}

impl Excerpt {
    /// Creates the excerpt around a range of bytes of the text of the file `name`. A range beyond the text is clamped
    /// to it.
    pub fn new(name: &str, text: &str, span: Range<usize>) -> Excerpt {
        let start = floor(text, span.start);
        let end = floor(text, span.end).max(start);
        let begin = line_start(text, start);
        let line = text[..begin].matches('\n').count();
        let column = text[begin..start].chars().count();
        let mut out = Excerpt {
            name: name.to_owned(),
            text: String::new(),
            place: 0..0,
            first: line - usize::from(begin > 0),
            line: line + 1,
            column: column + 1,
        };
        // One line before, for context.
        if begin > 0 {
            out.push(text, line_start(text, begin - 1), None);
        }
        let mut at = Some(begin);
        for _ in 0..MAX_LINES {
            at = at.and_then(|at| out.push(text, at, Some(start..end)));
            if at.is_none_or(|next| next > end) {
                break;
            }
        }
        // Two lines after the position.
        for _ in 0..2 {
            at = at.and_then(|at| out.push(text, at, None));
        }
        out.place.end = out.place.end.max(out.place.start);
        out
    }

    /// The file name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Line of the position, from 1.
    pub fn line(&self) -> usize {
        self.line
    }

    /// Column of the position in characters, from 1.
    pub fn column(&self) -> usize {
        self.column
    }

    /// Range of the marked bytes within this excerpt, for a label.
    pub fn place(&self) -> Range<usize> {
        self.place.clone()
    }

    /// The lines of this excerpt, and the number in the file of the first of them, from 0.
    #[cfg(feature = "miette")]
    pub(super) fn lines(&self) -> (&str, usize) {
        (&self.text, self.first)
    }

    /// Appends the line that starts at byte `begin`, and updates the marked range; returns the start of the next line.
    fn push(&mut self, text: &str, begin: usize, span: Option<Range<usize>>) -> Option<usize> {
        let length = text[begin..].find('\n');
        let end = length.map_or(text.len(), |n| begin + n);
        let line = &text[begin..end];
        let shown = window(line, span.as_ref().map_or(0, |s| s.start.saturating_sub(begin)));
        if shown.start > 0 {
            self.text.push(CUT);
        }
        for (i, c) in line[shown.clone()].char_indices() {
            let at = begin + shown.start + i;
            self.note(at, span.as_ref());
            match c {
                '\r' if at + 1 == end && length.is_some() => {}
                '\t' => self.text.push(c),
                c if is_hidden(c) => digits(&mut self.text, c),
                c => self.text.push(c),
            }
        }
        self.note(begin + shown.end, span.as_ref());
        if shown.end < line.len() {
            self.text.push(CUT);
        }
        length?;
        self.text.push('\n');
        Some(end + 1)
    }

    /// Updates the marked range when the excerpt reaches byte `at` of the file.
    fn note(&mut self, at: usize, span: Option<&Range<usize>>) {
        let Some(span) = span else { return };
        if at <= span.start {
            self.place.start = self.text.len();
        }
        if at <= span.end {
            self.place.end = self.text.len();
        }
    }
}

/// The part of a line that is shown around byte `at`.
fn window(line: &str, at: usize) -> Range<usize> {
    if line.chars().nth(MAX_LINE_CHARS).is_none() {
        return 0..line.len();
    }
    let at = floor(line, at);
    let start = line[..at].char_indices().rev().nth(CONTEXT_CHARS - 1).map_or(0, |(i, _)| i);
    let end = line[start..].char_indices().nth(MAX_LINE_CHARS).map_or(line.len(), |(i, _)| start + i);
    start..end
}

/// The last character boundary at or before a byte.
fn floor(text: &str, at: usize) -> usize {
    text.floor_char_boundary(at)
}

/// Start of the line that contains a byte.
fn line_start(text: &str, at: usize) -> usize {
    text[..at].rfind('\n').map_or(0, |i| i + 1)
}

#[cfg(all(test, feature = "miette"))]
mod tests {
    use super::*;
    use miette::{Diagnostic, GraphicalReportHandler, GraphicalTheme, LabeledSpan, SourceCode};

    #[derive(Debug, thiserror::Error)]
    #[error("wrong")]
    struct Wrong(Excerpt);

    impl Diagnostic for Wrong {
        fn source_code(&self) -> Option<&dyn SourceCode> {
            Some(&self.0)
        }
        fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
            let place = self.0.place();
            Some(Box::new(std::iter::once(LabeledSpan::new(Some("here".into()), place.start, place.len()))))
        }
    }

    fn shown(text: &str, span: Range<usize>) -> String {
        let handler = GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor());
        let mut out = String::new();
        handler.render_report(&mut out, &Wrong(Excerpt::new("f", text, span))).unwrap();
        out
    }

    #[test]
    fn a_position_far_out_on_a_long_line_is_shown_with_its_context() {
        let text = format!("first\n{}bad{}\nlast\n", "x".repeat(100_000), "y".repeat(100_000));
        let out = shown(&text, 100_006..100_009);
        assert!(out.contains("[f:2:100001]") && out.contains("xbady") && out.contains("1 │ first"), "{out}");
        assert!(out.contains("3 │ last") && out.chars().count() < 1500, "{out}");
        let line = out.lines().position(|l| l.contains("xbady")).unwrap();
        let at = |l: &str, what: &str| l.find(what).map(|i| l[..i].chars().count());
        let lines: Vec<&str> = out.lines().collect();
        assert_eq!(at(lines[line], "bad"), at(lines[line + 1], "─┬─"), "{out}");
    }

    #[test]
    fn terminal_control_characters_are_escaped() {
        let out = shown("a\u{1b}[31m \u{202e}b\r\n\rc", 0..1);
        assert!(out.contains("a\\u001b[31m \\u202eb\n") && out.contains("\\u000dc"), "{out:?}");
    }

    #[test]
    fn every_span_of_every_text_can_be_shown() {
        let text = "a = \"é\"\n\n[b]\u{7}\nc = 1\n";
        for start in 0..text.len() + 3 {
            for end in start..text.len() + 3 {
                let line = text[..floor(text, start)].matches('\n').count() + 1;
                assert!(shown(text, start..end).contains(&format!("f:{line}:")), "{start}..{end}");
            }
        }
        assert!(shown("", 0..0).contains("wrong"));
    }
}
