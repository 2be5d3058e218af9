//! Monitors the contacts of a stream of configurations, at a cost proportional to the changes.
//!
//! Each pair that was found apart stays apart until the motors have moved far enough. Pairs of the same two frames are
//! a *group* and share a clock that runs in meters: the sum over the motors between the frames of `reach * travel of
//! motor` (see `scene/travel.rs`). No point of one shape moves farther relative to the other than their clock advances,
//! so a pair with a reserve of `d` meters is checked again when the clock has advanced by `d`. This never misses a
//! contact; at worst it checks too early.
//!
//! ```text
//! reserve of a pair   distance - margin       |----------------------|
//! clock of its group  travel of its motors    |------->                  not due: nothing is placed, nothing measured
//! ```
//! A motor's travel counts only beyond a small band about its last turning point ([`MotorTrack`]): an encoder at rest
//! is noisy, and if every change of its last digit counted, the clocks would advance for a robot at rest.

use crate::engine::{DefaultEngine, Engine, IndexPair, Near, PairProximity};
use crate::scene::{Contact, PairGroup, Scene};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

/// Deviation of a motor from its turning point, rad of encoder, up to which its travel is not counted: above the noise
/// of an encoder, below any relevant motion (at an arm's length of half a meter it is half a millimeter).
const NOISE_BAND_RAD: f64 = 1e-3;
/// Distance beyond the margin up to which a pair is measured exactly, meters. For pairs beyond it the cheap bound
/// suffices, although they are checked again earlier than necessary; closer pairs would be checked at every other
/// configuration, so an exact distance pays.
const MEASURE_RANGE_M: f64 = 0.02;
/// Number of pairs whose earliest due time is stored together.
const BLOCK: usize = 32;
/// Tolerance subtracted from each pair's reserve, meters: far above the rounding of clocks that have run for days (1e6
/// m at 1e-16 is 1e-10), far below what would cause extra checks.
const ROUNDING_M: f64 = 1e-9;

/// Counters of a [`Watch`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WatchCounters {
    /// Number of updates.
    pub updates: u64,
    /// Updates at which no shape had to be placed.
    pub idle: u64,
    /// Pairs that were checked.
    pub looked: u64,
    /// Pairs that were measured exactly.
    pub measured: u64,
}

/// Monitors a scene's contacts in a stream of configurations. [`Watch::update`] returns the same as
/// [`Scene::contacts`].
///
/// # Example
/// ```
/// use mobee_model::{Scene, Watch, load_robot};
/// use nalgebra::Isometry3;
/// use std::sync::Arc;
///
/// let robot = Arc::new(load_robot("../../configs/robots/katana.xml")?.value);
/// let scene = Arc::new(Scene::new(vec![(robot, Isometry3::identity())], Vec::new())?);
/// let mut watch = Watch::new(scene, 0.01);
/// let mut pose = watch.scene().home()[0].to_vec();
/// for _ in 0..100 {
///     // The first motor moves in steps of a tenth of a milliradian: nothing comes near.
///     pose[0] += 1e-4;
///     assert!(watch.update(&[&pose]).is_empty());
/// }
/// // Most of these updates cost no more than a comparison.
/// assert!(watch.counters().idle > 50, "{:?}", watch.counters());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Watch<E: Engine = DefaultEngine> {
    /// The monitored scene.
    scene: Arc<Scene<E>>,
    /// The margin, meters.
    within: f64,
    /// True if only pairs of two robots are monitored.
    between: bool,
    /// Per motor of the scene: its travel.
    motors: Vec<MotorTrack>,
    /// Due time of each group on the common clock; a heap, so that an update without due groups costs one comparison.
    due: BinaryHeap<Reverse<DueGroup>>,
    /// Due times of the pairs, in the order of the scene's groups.
    groups: Vec<Expiries>,
    /// Per robot: the groups of its pairs.
    of_robot: Vec<Vec<u32>>,
    /// True if the last update checked only some groups.
    partial: bool,
    /// `world_from_frame` at the last configuration at which a pair was checked.
    frames: Vec<nalgebra::Isometry3<f64>>,
    /// The shapes that were checked at that configuration.
    placement: E::Placement,
    /// The contacts at the last configuration, sorted by pair.
    found: Vec<Contact>,
    counters: WatchCounters,
}

/// Travel of a motor. Between two configurations it has moved by at most the later `traveled` minus the earlier one,
/// plus both `since_turn`, by the triangle inequality through the turning points.
#[derive(Clone, Copy, Debug)]
struct MotorTrack {
    /// The last position, rad of encoder; NaN before the first.
    last_q: f64,
    /// The position at which it last left the noise band, rad of encoder: the center of the current band.
    turning_point: f64,
    /// Travel up to the turning point, rad of encoder; never decreases.
    traveled: f64,
    /// Current distance from the turning point, rad of encoder; decreases when the motor returns.
    since_turn: f64,
    /// Its greatest reach in any group, meters per rad: its weight in the common clock.
    fastest: f64,
}

/// Due times of a group's pairs, on the group's clock.
#[derive(Clone, Debug)]
struct Expiries {
    /// Due time per pair.
    pairs: Vec<f64>,
    /// Earliest due time per [`BLOCK`] of pairs: two links with many shapes make thousands of pairs, of which few are
    /// due at a time.
    blocks: Vec<f64>,
    /// Earliest due time of all.
    first: f64,
}

/// Groups of pairs of a scene, as returned by [`Watch::near_groups`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PairGroups {
    groups: Vec<u32>,
    /// The distance up to which their pairs matter, meters.
    within: f64,
}

impl PairGroups {
    /// True if there are no groups.
    pub fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }
}

impl Expiries {
    /// Creates entries for `pairs` pairs that are due at `time`.
    fn since(time: f64, pairs: usize) -> Self {
        Self { pairs: vec![time; pairs], blocks: vec![time; pairs.div_ceil(BLOCK)], first: time }
    }

    /// Checks the pairs that are due; `look` checks a pair and returns its next due time.
    ///
    /// # Returns
    /// The earliest due time of all pairs.
    fn renew(&mut self, pairs: &[IndexPair], now: f64, mut look: impl FnMut(IndexPair) -> f64) -> f64 {
        if now < self.first {
            return self.first;
        }
        let blocks = self.pairs.chunks_mut(BLOCK).zip(pairs.chunks(BLOCK));
        for (first, (expiries, pairs)) in self.blocks.iter_mut().zip(blocks) {
            if now < *first {
                continue;
            }
            for (expiry, pair) in expiries.iter_mut().zip(pairs) {
                if now < *expiry {
                    continue;
                }
                *expiry = look(*pair);
            }
            *first = expiries.iter().copied().fold(f64::INFINITY, f64::min);
        }
        self.first = self.blocks.iter().copied().fold(f64::INFINITY, f64::min);
        self.first
    }
}

/// Due time of a group. Ordered by time, then by group.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct DueGroup {
    /// Due time on the common clock.
    at: WatchClock,
    /// Index of the group.
    group: u32,
}

/// A time on a clock that runs in meters, totally ordered; NaN sorts last.
#[derive(Clone, Copy, Debug, PartialEq)]
struct WatchClock(f64);

impl Eq for WatchClock {}
impl PartialOrd for WatchClock {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for WatchClock {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl MotorTrack {
    /// Updates the travel for position `q`; returns false if the position is unchanged.
    fn follow(&mut self, q: f64) -> bool {
        if q == self.last_q {
            return false;
        }
        self.last_q = q;
        let deviation = (q - self.turning_point).abs();
        if deviation > NOISE_BAND_RAD {
            self.traveled += deviation;
            self.turning_point = q;
            self.since_turn = 0.0;
        } else {
            self.since_turn = deviation;
        }
        true
    }
}

impl<E: Engine> Watch<E> {
    /// Monitors reflex pairs that are closer than a margin.
    ///
    /// # Arguments
    /// * `scene`: the scene of the configurations that will follow.
    /// * `within`: the margin, meters, as for [`Scene::contacts`].
    pub fn new(scene: Arc<Scene<E>>, within: f64) -> Self {
        let mut watch = Watch {
            scene: scene.clone(),
            within,
            between: false,
            motors: Vec::new(),
            due: BinaryHeap::new(),
            groups: Vec::new(),
            of_robot: Vec::new(),
            partial: false,
            frames: Vec::new(),
            placement: E::Placement::default(),
            found: Vec::new(),
            counters: WatchCounters::default(),
        };
        watch.set_scene(scene);
        watch
    }

    /// As [`Watch::new`], but only for pairs of shapes of two different robots.
    pub fn between_robots(scene: Arc<Scene<E>>, within: f64) -> Self {
        let mut watch = Self::new(scene.clone(), within);
        watch.between = true;
        watch.set_scene(scene);
        watch
    }

    /// Continues with another scene, such as one after an edit. The margin and the counters are unchanged.
    ///
    /// # Performance
    /// All results about pairs are discarded, since indices may refer to other pairs now: the next update checks every
    /// pair.
    pub fn set_scene(&mut self, scene: Arc<Scene<E>>) {
        let motors = scene.bodies().motors;
        let world = scene.world();
        let unknown = MotorTrack { last_q: f64::NAN, turning_point: 0.0, traveled: 0.0, since_turn: 0.0, fastest: 0.0 };
        self.motors = vec![unknown; motors];
        for term in world.lists.groups.iter().flat_map(|g| &g.travel) {
            let motor = &mut self.motors[term.motor as usize];
            motor.fastest = motor.fastest.max(term.reach);
        }
        // All pairs are due at once, since nothing has been measured yet.
        let ever = f64::NEG_INFINITY;
        self.groups = world.lists.groups.iter().map(|g| Expiries::since(ever, g.pairs.len())).collect();
        // All pairs of a group have the same two frames, so its first pair represents it. Groups that are never due are
        // never checked.
        let robot = |k: u32| world.solids[k as usize].id.robot();
        let apart = |(i, j): &IndexPair| robot(*i).is_some() && robot(*j).is_some() && robot(*i) != robot(*j);
        let counts = |group: &PairGroup| !self.between || group.pairs.first().is_some_and(apart);
        let groups = (0..).zip(&world.lists.groups).filter(|(_, group)| counts(group));
        self.due = groups.map(|(group, _)| Reverse(DueGroup { at: WatchClock(ever), group })).collect();
        self.of_robot = vec![Vec::new(); scene.robots().len()];
        for Reverse(DueGroup { group, .. }) in &self.due {
            let pair = world.lists.groups[*group as usize].pairs.first();
            let robots = pair.map_or([None; 2], |(i, j)| [robot(*i), robot(*j)]);
            let other = robots[1].filter(|other| robots[0] != Some(*other));
            for robot in [robots[0], other].into_iter().flatten() {
                self.of_robot[robot].push(*group);
            }
        }
        self.of_robot.iter_mut().for_each(|groups| groups.sort_unstable());
        self.placement = E::Placement::default();
        self.found.clear();
        self.scene = scene;
    }

    /// The monitored scene.
    pub fn scene(&self) -> &Arc<Scene<E>> {
        &self.scene
    }

    /// Counters since creation: the actual cost of a stream of configurations.
    pub fn counters(&self) -> WatchCounters {
        self.counters
    }

    /// Returns the contacts at the next configurations of the stream: the same as [`Scene::contacts`], sorted by pair.
    ///
    /// # Arguments
    /// * `poses`: motor positions per robot, rad of encoder; a robot or motor without an entry is at home.
    ///
    /// # Performance
    /// Nothing is placed or measured while no pair can have come closer than the margin; a jump costs as much as a full
    /// query.
    pub fn update<P: AsRef<[f64]>>(&mut self, poses: &[P]) -> &[Contact] {
        self.counters.updates += 1;
        if !self.advance(poses) && !std::mem::take(&mut self.partial) {
            self.counters.idle += 1;
            return &self.found;
        }
        self.partial = false;
        self.found.clear();
        // The common clock is never slower than any group's, so no group is due earlier than its entry in the heap.
        // `settled` excludes the deviations of the motors: these decrease when the motors return, so a due time must
        // not depend on them.
        let now: f64 = self.motors.iter().map(|m| m.fastest * (m.traveled + m.since_turn)).sum();
        let settled: f64 = self.motors.iter().map(|m| m.fastest * m.traveled).sum();
        let mut placed = false;
        let mut again = Vec::new();
        while let Some(&Reverse(DueGroup { at: WatchClock(due), group: g })) = self.due.peek() {
            if now < due {
                break;
            }
            self.due.pop();
            let (first, clock) = self.check_group(g, (self.within, None), poses, &mut placed);
            again.push(Reverse(DueGroup { at: WatchClock(settled + (first - clock)), group: g }));
        }
        // Inserted after the loop: a group with a contact is due again at once, and would be popped forever.
        self.due.extend(again);
        if !placed {
            self.counters.idle += 1;
        }
        self.found.sort_unstable_by_key(|c| c.pair);
        &self.found
    }

    /// Returns the contacts at the next configurations of the stream, for the pairs of these groups only, sorted by
    /// pair: those closer than the distance for which the groups were found, or than the watch's own margin.
    ///
    /// # Arguments
    /// * `poses`: as for [`Watch::update`].
    /// * `groups`: of the same scene.
    pub fn update_of<P: AsRef<[f64]>>(&mut self, poses: &[P], groups: &PairGroups) -> &[Contact] {
        self.counters.updates += 1;
        self.advance(poses);
        self.partial = true;
        self.found.clear();
        let mut placed = false;
        for g in &groups.groups {
            self.check_group(*g, (groups.within, None), poses, &mut placed);
        }
        if !placed {
            self.counters.idle += 1;
        }
        self.found.sort_unstable_by_key(|c| c.pair);
        &self.found
    }

    /// Returns the groups of a robot's pairs that may come closer than a distance while no motor is farther from these
    /// configurations than its range. Pairs of all other groups stay farther apart.
    ///
    /// # Arguments
    /// * `poses`: as for [`Watch::update`]: the next configurations of the stream.
    /// * `ranges`: per motor, in the order of the scene's robots and their motors, rad of encoder.
    /// * `within`: the distance, meters; at most the watch's margin is used.
    pub fn near_groups<P: AsRef<[f64]>>(
        &mut self,
        robot: usize,
        poses: &[P],
        ranges: &[f64],
        within: f64,
    ) -> PairGroups {
        let within = within.min(self.within);
        self.counters.updates += 1;
        self.advance(poses);
        self.partial = true;
        self.found.clear();
        let Some(groups) = self.of_robot.get_mut(robot).map(std::mem::take) else { return PairGroups::default() };
        let mut placed = false;
        let scene = self.scene.clone();
        let mut near = Vec::new();
        for g in &groups {
            let travel = &scene.world().lists.groups[*g as usize].travel;
            let range = |motor: u32| ranges.get(motor as usize).copied().unwrap_or_default();
            let range: f64 = travel.iter().map(|term| term.reach * range(term.motor)).sum();
            let (first, clock) = self.check_group(*g, (within, Some(range)), poses, &mut placed);
            if clock >= first {
                near.push(*g);
            }
        }
        self.of_robot[robot] = groups;
        PairGroups { groups: near, within }
    }

    /// Checks the pairs of a group that may be closer than a distance of at most the margin, or would be if their clock
    /// advanced by a range, meters.
    ///
    /// # Returns
    /// The earliest due time of its pairs, and the group's clock; with a range, the clock includes the range and the
    /// motors' deviations.
    fn check_group<P: AsRef<[f64]>>(
        &mut self,
        g: u32,
        (within, range): (f64, Option<f64>),
        poses: &[P],
        placed: &mut bool,
    ) -> (f64, f64) {
        let bodies = self.scene.bodies();
        let world = self.scene.world();
        let group = &world.lists.groups[g as usize];
        let expiries = &mut self.groups[g as usize];
        let mut clock = 0.0;
        let mut stray = 0.0;
        for term in &group.travel {
            let motor = &self.motors[term.motor as usize];
            clock += term.reach * motor.traveled;
            stray += term.reach * motor.since_turn;
        }
        let within = within.min(self.within);
        // Due times refer to the margin: for a smaller distance they are later by the difference.
        let until = clock + stray + range.unwrap_or(0.0) - (self.within - within);
        let first = expiries.renew(&group.pairs, until, |pair| {
            // Forward kinematics only if a pair is due: most configurations of a moving robot need none.
            if !*placed {
                bodies.place(poses, &mut self.frames);
                world.engine.place_frames(&self.frames, &mut self.placement);
                *placed = true;
            }
            world.engine.place_pair(&mut self.placement, pair);
            self.counters.looked += 1;
            let enough = within + range.unwrap_or(0.0) + MEASURE_RANGE_M;
            let distance = match world.engine.near(&self.placement, pair, enough) {
                Near::Within(proximity) => {
                    self.counters.measured += 1;
                    if world.is_near(pair, proximity.distance, within) {
                        self.found.push(world.contact(PairProximity { pair, proximity }));
                    }
                    proximity.distance
                }
                Near::Beyond(distance) => {
                    self.counters.measured += u64::from(distance <= enough);
                    distance
                }
            };
            // The motors deviate from their turning points now, so they can get farther from here than their clocks
            // will advance, by at most `stray`: subtract it. A contact has expired already, so it is checked again at
            // every update while it lasts.
            clock + (distance - self.within) - stray - ROUNDING_M
        });
        (first, if range.is_some() { until } else { clock })
    }

    /// Updates the travel of all motors; returns false if no motor has moved.
    fn advance<P: AsRef<[f64]>>(&mut self, poses: &[P]) -> bool {
        let robots = self.scene.robots().iter().enumerate();
        let positions = robots.flat_map(|(r, robot)| {
            let pose = poses.get(r).map_or(&[][..], AsRef::as_ref);
            robot.motors.iter().enumerate().map(|(k, motor)| pose.get(k).copied().unwrap_or(motor.home))
        });
        let moved = self.motors.iter_mut().zip(positions).fold(false, |moved, (motor, q)| motor.follow(q) | moved);
        // A scene whose robots have no motors may have contacts, too.
        moved || self.motors.is_empty()
    }
}
