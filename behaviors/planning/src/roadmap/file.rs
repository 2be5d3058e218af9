//! A roadmap as a [`MapFile`] and as its JSON: the map that a run writes, and part of the state
//! that an agent passes to its successor.

use super::{Edge, Roadmap, Vertex};
use crate::map_file::{MapEdge, MapFile, MapVertex, VERSION, robot_digest};
use mobee_contract::{EdgeState, KindError};
use mobee_model::Robot;
use petgraph::stable_graph::NodeIndex;
use petgraph::visit::EdgeRef;
use serde_json::Value;

/// Properties of a map's file that no planner uses, stored for the next file.
#[derive(Clone, Debug, Default)]
pub(super) struct About {
    world_sha256: Option<String>,
    hand: Option<String>,
}

impl Roadmap {
    /// The marker at the positions of the vertices, if the file names it.
    pub fn hand(&self) -> Option<&str> {
        self.about.hand.as_deref()
    }

    /// Exports the roadmap as JSON: see [`Roadmap::file`].
    pub fn export(&self, robot: &Robot) -> Value {
        serde_json::to_value(self.file(robot)).unwrap_or(Value::Null)
    }

    /// Converts the roadmap to a map file. Certificates of edges are dropped: the environment may
    /// have changed since.
    pub fn file(&self, robot: &Robot) -> MapFile {
        let name = |m: &usize| robot.motors.get(*m).map(|m| m.name.clone()).unwrap_or_default();
        let vertex = |(id, v): (u32, &Vertex)| MapVertex { id, name: v.name.clone(), q_rad: v.q.clone(), at_m: v.at };
        MapFile {
            version: VERSION,
            robot: robot.name.clone(),
            robot_sha256: Some(robot_digest(robot)),
            world_sha256: self.about.world_sha256.clone(),
            motors: self.motors.iter().map(name).collect(),
            hand: self.about.hand.clone(),
            certified: None,
            vertices: self.vertices().map(vertex).collect(),
            edges: self.edges_in_file_order(),
            tried: self.tried.clone(),
        }
    }

    /// Returns the edges in an order such that adding them one by one rebuilds every vertex's list
    /// of edges in the same order. Among paths of equal cost, the same one is then chosen.
    fn edges_in_file_order(&self) -> Vec<MapEdge> {
        let file = |from: u32, to: u32, e: &Edge| MapEdge {
            from,
            to,
            state: e.state,
            driven: e.driven,
            cause: e.cause.clone(),
            verdict: None,
        };
        let mut all = Vec::new();
        for id in 0..self.len() as u32 {
            let mut out: Vec<_> = self.graph.edges(NodeIndex::new(id as usize)).collect();
            out.reverse();
            all.extend(out.into_iter().map(|e| file(id, e.target().index() as u32, e.weight())));
            // Blocked edges depend on the world; the reader of the map determines them again.
            all.extend(self.blocked_out(id).map(|(to, e)| file(id, to, &e)));
        }
        let removed = self.ledger.iter().filter(|(_, e)| e.state == EdgeState::Removed);
        all.extend(removed.map(|((a, b), e)| file(*a, *b, e)));
        all
    }

    /// Reads a roadmap for this robot.
    ///
    /// # Errors
    /// As for [`MapFile::from_value`] and [`MapFile::check`], with the place within the value.
    pub fn import(value: &Value, robot: &Robot) -> Result<Roadmap, KindError> {
        Roadmap::of_file(&MapFile::from_value(value)?, robot)
    }

    /// Creates the roadmap of a map file.
    ///
    /// # Errors
    /// As for [`MapFile::check`].
    pub fn of_file(file: &MapFile, robot: &Robot) -> Result<Roadmap, KindError> {
        file.check(robot)?;
        let motors = file.motors.iter().filter_map(|name| robot.motor_index(name)).collect();
        let mut map = Roadmap::new(motors, robot);
        map.about = About { world_sha256: file.world_sha256.clone(), hand: file.hand.clone() };
        map.tried.clone_from(&file.tried);
        for v in &file.vertices {
            map.add(Vertex { name: v.name.clone(), q: v.q_rad.clone(), at: v.at_m });
        }
        for e in &file.edges {
            map.restore(e.from, e.to, Edge { state: e.state, driven: e.driven, cause: e.cause.clone() });
        }
        Ok(map)
    }

    /// Adds an edge between two of the vertices in its former state.
    pub(super) fn restore(&mut self, from: u32, to: u32, edge: Edge) {
        if self.vertex(from).is_none() || self.vertex(to).is_none() {
            return;
        }
        let edge = if edge.state == EdgeState::Blocked { Edge::NEW } else { edge };
        self.note(from, to, &edge);
        if edge.state == EdgeState::Removed {
            self.ledger.insert((from, to), edge);
        } else {
            self.link(from, to, edge);
        }
    }
}
