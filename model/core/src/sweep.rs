//! Minimum distances during the motion from one configuration to the next: between robots, or of all pairs.
//!
//! Encoder samples are instants. Between two of them arms at half of their speed move several millimeters and may pass
//! each other, although they are apart at both instants. So the motion is divided until no shape moves farther than a
//! millimeter relative to another per part, and the minimum distance counts.
//!
//! Between two samples a motor is assumed to move at constant speed. With an acceleration `a` the error is `a t^2 / 8`
//! in the middle of the time `t` between them: at 200 deg/s^2 and 100 samples per second, 1/400 degree.

use crate::engine::{DefaultEngine, Engine};
use crate::scene::{Contact, Scene};
use crate::watch::{PairGroups, Watch};
use std::sync::Arc;

/// Maximum relative motion of two shapes per part, meters: the resolution of the depth.
const MAX_STEP_M: f64 = 0.001;
/// Maximum number of parts: a tenth of a meter within one sample period, as after a pause, is not a real motion.
const MAX_PARTS: f64 = 64.0;

/// Tracks the robots of a scene through a stream of configurations, and finds pairs that come closer than a margin
/// during the motion between them.
///
/// # Example
/// ```
/// use mobee_model::{Scene, Sweep, parse_robot};
/// use nalgebra::Isometry3;
/// use std::sync::Arc;
///
/// // A pivoting arm of 40 cm, and one in its path.
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
/// // Apart before and after, but not in between.
/// assert!(sweep.to(&poses(-50.0)).is_empty());
/// let _ = sweep.to(&poses(50.0));
/// assert!(sweep.to(&poses(51.0)).is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Sweep<E: Engine = DefaultEngine> {
    /// Monitors the pairs.
    watch: Watch<E>,
    /// Maximum relative motion of shapes per part, meters.
    step: f64,
    /// The last configurations.
    last: Option<Vec<Vec<f64>>>,
    /// Minimum distances during the motion from there, sorted by pair.
    least: Vec<Contact>,
}

impl<E: Engine> Sweep<E> {
    /// Monitors pairs of two robots that come closer than a margin, meters.
    pub fn new(scene: Arc<Scene<E>>, within: f64) -> Self {
        Sweep { watch: Watch::between_robots(scene, within), step: MAX_STEP_M, last: None, least: Vec::new() }
    }

    /// Monitors all pairs that come closer than a margin, meters; no shape moves farther than `step`, meters, per part.
    pub fn of_all(scene: Arc<Scene<E>>, within: f64, step: f64) -> Self {
        Sweep { watch: Watch::new(scene, within), step, last: None, least: Vec::new() }
    }

    /// Continues with another scene, such as one after an edit.
    pub fn set_scene(&mut self, scene: Arc<Scene<E>>) {
        self.watch.set_scene(scene);
    }

    /// Forgets the last configurations, after a motion of unknown path: the next configuration starts a new motion.
    pub fn jump(&mut self) {
        self.last = None;
    }

    /// Minimum distance per pair during the motion from the last configurations to these, for pairs below the margin,
    /// sorted by pair.
    ///
    /// # Arguments
    /// * `poses`: configurations of all robots at one instant, rad of encoder, in the scene's order.
    pub fn to<P: AsRef<[f64]>>(&mut self, poses: &[P]) -> &[Contact] {
        self.follow(poses, None)
    }

    /// As [`Sweep::to`], for the pairs of these groups only.
    pub fn to_of<P: AsRef<[f64]>>(&mut self, poses: &[P], groups: &PairGroups) -> &[Contact] {
        self.follow(poses, Some(groups))
    }

    /// Sets the start of the next motion.
    pub fn begin<P: AsRef<[f64]>>(&mut self, poses: &[P]) {
        self.last = Some(owned(poses));
    }

    /// Start of the next motion, if set.
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
        let travel = |last: &Vec<Vec<f64>>| -> f64 {
            last.iter().zip(&here).enumerate().map(|(robot, (a, b))| scene.travel(robot, a, b)).sum()
        };
        let parts = last.as_ref().map_or(1.0, |last| (travel(last) / self.step).ceil().clamp(1.0, MAX_PARTS));
        for part in 1..parts as usize {
            let share = part as f64 / parts;
            let on_line = |(a, b): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
                a.iter().zip(b).map(|(a, b)| a + (b - a) * share).collect()
            };
            let between: Vec<Vec<f64>> = last.iter().flat_map(|last| last.iter().zip(&here)).map(on_line).collect();
            self.record(&between, groups);
        }
        self.record(&here, groups);
        &self.least
    }

    fn record(&mut self, poses: &[Vec<f64>], groups: Option<&PairGroups>) {
        let near = match groups {
            Some(groups) => self.watch.update_of(poses, groups),
            None => self.watch.update(poses),
        };
        record_least(&mut self.least, near);
    }
}

fn owned<P: AsRef<[f64]>>(poses: &[P]) -> Vec<Vec<f64>> {
    poses.iter().map(|q| q.as_ref().to_vec()).collect()
}

/// True if two lists are configurations of the same robots.
fn same_length(a: &[Vec<f64>], b: &[Vec<f64>]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.len() == b.len())
}

/// Stores the smaller distance of each pair.
fn record_least(least: &mut Vec<Contact>, near: &[Contact]) {
    for contact in near {
        match least.binary_search_by_key(&contact.pair, |c| c.pair) {
            Ok(i) if least[i].distance <= contact.distance => {}
            Ok(i) => least[i] = *contact,
            Err(i) => least.insert(i, *contact),
        }
    }
}
