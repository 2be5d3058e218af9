//! The documentation is complete: the summary of the book lists every page, every relative link and anchor resolves, and
//! pages and files that sources or pages name exist.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

/// Markdown files beside those of `docs/` and `benches/results/`.
const PAGES: &[&str] = &[
    "README.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "benches/README.md",
    "benches/peers/README.md",
    "python/README.md",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Markdown files of a folder, as paths from the root.
fn pages_in(folder: &str) -> BTreeSet<String> {
    let names = fs::read_dir(root().join(folder)).expect("a folder");
    let names = names.map(|entry| entry.expect("an entry").file_name().into_string().expect("a name in UTF-8"));
    names.filter(|name| name.ends_with(".md")).map(|name| format!("{folder}/{name}")).collect()
}

/// The text without code blocks.
fn without_blocks(text: &str) -> String {
    let (mut kept, mut in_block) = (String::new(), false);
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            in_block = !in_block;
        } else if !in_block {
            kept.push_str(line);
            kept.push('\n');
        }
    }
    kept
}

/// Code spans and the prose between them: every second part is code.
fn parts(text: &str) -> Vec<String> {
    without_blocks(text).split('`').map(str::to_owned).collect()
}

/// Targets of the links of a page: what is in the parentheses behind `](`.
fn links(text: &str) -> Vec<String> {
    let prose: Vec<_> =
        parts(text).into_iter().enumerate().map(|(i, part)| if i % 2 == 0 { part } else { "code".into() }).collect();
    let prose = prose.concat();
    prose.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0.to_owned())).collect()
}

/// Anchors of a page's headings, as GitHub and mdBook form them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let mut found = BTreeSet::new();
    for line in without_blocks(text).lines().filter(|line| line.starts_with('#')) {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let slug: String = title.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c)).collect();
        let slug = slug.replace(' ', "-");
        let count = counts.entry(slug.clone()).or_default();
        found.insert(if *count == 0 { slug } else { format!("{slug}-{count}") });
        *count += 1;
    }
    found
}

/// `folder/../name` as `name`.
fn normal(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        if part == Component::ParentDir {
            out.pop();
        } else {
            out.push(part);
        }
    }
    out
}

#[test]
fn the_summary_lists_every_page_once() {
    let listed = links(&text("docs/SUMMARY.md"));
    let mut seen = BTreeSet::new();
    for page in &listed {
        assert!(seen.insert(format!("docs/{page}")), "docs/SUMMARY.md lists {page} twice");
    }
    let mut there = pages_in("docs");
    there.remove("docs/SUMMARY.md");
    assert_eq!(seen, there, "docs/SUMMARY.md lists the pages of docs/, and no other");
}

#[test]
fn every_link_and_anchor_resolves() {
    let mut pages = pages_in("docs");
    pages.extend(pages_in("benches/results"));
    pages.extend(PAGES.iter().map(|&page| page.to_owned()));
    let (mut broken, mut checked) = (Vec::new(), 0);
    for page in &pages {
        for link in links(&text(page)) {
            if link.contains("://") {
                continue;
            }
            checked += 1;
            let (path, anchor) = link.split_once('#').map_or((&*link, None), |(path, anchor)| (path, Some(anchor)));
            let folder = Path::new(page).parent().expect("a folder");
            let target = if path.is_empty() { PathBuf::from(page) } else { normal(&folder.join(path)) };
            let missing = !root().join(&target).exists();
            let lost = |anchor| !missing && !anchors(&text(target.to_str().expect("UTF-8"))).contains(anchor);
            if missing || anchor.is_some_and(lost) {
                broken.push(format!("{page}: {link}"));
            }
        }
    }
    assert!(checked > 200, "only {checked} links were found: the search itself is broken");
    assert!(broken.is_empty(), "links that lead nowhere: {broken:#?}");
}

/// Files that may name a page: sources, configurations and scripts, not build products.
fn naming(folder: &Path, found: &mut Vec<PathBuf>) {
    const ELSEWHERE: &[&str] = &["target", ".git", "docs", "runs", "dist", "data", "planted"];
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if path.is_dir() && !ELSEWHERE.contains(&name) {
            naming(&path, found);
        } else if path.is_file() && !path.ends_with("tests/it/book.rs") {
            found.push(path);
        }
    }
}

/// Paths of pages (`docs/NAME.md`) in a text.
fn named_pages(text: &str) -> impl Iterator<Item = String> {
    text.split("docs/").skip(1).filter_map(|rest| {
        let name: String = rest.chars().take_while(|c| c.is_ascii_alphanumeric() || "-_./".contains(*c)).collect();
        Some(format!("docs/{}.md", name.split_once(".md")?.0))
    })
}

#[test]
fn pages_that_sources_and_messages_name_exist() {
    let mut files = Vec::new();
    naming(root(), &mut files);
    let (mut missing, mut named) = (Vec::new(), 0);
    for file in files {
        let Ok(text) = fs::read_to_string(&file) else { continue };
        for page in named_pages(&text) {
            named += 1;
            if !root().join(&page).is_file() {
                missing.push(format!("{}: {page}", file.display()));
            }
        }
    }
    assert!(named > 50, "only {named} pages were named: the search itself is broken");
    assert!(missing.is_empty(), "pages that do not exist: {missing:#?}");
}

/// Paths from the root that a page has in code spans; those relative to another one can't be told from names.
fn named_paths(text: &str) -> Vec<String> {
    const FOLDERS: &[&str] = &[
        "src",
        "model",
        "actors",
        "behaviors",
        "drivers",
        "python",
        "configs",
        "tests",
        "tools",
        "examples",
        "benches",
        "docs",
    ];
    let code: Vec<_> = parts(text).into_iter().skip(1).step_by(2).collect();
    let is_path = |word: &String| {
        let plain = word.chars().all(|c| c.is_ascii_alphanumeric() || "-_./".contains(c));
        plain && word.split_once('/').is_some_and(|(first, _)| FOLDERS.contains(&first))
    };
    code.into_iter().filter(is_path).collect()
}

#[test]
fn files_that_contributors_are_sent_to_exist() {
    let mut missing = Vec::new();
    for page in ["ARCHITECTURE.md", "docs/where-to-change.md", "docs/actors.md", "docs/transactions.md"] {
        let paths = named_paths(&text(page));
        assert!(!paths.is_empty(), "{page} names no file: the search itself is broken");
        missing
            .extend(paths.into_iter().filter(|path| !root().join(path).exists()).map(|path| format!("{page}: {path}")));
    }
    assert!(missing.is_empty(), "files that do not exist: {missing:#?}");
}

#[test]
fn every_subcommand_is_in_the_reference() {
    let out = Command::new(env!("CARGO_BIN_EXE_mobee")).arg("--help").output().expect("mobee runs");
    let help = String::from_utf8(out.stdout).expect("UTF-8");
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let names: Vec<_> =
        listed.filter_map(|line| line.strip_prefix("  ")?.split(' ').next()).filter(|n| !n.is_empty()).collect();
    assert!(names.len() > 15, "only {names:?}: the search itself is broken");
    let page = text("docs/commands.md");
    let missing: Vec<_> =
        names.iter().filter(|&&name| name != "help" && !page.contains(&format!("`mobee {name}"))).collect();
    assert!(missing.is_empty(), "docs/commands.md lacks {missing:?}");
}
