//! The few lines of a file that an error is shown with. A file may be one line of many megabytes, or hold what would move a
//! terminal's cursor: an excerpt is short, and plain text.

use crate::printable::{digits, is_hidden};
use miette::{MietteError, MietteSpanContents, SourceCode, SourceSpan, SpanContents};
use std::ops::Range;

/// Longer lines are cut, characters.
const WIDEST: usize = 240;
/// Of a line that is cut, so much is shown before the place, characters.
const BEFORE: usize = 80;
/// A place of more lines is shown by its first ones.
const MOST_LINES: usize = 8;
/// Stands where a line was cut.
const CUT: char = '…';

/// A place in a file: its line and column, and the text around it.
#[derive(Clone, Debug)]
pub struct Excerpt {
    /// The file, as messages call it.
    name: String,
    /// A few lines, printable, cut to width.
    text: String,
    /// The place within `text`.
    place: Range<usize>,
    /// The number of the first line of `text`, from 0.
    first: usize,
    /// Of the place in the file, from 1.
    line: usize,
    /// Of the place in the file, characters, from 1.
    column: usize,
}

impl Excerpt {
    /// The excerpt around a span of bytes of the text of the file `name`. A span beyond the text is cut to it.
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
        // One line before, for people to find their way.
        if begin > 0 {
            out.push(text, line_start(text, begin - 1), None);
        }
        let mut at = Some(begin);
        for _ in 0..MOST_LINES {
            at = at.and_then(|at| out.push(text, at, Some(start..end)));
            if at.is_none_or(|next| next > end) {
                break;
            }
        }
        // a place at the end of a line is shown with two lines after it
        for _ in 0..2 {
            at = at.and_then(|at| out.push(text, at, None));
        }
        out.place.end = out.place.end.max(out.place.start);
        out
    }

    /// The file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The line of the place, counted from 1.
    pub fn line(&self) -> usize {
        self.line
    }

    /// Its column in characters, counted from 1.
    pub fn column(&self) -> usize {
        self.column
    }

    /// The place within this excerpt, for a label.
    pub fn place(&self) -> Range<usize> {
        self.place.clone()
    }

    /// Adds the line that begins at `begin`, and notes where the span begins and ends in it; returns where the next one begins.
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

    /// Notes that the excerpt has come to this byte of the file.
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

impl SourceCode for Excerpt {
    fn read_span<'a>(
        &'a self,
        span: &SourceSpan,
        before: usize,
        after: usize,
    ) -> Result<Box<dyn SpanContents<'a> + 'a>, MietteError> {
        let found = self.text.as_bytes().read_span(span, before, after)?;
        // what is told of the place is where it stands in the file, not in this excerpt
        let column = if found.column() == 0 { 0 } else { self.column - 1 };
        let (line, count) = (self.first + found.line(), found.line_count());
        let (data, span, name) = (found.data(), *found.span(), self.name.clone());
        Ok(Box::new(MietteSpanContents::new_named(name, data, span, line, column, count)))
    }
}

/// The part of a line that is shown, around a byte of it.
fn window(line: &str, at: usize) -> Range<usize> {
    if line.chars().nth(WIDEST).is_none() {
        return 0..line.len();
    }
    let at = floor(line, at);
    let start = line[..at].char_indices().rev().nth(BEFORE - 1).map_or(0, |(i, _)| i);
    let end = line[start..].char_indices().nth(WIDEST).map_or(line.len(), |(i, _)| start + i);
    start..end
}

/// The nearest place at or before a byte where a character begins.
fn floor(text: &str, at: usize) -> usize {
    text.floor_char_boundary(at)
}

/// Where the line begins that a byte is in.
fn line_start(text: &str, at: usize) -> usize {
    text[..at].rfind('\n').map_or(0, |i| i + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use miette::{Diagnostic, GraphicalReportHandler, GraphicalTheme, LabeledSpan};

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
    fn a_place_far_out_on_a_long_line_is_shown_by_what_stands_around_it() {
        let text = format!("first\n{}bad{}\nlast\n", "x".repeat(100_000), "y".repeat(100_000));
        let out = shown(&text, 100_006..100_009);
        assert!(out.contains("[f:2:100001]") && out.contains("xbady") && out.contains("1 │ first"), "{out}");
        assert!(out.contains("3 │ last") && out.chars().count() < 1500, "{out}");
        let (line, carets) = (out.lines().position(|l| l.contains("xbady")).unwrap(), out.lines());
        let at = |l: &str, what: &str| l.find(what).map(|i| l[..i].chars().count());
        let lines: Vec<&str> = carets.collect();
        assert_eq!(at(lines[line], "bad"), at(lines[line + 1], "─┬─"), "{out}");
    }

    #[test]
    fn what_would_act_on_a_terminal_is_shown_in_digits() {
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
