//! A configuration file and the files that it includes, as one tree of values. The file overrides the files that it
//! includes.

use super::layer::{Content, LayerNode};
use super::{Complaints, ConfigError};
use mobee_model::file::{MIB, path_remedy, read_text};
use mobee_model::is_hidden;
use serde_json::Value;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::de::DeTable;

/// Maximum nesting depth of includes.
const MAX_DEPTH: usize = 8;
/// Maximum number of files in a configuration; a file that is included twice counts twice.
const MAX_FILES: usize = 64;
/// Maximum size of a file, bytes.
const MAX_FILE_BYTES: u64 = MIB;
/// Maximum size of all files of a configuration together, bytes.
const MAX_TOTAL_BYTES: usize = 2 * MIB as usize;

/// The remedy for a hidden character.
const HIDDEN_REMEDY: &str = "use only visible characters in names and texts";
/// The remedy for a backslash in a text, which is usually a Windows path.
const ESCAPE_REMEDY: &str =
    "in \"...\" a backslash begins an escape such as \\n: write paths with /, or the text in single quotes: '...'";

/// One file of a configuration.
#[derive(Clone, Debug)]
pub struct TextFile {
    /// The path to show to users.
    pub name: String,
    /// Its folder relative to the main file's: empty for the main file.
    pub folder: PathBuf,
    /// The contents.
    pub text: String,
}

impl TextFile {
    /// A complaint about a span of this file.
    pub fn error(&self, span: Range<usize>, message: impl Into<String>, help: impl Into<String>) -> ConfigError {
        ConfigError::at(&self.name, &self.text, span, message, help)
    }

    /// The line of a place, from 1.
    pub fn line(&self, at: usize) -> usize {
        self.text.get(..at).map_or(1, |before| before.matches('\n').count() + 1)
    }
}

/// Reads a file and its includes.
pub struct IncludeReader {
    /// All files read so far.
    pub files: Vec<TextFile>,
    main_folder: PathBuf,
    /// The canonical paths of the files that are being read, the outermost first.
    open: Vec<PathBuf>,
}

impl IncludeReader {
    /// A reader for the file at `path`.
    pub fn new(path: &Path) -> IncludeReader {
        IncludeReader {
            files: Vec::new(),
            main_folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            open: Vec::new(),
        }
    }

    /// Reads a main file.
    ///
    /// # Errors
    /// Complaints about this file and all included ones that can't be read or are not TOML.
    pub fn main(&mut self, path: &Path) -> Result<LayerNode, Complaints> {
        let text = read_text(path, MAX_FILE_BYTES).map_err(|e| {
            ConfigError::plain(
                format!("can't read {}: {e}", path.display()),
                "give the path of a configuration file; `configs/behaviors/` has some to start from",
            )
        })?;
        self.open.push(path.canonicalize().unwrap_or_else(|_| path.to_owned()));
        self.parse(path.display().to_string(), PathBuf::new(), text)
    }

    /// Parses a text and reads its includes.
    ///
    /// # Errors
    /// As for [`IncludeReader::main`].
    pub fn parse(&mut self, name: String, folder: PathBuf, text: String) -> Result<LayerNode, Complaints> {
        let number = self.files.len();
        self.files.push(TextFile { name, folder, text: text.clone() });
        let mut wrong = Complaints::default();
        let (document, errors) = DeTable::parse_recoverable(&text);
        // one mistake leads to further errors on its line
        let mut reported = Vec::new();
        for e in errors.into_iter().take(super::complaints::MAX_COMPLAINTS) {
            let span = e.span().unwrap_or(0..0);
            let file = &self.files[number];
            if !reported.contains(&file.line(span.start)) {
                reported.push(file.line(span.start));
                let line = text.lines().nth(file.line(span.start) - 1).unwrap_or_default();
                wrong.push(file.error(span, e.message().to_owned(), remedy(e.message(), line)));
            }
        }
        if !wrong.is_empty() {
            return Err(wrong);
        }
        let mut bad = Vec::new();
        let mut own = LayerNode::document(document.get_ref(), document.span(), number, &mut bad);
        for (span, what) in bad {
            if wrong.is_full() {
                break;
            }
            let written = text.get(span.clone()).unwrap_or_default();
            // two characters were meant, unless the hidden character is in the text itself or by its number
            let escape = ["\\b", "\\e", "\\f", "\\n", "\\r", "\\t"].iter().any(|e| written.contains(e));
            let escape = escape && !written.contains(is_hidden);
            let (what, help) = match what.contains("hidden") {
                true if escape => (format!("{what}, by an escape that a backslash begins"), ESCAPE_REMEDY),
                true => (what, HIDDEN_REMEDY),
                false => (what, "write an ordinary finite number"),
            };
            wrong.push(self.files[number].error(span, what, help));
        }
        let below = self.included(&mut own, number, &mut wrong);
        wrong.none_or(below.into_iter().reduce(LayerNode::under).map_or(own.clone(), |below| below.under(own)))
    }

    /// Takes the key `include` out of a file and reads the files that it names.
    fn included(&mut self, own: &mut LayerNode, number: usize, wrong: &mut Complaints) -> Vec<LayerNode> {
        let Content::Table(map) = &mut own.content else { return Vec::new() };
        let Some(list) = map.remove("include") else { return Vec::new() };
        let entries = match list.content {
            Content::List(entries) => entries,
            _ => vec![list],
        };
        let mut layers = Vec::new();
        for entry in entries {
            let span = match &entry.origin {
                super::layer::Origin::File { value, .. } => value.clone(),
                _ => 0..0,
            };
            let Content::Leaf(Value::String(file)) = &entry.content else {
                let help = "write include = [\"other.toml\"], with paths relative to this file";
                wrong.push(self.files[number].error(span, "this is not a file path", help));
                continue;
            };
            match self.include(Path::new(file), number, span) {
                Ok(node) => layers.push(node),
                Err(e) => wrong.append(e),
            }
        }
        layers
    }

    fn include(&mut self, file: &Path, by: usize, span: Range<usize>) -> Result<LayerNode, Complaints> {
        let from_main = self.files[by].folder.join(from_home(file));
        let path = self.main_folder.join(&from_main);
        let wrong = |what: String, help: &str| Complaints::from(self.files[by].error(span.clone(), what, help));
        let real = path.canonicalize().map_err(|e| {
            let help = path_remedy(file).unwrap_or("give the path of a file, relative to this file");
            wrong(format!("can't read {}: {e}", path.display()), help)
        })?;
        if self.open.contains(&real) {
            let what = format!("{} includes itself, directly or through others", file.display());
            return Err(wrong(
                what,
                "remove this include; an included file need not include the file that includes it",
            ));
        }
        if self.open.len() > MAX_DEPTH {
            return Err(wrong(
                format!("includes are nested more than {MAX_DEPTH} deep"),
                "include fewer files in a chain",
            ));
        }
        let length = |files: &[TextFile]| files.iter().map(|f| f.text.len()).sum::<usize>();
        if self.files.len() >= MAX_FILES || length(&self.files) >= MAX_TOTAL_BYTES {
            let what = format!(
                "the configuration is made of more than {MAX_FILES} files, or of more than {} MiB",
                MAX_TOTAL_BYTES as u64 / MIB
            );
            return Err(wrong(what, "include fewer and smaller files"));
        }
        let text = read_text(&path, MAX_FILE_BYTES).map_err(|e| {
            wrong(format!("can't read {}: {e}", path.display()), "give the path of a text file, relative to this file")
        })?;
        let folder = from_main.parent().map(Path::to_owned).unwrap_or_default();
        self.open.push(real);
        let node = self.parse(path.display().to_string(), folder, text);
        self.open.pop();
        node
    }
}

/// Replaces a leading `~/`, `$HOME/` or `${HOME}/` with the user's home folder.
///
/// All paths of configuration files pass through here, since no shell expands them.
pub fn from_home(path: &Path) -> PathBuf {
    let home = std::env::var_os("HOME").filter(|home| !home.is_empty());
    let inside = ["~", "$HOME", "${HOME}"].iter().find_map(|begin| path.strip_prefix(begin).ok());
    match (home, inside) {
        (Some(home), Some(inside)) => Path::new(&home).join(inside),
        _ => path.to_owned(),
    }
}

/// The remedy for a syntax error in a line.
fn remedy(message: &str, line: &str) -> &'static str {
    let remedies = [
        ("escaped value", ESCAPE_REMEDY),
        ("too few unicode value digits", ESCAPE_REMEDY),
        ("duplicate key", "remove one of the two"),
        ("must be quoted", "put text in quotes, and write numbers without a unit"),
        ("expected newline", "write one setting per line, and decimals with a point, such as 0.1"),
        ("expected `=`", "write key = value"),
        ("between key-value pairs", "put a comma between two settings"),
        ("unclosed", "close the bracket"),
        ("string, expected", "close the quotes"),
    ];
    let found = remedies.iter().find(|(part, _)| message.contains(part)).map_or("fix the TOML syntax here", |(_, h)| h);
    // a backslash at the end of a folder's name escapes the quote after it
    if found == "close the quotes" && line.contains("\\\"") { ESCAPE_REMEDY } else { found }
}
