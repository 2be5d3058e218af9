//! Settings that name files, found by the schema of their kind: `format = "path"` marks a file that the kind opens, or a folder with files,
//! `format = "folder"` a folder that may be missing, `format = "roadmap"` a map file that composing reads for the kind. Kinds of other crates
//! are treated alike.

use super::{Config, Source};
use mobee_contract::{Agent, Bridge, Camera, Detector, Hardware, Locator, Role, registered};
use serde_json::Value;
use std::path::Path;

/// The `format` of a setting that is the path of a file, or of a folder with files.
const PATH: &str = "path";
/// The `format` of a setting that is the path of a folder, which the kind may make.
const FOLDER: &str = "folder";
/// The `format` of a setting that is the path of a map file, a list of such paths, or a map as JSON.
const ROADMAP: &str = "roadmap";
/// Greatest depth of settings within settings. Types that contain themselves end here.
const MAX_DEPTH: usize = 16;

/// A marked value of a kind's table.
struct MarkedValue<'s, 'v> {
    format: &'static str,
    /// The setting's documentation.
    doc: &'s str,
    /// Its place in the table, such as `scenery.stickers[0].picture`.
    place: String,
    value: &'v mut Value,
}

/// A setting that is the path of a file or folder.
pub struct PathSetting<'v> {
    /// Its place in the kind's table.
    pub place: String,
    /// The path as written, to be replaced.
    pub path: &'v mut String,
    /// True if it can only be a folder.
    pub is_folder: bool,
    /// The setting's documentation, on one line.
    pub doc: String,
}

/// The paths of files and folders in the table of a kind of `role`. The table may have its `kind` or not.
pub fn paths<'v>(role: &str, kind: &str, table: &'v mut Value) -> impl Iterator<Item = PathSetting<'v>> {
    marked(role, kind, table, &[PATH, FOLDER], |marked| {
        let is_folder = marked.format == FOLDER;
        let doc = marked.doc.replace('\n', " ");
        each(marked).filter_map(move |(place, value)| match value {
            Value::String(path) => Some(PathSetting { place, path, is_folder, doc: doc.clone() }),
            _ => None,
        })
    })
    .into_iter()
}

/// The maps in the table of a kind of `role`, one for each path or JSON.
pub fn maps<'v>(role: &str, kind: &str, table: &'v mut Value) -> Vec<(String, &'v mut Value)> {
    marked(role, kind, table, &[ROADMAP], each)
}

/// The values of a marked setting, which may be a list of them, each with its place.
fn each<'v>(marked: MarkedValue<'_, 'v>) -> impl Iterator<Item = (String, &'v mut Value)> + use<'v> {
    let place = marked.place;
    let values: Vec<_> = match marked.value {
        Value::Array(list) => list.iter_mut().enumerate().map(|(i, value)| (format!("{place}[{i}]"), value)).collect(),
        value => vec![(place, value)],
    };
    values.into_iter()
}

fn marked<'v, T, I: Iterator<Item = T>>(
    role: &str,
    kind: &str,
    table: &'v mut Value,
    formats: &[&'static str],
    of: impl Fn(MarkedValue<'_, 'v>) -> I,
) -> Vec<T> {
    let Some(kind) = registered().into_iter().find(|k| k.role() == role && k.name() == kind) else { return Vec::new() };
    let schema = kind.schema().to_value();
    let mut found = Vec::new();
    Search { root: &schema, formats }.value(&schema, String::new(), table, 0, &mut found);
    found.into_iter().flat_map(of).collect()
}

/// Walks values along their schema.
struct Search<'s> {
    root: &'s Value,
    formats: &'s [&'static str],
}

impl<'s> Search<'s> {
    fn value<'v>(
        &self,
        schema: &'s Value,
        at: String,
        value: &'v mut Value,
        depth: usize,
        found: &mut Vec<MarkedValue<'s, 'v>>,
    ) {
        if let Some(format) = self.formats.iter().find(|format| schema["format"] == **format) {
            let doc = schema["description"].as_str().unwrap_or_default();
            found.push(MarkedValue { format, doc, place: at, value });
            return;
        }
        if depth > MAX_DEPTH {
            return;
        }
        let linked = schema["$ref"].as_str().and_then(|link| self.root.pointer(link.strip_prefix('#')?));
        let options = ["allOf", "anyOf", "oneOf"].into_iter().filter_map(|key| schema[key].as_array()).flatten();
        let within: Vec<&Value> = linked.into_iter().chain(options).collect();
        match within.as_slice() {
            [] => {}
            [only] => return self.value(only, at, value, depth + 1, found),
            several => {
                // the variants of an enum, or a type and null: the value fits the one that has its keys
                let fits = |s: &&&Value| self.fits(s, value, depth + 1);
                if let Some(one) = several.iter().find(fits) {
                    self.value(one, at, value, depth + 1, found);
                }
                return;
            }
        }
        match value {
            Value::Object(map) => {
                for (key, inner) in map {
                    let known = schema["properties"].get(key.as_str()).or(schema.get("additionalProperties"));
                    let place = if at.is_empty() { key.clone() } else { format!("{at}.{key}") };
                    if let Some(known) = known {
                        self.value(known, place, inner, depth + 1, found);
                    }
                }
            }
            Value::Array(list) => {
                for (i, inner) in list.iter_mut().enumerate() {
                    self.value(&schema["items"], format!("{at}[{i}]"), inner, depth + 1, found);
                }
            }
            _ => {}
        }
    }

    /// Whether a value can be of this variant: of its JSON type, with all keys that it requires and its constants.
    fn fits(&self, schema: &'s Value, value: &Value, depth: usize) -> bool {
        if depth > MAX_DEPTH {
            return false;
        }
        if let Some(inner) = schema["$ref"].as_str().and_then(|link| self.root.pointer(link.strip_prefix('#')?)) {
            return self.fits(inner, value, depth + 1);
        }
        let named = |wanted: &str| match value {
            Value::Object(_) => wanted == "object",
            Value::Array(_) => wanted == "array",
            Value::String(_) => wanted == "string",
            Value::Bool(_) => wanted == "boolean",
            Value::Number(_) => wanted == "number" || wanted == "integer",
            Value::Null => wanted == "null",
        };
        let typed = match &schema["type"] {
            Value::String(wanted) => named(wanted),
            Value::Array(wanted) => wanted.iter().filter_map(Value::as_str).any(named),
            _ => true,
        };
        let required = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str);
        let properties = schema["properties"].as_object().into_iter().flatten();
        let constants = properties.filter_map(|(key, s)| Some((key, s.get("const")?)));
        let holds = |(key, constant): (&String, &Value)| value.get(key).is_none_or(|v| v == constant);
        typed && required.into_iter().all(|key| value.get(key).is_some()) && constants.into_iter().all(holds)
    }
}

/// A kind's table in a configuration: its place, its role and its `kind`.
pub struct KindTable<'c> {
    /// Place of the table in the configuration, such as `robot[0].agent`.
    pub at: String,
    /// Role of the kind.
    pub role: &'static str,
    /// Name of the kind.
    pub kind: String,
    /// The table itself.
    pub table: &'c mut Value,
}

impl Config {
    /// The tables of all kinds but controllers, which open no files.
    pub fn kind_tables(&mut self) -> impl Iterator<Item = KindTable<'_>> {
        let robots = self.robot.iter_mut().enumerate().flat_map(|(i, robot)| {
            let driver = (format!("robot[{i}].driver"), <dyn Hardware>::NAME, &mut robot.driver);
            let agent = robot.agent.iter_mut().map(move |a| (format!("robot[{i}].agent"), <dyn Agent>::NAME, a));
            std::iter::once(driver).chain(agent)
        });
        let sensors = self.sensor.iter_mut().enumerate().flat_map(|(i, sensor)| {
            let eyes = sensor.eye.iter_mut().enumerate().flat_map(move |(k, eye)| {
                let at = move |part: &str| format!("sensor[{i}].eye[{k}].{part}");
                let camera = (at("camera"), <dyn Camera>::NAME, &mut eye.camera);
                [camera, (at("detector"), <dyn Detector>::NAME, &mut eye.detector)]
            });
            let locator =
                sensor.locator.iter_mut().map(move |l| (format!("sensor[{i}].locator"), <dyn Locator>::NAME, l));
            eyes.chain(locator)
        });
        let bridges =
            self.bridge.iter_mut().enumerate().map(|(i, table)| (format!("bridge[{i}]"), <dyn Bridge>::NAME, table));
        robots.chain(sensors).chain(bridges).map(|(at, role, table)| {
            let kind = table.get("kind").and_then(Value::as_str).unwrap_or_default().to_owned();
            KindTable { at, role, kind, table }
        })
    }

    /// Makes paths that stand in included files relative to the main file, in the tables of all kinds.
    pub(super) fn relocate_kinds(&mut self, source: &Source) {
        for KindTable { at, role, kind, table } in self.kind_tables() {
            let relocate = |place: &str, path: &mut String| {
                *path =
                    source.relocated(&format!("{at}.{place}"), Path::new(path.as_str())).to_string_lossy().into_owned();
            };
            paths(role, &kind, table).for_each(|setting| relocate(&setting.place, setting.path));
            for (place, map) in maps(role, &kind, table) {
                if let Value::String(path) = map {
                    relocate(&place, path);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schemars::JsonSchema;
    use serde_json::json;
    use std::path::PathBuf;

    /// Settings as a crate of one's own may have them.
    #[derive(JsonSchema)]
    #[allow(dead_code, reason = "only the schema is used")]
    struct Weights {
        #[schemars(extend("format" = "path"))]
        weights: PathBuf,
        #[schemars(extend("format" = "path"))]
        cache: Option<PathBuf>,
        #[schemars(extend("format" = "path"))]
        shards: Vec<PathBuf>,
        layers: Vec<Layer>,
        source: Option<Source>,
    }

    #[derive(JsonSchema)]
    #[allow(dead_code, reason = "only the schema is used")]
    struct Layer {
        name: String,
        #[schemars(extend("format" = "path"))]
        table: PathBuf,
    }

    #[derive(JsonSchema)]
    #[serde(tag = "kind", rename_all = "snake_case")]
    #[allow(dead_code, reason = "only the schema is used")]
    enum Source {
        Url {
            address: String,
        },
        Disk {
            #[schemars(extend("format" = "path"))]
            folder: PathBuf,
        },
    }

    #[test]
    fn paths_are_found_by_their_schema_wherever_they_stand() {
        let schema = schemars::schema_for!(Weights).to_value();
        let mut table = json!({
            "weights": "a.bin", "cache": "c", "shards": ["s", "t"], "name": "no path", "layers": [{ "name": "x", "table": "t.csv" }, { "name": "y", "table": "u.csv" }],
            "source": { "kind": "disk", "folder": "d" },
        });
        let mut found = Vec::new();
        Search { root: &schema, formats: &[PATH, FOLDER] }.value(&schema, String::new(), &mut table, 0, &mut found);
        let mut found: Vec<(String, String)> =
            found.into_iter().flat_map(each).map(|(at, v)| (at, v.as_str().unwrap_or_default().to_owned())).collect();
        found.sort();
        let wanted = [
            ("cache", "c"),
            ("layers[0].table", "t.csv"),
            ("layers[1].table", "u.csv"),
            ("shards[0]", "s"),
            ("shards[1]", "t"),
            ("source.folder", "d"),
            ("weights", "a.bin"),
        ];
        assert_eq!(found, wanted.map(|(at, path)| (at.to_owned(), path.to_owned())));
    }

    /// A path that is not marked would be resolved against the working directory.
    #[test]
    fn no_setting_of_a_kind_is_a_path_without_a_mark() {
        let root = &Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let mut open: Vec<PathBuf> = ["behaviors", "drivers"].iter().map(|folder| root.join(folder)).collect();
        let mut found = 0;
        while let Some(path) = open.pop() {
            if let Ok(entries) = std::fs::read_dir(&path) {
                open.extend(entries.map(|entry| entry.expect("an entry").path()));
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap_or_default();
            if path.extension().is_none_or(|e| e != "rs") || !text.contains("JsonSchema") {
                continue;
            }
            let lines: Vec<&str> = text.lines().map(str::trim).collect();
            for (i, line) in lines.iter().enumerate().filter(|(_, line)| line.starts_with("pub ")) {
                let is_path = line.ends_with(": PathBuf,") || line.ends_with(": Option<PathBuf>,");
                // settings of `mobee roadmap build` are no kind's
                if is_path && !path.ends_with("table_map.rs") {
                    let attributes = lines[..i].iter().rev().take_while(|l| l.starts_with("#[") || l.starts_with("//"));
                    let marked = attributes.into_iter().any(|l| l.contains("\"format\" ="));
                    assert!(marked, "{}:{}: {line}", path.display(), i + 1);
                    found += 1;
                }
            }
        }
        assert!(found >= 9, "{found} settings are paths");
    }

    #[test]
    fn every_path_of_the_shipped_kinds_is_marked() {
        let places = |role: &str, kind: &str, mut table: Value| -> Vec<String> {
            paths(role, kind, &mut table).map(|setting| setting.place).collect()
        };
        assert_eq!(places("driver", "replay", json!({ "file": "a" })), ["file"]);
        assert_eq!(places("camera", "folder", json!({ "path": "a" })), ["path"]);
        assert_eq!(places("camera", "recorded", json!({ "run": "a" })), ["run"]);
        let scenery = json!({ "scenery": { "pictures": "p", "stickers": [{ "picture": "s" }] } });
        assert_eq!(places("camera", "simulated", scenery), ["scenery.pictures", "scenery.stickers[0].picture"]);
        assert_eq!(places("bridge", "yarp", json!({ "save_folder": "a" })), ["save_folder"]);
        for kind in ["color", "cgp", "onnx"] {
            assert_eq!(places("detector", kind, json!({ "file": "a" })), ["file"], "{kind}");
        }
        let mut table = json!({ "map": ["a.json", { "vertices": [] }] });
        let found: Vec<String> = maps("agent", "roadmap", &mut table).into_iter().map(|(at, _)| at).collect();
        assert_eq!(found, ["map[0]", "map[1]"]);
    }
}
