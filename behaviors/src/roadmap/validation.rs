//! Validation modes: whether a roadmap's edges are driven to find out, or certified in the model first.
//!
//! | mode | certified | when |
//! |---|---|---|
//! | `optimistic` | nothing: edges are learned by driving them (the paper) | |
//! | `lazy` | the edges of a path | before it is driven; one that is blocked is taken out, and another path planned |
//! | `verified` | all edges | before anything is planned |
//!
//! Whoever drives to find out can learn more of a failure than one edge ([`Validator::blaming`]): what was in the way is minded from then
//! on, and edges that the model has in the way of that are driven no more. A map of thousands of poses has more edges at one obstacle than
//! anybody wants to bump into, and every one of them would teach the same.
//!
//! In the last two modes, an edge that failed when driven is tried again once an object that was in its way has changed (I11). What
//! is certified is the model's world, with the view's clearance; the reflex is on in every mode.

use super::Roadmap;
use super::validity::{EdgeEnds, Validity, edge_between};
use mobee_contract::{EdgeState, View};
use mobee_fast::EdgeVerdict;
use mobee_model::{Pair, Scene, ShapeId};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// What is certified before a roadmap's edges are driven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Validation {
    /// Nothing: every edge is taken for feasible until it fails.
    #[default]
    Optimistic,
    /// The edges of a path, before it is driven.
    Lazy,
    /// The whole map, before anything is planned.
    Verified,
}

/// Edges that are certified at once, where a path has fewer that are not known: three blocks of lanes of `mobee-fast`.
const AT_ONCE: usize = 48;

/// A directed edge that failed when driven, and what was in its way: part of an agent's state.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailedEdge {
    /// From vertex.
    pub from: u32,
    /// To vertex.
    pub to: u32,
    /// The objects that were in the way, by their numbers in the scene; none: nobody knows, or it was no object.
    pub by: BTreeSet<u32>,
}

/// What was in the way of edges that failed: part of an agent's state.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Blame {
    /// Objects, by their numbers in the scene.
    pub objects: BTreeSet<u32>,
    /// Whether the robot was in its own way.
    pub itself: bool,
}

impl Blame {
    /// Whether nothing was.
    pub fn is_nobody(&self) -> bool {
        *self == Blame::default()
    }
}

/// Keeps a roadmap true to the world, as far as its mode says.
pub struct Validator {
    mode: Validation,
    /// Whether what was in the way is minded where nothing is certified.
    blames: bool,
    blame: Blame,
    validity: Validity,
    /// Directed edges that failed when driven, and the objects that were in their way.
    failed: BTreeMap<(u32, u32), BTreeSet<u32>>,
    /// Edges of the map when all of them were last certified.
    certified: usize,
}

impl Validator {
    /// For a map of these motors.
    pub fn new(mode: Validation, motors: &[usize]) -> Validator {
        let (validity, failed, blame) = (Validity::new(motors), BTreeMap::new(), Blame::default());
        Validator { mode, blames: false, blame, validity, failed, certified: 0 }
    }

    /// The same; where nothing is certified, what was in the way of an edge that failed is minded from then on.
    pub fn blaming(mut self) -> Validator {
        self.blames = true;
        self
    }

    /// Whether it certifies anything.
    pub fn certifies(&self) -> bool {
        self.mode != Validation::Optimistic
    }

    /// The mode, for another map: nothing is known of that one.
    pub fn renewed(&self, map: &Roadmap) -> Validator {
        Validator { blames: self.blames, ..Validator::new(self.mode, map.motors()) }
    }

    /// Whether any edge is judged by the model.
    fn judges(&self) -> bool {
        self.certifies() || !self.blame.is_nobody()
    }

    /// What is known of an edge, as far as it counts: where nothing is certified, only what is blamed can be in the way.
    fn verdict(&self, edge: (u32, u32)) -> Option<EdgeVerdict> {
        let known = self.validity.verdict(edge)?;
        let mut by = self.validity.blocked_by(edge).peekable();
        let counts = self.certifies()
            || if by.peek().is_some() { by.any(|o| self.blame.objects.contains(&o)) } else { self.blame.itself };
        Some(if counts { *known } else { EdgeVerdict::Free })
    }

    /// Brings the map up to date with the world: edges that an object blocks leave it, those that none blocks any more return.
    /// Answers how many undirected edges did the one and the other.
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

    /// Whether all edges of a path are certified to be free, or nothing has to be. Those that are not leave the map.
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
                // nobody could be asked: it must leave the map all the same, or it is planned over for ever
                None => {
                    map.block(a, b, None);
                    map.block(b, a, None);
                }
            }
            all_free &= self.verdict((a, b)) == Some(EdgeVerdict::Free);
        }
        all_free
    }

    /// Certifies the edges of a path that are not known yet. Where everything driven has to be certified, others that leave the path
    /// are with them: the next path, should this one not hold, is likely to take some of them, and many at once cost little more than few.
    fn certify_around(&mut self, map: &mut Roadmap, path: &[u32], edges: &[EdgeEnds], scene: &Scene) {
        let is_new = |edge: &EdgeEnds| self.validity.verdict(*edge).is_none();
        let mut due: BTreeSet<_> = edges.iter().copied().filter(is_new).collect();
        if due.is_empty() {
            return;
        }
        let around = path.iter().flat_map(|from| map.links.out(*from).map(|to| edge_between(*from, to)));
        let most = if self.certifies() { AT_ONCE } else { 0 };
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

    /// An edge failed when driven: remembers the objects that the view, or the model, has in its way.
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

    /// The edges that failed, each with what must change before it is tried again.
    pub fn causes(&self) -> Vec<FailedEdge> {
        self.failed.iter().map(|((from, to), by)| FailedEdge { from: *from, to: *to, by: by.clone() }).collect()
    }

    /// Takes over what a predecessor knew of the edges that failed.
    pub fn remember(&mut self, causes: &[FailedEdge]) {
        self.failed.extend(causes.iter().map(|f| ((f.from, f.to), f.by.clone())));
    }

    /// What was in the way of edges that failed, where nothing is certified.
    pub fn blame(&self) -> &Blame {
        &self.blame
    }

    /// Takes over what a predecessor blamed.
    pub fn take_blame(&mut self, blame: &Blame) {
        self.blame.clone_from(blame);
    }

    /// A vertex is another one now: nothing is known of its edges.
    pub fn forget(&mut self, vertex: u32) {
        self.failed.retain(|(from, to), _| *from != vertex && *to != vertex);
        self.validity.forget_edges();
        self.certified = 0;
    }

    /// What is known of the edges.
    pub fn validity(&self) -> &Validity {
        &self.validity
    }

    /// Lets both directions of an edge be what its verdict says.
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

/// How many undirected edges changed with the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EdgeChange {
    /// Blocked now, and not before.
    pub blocked: usize,
    /// Not blocked any more.
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

/// What stands in the way, in words.
fn words(verdict: &EdgeVerdict, scene: &Scene) -> String {
    match verdict {
        EdgeVerdict::Free => "nothing".to_owned(),
        EdgeVerdict::Blocked(found) => {
            let who = found.pair.map(|(a, b)| format!("{} and {}", scene.shape_name(a), scene.shape_name(b)));
            let who = who.unwrap_or_else(|| "a limit or constraint".to_owned());
            format!("{who} at {:.0} % of the way", 100.0 * found.at)
        }
        EdgeVerdict::Uncertified { at } => format!("too near to tell at {:.0} % of the way", 100.0 * at),
    }
}
