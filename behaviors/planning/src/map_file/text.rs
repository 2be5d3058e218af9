//! Writing a map: JSON, one vertex, edge or trial per line.

use super::{MapFile, StoredVerdict};
use serde::Serialize;
use std::fmt::Write;

/// Inverse of the resolution of written numbers: JSON parsers agree on this number of digits to the
/// last bit.
const STEPS_PER_UNIT: f64 = 1e9;

impl MapFile {
    /// Rounds all numbers as in files.
    pub(super) fn round(&mut self) {
        let round = |x: &mut f64| *x = (*x * STEPS_PER_UNIT).round() / STEPS_PER_UNIT + 0.0;
        for v in &mut self.vertices {
            v.q_rad.iter_mut().chain(&mut v.at_m).for_each(round);
        }
        for e in &mut self.edges {
            if let Some(StoredVerdict::Blocked { at, .. } | StoredVerdict::Uncertified { at }) = &mut e.verdict {
                round(at);
            }
        }
        self.certified.iter_mut().for_each(|c| round(&mut c.clearance_m));
    }

    /// Formats the map as the text of a file.
    pub fn text(&self) -> String {
        let mut map = self.clone();
        map.round();
        let mut out = String::from("{\n");
        line(&mut out, "version", &map.version);
        line(&mut out, "robot", &map.robot);
        for (key, value) in [("robot_sha256", &map.robot_sha256), ("world_sha256", &map.world_sha256)] {
            value.iter().for_each(|value| line(&mut out, key, value));
        }
        line(&mut out, "motors", &map.motors);
        map.hand.iter().for_each(|hand| line(&mut out, "hand", hand));
        map.certified.iter().for_each(|c| line(&mut out, "certified", c));
        list(&mut out, "vertices", &map.vertices);
        out += ",\n";
        list(&mut out, "edges", &map.edges);
        if !map.tried.is_empty() {
            out += ",\n";
            list(&mut out, "tried", &map.tried);
        }
        out += "\n}\n";
        out
    }
}

fn json(value: &impl Serialize) -> String {
    // These are plain structures: serialization can't fail.
    serde_json::to_string(value).unwrap_or_default()
}

fn line(out: &mut String, key: &str, value: &impl Serialize) {
    let _ = writeln!(out, "\"{key}\": {},", json(value));
}

fn list<T: Serialize>(out: &mut String, key: &str, all: &[T]) {
    let lines: Vec<String> = all.iter().map(|one| format!("  {}", json(one))).collect();
    let (open, close) = if lines.is_empty() { ("", "") } else { ("\n", "\n") };
    let _ = write!(out, "\"{key}\": [{open}{}{close}]", lines.join(",\n"));
}
