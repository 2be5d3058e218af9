//! `mobee new`: a starting file for one's own behavior, with the robot and the world that it names beside it.

use crate::config::{ConfigError, suggestion};
use crate::kinds::entries;
use mobee_model::file::{MIB, read_text};
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A file that ships, and its text.
type Shipped = (&'static str, &'static str);

/// A behavior to start from: its name, its text, and the files that it names.
struct Template {
    name: &'static str,
    text: &'static str,
    files: &'static [Shipped],
}

const ICUB: Shipped = ("../robots/icub.xml", include_str!("../configs/robots/icub.xml"));
const KATANA: Shipped = ("../robots/katana.xml", include_str!("../configs/robots/katana.xml"));
const EXPLORE: Shipped = ("../worlds/explore.xml", include_str!("../configs/worlds/explore.xml"));
const BALL: Shipped = ("../worlds/ball.xml", include_str!("../configs/worlds/ball.xml"));

const TEMPLATES: &[Template] = &[
    Template { name: "explore", text: include_str!("../configs/behaviors/explore.toml"), files: &[ICUB, EXPLORE] },
    Template { name: "ball", text: include_str!("../configs/behaviors/ball.toml"), files: &[ICUB, BALL] },
    Template { name: "filter", text: include_str!("../configs/behaviors/filter.toml"), files: &[ICUB, BALL] },
    Template { name: "torture", text: include_str!("../configs/behaviors/torture.toml"), files: &[KATANA] },
    Template {
        name: "explore-yarp",
        text: include_str!("../configs/behaviors/explore-yarp.toml"),
        files: &[ICUB, EXPLORE],
    },
];

/// The schema's file, which editors look for.
pub(crate) const SCHEMA: &str = "mobee.schema.json";

/// Writes `NAME.toml`, and beside it what it names. Answers the files that were written.
///
/// # Errors
/// If the name is none, there is no such behavior, or a file would be written over. Nothing is written then.
pub fn write(name: &str, from: &str) -> Result<Vec<PathBuf>, ConfigError> {
    let names: Vec<&str> = TEMPLATES.iter().map(|t| t.name).collect();
    let template = TEMPLATES.iter().find(|t| t.name == from).ok_or_else(|| {
        ConfigError::plain(format!("there is no behavior `{from}` to start from"), suggestion(from, "behavior", &names))
    })?;
    let (dir, stem) = file_stem(name)?;
    let file_of = |shipped: &str| Path::new(shipped).file_name().map(|f| dir.join(f)).unwrap_or_default();
    let mut files = vec![(dir.join(format!("{stem}.toml")), text(template, &stem))];
    files.extend(template.files.iter().map(|(shipped, text)| (file_of(shipped), (*text).to_owned())));
    files.push((dir.join(SCHEMA), crate::schema::text()));
    // what stands there already and says the same is left; the behavior itself is always new
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
    for (file, text) in &missing {
        std::fs::write(file, text).map_err(|e| {
            ConfigError::plain(
                format!("can't write {}: {e}", file.display()),
                "check the folder's space and permissions",
            )
        })?;
    }
    Ok(missing.into_iter().map(|(file, _)| file).collect())
}

/// The folder and the stem of a behavior's file.
///
/// # Errors
/// If the name is none, or the folder does not exist.
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

/// The behavior with its files beside it, and the settings that it leaves out as comments.
fn text(template: &Template, stem: &str) -> String {
    let mut text = format!("#:schema ./{SCHEMA}\n{}", template.text);
    for (shipped, _) in template.files {
        let name = shipped.rsplit('/').next().unwrap_or(shipped);
        text = text.replace(shipped, name);
    }
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
