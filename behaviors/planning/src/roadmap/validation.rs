//! Validation modes: edges of a roadmap are either tried by driving them, or certified in the model
//! first.
//!
//! | mode | certified | when |
//! |---|---|---|
//! | `optimistic` | nothing: edges are confirmed by driving them (the paper) | |
//! | `lazy` | the edges of a path | before it is driven; one that is blocked is removed, and another path is planned |
//! | `verified` | all edges | before anything is planned |
//!
//! Without certification, a failure can exclude more than one edge ([`Validator::blaming`]): from
//! then on, the obstacle is checked, and edges that it blocks in the model are no longer driven. A
//! map of thousands of poses has many edges at one obstacle, and driving each of them into it would
//! gain nothing.
//!
//! In the last two modes, an edge that failed when driven is tried again once an object that was in
//! its way has changed (I11). Edges are certified in the model's world, with the view's clearance;
//! the reflex is active in every mode.

use super::Roadmap;
use super::validity::{EdgeEnds, Validity, edge_between};
use mobee_contract::{EdgeState, View};
use mobee_fast::EdgeVerdict;
use mobee_model::{Pair, Scene, ShapeId};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Extent of the certification before edges of a roadmap are driven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Validation {
    /// No certification: every edge is assumed to be feasible until it fails.
    #[default]
    Optimistic,
    /// The edges of a path, before it is driven.
    Lazy,
    /// The whole map, before anything is planned.
    Verified,
}

/// Number of edges certified at once, also if fewer edges of a path are due: three blocks of lanes
/// of `mobee-fast`.
const MIN_BATCH: usize = 48;

/// A directed edge that failed when driven, and its obstacles: part of an agent's state.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailedEdge {
    /// From vertex.
    pub from: u32,
    /// To vertex.
    pub to: u32,
    /// Objects in its way, by their numbers in the scene; empty: unknown, or not an object.
    pub by: BTreeSet<u32>,
}

/// Obstacles of the edges that failed: part of an agent's state.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Blame {
    /// Objects, by their numbers in the scene.
    pub objects: BTreeSet<u32>,
    /// The robot collided with itself.
    pub itself: bool,
}

impl Blame {
    /// Returns whether there are no obstacles.
    pub fn is_empty(&self) -> bool {
        *self == Blame::default()
    }
}

/// Keeps a roadmap consistent with the world, as far as its mode requires.
pub struct Validator {
    mode: Validation,
    /// Check the obstacles of failed edges even if nothing is certified.
    blames: bool,
    blame: Blame,
    validity: Validity,
    /// Directed edges that failed when driven, and the objects that were in their way.
    failed: BTreeMap<(u32, u32), BTreeSet<u32>>,
    /// Number of edges of the map when all of them were last certified.
    certified: usize,
}

impl Validator {
    /// Creates a validator for a map of these motors.
    pub fn new(mode: Validation, motors: &[usize]) -> Validator {
        let validity = Validity::new(motors);
        let failed = BTreeMap::new();
        let blame = Blame::default();
        Validator { mode, blames: false, blame, validity, failed, certified: 0 }
    }

    /// Makes it check the obstacles of failed edges even if nothing is certified.
    pub fn blaming(mut self) -> Validator {
        self.blames = true;
        self
    }

    /// Returns whether it certifies edges.
    pub fn certifies(&self) -> bool {
        self.mode != Validation::Optimistic
    }

    /// Creates a validator of the same mode for another map, without any verdicts.
    pub fn renewed(&self, map: &Roadmap) -> Validator {
        Validator { blames: self.blames, ..Validator::new(self.mode, map.motors()) }
    }

    /// Returns whether edges are checked in the model.
    fn judges(&self) -> bool {
        self.certifies() || !self.blame.is_empty()
    }

    /// Returns the applicable verdict of an edge: without certification, only blamed obstacles can
    /// block it.
    fn verdict(&self, edge: (u32, u32)) -> Option<EdgeVerdict> {
        let known = self.validity.verdict(edge)?;
        let mut by = self.validity.blocked_by(edge).peekable();
        let counts = self.certifies()
            || if by.peek().is_some() { by.any(|o| self.blame.objects.contains(&o)) } else { self.blame.itself };
        Some(if counts { *known } else { EdgeVerdict::Free })
    }

    /// Updates the map to the world: edges that an object blocks leave it, those that no object
    /// blocks any longer return. Returns the numbers of undirected edges that did.
    pub fn look(&mut self, map: &mut Roadmap, view: &View) -> EdgeChange {
        let mut change = EdgeChange::default();
        if !self.judges() {
            return change;
        }
        let news = self.validity.look(view);
        let again: Vec<_> =
            self.failed.iter().filter(|(_, by)| !by.is_disjoint(&news.objects)).map(|(edge, _)| *edge).collect();
        for (from, to) in &again {
            self.failed.remove(&(*from, *to));
            map.readmit(*from, *to);
        }
        let mut due: BTreeSet<_> =
            news.edges.into_iter().chain(again.iter().map(|(a, b)| edge_between(*a, *b))).collect();
        let count = map.edge_count();
        if self.mode == Validation::Verified && (news.forgotten || count != self.certified) {
            self.certified = count;
            due.extend(map.edges().iter().map(|(a, b, _)| edge_between(*a, *b)));
            self.validity.certify(map, due.iter().copied());
        } else if news.forgotten {
            let blocked = map.edges().into_iter().filter(|(.., e)| e.state == EdgeState::Blocked);
            due.extend(blocked.map(|(a, b, _)| edge_between(a, b)));
        }
        for edge in due {
            change.count(self.apply(map, edge, &view.scene));
        }
        change
    }

    /// Returns whether all edges of a path are certified free, or need not be. Edges that are not
    /// free leave the map.
    pub fn admits(&mut self, map: &mut Roadmap, path: &[u32], view: &View) -> bool {
        if !self.judges() {
            return true;
        }
        let edges: Vec<_> = path.iter().zip(path.iter().skip(1)).map(|(a, b)| edge_between(*a, *b)).collect();
        self.certify_around(map, path, &edges, &view.scene);
        let mut all_free = true;
        for (a, b) in edges {
            match self.verdict((a, b)) {
                Some(EdgeVerdict::Free) => {}
                Some(_) => {
                    self.apply(map, (a, b), &view.scene);
                }
                // Without a verdict, the edge must leave the map as well, or it would be planned
                // over forever.
                None => {
                    map.block(a, b, None);
                    map.block(b, a, None);
                }
            }
            all_free &= self.verdict((a, b)) == Some(EdgeVerdict::Free);
        }
        all_free
    }

    /// Certifies the edges of a path that have no verdict yet. If every driven edge must be
    /// certified, it includes other edges that leave the path: an alternative path is likely to
    /// need some of them, and many at once cost little more than few.
    fn certify_around(&mut self, map: &mut Roadmap, path: &[u32], edges: &[EdgeEnds], scene: &Scene) {
        let is_new = |edge: &EdgeEnds| self.validity.verdict(*edge).is_none();
        let mut due: BTreeSet<_> = edges.iter().copied().filter(is_new).collect();
        if due.is_empty() {
            return;
        }
        let around = path.iter().flat_map(|from| map.links.out(*from).map(|to| edge_between(*from, to)));
        let most = if self.certifies() { MIN_BATCH } else { 0 };
        for edge in around.filter(is_new) {
            if due.len() >= most {
                break;
            }
            due.insert(edge);
        }
        self.validity.certify(map, due.iter().copied());
        for edge in due {
            self.apply(map, edge, scene);
        }
    }

    /// Records that an edge failed when driven, with the objects in its way by the view or the
    /// model.
    pub fn failed(&mut self, from: u32, to: u32, view: &View) {
        let object = |(a, b): Pair| [a, b].into_iter().find_map(object_of);
        let own = view.contacts.iter().filter(|c| crate::group::involves(view.robot, c));
        if self.blames && !self.certifies() {
            for contact in own {
                match object(contact.pair) {
                    Some(object) => drop(self.blame.objects.insert(object)),
                    None => self.blame.itself = true,
                }
            }
            self.validity.look(view);
        } else if self.certifies() {
            let touched = own.filter_map(|c| object(c.pair));
            let by = touched.chain(self.validity.blocked_by(edge_between(from, to))).collect();
            self.failed.insert((from, to), by);
        }
    }

    /// Returns the edges that failed, each with the objects that must change before it is tried
    /// again.
    pub fn causes(&self) -> Vec<FailedEdge> {
        self.failed.iter().map(|((from, to), by)| FailedEdge { from: *from, to: *to, by: by.clone() }).collect()
    }

    /// Restores a predecessor's failed edges.
    pub fn remember(&mut self, causes: &[FailedEdge]) {
        self.failed.extend(causes.iter().map(|f| ((f.from, f.to), f.by.clone())));
    }

    /// Obstacles of the edges that failed, if nothing is certified.
    pub fn blame(&self) -> &Blame {
        &self.blame
    }

    /// Restores a predecessor's obstacles.
    pub fn take_blame(&mut self, blame: &Blame) {
        self.blame.clone_from(blame);
    }

    /// Discards all verdicts of edges, because a vertex was replaced.
    pub fn forget(&mut self, vertex: u32) {
        self.failed.retain(|(from, to), _| *from != vertex && *to != vertex);
        self.validity.forget_edges();
        self.certified = 0;
    }

    /// Verdicts of the edges.
    pub fn validity(&self) -> &Validity {
        &self.validity
    }

    /// Applies the verdict of an edge to both of its directions.
    fn apply(&self, map: &mut Roadmap, (a, b): (u32, u32), scene: &Scene) -> Option<bool> {
        let both = [(a, b), (b, a)];
        match self.verdict((a, b)) {
            None | Some(EdgeVerdict::Free) => {
                both.map(|(from, to)| map.unblock(from, to)).contains(&true).then_some(false)
            }
            Some(verdict) => {
                let cause = words(&verdict, scene);
                both.map(|(from, to)| map.block(from, to, Some(cause.clone()))).contains(&true).then_some(true)
            }
        }
    }
}

/// Numbers of undirected edges that changed with the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EdgeChange {
    /// Newly blocked edges.
    pub blocked: usize,
    /// Edges that are no longer blocked.
    pub freed: usize,
}

impl EdgeChange {
    fn count(&mut self, blocked: Option<bool>) {
        self.blocked += usize::from(blocked == Some(true));
        self.freed += usize::from(blocked == Some(false));
    }
}

fn object_of(shape: ShapeId) -> Option<u32> {
    match shape {
        ShapeId::Object { object, .. } => Some(object),
        ShapeId::Robot { .. } => None,
    }
}

/// Describes the obstacle.
fn words(verdict: &EdgeVerdict, scene: &Scene) -> String {
    match verdict {
        EdgeVerdict::Free => "nothing".to_owned(),
        EdgeVerdict::Blocked(found) => {
            let obstacle = found.pair.map(|(a, b)| format!("{} and {}", scene.shape_name(a), scene.shape_name(b)));
            let obstacle = obstacle.unwrap_or_else(|| "a limit or constraint".to_owned());
            format!("{obstacle} at {:.0} % of the way", 100.0 * found.at)
        }
        EdgeVerdict::Uncertified { at } => format!("too close to certify at {:.0} % of the way", 100.0 * at),
    }
}
