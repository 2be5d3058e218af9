//! Every file that a user names is opened by `mobee_text::file`: a pipe, a device or a file without an end is refused at once. Whoever
//! adds another way to open files for reading finds it here.

use std::path::{Path, PathBuf};

/// Calls that open a file for reading, and wait for ever if it is a pipe.
const CALLS: &[&str] = &[
    "File::open(",
    "fs::read(",
    "fs::read_to_string(",
    "fs::copy(",
    "ImageReader::open(",
    "image::open(",
    ".read(true)",
];

/// Files that may: the file, the call, and why.
const ALLOWED: &[(&str, &str, &str)] = &[
    ("model/text/src/file.rs", ".read(true)", "this is the one that opens users' files"),
    ("yarp/src/config.rs", "fs::read_to_string(", "it looks at the file's kind before, and may not use the model"),
    ("app/cli/src/ctl/listener.rs", "File::open(", "a folder of ours, for a short name of it"),
    ("app/cli/src/run/folder.rs", "File::open(", "the run's own folder, to hold on to it"),
    ("actors/journal/src/journal.rs", "File::open(", "the run's own folder, to hold on to it"),
    ("app/cli/src/signals.rs", "fs::read_to_string(", "the system's own file"),
    ("app/cli/src/torture/memory.rs", "fs::read_to_string(", "the system's own file"),
    ("app/cli/src/run/resource_limits.rs", "fs::read_to_string(", "the system's own file"),
];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path()) {
        let name = entry.file_name().expect("a name").to_string_lossy().into_owned();
        if entry.is_dir()
            && !["tests", "benches", "target", "fuzz", "examples"].contains(&name.as_str())
            && !name.starts_with('.')
        {
            sources(&entry, found);
        } else if name.ends_with(".rs") && name != "tests.rs" {
            found.push(entry);
        }
    }
}

/// Whether a line has this call, and not that of a longer name.
fn has_call(line: &str, call: &str) -> bool {
    line.match_indices(call).any(|(at, _)| call.starts_with('.') || !line[..at].ends_with(char::is_alphanumeric))
}

#[test]
fn users_files_are_opened_in_one_place() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    ["src", "app", "model", "actors", "behaviors", "bridges", "drivers", "yarp"]
        .iter()
        .for_each(|f| sources(&root.join(f), &mut files));
    assert!(files.len() > 400, "only {} sources are found", files.len());
    let (mut wrong, mut used) = (Vec::new(), Vec::new());
    for file in &files {
        let name = file.strip_prefix(root).expect("in the project").to_string_lossy().into_owned();
        let text = std::fs::read_to_string(file).expect("a text");
        // unit tests stand at the end, and open what they wrote
        let code = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
        for (number, line) in code.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//")) {
            for call in CALLS.iter().filter(|call| has_call(line, call)) {
                match ALLOWED.iter().position(|(at, allowed, _)| *at == name && allowed == call) {
                    Some(k) => used.push(k),
                    None => wrong.push(format!("{name}:{}: {}", number + 1, line.trim())),
                }
            }
        }
    }
    assert!(wrong.is_empty(), "open them by mobee_text::file:\n{}", wrong.join("\n"));
    let idle: Vec<_> = ALLOWED.iter().enumerate().filter(|(k, _)| !used.contains(k)).map(|(_, a)| a).collect();
    assert!(idle.is_empty(), "these need no exception any more: {idle:?}");
}
