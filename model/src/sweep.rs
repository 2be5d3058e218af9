//! The least distances on the way from one pose to the next: between robots, or of all pairs.
//!
//! Readings are instants. Between two of them arms at half of their speed go several millimeters, and may pass each other: at both
//! instants they are apart, in between they were not. So the way is divided until no shape goes farther than a millimeter against
//! another from one place of it to the next, and what was nearest counts.
//!
//! Between two readings a motor is taken to go straight at an even rate. One that gains speed with `a` is off by `a t^2 / 8` after
//! half of the time `t` between them: at 200 deg/s^2 and 100 readings a second a 400th of a degree.

use crate::engine::{DefaultEngine, Engine};
use crate::scene::{Contact, Scene};
use crate::watch::{PairGroups, Watch};
use std::sync::Arc;

/// How far two shapes may go against each other from one place to the next, meters: what counts as deeper.
const STEP: f64 = 0.001;
/// Into so many parts a way is divided at most: a tenth of a meter in one reading, as after a pause, is nobody's motion.
const PARTS: f64 = 64.0;

/// Follows the robots of a scene through a stream of poses, and what they come nearer to each other than a margin on the way.
///
/// # Example
/// ```
/// use mobee_model::{Scene, Sweep, parse_robot};
/// use nalgebra::Isometry3;
/// use std::sync::Arc;
///
/// // An arm of 40 cm that turns, and one that stands in its way.
/// let file = |name: &str| format!(
///     r#"<ZeroPositionKinematicTree version="1.0" robotName="{name}"><bodypart name="arm"><link z="0.2" radius="0.03">
///     <motor name="pan" minPos="-90" maxPos="90" home="0"><joint z="1" length="0.05" minPos="-90" maxPos="90">
///     <link x="0.4" radius="0.03"/></joint></motor></link></bodypart></ZeroPositionKinematicTree>"#
/// );
/// let arm = |name: &str| parse_robot("arm.xml", &file(name)).map(|loaded| Arc::new(loaded.value));
/// let beside = Isometry3::translation(0.5, 0.0, 0.1);
/// let scene = Scene::new(vec![(arm("one")?, Isometry3::identity()), (arm("other")?, beside)], Vec::new())?;
/// let mut sweep = Sweep::new(Arc::new(scene), 0.01);
/// let poses = |deg: f64| [vec![deg.to_radians()], vec![1.5]];
/// // Apart before and after, and not on the way.
/// assert!(sweep.to(&poses(-50.0)).is_empty());
/// let _ = sweep.to(&poses(50.0));
/// assert!(sweep.to(&poses(51.0)).is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Sweep<E: Engine = DefaultEngine> {
    /// Looks at the pairs.
    watch: Watch<E>,
    /// How far shapes may go against each other from one place of the way to the next, meters.
    step: f64,
    /// Where the robots were last.
    last: Option<Vec<Vec<f64>>>,
    /// What was nearest on the way from there, sorted by pair.
    least: Vec<Contact>,
}

impl<E: Engine> Sweep<E> {
    /// Looks for pairs of two robots that come nearer than a margin, meters.
    pub fn new(scene: Arc<Scene<E>>, within: f64) -> Self {
        Sweep { watch: Watch::between_robots(scene, within), step: STEP, last: None, least: Vec::new() }
    }

    /// Looks for any pairs that come nearer than a margin, meters, in places between which no shape goes farther than `step`, meters.
    pub fn of_all(scene: Arc<Scene<E>>, within: f64, step: f64) -> Self {
        Sweep { watch: Watch::new(scene, within), step, last: None, least: Vec::new() }
    }

    /// Goes on with another scene, such as one after an edit.
    pub fn set_scene(&mut self, scene: Arc<Scene<E>>) {
        self.watch.set_scene(scene);
    }

    /// The robots are elsewhere, and nobody knows how they came there: the next pose is the first of a way.
    pub fn jump(&mut self) {
        self.last = None;
    }

    /// Per pair the least distance on the way from the poses before to these, where it was below the margin, sorted by pair.
    ///
    /// # Arguments
    /// * `poses`: of all robots at one instant, rad of encoder, in the scene's order.
    pub fn to<P: AsRef<[f64]>>(&mut self, poses: &[P]) -> &[Contact] {
        self.follow(poses, None)
    }

    /// The same of the pairs of these groups alone.
    pub fn to_of<P: AsRef<[f64]>>(&mut self, poses: &[P], groups: &PairGroups) -> &[Contact] {
        self.follow(poses, Some(groups))
    }

    /// The next way begins here.
    pub fn begin<P: AsRef<[f64]>>(&mut self, poses: &[P]) {
        self.last = Some(owned(poses));
    }

    /// Where the next way begins, if that is known.
    pub fn last(&self) -> Option<&[Vec<f64>]> {
        self.last.as_deref()
    }

    fn follow<P: AsRef<[f64]>>(&mut self, poses: &[P], groups: Option<&PairGroups>) -> &[Contact] {
        let here = owned(poses);
        let last = self.last.replace(here.clone()).filter(|last| same_length(last, &here));
        self.least.clear();
        if groups.is_some_and(PairGroups::is_empty) {
            return &self.least;
        }
        let scene = self.watch.scene().clone();
        let way = |last: &Vec<Vec<f64>>| -> f64 {
            last.iter().zip(&here).enumerate().map(|(robot, (a, b))| scene.travel(robot, a, b)).sum()
        };
        let parts = last.as_ref().map_or(1.0, |last| (way(last) / self.step).ceil().clamp(1.0, PARTS));
        for part in 1..parts as usize {
            let share = part as f64 / parts;
            let on_line = |(a, b): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
                a.iter().zip(b).map(|(a, b)| a + (b - a) * share).collect()
            };
            let between: Vec<Vec<f64>> = last.iter().flat_map(|last| last.iter().zip(&here)).map(on_line).collect();
            self.look(&between, groups);
        }
        self.look(&here, groups);
        &self.least
    }

    fn look(&mut self, poses: &[Vec<f64>], groups: Option<&PairGroups>) {
        let near = match groups {
            Some(groups) => self.watch.update_of(poses, groups),
            None => self.watch.update(poses),
        };
        note(&mut self.least, near);
    }
}

fn owned<P: AsRef<[f64]>>(poses: &[P]) -> Vec<Vec<f64>> {
    poses.iter().map(|q| q.as_ref().to_vec()).collect()
}

/// Whether two lists of poses are of the same robots.
fn same_length(a: &[Vec<f64>], b: &[Vec<f64>]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.len() == b.len())
}

/// The nearer of each pair counts.
fn note(least: &mut Vec<Contact>, near: &[Contact]) {
    for contact in near {
        match least.binary_search_by_key(&contact.pair, |c| c.pair) {
            Ok(i) if least[i].distance <= contact.distance => {}
            Ok(i) => least[i] = *contact,
            Err(i) => least.insert(i, *contact),
        }
    }
}
