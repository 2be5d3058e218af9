//! Shapes fitted closer where they touch falsely, and only there.
//!
//! ```text
//! random poses ──> those at which shapes touch and meshes do not ──> places that both shapes hold
//!       ^                                                                       │
//!       └──── shapes that hold most of them give way, in one piece or two <─────┘
//! ```
//! `falsely.rs` finds the poses, `claims.rs` says which shape should leave which places. Where that does not get far enough ([`Closer::hulls`]), the shapes get hulls (`hulled.rs`).

use super::falsely::{Falsely, NodePair, falsely_touching};
use super::{Placed, Subject};
use crate::scene::MAX_PAIRS;
use crate::{Fit, FitOptions, LinkSurface, Robot, SceneError, Surfaces};
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// How many shapes give way before it is looked again what that changed.
const AT_ONCE: usize = 32;
/// A shape gives way if it touches falsely at this share of the poses of the worst, at least.
const NEAR_WORST: f64 = 0.25;
/// How links are fitted anew that would be left out otherwise.
const CLOSE_FIT: FitOptions = FitOptions { overshoot: 0.003, primitives: 40 };
/// Hulls are taken if they leave less than this share of the poses that shapes without do.
const LEFT_BY_HULLS: f64 = 0.9;
/// Twice as many pairs of shapes are worth it if they leave less than this share of the poses.
const GAIN: f64 = 0.9;
/// From so many pairs of shapes on hulls are tried before further shapes: they are the cheaper ones then, for the fit as for the robot.
const FEW_PAIRS: usize = 20_000;

/// How close shapes are to be fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closer {
    /// At what share of the poses that are free by the meshes shapes may touch falsely.
    pub falsely: f64,
    /// How many shapes a link may have.
    pub shapes: usize,
    /// If more than this share of these poses is left, shapes get hulls: what touches is then the hull of what a shape encloses.
    pub hulls: f64,
}

/// A link that was fitted closer.
#[derive(Clone, Debug, PartialEq)]
pub struct Nearer {
    /// Its name.
    pub link: String,
    /// How many shapes were around its meshes, and how many are.
    pub shapes: (usize, usize),
    /// How many of them have hulls.
    pub hulls: usize,
    /// As [`crate::Fitted::overshoot`], now.
    pub overshoot: f64,
}

/// Fits those shapes of links closer that touch at random poses where the meshes do not.
///
/// Pairs that need no test (see [`crate::spared_pairs`]) do not count. Of two shapes that touch falsely the one gives way that is
/// farther from its mesh; it is replaced by one or two that still hold its part of the mesh. Ends where few poses are left, or more
/// shapes gain too little, or none can give way or be added. If too many are left then, or by the time there are many pairs of
/// shapes, it begins anew with hulls ([`crate::Hull`]): those of whole links that touch falsely, and then hulls give way as shapes do, in two parts.
///
/// # Arguments
/// * `links`, `fits`: what was fitted to the links' meshes, as [`crate::load_urdf_with_surfaces`] gives them.
///
/// # Errors
/// If the robot can't stand in a scene.
pub fn fit_closer(
    robot: &mut Robot,
    (links, fits): (&[LinkSurface], &mut BTreeMap<String, Fit>),
    surfaces: &Surfaces,
    goal: &Closer,
    (poses, seed): (usize, u64),
    progress: &mut dyn FnMut(f64),
) -> Result<Vec<Nearer>, SceneError> {
    let half = |from: f64, share: f64| from + share / 2.0;
    let (falsely, always_near) =
        falsely_touching(&Subject::new(robot, surfaces)?, surfaces, (poses, seed), &mut |share| {
            progress(half(0.0, share));
        });
    let before: BTreeMap<String, usize> = fits.iter().map(|(link, fit)| (link.clone(), fit.count())).collect();
    let (free, first) = (falsely.len() as f64, (robot.clone(), fits.clone(), falsely.clone()));
    let (enough, many) = ((goal.falsely * free) as usize, (goal.hulls * free) as usize);
    let mut work = Work::new(robot, links, fits, falsely, goal.shapes);
    work.refit(&always_near);
    let mut further = |share| progress(half(0.5, share));
    let left = work.with_shapes(surfaces, (enough, FEW_PAIRS), &mut further)?;
    if left > many {
        let (mut other, mut hulled, falsely) = first;
        let mut anew = Work::new(&mut other, links, &mut hulled, falsely, goal.shapes);
        // by the poses that both were fitted at: what is hardly better there may be worse elsewhere
        if (anew.with_hulls(surfaces, enough)? as f64) < LEFT_BY_HULLS * left as f64 {
            (*robot, *fits) = (other, hulled);
        } else {
            work.with_shapes(surfaces, (enough, MAX_PAIRS), &mut further)?;
        }
    }
    Ok(told(fits, before))
}

/// Two shapes that touch falsely, each by its node and its number there.
pub(super) struct Touch {
    /// Index of the pose.
    pub(super) pose: usize,
    /// Who.
    pub(super) shapes: [(usize, usize); 2],
    /// If one of them has a hull, the middle of what both hold, world frame.
    pub(super) place: Option<Point3<f64>>,
}

/// What is being fitted.
pub(super) struct Work<'a> {
    pub(super) robot: &'a mut Robot,
    pub(super) fits: &'a mut BTreeMap<String, Fit>,
    /// Per node with a fit: its link.
    pub(super) links: BTreeMap<usize, &'a LinkSurface>,
    /// The poses that are left.
    pub(super) falsely: Vec<Falsely>,
    /// How many shapes a link may have.
    most: usize,
    /// How many pairs of shapes there are.
    pairs: usize,
    /// Shapes that can't give way, by node and number.
    stuck: BTreeSet<(usize, usize)>,
    /// Shapes of which nothing was claimed, of the touches that are looked at.
    idle: BTreeSet<(usize, usize)>,
}

impl<'a> Work<'a> {
    pub(super) fn new(
        robot: &'a mut Robot,
        links: &'a [LinkSurface],
        fits: &'a mut BTreeMap<String, Fit>,
        falsely: Vec<Falsely>,
        most: usize,
    ) -> Self {
        let fitted = links.iter().filter(|l| fits.contains_key(&l.link));
        let links = fitted.filter_map(|l| Some((robot.node_named(&l.link)?, l))).collect();
        let shapes = |node: usize| robot.nodes[node].solids.len();
        let pairs = robot.pairs.reflex.iter().map(|(a, b)| shapes(*a) * shapes(*b)).sum();
        Self { robot, fits, links, falsely, most, pairs, stuck: BTreeSet::new(), idle: BTreeSet::new() }
    }

    /// Fits whole links closer whose shapes are always near each other and whose meshes are not: they would be left out.
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

    /// Lets shapes give way until no more poses than this are left, or there are so many pairs of shapes, or more of them gain too little,
    /// or none can give way.
    ///
    /// # Arguments
    /// * `progress`: told the share of the poses that are done with.
    ///
    /// # Returns
    /// How many are left.
    fn with_shapes(
        &mut self,
        surfaces: &Surfaces,
        (enough, pairs): (usize, usize),
        progress: &mut dyn FnMut(f64),
    ) -> Result<usize, SceneError> {
        let mut begin = None;
        let mut gained = (usize::MAX, self.pairs);
        loop {
            let touches = self.look(surfaces)?;
            let left = self.falsely.len();
            let begin = *begin.get_or_insert(left);
            progress((begin - left) as f64 / begin.max(1) as f64);
            if (left as f64) < GAIN * gained.0 as f64 {
                gained = (left, self.pairs);
            }
            let in_vain = self.pairs >= 2 * gained.1;
            if left <= enough || in_vain || self.pairs >= pairs || !self.give_way(&touches) {
                return Ok(left);
            }
        }
    }

    /// What of the shapes still touches falsely; poses at which nothing does are done with.
    pub(super) fn look(&mut self, surfaces: &Surfaces) -> Result<Vec<Touch>, SceneError> {
        let subject = Subject::new(self.robot, surfaces)?;
        let (mut touches, mut pose) = (Vec::new(), 0);
        self.falsely.retain_mut(|f| {
            let placed: Placed = subject.place(&f.q);
            f.pairs.retain(|(a, b)| {
                let count = touches.len();
                for (i, j) in subject.touching(&placed, (*a, *b), 0.0) {
                    let hulls = [*a, *b].iter().any(|node| !subject.robot.nodes[*node].hulls.is_empty());
                    let place = hulls.then(|| subject.place_of(&placed, [(*a, i), (*b, j)])).flatten();
                    touches.push(Touch { pose, shapes: [(*a, i), (*b, j)], place });
                }
                touches.len() > count
            });
            pose += usize::from(!f.pairs.is_empty());
            !f.pairs.is_empty()
        });
        Ok(touches)
    }

    /// The number of a shape among those that were fitted.
    pub(super) fn fitted(&self, (node, shape): (usize, usize)) -> Option<(&'a LinkSurface, usize)> {
        let link = self.links.get(&node)?;
        Some((link, shape.checked_sub(link.solids.len())?))
    }

    /// Whether a shape may be replaced by two.
    pub(super) fn can_give(&self, shape: (usize, usize)) -> bool {
        !self.stuck.contains(&shape)
            && !self.idle.contains(&shape)
            && self.fitted(shape).is_some_and(|(link, _)| self.fits[&link.link].count() < self.most)
            && self.pairs + self.facing(shape.0) <= MAX_PAIRS
    }

    /// How many shapes those of a node are tested against: so many pairs another one there adds.
    fn facing(&self, node: usize) -> usize {
        let other = |(a, b): &(usize, usize)| if *a == node { Some(*b) } else { (*b == node).then_some(*a) };
        self.robot.pairs.reflex.iter().filter_map(other).map(|n| self.robot.nodes[n].solids.len()).sum()
    }

    /// Lets the shapes give way that touch most often; answers whether there are any.
    pub(super) fn give_way(&mut self, touches: &[Touch]) -> bool {
        self.idle.clear();
        loop {
            let worst = self.worst(touches);
            if worst.is_empty() {
                return false;
            }
            let mut gave = false;
            for (shape, places) in self.claims(touches, &worst) {
                if !self.can_give(shape) {
                    continue;
                }
                gave |= self.give(shape, places);
            }
            if gave {
                return true;
            }
        }
    }

    /// The shapes that touch at most poses, of those that may be replaced.
    fn worst(&self, touches: &[Touch]) -> BTreeSet<(usize, usize)> {
        let mut poses: BTreeMap<(usize, usize), (usize, usize)> = BTreeMap::new();
        for touch in touches {
            for shape in touch.shapes {
                // each pose once: they come in order
                let (count, last) = poses.entry(shape).or_insert((0, usize::MAX));
                *count += usize::from(*last != touch.pose);
                *last = touch.pose;
            }
        }
        let mut worst: Vec<_> = poses.into_iter().map(|(shape, (count, _))| (count, shape)).collect();
        worst.retain(|(_, shape)| self.can_give(*shape));
        worst.sort_by_key(|(count, shape)| (std::cmp::Reverse(*count), *shape));
        let most = worst.first().map_or(0, |(count, _)| *count) as f64;
        let near = |(count, _): &(usize, _)| *count as f64 >= NEAR_WORST * most;
        worst.into_iter().take(AT_ONCE).take_while(near).map(|(_, shape)| shape).collect()
    }

    /// Lets a shape give way; one that can't is not asked again.
    fn give(&mut self, shape: (usize, usize), places: Vec<Vector3<f64>>) -> bool {
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
        let (shapes, hulls) = (link.shapes(Some(fit)), link.hulls(fit));
        let more = shapes.len() - self.robot.nodes[shape.0].solids.len();
        self.pairs += more * self.facing(shape.0);
        self.robot.nodes[shape.0].solids = shapes;
        self.robot.nodes[shape.0].hulls = hulls;
        true
    }
}

/// Which links are nearer to their meshes now.
fn told(fits: &BTreeMap<String, Fit>, before: BTreeMap<String, usize>) -> Vec<Nearer> {
    let nearer = |(link, before): (String, usize)| {
        let fit = fits.get(&link).filter(|f| f.count() > before || f.hulled() > 0)?;
        Some(Nearer { shapes: (before, fit.count()), hulls: fit.hulled(), overshoot: fit.overshoot(), link })
    };
    before.into_iter().filter_map(nearer).collect()
}
