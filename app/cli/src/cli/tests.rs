//! Every command line of the documentation parses: subcommands, options and values exist as written there.

use super::Cli;
use clap::Parser;
use std::fs;
use std::path::Path;

/// Words of a command line up to a comment, a pipe or `&`; quotes group, and brackets around optional words are dropped.
fn words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote, mut is_quoted) = (Vec::new(), String::new(), None, false);
    for c in line.chars().chain([' ']) {
        match (c, quote) {
            ('\'' | '"', None) => (quote, is_quoted) = (Some(c), true),
            (c, Some(open)) if c == open => quote = None,
            (' ', None) if word.is_empty() && !is_quoted => {}
            (' ', None) => {
                if !is_quoted && (word.starts_with('#') || ["|", "&", "&&", ">", "<", ";"].contains(&&*word)) {
                    return words;
                }
                let plain = if is_quoted { &*word } else { word.trim_matches(['[', ']', ';']) };
                words.push(plain.to_owned());
                (word, is_quoted) = (String::new(), false);
            }
            (c, _) => word.push(c),
        }
    }
    words
}

/// The lines of a page's `sh` blocks that call the program, with their continuations. A synopsis with placeholders is a
/// `text` block.
fn commands(page: &str) -> Vec<String> {
    let (mut found, mut is_shell) = (Vec::new(), false);
    let joined = page.replace("\\\n", " ");
    for line in joined.lines() {
        if line.trim_start().starts_with("```") {
            is_shell = line.trim() == "```sh" && !is_shell;
        } else if is_shell && let Some(command) = line.trim_start_matches("$ ").strip_prefix("mobee ") {
            found.push(command.to_owned());
        }
    }
    found
}

#[test]
fn words_are_grouped_and_cut() {
    assert_eq!(
        words("run a.toml --set 'x={ y = 1 }' [--json]  # it runs"),
        ["run", "a.toml", "--set", "x={ y = 1 }", "--json"]
    );
    assert_eq!(words("ctl halt | release"), ["ctl", "halt"]);
}

#[test]
fn every_documented_command_parses() {
    let root = &Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let pages = fs::read_dir(root.join("docs")).expect("docs").map(|entry| entry.expect("an entry").path());
    let pages = pages.filter(|path| path.extension().is_some_and(|e| e == "md")).chain([root.join("README.md")]);
    let (mut wrong, mut parsed) = (Vec::new(), 0);
    for path in pages {
        for command in commands(&fs::read_to_string(&path).expect("a page")) {
            parsed += 1;
            let Err(error) = Cli::try_parse_from([vec!["mobee".to_owned()], words(&command)].concat()) else {
                continue;
            };
            // subcommands of optional features
            let is_absent = error.kind() == clap::error::ErrorKind::InvalidSubcommand;
            if !(is_absent && cfg!(not(feature = "feetech"))) {
                wrong.push(format!("{}: mobee {command}\n{error}", path.display()));
            }
        }
    }
    assert!(parsed > 50, "only {parsed} commands were found: the search itself is broken");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
