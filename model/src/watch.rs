//! The contacts of a stream of poses, at little more than the cost of what changed.
//!
//! Each pair that was found apart stays so until the motors have moved far enough. Pairs of the same two frames are a *group*
//! and share a clock that runs in meters: the sum over the motors between the frames of `reach * way of motor` (see
//! `scene/travel.rs`). No point of one shape moves farther against the other than their clock runs, so a pair with `d` meters of
//! room is looked at again when the clock has run `d`. That never misses a contact, and at worst it looks
//! too early.
//!
//! ```text
//! room of a pair      distance - margin     |----------------------|
//! clock of its group  way of its motors     |------->                  not due: nothing is placed, nothing measured
//! ```
//! A motor's way counts only beyond a small band about its last turning point ([`MotorTrack`]): an encoder at rest is noisy,
//! and if every change of its last digit counted, the clocks would run in a robot that stands still.

use crate::engine::{DefaultEngine, Engine, IndexPair, Near, PairProximity};
use crate::scene::{Contact, Group, Scene};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

/// How far a motor may stray from its turning point, rad, before its way counts: above the noise of an encoder, below
/// what matters (at an arm's length of half a meter it is half a millimeter).
const NOISE_BAND: f64 = 1e-3;
/// How far beyond the margin a pair is measured exactly, meters. A pair with more room is left with its cheap bound, which
/// is looked at again sooner than need be; with less it would be looked at at every other pose, where exactness pays.
const MEASURE_RANGE: f64 = 0.02;
/// Pairs that are asked together whether any of them is due.
const BLOCK: usize = 32;
/// Taken off each pair's room, meters: far above the rounding of clocks that have run for days (1e6 m at 1e-16 is 1e-10),
/// far below what costs a look.
const ROUNDING: f64 = 1e-9;

/// What a [`Watch`] has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WatchCounters {
    /// Poses it was given.
    pub updates: u64,
    /// Poses for which no shape had to be placed.
    pub idle: u64,
    /// Pairs that were looked at.
    pub looked: u64,
    /// Pairs that were measured exactly.
    pub measured: u64,
}

/// Follows a scene's contacts through a stream of poses. [`Watch::update`] returns just what [`Scene::contacts`] would.
///
/// # Example
/// ```
/// use mobee_model::{Scene, Watch, load_robot};
/// use nalgebra::Isometry3;
/// use std::sync::Arc;
///
/// let robot = Arc::new(load_robot("../configs/robots/katana.xml")?.value);
/// let scene = Arc::new(Scene::new(vec![(robot, Isometry3::identity())], Vec::new())?);
/// let mut watch = Watch::new(scene, 0.01);
/// let mut pose = watch.scene().home()[0].to_vec();
/// for _ in 0..100 {
///     // A tenth of a milliradian at a time the first motor goes on: nothing comes near.
///     pose[0] += 1e-4;
///     assert!(watch.update(&[&pose]).is_empty());
/// }
/// // Most of these poses cost no more than a comparison.
/// assert!(watch.counters().idle > 50, "{:?}", watch.counters());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Watch<E: Engine = DefaultEngine> {
    /// Whose contacts are followed.
    scene: Arc<Scene<E>>,
    /// The margin, meters.
    within: f64,
    /// Whether only pairs of two robots are followed.
    between: bool,
    /// Per motor of the scene: how far it has gone.
    motors: Vec<MotorTrack>,
    /// When, on the common clock, each group is due; a heap, so that a pose at which none is costs one comparison.
    due: BinaryHeap<Reverse<Due>>,
    /// In the order of the scene's groups.
    groups: Vec<Expiries>,
    /// Per robot the groups of its pairs.
    of_robot: Vec<Vec<u32>>,
    /// Whether the last update looked at some groups only.
    partial: bool,
    /// `world_from_frame` at the last pose at which a pair was looked at.
    frames: Vec<nalgebra::Isometry3<f64>>,
    /// The shapes at that pose, as far as they were looked at.
    placement: E::Placement,
    /// The contacts at the last pose, sorted by pair.
    found: Vec<Contact>,
    counters: WatchCounters,
}

/// How far a motor has gone. Between two poses it has moved by no more than the later `traveled` less the earlier one, plus
/// both `since_turn`: the triangle inequality through the turning points.
#[derive(Clone, Copy, Debug)]
struct MotorTrack {
    /// The last position, rad of encoder; not a number before the first.
    last_q: f64,
    /// Where it last left the noise band, rad of encoder: the middle of the band it is in now.
    turning_point: f64,
    /// Its way up to the turning point, rad. Only grows.
    traveled: f64,
    /// How far it is from the turning point now, rad. Falls when the motor comes back.
    since_turn: f64,
    /// The greatest reach that it has in any group, meters per rad: what it adds to the common clock.
    fastest: f64,
}

/// The times on a group's clock at which its pairs must be looked at.
#[derive(Clone, Debug)]
struct Expiries {
    /// Per pair.
    pairs: Vec<f64>,
    /// Per [`BLOCK`] of pairs the first of theirs: two links of many shapes make thousands of pairs, of which few are due at a time.
    blocks: Vec<f64>,
    /// The first of all.
    first: f64,
}

/// Groups of pairs of a scene, as [`Watch::near_groups`] finds them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PairGroups {
    groups: Vec<u32>,
    /// The distance up to which their pairs matter, m.
    within: f64,
}

impl PairGroups {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }
}

impl Expiries {
    /// So many pairs that were due at this time.
    fn since(time: f64, pairs: usize) -> Self {
        Self { pairs: vec![time; pairs], blocks: vec![time; pairs.div_ceil(BLOCK)], first: time }
    }

    /// Looks at the pairs that are due: `look` tells when a pair is due again.
    ///
    /// # Returns
    /// When the first of all is due.
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

/// When a group is due. Ordered by time, then by group.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Due {
    /// On the common clock.
    at: Clock,
    /// Index of the group.
    group: u32,
}

/// A time on a clock that runs in meters, ordered; nothing is due before a time that is not a number.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Clock(f64);

impl Eq for Clock {}
impl PartialOrd for Clock {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Clock {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl MotorTrack {
    /// Follows the motor to `q`; false if it is where it was.
    fn follow(&mut self, q: f64) -> bool {
        if q == self.last_q {
            return false;
        }
        self.last_q = q;
        let astray = (q - self.turning_point).abs();
        if astray > NOISE_BAND {
            self.traveled += astray;
            self.turning_point = q;
            self.since_turn = 0.0;
        } else {
            self.since_turn = astray;
        }
        true
    }
}

impl<E: Engine> Watch<E> {
    /// Watches for reflex pairs nearer than a margin.
    ///
    /// # Arguments
    /// * `scene`: whose robots the poses will be of.
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

    /// The same, but only for pairs of which each shape is another robot's.
    pub fn between_robots(scene: Arc<Scene<E>>, within: f64) -> Self {
        let mut watch = Self::new(scene.clone(), within);
        watch.between = true;
        watch.set_scene(scene);
        watch
    }

    /// Goes on with another scene, such as one after an edit. The margin stays, as do the counters.
    ///
    /// # Performance
    /// Nothing that was known of pairs is kept, as their numbers may mean others now: the next update looks at every pair.
    pub fn set_scene(&mut self, scene: Arc<Scene<E>>) {
        let (motors, world) = (scene.bodies().motors, scene.world());
        let unknown = MotorTrack { last_q: f64::NAN, turning_point: 0.0, traveled: 0.0, since_turn: 0.0, fastest: 0.0 };
        self.motors = vec![unknown; motors];
        for term in world.groups.iter().flat_map(|g| &g.travel) {
            let motor = &mut self.motors[term.motor as usize];
            motor.fastest = motor.fastest.max(term.reach);
        }
        // Expired since ever: nothing is known of any pair.
        let ever = f64::NEG_INFINITY;
        self.groups = world.groups.iter().map(|g| Expiries::since(ever, g.pairs.len())).collect();
        // the pairs of a group are of the same two frames, so its first speaks for all; what is never due is never looked at
        let robot = |k: u32| world.solids[k as usize].id.robot();
        let apart = |(i, j): &IndexPair| robot(*i).is_some() && robot(*j).is_some() && robot(*i) != robot(*j);
        let counts = |group: &Group| !self.between || group.pairs.first().is_some_and(apart);
        let groups = (0..).zip(&world.groups).filter(|(_, group)| counts(group));
        self.due = groups.map(|(group, _)| Reverse(Due { at: Clock(ever), group })).collect();
        self.of_robot = vec![Vec::new(); scene.robots().len()];
        for Reverse(Due { group, .. }) in &self.due {
            let pair = world.groups[*group as usize].pairs.first();
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

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene<E>> {
        &self.scene
    }

    /// What it has done so far: how much a stream of poses really costs.
    pub fn counters(&self) -> WatchCounters {
        self.counters
    }

    /// The contacts at the next poses of the stream: the same as [`Scene::contacts`], sorted by pair.
    ///
    /// # Arguments
    /// * `poses`: per robot its motors' positions, rad of encoder; a robot or motor without an entry is at home.
    ///
    /// # Performance
    /// Nothing is placed or measured while no pair can have come nearer than the margin; a jump costs as much as a full query.
    pub fn update<P: AsRef<[f64]>>(&mut self, poses: &[P]) -> &[Contact] {
        self.counters.updates += 1;
        if !self.advance(poses) && !std::mem::take(&mut self.partial) {
            self.counters.idle += 1;
            return &self.found;
        }
        self.partial = false;
        self.found.clear();
        // The common clock is never slower than any group's, so no group is due before the heap says so. `settled` leaves
        // out what the motors are astray by: that falls again when they come back, and a due time must not rest on it.
        let now: f64 = self.motors.iter().map(|m| m.fastest * (m.traveled + m.since_turn)).sum();
        let settled: f64 = self.motors.iter().map(|m| m.fastest * m.traveled).sum();
        let mut placed = false;
        let mut again = Vec::new();
        while let Some(&Reverse(Due { at: Clock(due), group: g })) = self.due.peek() {
            if now < due {
                break;
            }
            self.due.pop();
            let (first, clock) = self.look_at(g, (self.within, None), poses, &mut placed);
            again.push(Reverse(Due { at: Clock(settled + (first - clock)), group: g }));
        }
        // Only now: a group with a contact is due again at once, and would be popped forever.
        self.due.extend(again);
        if !placed {
            self.counters.idle += 1;
        }
        self.found.sort_unstable_by_key(|c| c.pair);
        &self.found
    }

    /// The contacts at the next poses of the stream, of the pairs of these groups alone, sorted by pair: those nearer than the distance up
    /// to which they were found, or than the watch's own margin.
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
            self.look_at(*g, (groups.within, None), poses, &mut placed);
        }
        if !placed {
            self.counters.idle += 1;
        }
        self.found.sort_unstable_by_key(|c| c.pair);
        &self.found
    }

    /// The groups of a robot's pairs that may come nearer than a distance while no motor is farther from these poses than its range. Of all
    /// others no pair does.
    ///
    /// # Arguments
    /// * `poses`: as for [`Watch::update`]: the next of the stream.
    /// * `ranges`: per motor, in the order of the scene's robots and their motors, rad of encoder.
    /// * `within`: that distance, m, at most the watch's margin.
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
            let travel = &scene.world().groups[*g as usize].travel;
            let range = |motor: u32| ranges.get(motor as usize).copied().unwrap_or_default();
            let range: f64 = travel.iter().map(|term| term.reach * range(term.motor)).sum();
            let (first, clock) = self.look_at(*g, (within, Some(range)), poses, &mut placed);
            if clock >= first {
                near.push(*g);
            }
        }
        self.of_robot[robot] = groups;
        PairGroups { groups: near, within }
    }

    /// Looks at the pairs of a group that may be nearer than a distance of at most the margin, or would be if their clock ran on by a range,
    /// meters.
    ///
    /// # Returns
    /// When the first of its pairs is due again; and its clock, with the range and what its motors are astray by if there is a range.
    fn look_at<P: AsRef<[f64]>>(
        &mut self,
        g: u32,
        (within, range): (f64, Option<f64>),
        poses: &[P],
        placed: &mut bool,
    ) -> (f64, f64) {
        let (bodies, world) = (self.scene.bodies(), self.scene.world());
        let (group, expiries) = (&world.groups[g as usize], &mut self.groups[g as usize]);
        let (mut clock, mut stray) = (0.0, 0.0);
        for term in &group.travel {
            let motor = &self.motors[term.motor as usize];
            clock += term.reach * motor.traveled;
            stray += term.reach * motor.since_turn;
        }
        let within = within.min(self.within);
        // pairs are due by the margin: by a lesser distance they are due so much later
        let until = clock + stray + range.unwrap_or(0.0) - (self.within - within);
        let first = expiries.renew(&group.pairs, until, |pair| {
            // Kinematics only once a pair is really looked at: most poses of a moving robot need none.
            if !*placed {
                bodies.place(poses, &mut self.frames);
                world.engine.place_frames(&self.frames, &mut self.placement);
                *placed = true;
            }
            world.engine.place_pair(&mut self.placement, pair);
            self.counters.looked += 1;
            let enough = within + range.unwrap_or(0.0) + MEASURE_RANGE;
            let distance = match world.engine.near(&self.placement, pair, enough) {
                Near::Within(proximity) => {
                    self.counters.measured += 1;
                    if proximity.distance < within || proximity.distance <= 0.0 {
                        self.found.push(world.contact(PairProximity { pair, proximity }));
                    }
                    proximity.distance
                }
                Near::Beyond(distance) => {
                    self.counters.measured += u64::from(distance <= enough);
                    distance
                }
            };
            // Where the motors stand now they are astray from their turning points, so that they can get farther from
            // here than their clocks will run, by `stray` at most: taken off. A contact has expired already, so that
            // it is looked at again at every pose while it lasts.
            clock + (distance - self.within) - stray - ROUNDING
        });
        (first, if range.is_some() { until } else { clock })
    }

    /// Runs the motors' ways on; false if no motor has moved at all.
    fn advance<P: AsRef<[f64]>>(&mut self, poses: &[P]) -> bool {
        let robots = self.scene.robots().iter().enumerate();
        let positions = robots.flat_map(|(r, robot)| {
            let pose = poses.get(r).map_or(&[][..], AsRef::as_ref);
            robot.motors.iter().enumerate().map(|(k, motor)| pose.get(k).copied().unwrap_or(motor.home))
        });
        let moved = self.motors.iter_mut().zip(positions).fold(false, |moved, (motor, q)| motor.follow(q) | moved);
        // A scene whose robots have no motors has contacts all the same.
        moved || self.motors.is_empty()
    }
}
