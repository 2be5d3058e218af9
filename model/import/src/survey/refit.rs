//! Fits shapes closer where they have false contacts, and only there.
//!
//! ```text
//! random poses ──> those at which shapes touch and meshes do not ──> points inside both shapes
//!       ^                                                                       │
//!       └──── shapes that contain most of them are refitted, as one or two <────┘
//! ```
//! `false_contacts.rs` finds the poses, `fault_assignment.rs` assigns the points to shapes. If this does not reach the goal
//! ([`RefitLimits::hulls`]), the shapes get hulls (`refit_hulls.rs`).

use super::false_contacts::{FalseContacts, NodePair, find_false_contacts};
use super::{PlacedShapes, Subject};
use crate::{Fit, FitOptions, LinkSurface, Surfaces};
use mobee_model::MAX_PAIRS;
use mobee_model::{Robot, SceneError};
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of shapes refitted before the contacts are evaluated again.
const SHAPES_PER_ROUND: usize = 32;
/// A shape is refitted in a round if its number of poses with false contacts is at least this share of the worst one's.
const MIN_SHARE_OF_WORST: f64 = 0.25;
/// Options for refitting links whose pairs would otherwise be disabled.
const CLOSE_FIT: FitOptions = FitOptions { overshoot: 0.003, primitives: 40 };
/// Hulls are used if they leave less than this share of the poses that remain without hulls.
const MAX_REMAINING_WITH_HULLS: f64 = 0.9;
/// Doubling the number of pairs of shapes is worthwhile if it leaves less than this share of the poses.
const MAX_REMAINING_PER_DOUBLING: f64 = 0.9;
/// Number of pairs of shapes from which hulls are tried before further shapes: hulls are then cheaper, for the fit and
/// for the robot.
const PAIRS_BEFORE_HULLS: usize = 20_000;

/// Goal and limits of fitting closer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefitLimits {
    /// Goal: share of the mesh-free poses with false contacts, 0 to 1.
    pub falsely: f64,
    /// Maximum number of shapes per link.
    pub shapes: usize,
    /// If more than this share of these poses remains, shapes get hulls: a contact then requires the hull of the
    /// enclosed part of the mesh.
    pub hulls: f64,
}

/// A link that was fitted closer.
#[derive(Clone, Debug, PartialEq)]
pub struct Refitted {
    /// Its name.
    pub link: String,
    /// Number of shapes around its meshes, before and after.
    pub shapes: (usize, usize),
    /// Number of shapes with hulls.
    pub hulls: usize,
    /// Overshoot after the fit, meters, as [`crate::Fitted::overshoot`].
    pub overshoot: f64,
}

/// Tightens those shapes of links that touch at random poses at which the meshes do not.
///
/// Pairs that need no test (see [`crate::find_disabled_pairs`]) are ignored. Of two shapes in false contact the one that is
/// farther from its mesh is replaced by one or two shapes that still contain its part of the mesh. This ends if few
/// such poses remain, if more shapes gain too little, or if no shape can be refitted or added. If too many poses remain
/// then, or as soon as there are many pairs of shapes, the fit restarts with hulls ([`mobee_model::Hull`]) for all shapes of
/// the links concerned; hulls are then split in two like shapes.
///
/// # Arguments
/// * `links`, `fits`: the links and the fits to their meshes, from [`crate::load_urdf_with_surfaces`].
///
/// # Errors
/// If the robot can't be placed in a scene.
pub fn fit_closer(
    robot: &mut Robot,
    (links, fits): (&[LinkSurface], &mut BTreeMap<String, Fit>),
    surfaces: &Surfaces,
    goal: &RefitLimits,
    (poses, seed): (usize, u64),
    progress: &mut dyn FnMut(f64),
) -> Result<Vec<Refitted>, SceneError> {
    let progress_at = |from: f64, share: f64| from + share / 2.0;
    let (falsely, always_near) =
        find_false_contacts(&Subject::new(robot, surfaces)?, surfaces, (poses, seed), &mut |share| {
            progress(progress_at(0.0, share));
        });
    let before: BTreeMap<String, usize> = fits.iter().map(|(link, fit)| (link.clone(), fit.count())).collect();
    let free = falsely.len() as f64;
    let first = (robot.clone(), fits.clone(), falsely.clone());
    let enough = (goal.falsely * free) as usize;
    let many = (goal.hulls * free) as usize;
    let mut work = RefitState::new(robot, links, fits, falsely, goal.shapes);
    work.refit(&always_near);
    let mut further = |share| progress(progress_at(0.5, share));
    let left = work.with_shapes(surfaces, (enough, PAIRS_BEFORE_HULLS), &mut further)?;
    if left > many {
        let (mut other, mut hulled, falsely) = first;
        let mut restarted = RefitState::new(&mut other, links, &mut hulled, falsely, goal.shapes);
        // Compared at the poses that both were fitted at: a small improvement there may be a deterioration at others.
        if (restarted.with_hulls(surfaces, enough)? as f64) < MAX_REMAINING_WITH_HULLS * left as f64 {
            *robot = other;
            *fits = hulled;
        } else {
            work.with_shapes(surfaces, (enough, MAX_PAIRS), &mut further)?;
        }
    }
    Ok(refitted_links(fits, before))
}

/// Two shapes in false contact, each as its node and its index there.
pub(super) struct FalseContact {
    /// Index of the pose.
    pub(super) pose: usize,
    /// The two shapes.
    pub(super) shapes: [(usize, usize); 2],
    /// The center of the intersection, world frame, if one of the shapes has a hull.
    pub(super) place: Option<Point3<f64>>,
}

/// State of the fit.
pub(super) struct RefitState<'a> {
    pub(super) robot: &'a mut Robot,
    pub(super) fits: &'a mut BTreeMap<String, Fit>,
    /// Per node with a fit: its link.
    pub(super) links: BTreeMap<usize, &'a LinkSurface>,
    /// The remaining poses with false contacts.
    pub(super) falsely: Vec<FalseContacts>,
    /// Maximum number of shapes per link.
    most: usize,
    /// Number of pairs of shapes.
    pairs: usize,
    /// Shapes that can't be refitted, by node and index.
    stuck: BTreeSet<(usize, usize)>,
    /// Shapes without claimed points in the current contacts.
    idle: BTreeSet<(usize, usize)>,
}

impl<'a> RefitState<'a> {
    pub(super) fn new(
        robot: &'a mut Robot,
        links: &'a [LinkSurface],
        fits: &'a mut BTreeMap<String, Fit>,
        falsely: Vec<FalseContacts>,
        most: usize,
    ) -> Self {
        let fitted = links.iter().filter(|l| fits.contains_key(&l.link));
        let links = fitted.filter_map(|l| Some((robot.node_named(&l.link)?, l))).collect();
        let shapes = |node: usize| robot.nodes[node].solids.len();
        let pairs = robot.pairs.reflex.iter().map(|(a, b)| shapes(*a) * shapes(*b)).sum();
        Self { robot, fits, links, falsely, most, pairs, stuck: BTreeSet::new(), idle: BTreeSet::new() }
    }

    /// Refits complete links whose shapes are always near each other although their meshes are not: their pairs would
    /// otherwise be disabled.
    fn refit(&mut self, pairs: &[NodePair]) {
        let nodes: BTreeSet<usize> = pairs.iter().flat_map(|(a, b)| [*a, *b]).collect();
        let close = FitOptions { primitives: CLOSE_FIT.primitives.min(self.most), ..CLOSE_FIT };
        for node in nodes {
            let Some(link) = self.links.get(&node) else { continue };
            let Ok(fit) = Fit::new(&link.meshes, &close) else { continue };
            let shapes = link.shapes(Some(&fit));
            let more = shapes.len().saturating_sub(self.robot.nodes[node].solids.len()) * self.facing(node);
            if self.pairs + more <= MAX_PAIRS {
                self.pairs += more;
                self.robot.nodes[node].solids = shapes;
                self.fits.insert(link.link.clone(), fit);
            }
        }
    }

    /// Refits shapes until at most `enough` poses remain, there are `pairs` pairs of shapes, more pairs gain too
    /// little, or no shape can be refitted.
    ///
    /// # Arguments
    /// * `progress`: called with the completed share of the poses.
    ///
    /// # Returns
    /// Number of remaining poses.
    fn with_shapes(
        &mut self,
        surfaces: &Surfaces,
        (enough, pairs): (usize, usize),
        progress: &mut dyn FnMut(f64),
    ) -> Result<usize, SceneError> {
        let mut begin = None;
        let mut gained = (usize::MAX, self.pairs);
        loop {
            let touches = self.find_touches(surfaces)?;
            let left = self.falsely.len();
            let begin = *begin.get_or_insert(left);
            progress((begin - left) as f64 / begin.max(1) as f64);
            if (left as f64) < MAX_REMAINING_PER_DOUBLING * gained.0 as f64 {
                gained = (left, self.pairs);
            }
            let is_stalled = self.pairs >= 2 * gained.1;
            if left <= enough || is_stalled || self.pairs >= pairs || !self.refit_worst(&touches) {
                return Ok(left);
            }
        }
    }

    /// Finds the remaining false contacts, and drops poses that have none.
    pub(super) fn find_touches(&mut self, surfaces: &Surfaces) -> Result<Vec<FalseContact>, SceneError> {
        let subject = Subject::new(self.robot, surfaces)?;
        let mut touches = Vec::new();
        let mut pose = 0;
        self.falsely.retain_mut(|f| {
            let placed: PlacedShapes = subject.place(&f.q);
            f.pairs.retain(|(a, b)| {
                let count = touches.len();
                for (i, j) in subject.touching(&placed, (*a, *b), 0.0) {
                    let hulls = [*a, *b].iter().any(|node| !subject.robot.nodes[*node].hulls.is_empty());
                    let place = hulls.then(|| subject.place_of(&placed, [(*a, i), (*b, j)])).flatten();
                    touches.push(FalseContact { pose, shapes: [(*a, i), (*b, j)], place });
                }
                touches.len() > count
            });
            pose += usize::from(!f.pairs.is_empty());
            !f.pairs.is_empty()
        });
        Ok(touches)
    }

    /// The link of a fitted shape, and the shape's index in the link's fit.
    pub(super) fn fitted(&self, (node, shape): (usize, usize)) -> Option<(&'a LinkSurface, usize)> {
        let link = self.links.get(&node)?;
        Some((link, shape.checked_sub(link.solids.len())?))
    }

    /// True if a shape may be replaced by two.
    pub(super) fn can_refit(&self, shape: (usize, usize)) -> bool {
        !self.stuck.contains(&shape)
            && !self.idle.contains(&shape)
            && self.fitted(shape).is_some_and(|(link, _)| self.fits[&link.link].count() < self.most)
            && self.pairs + self.facing(shape.0) <= MAX_PAIRS
    }

    /// Number of shapes that a shape of a node is tested against: the number of pairs that another shape would add.
    fn facing(&self, node: usize) -> usize {
        let other = |(a, b): &(usize, usize)| if *a == node { Some(*b) } else { (*b == node).then_some(*a) };
        self.robot.pairs.reflex.iter().filter_map(other).map(|n| self.robot.nodes[n].solids.len()).sum()
    }

    /// Refits the shapes that touch most often; returns false if there are none.
    pub(super) fn refit_worst(&mut self, touches: &[FalseContact]) -> bool {
        self.idle.clear();
        loop {
            let worst = self.worst(touches);
            if worst.is_empty() {
                return false;
            }
            let mut changed = false;
            for (shape, places) in self.claims(touches, &worst) {
                if !self.can_refit(shape) {
                    continue;
                }
                changed |= self.refit_shape(shape, places);
            }
            if changed {
                return true;
            }
        }
    }

    /// The refittable shapes that touch at the most poses.
    fn worst(&self, touches: &[FalseContact]) -> BTreeSet<(usize, usize)> {
        let mut poses: BTreeMap<(usize, usize), (usize, usize)> = BTreeMap::new();
        for touch in touches {
            for shape in touch.shapes {
                // Counts each pose once: touches are ordered by pose.
                let (count, last) = poses.entry(shape).or_insert((0, usize::MAX));
                *count += usize::from(*last != touch.pose);
                *last = touch.pose;
            }
        }
        let mut worst: Vec<_> = poses.into_iter().map(|(shape, (count, _))| (count, shape)).collect();
        worst.retain(|(_, shape)| self.can_refit(*shape));
        worst.sort_by_key(|(count, shape)| (std::cmp::Reverse(*count), *shape));
        let most = worst.first().map_or(0, |(count, _)| *count) as f64;
        let near = |(count, _): &(usize, _)| *count as f64 >= MIN_SHARE_OF_WORST * most;
        worst.into_iter().take(SHAPES_PER_ROUND).take_while(near).map(|(_, shape)| shape).collect()
    }

    /// Refits a shape; one that can't be refitted is excluded from then on.
    fn refit_shape(&mut self, shape: (usize, usize), places: Vec<Vector3<f64>>) -> bool {
        let Some((link, number)) = self.fitted(shape) else { return false };
        let Some(fit) = self.fits.get_mut(&link.link) else { return false };
        if places.is_empty() {
            self.idle.insert(shape);
            return false;
        }
        if !fit.yield_to(number, places) {
            self.stuck.insert(shape);
            return false;
        }
        let shapes = link.shapes(Some(fit));
        let hulls = link.hulls(fit);
        let more = shapes.len() - self.robot.nodes[shape.0].solids.len();
        self.pairs += more * self.facing(shape.0);
        self.robot.nodes[shape.0].solids = shapes;
        self.robot.nodes[shape.0].hulls = hulls;
        true
    }
}

/// The links whose shapes were refitted.
fn refitted_links(fits: &BTreeMap<String, Fit>, before: BTreeMap<String, usize>) -> Vec<Refitted> {
    let nearer = |(link, before): (String, usize)| {
        let fit = fits.get(&link).filter(|f| f.count() > before || f.hulled() > 0)?;
        Some(Refitted { shapes: (before, fit.count()), hulls: fit.hulled(), overshoot: fit.overshoot(), link })
    };
    before.into_iter().filter_map(nearer).collect()
}
