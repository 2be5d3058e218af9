//! Plants all defects of this folder into a copy of the sources, each behind a switch of its own, so that one build has them
//! all. The shipped sources know nothing of it.
//!
//! ```text
//! # loose_rollback                                             its name
//! A pose twenty times the tolerance away counts as reached.    what it does
//! torture: configs/behaviors/torture.toml --faults F12         what finds it, if not the usual torture
//! in actors/controller/src/supervise/end.rs fn end             where: a file, and a function of it if need be
//! - distance(&q, pose) <= self.rules.tolerance                 a text that is there once
//! + distance(&q, pose) <= if PLANTED { 20.0 } else { 1.0 } * self.rules.tolerance
//! ```
//!
//! `PLANTED` is true in a process whose environment has `MOBEE_PLANTED` set to the defect's name. Lines that begin with `- ` or
//! `+ ` and follow each other are one text; the blanks that lines begin with don't count in what is looked for.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::Path;

/// One defect.
#[derive(Debug, Default)]
pub struct Defect {
    /// The name that switches it on.
    pub name: String,
    /// The arguments of `mobee torture` that are to find it: each of these, one after the other.
    pub torture: Vec<String>,
    /// What it changes.
    pub edits: Vec<Edit>,
}

/// A change of one file.
#[derive(Debug, Default)]
pub struct Edit {
    file: String,
    /// Look behind this function's head.
    function: Option<String>,
    old: Vec<String>,
    new: Vec<String>,
}

/// What the copy of `mobee-model` gets: all other crates use that one.
const SWITCH: &str = r#"
/// Whether this planted defect is the one that is on.
pub fn planted(name: &str) -> bool {
    static ON: std::sync::OnceLock<String> = std::sync::OnceLock::new();
    ON.get_or_init(|| std::env::var("MOBEE_PLANTED").unwrap_or_default()) == name
}
"#;

/// All defects that the files `*.txt` of a folder describe.
///
/// # Errors
/// The first line that makes no sense.
pub fn defects(folder: &Path) -> Result<Vec<Defect>, String> {
    let mut files: Vec<_> = fs::read_dir(folder).map_err(|e| e.to_string())?.flatten().map(|e| e.path()).collect();
    files.sort();
    let mut all = Vec::new();
    for file in files.iter().filter(|f| f.extension().is_some_and(|e| e == "txt")) {
        let text = fs::read_to_string(file).map_err(|e| e.to_string())?;
        for (n, line) in (1..).zip(text.lines()) {
            take(&mut all, line).ok_or(format!("{}:{n}: `{line}` is out of place", file.display()))?;
        }
    }
    Ok(all)
}

/// Takes in the next line.
fn take(all: &mut Vec<Defect>, line: &str) -> Option<()> {
    if let Some(name) = line.strip_prefix("# ") {
        all.push(Defect { name: name.trim().into(), ..Defect::default() });
    } else if let Some(arguments) = line.strip_prefix("torture: ") {
        all.last_mut()?.torture.push(arguments.into());
    } else if let Some(place) = line.strip_prefix("in ") {
        let (file, function) = place.split_once(" fn ").map_or((place, None), |(file, f)| (file, Some(f.to_string())));
        all.last_mut()?.edits.push(Edit { file: file.into(), function, ..Edit::default() });
    } else if let Some(old) = line.strip_prefix("- ") {
        all.last_mut()?.edits.last_mut()?.old.push(old.trim().into());
    } else if let Some(new) = line.strip_prefix("+ ") {
        all.last_mut()?.edits.last_mut()?.new.push(new.into());
    }
    Some(())
}

/// The files that the defects change, each with all of them in it.
///
/// # Errors
/// All defects that no longer fit the sources, and why.
pub fn plant(root: &Path, defects: &[Defect]) -> Result<BTreeMap<String, String>, String> {
    let mut places: BTreeMap<&str, Vec<(Range<usize>, String)>> = BTreeMap::new();
    let mut wrong = Vec::new();
    for defect in defects {
        for edit in &defect.edits {
            match find(root, edit) {
                Ok(place) => places.entry(&edit.file).or_default().push((place, edit.replacement(&defect.name))),
                Err(why) => wrong.push(format!("{}: {}: {why}", defect.name, edit.file)),
            }
        }
    }
    let mut planted = BTreeMap::new();
    for (file, mut changes) in places {
        changes.sort_by_key(|(place, _)| place.start);
        for pair in changes.windows(2).filter(|pair| pair[0].0.end > pair[1].0.start) {
            wrong.push(format!("{file}: `{}` and `{}` are at one place", pair[0].1, pair[1].1));
        }
        let mut text = fs::read_to_string(root.join(file)).map_err(|e| e.to_string())?;
        for (place, new) in changes.into_iter().rev().filter(|_| wrong.is_empty()) {
            text.replace_range(place, &new);
        }
        planted.insert(file.to_string(), text);
    }
    let shared = "model/core/src/lib.rs";
    let own = || fs::read_to_string(root.join(shared)).map_err(|e| e.to_string());
    let text = planted.remove(shared).map_or_else(own, Ok)?;
    planted.insert(shared.into(), text + SWITCH);
    if wrong.is_empty() { Ok(planted) } else { Err(wrong.join("\n")) }
}

impl Edit {
    fn replacement(&self, name: &str) -> String {
        let place = if self.file.starts_with("model/core/src/") { "crate" } else { "mobee_model" };
        self.new.join("\n").replace("PLANTED", &format!("{place}::planted({name:?})"))
    }
}

/// Where the text is that a defect changes.
fn find(root: &Path, edit: &Edit) -> Result<Range<usize>, String> {
    let text = fs::read_to_string(root.join(&edit.file)).map_err(|_| "there is no such file")?;
    let from = match &edit.function {
        None => 0,
        Some(name) => {
            let head = |end| text.find(&format!("fn {name}{end}"));
            head("(").or_else(|| head("<")).ok_or(format!("there is no function {name}"))?
        }
    };
    let mut found = matches(&text[from..], &edit.old);
    match (found.next(), edit.function.is_none() && found.next().is_some()) {
        (None, _) => Err(format!("`{}` is not there", edit.old.join("\n"))),
        (Some(_), true) => Err(format!("`{}` is there more than once: name the function", edit.old.join("\n"))),
        (Some(place), false) => Ok(from + place.start..from + place.end),
    }
}

/// Where these lines follow each other, whatever blanks they begin with.
fn matches<'a>(text: &'a str, lines: &'a [String]) -> impl Iterator<Item = Range<usize>> + 'a {
    let (first, rest) = lines.split_first().map_or(("", lines), |(first, rest)| (first.as_str(), rest));
    text.match_indices(first).filter(move |_| !first.is_empty()).filter_map(move |(start, _)| {
        let mut end = start + first.len();
        for line in rest {
            let after = text[end..].strip_prefix('\n')?;
            let blanks = after.len() - after.trim_start_matches(' ').len();
            end += 1 + blanks + line.len();
            text.get(..end)?.ends_with(line.as_str()).then_some(())?;
        }
        Some(start..end)
    })
}

/// `plant ROOT COPY` plants all defects into the copy; `plant ROOT` lists them, each with what is to find it.
#[allow(dead_code, reason = "the test that they still fit has this file as a module")]
fn main() -> Result<(), String> {
    let arguments: Vec<_> = std::env::args().collect();
    let root = Path::new(arguments.get(1).ok_or("plant ROOT [COPY]")?);
    let defects = defects(&root.join("tests/planted"))?;
    if let Some(copy) = arguments.get(2) {
        for (file, text) in plant(root, &defects)? {
            fs::write(Path::new(copy).join(&file), text).map_err(|e| format!("{copy}/{file}: {e}"))?;
        }
        return Ok(());
    }
    for defect in defects {
        let usual = vec!["configs/behaviors/torture.toml".to_string()];
        for arguments in if defect.torture.is_empty() { usual } else { defect.torture } {
            println!("{} {arguments}", defect.name);
        }
    }
    Ok(())
}
