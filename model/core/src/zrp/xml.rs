//! Converts XML text to located tokens.

use super::element::{Attr, Element};
use mobee_text::hidden_in;
use mobee_text::{FileError, SourceText};
use quick_xml::events::attributes::AttrError;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::ops::Range;

/// Maximum nesting depth.
const MAX_DEPTH: usize = 1000;
/// Maximum number of attributes of an element: the search for duplicates is quadratic.
const MAX_ATTRIBUTES: usize = 64;
/// Maximum length of a value, bytes.
const MAX_VALUE_BYTES: usize = 4096;

/// Input of the readers of robots and worlds.
pub(super) enum Token {
    /// Start of an element, with all of its attributes.
    Start(Element),
    /// End of the innermost open element.
    End,
}

/// The tokens of a file in sequence, with locations, so that every error can refer to the text.
pub(super) struct Tokens<'a> {
    /// The text, for locations.
    source: &'a SourceText,
    /// The XML parser; it borrows from the text, so that the locations of slices can be computed.
    reader: Reader<&'a [u8]>,
    /// Locations of the names of the open elements.
    open: Vec<Range<usize>>,
    /// True after the start of the root element; there must be exactly one.
    root_seen: bool,
}

impl<'a> Tokens<'a> {
    /// Creates the tokens of a text.
    pub(super) fn new(source: &'a SourceText) -> Self {
        let mut reader = Reader::from_str(source.text());
        // Expands `<a/>` to a start and an end, which saves the readers a case.
        reader.config_mut().expand_empty_elements = true;
        Self { source, reader, open: Vec::new(), root_seen: false }
    }

    /// The next start or end of an element; `None` after the root element's end.
    pub(super) fn next(&mut self) -> Result<Option<Token>, FileError> {
        loop {
            let before = self.reader.buffer_position() as usize;
            let event = match self.reader.read_event() {
                Ok(event) => event,
                Err(e) => return Err(self.syntax(before, &e)),
            };
            match event {
                Event::Start(tag) => return self.start(&tag).map(|e| Some(Token::Start(e))),
                Event::End(_) => {
                    self.open.pop();
                    return Ok(Some(Token::End));
                }
                Event::Eof => return self.end(),
                Event::Text(t) if t.trim().is_empty() => {}
                Event::Text(_) | Event::CData(_) | Event::GeneralRef(_) => {
                    let text = self.source.text();
                    let end = self.reader.buffer_position() as usize;
                    let skip = text.get(before..end).map_or(0, |t| t.len() - t.trim_start().len());
                    return Err(self.source.error(
                        before + skip..end,
                        "there is text between the elements",
                        "remove it, or put it into a comment: <!-- ... -->",
                    ));
                }
                Event::Comment(_) | Event::Decl(_) | Event::PI(_) | Event::DocType(_) | Event::Empty(_) => {}
            }
        }
    }

    /// Checks the end of the file: an error if an element is open, or if there was none.
    fn end(&self) -> Result<Option<Token>, FileError> {
        let end = self.source.text().len();
        if let Some(at) = self.open.last() {
            let name = self.source.text().get(at.clone()).unwrap_or_default();
            let help = format!("add </{name}> where it ends");
            return Err(self.source.error(at.clone(), format!("<{name}> is never closed"), help));
        }
        if !self.root_seen {
            return Err(self.source.error(
                end..end,
                "the file has no element",
                "a robot file begins with <ZeroPositionKinematicTree>, a world file with <WorldList>",
            ));
        }
        Ok(None)
    }

    /// Converts a start tag to an element, whose values are unescaped, bounded in length and free of hidden characters.
    fn start(&mut self, tag: &BytesStart<'_>) -> Result<Element, FileError> {
        let name = tag.name().into_inner();
        let at = self.place(name).unwrap_or(0..0);
        if self.open.is_empty() && std::mem::replace(&mut self.root_seen, true) {
            let help = "keep a single outermost element and put everything into it";
            return Err(self.source.error(at, format!("<{name}> is a second outermost element"), help));
        }
        if self.open.len() >= MAX_DEPTH {
            let message = format!("elements are nested more than {MAX_DEPTH} deep");
            return Err(self.source.error(at, message, "make the kinematic tree less deep"));
        }
        let mut element = Element::new(self.source.clone(), name, at.clone());
        for attr in tag.attributes() {
            let attr = attr.map_err(|e| self.bad_attribute(&at, &e))?;
            if element.attrs.len() >= MAX_ATTRIBUTES {
                let message = format!("<{name}> has more than {MAX_ATTRIBUTES} attributes");
                return Err(self.source.error(at, message, "remove those that the format does not know"));
            }
            // Before unescaping, a value is a slice of the text, so its location can be computed.
            let value_at = self.place(&attr.value).unwrap_or_else(|| at.clone());
            let value = attr.normalized_value(XmlVersion::Implicit1_0).map_err(|e| {
                let help = "write & as &amp;, < as &lt;, and define no entities of your own";
                self.source.error(value_at.clone(), format!("this value cannot be read: {e}"), help)
            })?;
            if value.len() > MAX_VALUE_BYTES {
                let message = format!("a value has {} bytes, more than {MAX_VALUE_BYTES}", value.len());
                return Err(self.source.error(value_at, message, "shorten it"));
            }
            if let Some(what) = hidden_in(&value) {
                return Err(self.source.error(value_at, what, "use only visible characters in names and values"));
            }
            let key = attr.key.into_inner();
            let key_at = self.place(key).unwrap_or_else(|| at.clone());
            element.attrs.push(Attr { name: key.to_owned(), value: value.into_owned(), name_at: key_at, at: value_at });
        }
        self.open.push(at);
        Ok(element)
    }

    /// Location of a slice of the file's text.
    fn place(&self, part: &str) -> Option<Range<usize>> {
        let text = self.source.text();
        let start = (part.as_ptr() as usize).checked_sub(text.as_ptr() as usize)?;
        (start + part.len() <= text.len()).then(|| start..start + part.len())
    }

    /// Error for a malformed attribute, with a remedy.
    fn bad_attribute(&self, tag: &Range<usize>, e: &AttrError) -> FileError {
        let (offset, message, help) = match *e {
            AttrError::ExpectedEq(p) => (p, "an attribute has no value", "write it as name=\"value\""),
            AttrError::ExpectedValue(p) => (p, "a value is missing after =", "write it as name=\"value\""),
            AttrError::UnquotedValue(p) => (p, "this value is not in quotes", "write it as name=\"value\""),
            AttrError::ExpectedQuote(p, _) => (p, "this value's closing quote is missing", "close it with a quote"),
            AttrError::Duplicated(p, _) => (p, "this attribute is given twice", "keep one of the two"),
        };
        let at = (tag.start + offset).min(self.source.text().len());
        self.source.error(at..at, message, help)
    }

    /// Error for malformed XML; frequent mistakes have their own messages.
    fn syntax(&self, before: usize, e: &quick_xml::Error) -> FileError {
        use quick_xml::errors::{Error, IllFormedError as Ill};
        let at = match self.reader.error_position() as usize {
            0 => before,
            at => at,
        };
        let (message, help) = match e {
            Error::IllFormed(Ill::MismatchedEndTag { expected, found }) => {
                let opened = self.open.last().map_or(0, |o| self.source.error(o.clone(), "", "").line());
                (
                    format!("</{found}> closes <{expected}>, which was opened in line {opened}"),
                    format!("close <{expected}> first, or spell both names alike (case matters here)"),
                )
            }
            Error::IllFormed(Ill::UnmatchedEndTag(found)) => {
                (format!("</{found}> closes nothing"), "remove it, or open the element before".to_owned())
            }
            e => (format!("this is not XML: {e}"), "check the brackets < > and the quotes around here".to_owned()),
        };
        let len = self.source.text()[..].get(at..).and_then(|t| t.find('>')).map_or(0, |n| n + 1);
        self.source.error(at..at + len.min(40), message, help)
    }
}
