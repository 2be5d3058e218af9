//! Output of the program. Texts come from files, ports and runs of others, and must not move the cursor, set colors or
//! change the direction of writing: such characters are printed as digits, as in `\u001b`.
//!
//! The macros here replace those of the standard library in this whole crate, so that nothing bypasses this module by
//! mistake.

use miette::{GraphicalReportHandler, GraphicalTheme, Report};
use mobee_compose::config::{Complaints, ConfigError};
use mobee_model::{FileError, printable};
use std::path::Path;

/// Like the standard library's, for untrusted text.
macro_rules! println {
    ($($text:tt)*) => { $crate::terminal::out(&(format!($($text)*) + "\n")) };
}

/// Like the standard library's, for untrusted text.
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::terminal::err(&format!($($text)*)) };
}

/// Prints on standard output.
pub fn out(text: &str) {
    std::print!("{}", printable(text));
}

/// Prints a line on standard error.
pub fn err(text: &str) {
    std::eprintln!("{}", printable(text));
}

/// Prints a complaint on standard error.
pub fn complain(report: &Report) {
    // these are plain text already, so remaining control characters are our own colors
    let plain = report.is::<ConfigError>() || report.is::<Complaints>() || report.is::<FileError>();
    if plain {
        return std::eprintln!("{report:?}");
    }
    let handler = GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor());
    let mut text = String::new();
    match handler.render_report(&mut text, report.as_ref()) {
        Ok(()) => err(&text),
        Err(_) => err(&report.to_string()),
    }
}

/// A path as a word of a shell command that a user may copy: quoted if it has characters with a meaning to the shell.
pub(crate) fn shell_word(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_alphanumeric() || "/._-+,:@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

#[cfg(test)]
mod tests {
    use super::shell_word;
    use std::path::{Path, PathBuf};

    fn files(dir: &Path) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(dir).expect("a folder").map(|e| e.expect("an entry").path());
        entries.flat_map(|p| if p.is_dir() { files(&p) } else { vec![p] }).collect()
    }

    #[test]
    fn a_copied_command_has_its_path_in_one_word() {
        for path in ["runs/explore-2026", "/tmp/a b", "it's", "$(rm)", "-"] {
            let script = format!("printf %s {}", shell_word(Path::new(path)));
            let out = std::process::Command::new("sh").args(["-c", &script]).output().expect("a shell");
            assert_eq!(String::from_utf8_lossy(&out.stdout), path);
        }
    }

    #[test]
    fn nothing_is_printed_past_this_module() {
        let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        for file in files(&src).into_iter().filter(|f| !f.ends_with("terminal.rs")) {
            let text = std::fs::read_to_string(&file).expect("a text");
            let ways = [" print!(", "eprint!(", "std::println", "std::eprintln"];
            let found: Vec<&&str> = ways.iter().filter(|way| text.contains(**way)).collect();
            assert!(found.is_empty(), "{}: {found:?}", file.display());
        }
    }
}
