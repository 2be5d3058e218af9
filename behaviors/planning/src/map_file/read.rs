//! Reading a map: it is accepted completely, or rejected with the place of the error and a remedy.

use super::place;
use super::{MapFile, MapVertex, StoredVerdict, VERSION, robot_digest};
use mobee_contract::{KindError, settings};
use mobee_model::Robot;
use serde_json::Value;
use std::collections::BTreeSet;
use std::ops::Range;

const HELP: &str = "give a map as `mobee roadmap build`, `mobee roadmap merge` or `mobee run` wrote it, unchanged";

/// Reason why a text is rejected as a map.
#[derive(Clone, Debug, PartialEq)]
pub struct MapFault {
    /// Place in the text, in bytes.
    pub span: Range<usize>,
    /// Problem.
    pub what: String,
    /// Remedy.
    pub help: String,
}

impl MapFile {
    /// Reads a map file. Numbers are rounded to 1e-9, as in files.
    ///
    /// # Errors
    /// Text that is not JSON, another version, or inconsistent contents, with the place.
    pub fn parse(text: &str) -> Result<MapFile, MapFault> {
        let value: Value = serde_json::from_str(text).map_err(|e| {
            let at = place::byte(text, e.line(), e.column());
            let torn = e.is_eof();
            let what = if torn { "the file ends in the middle".to_owned() } else { format!("this is no JSON: {e}") };
            let help = if torn {
                "it is torn: build or merge it again; what was being built is beside it, in a file .part"
            } else {
                HELP
            };
            MapFault { span: at..at, what, help: help.to_owned() }
        })?;
        let mut map = MapFile::from_value(&value).map_err(|e| MapFault {
            span: place::span(text, &e.path),
            what: if e.path.is_empty() { e.what } else { format!("{}: {}", e.path, e.what) },
            help: e.help,
        })?;
        map.round();
        Ok(map)
    }

    /// Reads a map from JSON, and checks everything that can be checked without its robot.
    ///
    /// # Errors
    /// Another version, vertices out of order or of different lengths, edges between missing
    /// vertices, and duplicates, with the place within the value.
    pub fn from_value(value: &Value) -> Result<MapFile, KindError> {
        let version = value.get("version").and_then(Value::as_u64);
        match version {
            Some(v) if v > u64::from(VERSION) => {
                let what = format!("the map has version {v}; this program reads versions up to {VERSION}");
                return Err(KindError::new("version", what, "use the `mobee run` or `mobee roadmap` that wrote it"));
            }
            Some(1..) => {}
            _ => {
                let found = version.map_or("none".to_owned(), |v| v.to_string());
                return Err(bad("version", format!("a map of version 1 to {VERSION} was expected, found {found}")));
            }
        }
        let map: MapFile = settings(value).map_err(|e| bad(e.path, e.what))?;
        map.coherent()?;
        Ok(map)
    }

    fn coherent(&self) -> Result<(), KindError> {
        for (i, name) in self.motors.iter().enumerate() {
            if self.motors.iter().take(i).any(|m| m == name) {
                return Err(bad(format!("motors[{i}]"), format!("motor {name:?} is named twice")));
            }
        }
        let motors = self.vertices.first().map_or(0, |v| v.q_rad.len());
        for (i, v) in self.vertices.iter().enumerate() {
            vertex(&format!("vertices[{i}]"), i, v, motors)?;
        }
        let known = |id: u32| (id as usize) < self.vertices.len();
        let mut seen = BTreeSet::new();
        for (i, e) in self.edges.iter().enumerate() {
            let place = |end: &str| format!("edges[{i}].{end}");
            for (end, id) in [("from", e.from), ("to", e.to)] {
                if !known(id) {
                    return Err(bad(place(end), format!("there is no vertex {id}")));
                }
            }
            if e.from == e.to || !seen.insert((e.from, e.to)) {
                return Err(bad(place("to"), "an edge joins two different vertices, once per direction".to_owned()));
            }
            match &e.verdict {
                Some(_) if self.certified.is_none() => {
                    let what = "there is a verdict, but `certified` with its clearance and world is missing".to_owned();
                    return Err(bad(place("verdict"), what));
                }
                Some(StoredVerdict::Blocked { at, .. } | StoredVerdict::Uncertified { at })
                    if !(0.0..=1.0).contains(at) =>
                {
                    return Err(bad(place("verdict"), format!("{at} is not a share of the edge, from 0 to 1")));
                }
                _ => {}
            }
        }
        for (i, t) in self.tried.iter().enumerate() {
            for (end, id) in [("from", t.from), ("to", t.to)] {
                if !known(id) {
                    return Err(bad(format!("tried[{i}].{end}"), format!("there is no vertex {id}")));
                }
            }
        }
        Ok(())
    }

    /// Checks that the map belongs to this robot.
    ///
    /// # Errors
    /// Another robot, a model that has changed since, missing motors, and poses of another length
    /// or outside the limits, with the place within the map.
    pub fn check(&self, robot: &Robot) -> Result<(), KindError> {
        let digest = robot_digest(robot);
        if let Some(known) = self.robot_sha256.as_ref().filter(|known| **known != digest) {
            let short = |digest: &str| digest.chars().take(12).collect::<String>();
            let known = short(known);
            let digest = short(&digest);
            let (what, help) = if self.robot == robot.name {
                let what = format!(
                    "the model of {} has changed since the map was made ({known}, now {digest}): its shapes, joints or limits",
                    robot.name
                );
                (what, "build the map anew with `mobee roadmap build`, or give the robot file that it was made for")
            } else {
                let what = format!("the map is one of the robot {}, not of {}", self.robot, robot.name);
                (what, "give a map of this robot, or the robot file that the map was made for")
            };
            return Err(KindError::new("robot_sha256", what, help));
        }
        for (i, name) in self.motors.iter().enumerate() {
            if robot.motor_index(name).is_none() {
                return Err(bad(format!("motors[{i}]"), format!("the robot {} has no motor {name:?}", robot.name)));
            }
        }
        for (i, v) in self.vertices.iter().enumerate() {
            if v.q_rad.len() != robot.motors.len() {
                let what =
                    format!("{} positions for the {} motors of {}", v.q_rad.len(), robot.motors.len(), robot.name);
                return Err(bad(format!("vertices[{i}].q_rad"), what));
            }
            for (j, (q, m)) in v.q_rad.iter().zip(&robot.motors).enumerate() {
                if !(*q >= m.min - 1e-6 && *q <= m.max + 1e-6) {
                    let limits = format!("{:.4} to {:.4} rad", m.min, m.max);
                    let what = format!("{q} rad is outside the limits of {}, {limits}", m.name);
                    return Err(bad(format!("vertices[{i}].q_rad[{j}]"), what));
                }
            }
        }
        Ok(())
    }
}

fn vertex(place: &str, i: usize, v: &MapVertex, motors: usize) -> Result<(), KindError> {
    if v.id as usize != i {
        return Err(bad(format!("{place}.id"), format!("vertices are numbered in order: {i} was expected")));
    }
    if v.q_rad.len() != motors {
        let what = format!("{} positions, where the first vertex has {motors}", v.q_rad.len());
        return Err(bad(format!("{place}.q_rad"), what));
    }
    if let Some(j) = v.q_rad.iter().position(|q| !q.is_finite()) {
        return Err(bad(format!("{place}.q_rad[{j}]"), "a position is a finite number".to_owned()));
    }
    if v.at_m.iter().any(|c| !c.is_finite()) {
        return Err(bad(format!("{place}.at_m"), "a position is three finite numbers".to_owned()));
    }
    Ok(())
}

fn bad(path: impl Into<String>, what: String) -> KindError {
    KindError::new(path, what, HELP)
}
