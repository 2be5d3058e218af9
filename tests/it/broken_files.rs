//! Every file in `tests/broken` holds a mistake as people make them. Each is answered by the way that `mobee check` takes, before
//! anything could move: at the lines that are marked in it, with a remedy, in the words of the stored snapshot.
//!
//! A line is marked by `<- here` in a comment at its end, or by `# expect: line N` in the first line of the file.

use miette::{Diagnostic, GraphicalReportHandler, GraphicalTheme};
use mobee::config::Complaints;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

const FOLDER: &str = "tests/broken";

fn files() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(FOLDER).expect("the folder").map(|e| e.expect("an entry").path());
    let mut files: Vec<PathBuf> = entries.filter(|p| p.extension().is_some_and(|e| e == "toml")).collect();
    files.sort();
    files
}

/// The marked lines of a file, from 1.
fn marks(file: &Path) -> BTreeSet<usize> {
    let text = std::fs::read_to_string(file).expect("a text");
    if let Some(line) = text.strip_prefix("# expect: line ").and_then(|rest| rest.lines().next()) {
        return BTreeSet::from([line.parse().expect("a line's number")]);
    }
    (1..).zip(text.lines()).filter(|(_, line)| line.contains("<- here")).map(|(n, _)| n).collect()
}

fn shown(complaints: &Complaints) -> String {
    let handler = GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor()).with_width(110);
    let mut text = String::new();
    handler.render_report(&mut text, complaints).expect("it can be shown");
    // a kind of a feature, which may be off
    text.replace("known here: feetech, ", "known here: ")
}

/// What is wrong with how one file is answered.
fn judge(file: &Path) -> Vec<String> {
    let name = file.file_stem().expect("a name").to_string_lossy().into_owned();
    let complaints = match mobee::compose::read(file, &[]) {
        Ok(_) => return vec![format!("{name} passes")],
        Err(complaints) => complaints,
    };
    let mut wrong = Vec::new();
    let mut told: BTreeSet<(PathBuf, usize)> = BTreeSet::new();
    for c in complaints.iter() {
        match c.place() {
            Some((place, line, _)) => drop(told.insert((PathBuf::from(place), line))),
            None => wrong.push(format!("{name}: no place: {c:?}")),
        }
        if c.remedy().is_empty() {
            wrong.push(format!("{name}: no remedy: {c:?}"));
        }
    }
    let named: BTreeSet<&Path> = told.iter().map(|(place, _)| place.as_path()).chain([file]).collect();
    let marked: BTreeSet<(PathBuf, usize)> =
        named.iter().flat_map(|f| marks(f).into_iter().map(|line| (f.to_path_buf(), line))).collect();
    if told != marked {
        wrong.push(format!("{name}: told of {told:?}, marked are {marked:?}\n{}", shown(&complaints)));
    }
    insta::with_settings!({ snapshot_path => "../broken/snapshots", prepend_module_to_snapshot => false, omit_expression => true }, {
        insta::assert_snapshot!(name, shown(&complaints));
    });
    assert!(complaints.severity().is_none_or(|s| s == miette::Severity::Error));
    wrong
}

#[test]
fn every_broken_file_is_answered_at_the_right_line() {
    let files = files();
    assert!(files.len() >= 100, "{} broken files", files.len());
    let wrong: Vec<String> = files.iter().flat_map(|f| judge(f)).collect();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), files.len(), wrong.join("\n"));
}
