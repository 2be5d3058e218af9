//! `mobee new --crate`: a crate outside of this repository with a driver, an agent and a camera, whose program has every subcommand.
//!
//! Its files are those of `examples/my_arm`, which the gate builds and tests, under another name.

use crate::new::save_all;
use mobee_compose::config::ConfigError;
use mobee_model::file::{MIB, read_text};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The name of the crate in the sources below.
const NAME: &str = "my_arm";
/// The sources, by their place in the crate.
const SOURCES: &[(&str, &str)] = &[
    ("src/main.rs", include_str!("../../../examples/my_arm/src/main.rs")),
    ("src/lib.rs", include_str!("../../../examples/my_arm/src/lib.rs")),
    ("src/driver.rs", include_str!("../../../examples/my_arm/src/driver.rs")),
    ("src/agent.rs", include_str!("../../../examples/my_arm/src/agent.rs")),
    ("src/camera.rs", include_str!("../../../examples/my_arm/src/camera.rs")),
    ("tests/conformance.rs", include_str!("../../../examples/my_arm/tests/conformance.rs")),
];
const BEHAVIOR: &str = include_str!("../../../examples/my_arm/my_arm.toml");
const MANIFEST: &str = include_str!("../../../examples/my_arm/Cargo.toml");
const ROBOT: &str = include_str!("../../../configs/robots/katana.xml");
/// The manifest of this workspace: versions of dependencies, and the build profile.
const WORKSPACE: &str = include_str!("../../../Cargo.toml");
/// Words that are no names of crates: Rust's, and those of packages that the crate depends on.
const RESERVED: &[&str] = &[
    "abstract",
    "as",
    "async",
    "await",
    "become",
    "box",
    "break",
    "const",
    "continue",
    "crate",
    "do",
    "dyn",
    "else",
    "enum",
    "extern",
    "false",
    "final",
    "fn",
    "for",
    "gen",
    "if",
    "impl",
    "in",
    "inventory",
    "let",
    "loop",
    "macro",
    "match",
    "mobee",
    "mod",
    "move",
    "mut",
    "override",
    "priv",
    "pub",
    "ref",
    "return",
    "schemars",
    "self",
    "serde",
    "serde_json",
    "static",
    "struct",
    "super",
    "tempfile",
    "test",
    "trait",
    "true",
    "try",
    "type",
    "typeof",
    "unsafe",
    "unsized",
    "use",
    "virtual",
    "where",
    "while",
    "yield",
];

/// Writes the crate into the new folder `name`; returns the list of files and the next commands. `checkout` is the folder of MoBeE's
/// sources; default: the one that this program was built from.
///
/// # Errors
/// If the name is not that of a crate, the folder exists, there is no checkout, or a file can't be written. Nothing is left then.
pub fn command(name: &str, checkout: Option<&Path>) -> Result<String, ConfigError> {
    let folder = PathBuf::from(name);
    let stem = folder.file_name().and_then(|s| s.to_str()).unwrap_or_default();
    check_name(stem)?;
    if folder.exists() {
        let help = "give another name, or work in another folder; nothing is written over";
        return Err(ConfigError::plain(format!("{} exists already", folder.display()), help));
    }
    let checkout = checkout.unwrap_or(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")));
    let checkout = checkout.canonicalize().unwrap_or(checkout.to_owned());
    let manifest = read_text(&checkout.join("Cargo.toml"), MIB).unwrap_or_default();
    if !manifest.contains("name = \"mobee\"") {
        let what = format!("there is no checkout of MoBeE at {}", checkout.display());
        return Err(ConfigError::plain(what, "name the folder with MoBeE's sources by --mobee FOLDER"));
    }
    let named = |text: &str| text.replace(NAME, stem);
    let mut files: Vec<(PathBuf, String)> =
        SOURCES.iter().map(|(path, text)| (folder.join(path), named(text))).collect();
    let behavior = named(BEHAVIOR).replace("../../configs/robots/", "");
    files.push((folder.join("Cargo.toml"), cargo_toml(stem, &checkout)?));
    files.push((folder.join(format!("{stem}.toml")), behavior));
    files.push((folder.join("katana.xml"), ROBOT.to_owned()));
    files.push((folder.join(".gitignore"), "/target\n/runs\n".to_owned()));
    // the versions that MoBeE is tested with
    if let Ok(lock) = read_text(&checkout.join("Cargo.lock"), 4 * MIB) {
        files.push((folder.join("Cargo.lock"), lock));
    }
    write_all(&folder, &files)?;
    let mut text: String = files.iter().map(|(file, _)| format!("{}\n", file.display())).collect();
    let _ =
        write!(text, "\ncd {0}\ncargo test --release\ncargo run --release -- run {1}.toml\n", folder.display(), stem);
    Ok(text)
}

fn check_name(stem: &str) -> Result<(), ConfigError> {
    let starts = stem.starts_with(|c: char| c.is_ascii_lowercase());
    let letters = stem.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
    if !starts || !letters || stem.len() > 64 {
        let help = "begin with a letter, and use lower-case letters, digits and _: `mobee new --crate my_arm`";
        return Err(ConfigError::plain(format!("{stem:?} is not a valid name for a crate"), help));
    }
    if RESERVED.contains(&stem) || stem.starts_with("mobee_") {
        let help = "give another one, such as `mobee new --crate my_arm`";
        return Err(ConfigError::plain(format!("the name `{stem}` is taken by Rust or by a dependency"), help));
    }
    Ok(())
}

/// All files, or none and no folder.
fn write_all(folder: &Path, files: &[(PathBuf, String)]) -> Result<(), ConfigError> {
    let made = ["", "src", "tests"].iter().try_for_each(|part| std::fs::create_dir(folder.join(part)));
    let written = made
        .map_err(|e| {
            let help = "check that its parent folder exists, and its space and permissions";
            ConfigError::plain(format!("can't make the folder {}: {e}", folder.display()), help)
        })
        .and_then(|()| {
            let all: Vec<(&Path, &str)> = files.iter().map(|(file, text)| (file.as_path(), text.as_str())).collect();
            save_all(&all)
        });
    if written.is_err() {
        // only what was made here: `save_all` leaves no file
        ["tests", "src", ""].iter().for_each(|part| drop(std::fs::remove_dir(folder.join(part))));
    }
    written
}

/// The manifest of the crate: the dependencies of the example, our own by their folders and the others by version, and this workspace's
/// build profile, so that the crate is as fast.
fn cargo_toml(name: &str, checkout: &Path) -> Result<String, ConfigError> {
    let damaged = |e: &dyn std::fmt::Display| ConfigError::plain(format!("a built-in manifest: {e}"), "report this");
    let ours: toml::Table = WORKSPACE.parse().map_err(|e: toml::de::Error| damaged(&e))?;
    let example: toml::Table = MANIFEST.parse().map_err(|e: toml::de::Error| damaged(&e))?;
    let known = &ours["workspace"]["dependencies"];
    let package = &ours["workspace"]["package"];
    let text = |key: &str| package[key].as_str().unwrap_or_default().to_owned();
    let mut out = format!(
        "[package]\nname = \"{name}\"\nversion = \"0.1.0\"\nedition = \"{}\"\nrust-version = \"{}\"\npublish = false\n\n# a workspace of its own\n[workspace]\n",
        text("edition"),
        text("rust-version")
    );
    for section in ["dependencies", "dev-dependencies"] {
        let _ = writeln!(out, "\n[{section}]");
        for dependency in example[section].as_table().into_iter().flatten().map(|(dependency, _)| dependency) {
            let spec = known.get(dependency).ok_or_else(|| damaged(&dependency))?;
            let spec = match spec.get("path").and_then(toml::Value::as_str) {
                Some(path) => {
                    let path = if path == "." { checkout.to_owned() } else { checkout.join(path) };
                    let path = toml::Value::String(path.to_string_lossy().into_owned());
                    format!("{{ path = {path} }}")
                }
                None => spec.to_string(),
            };
            let _ = writeln!(out, "{dependency} = {spec}");
        }
    }
    let profile = WORKSPACE.find("[profile.release]").and_then(|from| WORKSPACE.get(from..)).unwrap_or_default();
    let profile = profile.split("\n[profile.dev]").next().unwrap_or_default();
    let _ = write!(out, "\n# MoBeE's own build profile\n{}\n", profile.trim_end());
    Ok(out)
}
