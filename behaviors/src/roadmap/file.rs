//! A roadmap as JSON: the roadmap file of a run, and the part of an agent's state that a successor takes over.

use super::{Edge, Roadmap, Vertex};
use mobee_contract::{EdgeState, KindError, settings};
use mobee_model::Robot;
use petgraph::stable_graph::NodeIndex;
use petgraph::visit::EdgeRef;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeSet;

/// The version of the layout.
pub const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: u32,
    robot: String,
    /// The group, by motor name.
    motors: Vec<String>,
    vertices: Vec<FileVertex>,
    edges: Vec<FileEdge>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileVertex {
    id: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    q_rad: Vec<f64>,
    at_m: [f64; 3],
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileEdge {
    from: u32,
    to: u32,
    state: EdgeState,
    #[serde(default)]
    driven: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    cause: Option<String>,
}

impl Roadmap {
    /// The roadmap as JSON, version [`VERSION`]: whole poses in rad, hand positions in meters.
    pub fn export(&self, robot: &Robot) -> Value {
        let name = |m: &usize| robot.motors.get(*m).map(|m| m.name.clone()).unwrap_or_default();
        let vertices = self
            .vertices()
            .map(|(id, v)| FileVertex { id, name: v.name.clone(), q_rad: v.q.clone(), at_m: v.at })
            .collect();
        let file = File {
            version: VERSION,
            robot: robot.name.clone(),
            motors: self.motors.iter().map(name).collect(),
            vertices,
            edges: self.edges_in_file_order(),
        };
        serde_json::to_value(file).unwrap_or(Value::Null)
    }

    /// Edges such that adding them one by one rebuilds every vertex's list of edges in the same order: ways of equal
    /// cost are then chosen as before.
    fn edges_in_file_order(&self) -> Vec<FileEdge> {
        let file = |from: u32, to: u32, e: &Edge| FileEdge {
            from,
            to,
            state: e.state,
            driven: e.driven,
            cause: e.cause.clone(),
        };
        let mut all = Vec::new();
        for id in 0..self.len() as u32 {
            let mut out: Vec<_> = self.graph.edges(NodeIndex::new(id as usize)).collect();
            out.reverse();
            all.extend(out.into_iter().map(|e| file(id, e.target().index() as u32, e.weight())));
            // what blocks an edge is the world's matter: whoever takes the map up finds it out anew
            all.extend(self.blocked_out(id).map(|(to, e)| file(id, to, &e)));
        }
        let removed = self.ledger.iter().filter(|(_, e)| e.state == EdgeState::Removed);
        all.extend(removed.map(|((a, b), e)| file(*a, *b, e)));
        all
    }

    /// Reads a roadmap for this robot.
    ///
    /// # Errors
    /// Another version, motors that the robot has not, poses outside its limits or of another length, edges between
    /// vertices that are not there, anything given twice: with the place within the value.
    pub fn import(value: &Value, robot: &Robot) -> Result<Roadmap, KindError> {
        let version = value.get("version").and_then(Value::as_u64);
        if version != Some(u64::from(VERSION)) {
            let found = version.map_or("none".to_owned(), |v| v.to_string());
            return Err(bad("version", format!("a roadmap of version {VERSION} was expected, found {found}")));
        }
        let file: File = settings(value).map_err(|e| bad(e.path, e.what))?;
        let mut motors = Vec::new();
        for (i, name) in file.motors.iter().enumerate() {
            let motor = robot.motors.iter().position(|m| m.name == *name);
            let motor = motor.ok_or_else(|| {
                bad(format!("motors[{i}]"), format!("the robot {} has no motor {name:?}", robot.name))
            })?;
            if motors.contains(&motor) {
                return Err(bad(format!("motors[{i}]"), format!("motor {name:?} is named twice")));
            }
            motors.push(motor);
        }
        let mut map = Roadmap::new(motors, robot);
        for (i, v) in file.vertices.into_iter().enumerate() {
            check_vertex(&format!("vertices[{i}]"), i, &v, robot)?;
            map.add(Vertex { name: v.name, q: v.q_rad, at: v.at_m });
        }
        let mut seen = BTreeSet::new();
        for (i, e) in file.edges.into_iter().enumerate() {
            let place = |end: &str| format!("edges[{i}].{end}");
            for (end, id) in [("from", e.from), ("to", e.to)] {
                if map.vertex(id).is_none() {
                    return Err(bad(place(end), format!("there is no vertex {id}")));
                }
            }
            if e.from == e.to || !seen.insert((e.from, e.to)) {
                return Err(bad(place("to"), "an edge joins two different vertices, once per direction".to_owned()));
            }
            map.restore(e.from, e.to, Edge { state: e.state, driven: e.driven, cause: e.cause });
        }
        Ok(map)
    }

    /// Adds an edge between two of the vertices as it was.
    pub(super) fn restore(&mut self, from: u32, to: u32, edge: Edge) {
        if self.vertex(from).is_none() || self.vertex(to).is_none() {
            return;
        }
        let edge = if edge.state == EdgeState::Blocked { Edge { state: EdgeState::Optimistic, ..edge } } else { edge };
        self.note(from, to, &edge);
        if edge.state == EdgeState::Removed {
            self.ledger.insert((from, to), edge);
        } else {
            self.graph.add_edge(NodeIndex::new(from as usize), NodeIndex::new(to as usize), edge);
        }
    }
}

fn check_vertex(place: &str, i: usize, v: &FileVertex, robot: &Robot) -> Result<(), KindError> {
    if v.id as usize != i {
        return Err(bad(format!("{place}.id"), format!("vertices are numbered in order: {i} was expected")));
    }
    if v.q_rad.len() != robot.motors.len() {
        let what = format!("{} positions for the {} motors of {}", v.q_rad.len(), robot.motors.len(), robot.name);
        return Err(bad(format!("{place}.q_rad"), what));
    }
    for (j, (q, m)) in v.q_rad.iter().zip(&robot.motors).enumerate() {
        if !(*q >= m.min - 1e-6 && *q <= m.max + 1e-6) {
            let limits = format!("{:.4} to {:.4} rad", m.min, m.max);
            let what = format!("{q} rad is outside the limits of {}, {limits}", m.name);
            return Err(bad(format!("{place}.q_rad[{j}]"), what));
        }
    }
    if v.at_m.iter().any(|c| !c.is_finite()) {
        return Err(bad(format!("{place}.at_m"), "a position is three finite numbers".to_owned()));
    }
    Ok(())
}

fn bad(path: impl Into<String>, what: String) -> KindError {
    KindError::new(path, what, "give a roadmap that `mobee run` wrote for this robot, unchanged, or none")
}
