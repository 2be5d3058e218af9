//! `mobee new`: a starting file for a behavior of your own, with the robot and the world that it names beside it.

use mobee_compose::config::{ConfigError, suggestion};
use mobee_compose::kinds::entries;
use mobee_compose::maps::stage;
use mobee_model::file::{MIB, read_text};
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A shipped file: its path in behaviors, its name beside a new behavior, and its text.
type Shipped = (&'static str, &'static str, &'static str);

/// A behavior to start from: its name, its text, and all files that it needs.
struct Template {
    name: &'static str,
    text: &'static str,
    files: &'static [Shipped],
}

macro_rules! shipped {
    ($path:literal, $name:literal) => {
        (concat!("../", $path), $name, include_str!(concat!("../../../configs/", $path)))
    };
}

const ICUB: Shipped = shipped!("robots/icub.xml", "icub.xml");
const KATANA: Shipped = shipped!("robots/katana.xml", "katana.xml");
const KATANA_BLOCK: Shipped = shipped!("robots/katana-block.xml", "katana-block.xml");
const EXPLORE: Shipped = shipped!("worlds/explore.xml", "explore.xml");
const BALL: Shipped = shipped!("worlds/ball.xml", "ball.xml");
const CUP: Shipped = shipped!("worlds/cup.xml", "cup.xml");
const TABLE: Shipped = shipped!("worlds/table.xml", "table.xml");
const REACH: Shipped = shipped!("worlds/reach.xml", "reach.xml");
const DETECTOR: Shipped = shipped!("sensing/cup.detector.json", "cup.detector.json");
const LOCATOR: Shipped = shipped!("sensing/icub-sim.locator.json", "icub-sim.locator.json");
const RIGHT_MAP: Shipped = shipped!("roadmaps/reach.toml", "right-arm-map.toml");
const LEFT_MAP: Shipped = shipped!("roadmaps/reach-left.toml", "left-arm-map.toml");

macro_rules! template {
    ($name:literal, $files:expr) => {
        Template {
            name: $name,
            text: include_str!(concat!("../../../configs/behaviors/", $name, ".toml")),
            files: $files,
        }
    };
}

const TEMPLATES: &[Template] = &[
    template!("explore", &[ICUB, EXPLORE]),
    template!("ball", &[ICUB, BALL]),
    template!("plan", &[ICUB, BALL]),
    template!("look", &[ICUB, CUP, DETECTOR, LOCATOR]),
    template!("collect", &[ICUB, KATANA_BLOCK, DETECTOR, LOCATOR]),
    template!("reach", &[ICUB, REACH, TABLE, DETECTOR, LOCATOR, RIGHT_MAP, LEFT_MAP]),
    template!("filter", &[ICUB, BALL]),
    template!("torture", &[KATANA]),
    template!("explore-yarp", &[ICUB, EXPLORE]),
];

/// The name of the schema's file, which editors look for.
pub(crate) const SCHEMA: &str = "mobee.schema.json";

/// Writes `NAME.toml`, and the files that it names beside it. Returns the written files.
///
/// # Errors
/// If the name is invalid, there is no such behavior, or a file would be overwritten. Nothing is written then.
pub fn write(name: &str, from: &str) -> Result<Vec<PathBuf>, ConfigError> {
    let names: Vec<&str> = TEMPLATES.iter().map(|t| t.name).collect();
    let template = TEMPLATES.iter().find(|t| t.name == from).ok_or_else(|| {
        ConfigError::plain(format!("there is no behavior `{from}` to start from"), suggestion(from, "behavior", &names))
    })?;
    let (dir, stem) = file_stem(name)?;
    let mut files = vec![(dir.join(format!("{stem}.toml")), text(template, &stem))];
    files.extend(template.files.iter().map(|(_, name, text)| (dir.join(name), beside(template, text))));
    files.push((dir.join(SCHEMA), mobee_compose::schema::text()));
    save_new(files)
}

/// Writes the files that are missing, all or none, and returns them. The first must be new; others that are there stay if their text is
/// the same.
///
/// # Errors
/// If a file would be overwritten, or can't be written.
pub(crate) fn save_new(files: Vec<(PathBuf, String)>) -> Result<Vec<PathBuf>, ConfigError> {
    let mut missing = Vec::new();
    for (i, (file, text)) in files.into_iter().enumerate() {
        match read_text(&file, MIB) {
            Ok(old) if i > 0 && old == text => {}
            _ if file.exists() && !file.ends_with(SCHEMA) => {
                let help = "give another name, or work in another folder; nothing is written over";
                return Err(ConfigError::plain(format!("{} exists already", file.display()), help));
            }
            _ => missing.push((file, text)),
        }
    }
    let all: Vec<(&Path, &str)> = missing.iter().map(|(file, text)| (file.as_path(), text.as_str())).collect();
    save_all(&all)?;
    Ok(missing.into_iter().map(|(file, _)| file).collect())
}

/// Writes new files, all or none: all are complete under temporary names before the first is renamed. Only the schema
/// may replace an older one.
///
/// # Errors
/// If one can't be written, or has been created by another program. None of the files remains then.
pub(crate) fn save_all(files: &[(&Path, &str)]) -> Result<(), ConfigError> {
    let refused = |file: &Path, why: &dyn std::fmt::Display| {
        let help = "check the folder's space and permissions; none of the files was written";
        ConfigError::plain(format!("can't write {}: {why}", file.display()), help)
    };
    let mut staged = Vec::new();
    for (file, text) in files {
        staged.push((*file, stage(file, text).map_err(|e| refused(file, &e))?));
    }
    let mut placed: Vec<&Path> = Vec::new();
    for (file, temporary) in staged {
        let replaces = file.ends_with(SCHEMA) && (file.is_file() || !file.exists());
        let put = if replaces { temporary.persist(file) } else { temporary.persist_noclobber(file) };
        if let Err(e) = put {
            placed.iter().for_each(|file| drop(std::fs::remove_file(file)));
            return Err(refused(file, &e.error));
        }
        if !replaces {
            placed.push(file);
        }
    }
    Ok(())
}

/// The folder and the stem of a behavior's file.
///
/// # Errors
/// If the name is invalid, or the folder does not exist.
pub(crate) fn file_stem(name: &str) -> Result<(PathBuf, String), ConfigError> {
    let path = PathBuf::from(name.strip_suffix(".toml").unwrap_or(name));
    let stem = path.file_name().and_then(|s| s.to_str()).unwrap_or_default();
    if stem.is_empty() || !stem.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_') {
        let help = "use letters, digits, - and _, such as `mobee new reach`";
        return Err(ConfigError::plain(format!("{name:?} is not a valid name for a behavior"), help));
    }
    let dir = path.parent().unwrap_or(Path::new(""));
    if !dir.as_os_str().is_empty() && !dir.is_dir() {
        return Err(ConfigError::plain(format!("there is no folder {}", dir.display()), "make it first"));
    }
    Ok((dir.to_owned(), stem.to_owned()))
}

/// The text with the paths of its files beside it.
fn beside(template: &Template, text: &str) -> String {
    template.files.iter().fold(text.to_owned(), |text, (shipped, name, _)| text.replace(shipped, name))
}

/// The behavior with its files beside it, and with the settings that it omits as comments.
fn text(template: &Template, stem: &str) -> String {
    let mut text = format!("#:schema ./{SCHEMA}\n{}", beside(template, template.text));
    text = text.replace(&format!("configs/behaviors/{}.toml", template.name), &format!("{stem}.toml"));
    let used = |role: &str, kind: &str| role == "agent" && text.contains(&format!("kind = \"{kind}\""));
    let mut more = String::new();
    for e in entries().iter().filter(|e| used(e.role, e.name)) {
        let _ = writeln!(more, "\n# More settings of the {} `{}`, with their defaults:", e.role, e.name);
        for (key, s) in e.schema["properties"].as_object().into_iter().flatten() {
            let Some(default) = s.get("default").filter(|d| !d.is_null() && !is_empty(d)) else { continue };
            let doc = s["description"].as_str().unwrap_or_default().replace('\n', " ");
            let _ = writeln!(more, "#   {key} = {default}  # {doc}");
        }
    }
    text + &more
}

fn is_empty(value: &Value) -> bool {
    value.as_array().is_some_and(Vec::is_empty) || value.as_object().is_some_and(serde_json::Map::is_empty)
}
