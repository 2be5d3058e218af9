//! The contacts of a stream of poses, at little more than the cost of what changed.
//!
//! Each pair that was found apart stays so until the motors have moved far enough: pairs of the same two frames share a
//! clock that runs in metres, the sum of `reach * way of motor` (see `scene/travel.rs`), and a pair is looked at again when its
//! clock has run as far as the pair had room. A motor's way counts only beyond a small band about its last
//! turning point, so that the noise of an encoder at rest does not run the clocks.

use crate::collision::{Placement, bound, measure};
use crate::scene::{Contact, Scene};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

/// How far a motor may stray, rad, before its way counts: above the noise of an encoder, below what matters.
const BAND: f64 = 1e-3;
/// Room that is worth measuring exactly, metres: a pair with more is left with its bound.
const ROOM: f64 = 0.02;
/// Subtracted from each room for rounding, metres.
const HAIR: f64 = 1e-9;

/// What a [`Watch`] has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
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
#[derive(Clone, Debug)]
pub struct Watch {
    scene: Arc<Scene>,
    within: f64,
    /// Per motor: the last pose, its turning point, the way up to that, and how far it is from it.
    last: Vec<f64>,
    anchor: Vec<f64>,
    way: Vec<f64>,
    astray: Vec<f64>,
    /// Per motor: the greatest reach in any group. Runs a clock that is never slower than a group's.
    fastest: Vec<f64>,
    /// When, on that clock, each group is due.
    due: BinaryHeap<Reverse<(Clock, u32)>>,
    groups: Vec<Expiries>,
    placement: Placement,
    found: Vec<Contact>,
    counters: Counters,
}

/// Per pair of a group: the time on the group's clock at which it must be looked at.
#[derive(Clone, Debug, Default)]
struct Expiries(Vec<f64>);

/// A time on a clock, ordered; nothing is due before a time that is not a number.
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

impl Watch {
    /// Watches for reflex pairs nearer than `within` metres.
    pub fn new(scene: Arc<Scene>, within: f64) -> Self {
        let mut watch = Watch {
            scene: scene.clone(),
            within,
            last: Vec::new(),
            anchor: Vec::new(),
            way: Vec::new(),
            astray: Vec::new(),
            fastest: Vec::new(),
            due: BinaryHeap::new(),
            groups: Vec::new(),
            placement: Placement::default(),
            found: Vec::new(),
            counters: Counters::default(),
        };
        watch.set_scene(scene);
        watch
    }

    /// Goes on with another scene, such as one after an edit. The next update looks at every pair.
    pub fn set_scene(&mut self, scene: Arc<Scene>) {
        let (motors, world) = (scene.bodies().motors, scene.world());
        self.last = vec![f64::NAN; motors];
        self.anchor = vec![0.0; motors];
        self.way = vec![0.0; motors];
        self.astray = vec![0.0; motors];
        self.fastest = vec![0.0; motors];
        for (m, reach) in world.groups.iter().flat_map(|g| &g.travel) {
            let fastest = &mut self.fastest[*m as usize];
            *fastest = fastest.max(*reach);
        }
        self.groups = world.groups.iter().map(|g| Expiries(vec![f64::NEG_INFINITY; g.pairs.len()])).collect();
        self.due = (0..world.groups.len()).map(|g| Reverse((Clock(f64::NEG_INFINITY), g as u32))).collect();
        self.placement = Placement::default();
        self.placement.solids_unplaced(&world.solids);
        self.found.clear();
        self.scene = scene;
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// What it has done so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The contacts at these poses: the same as [`Scene::contacts`], sorted by pair.
    pub fn update<P: AsRef<[f64]>>(&mut self, poses: &[P]) -> &[Contact] {
        self.counters.updates += 1;
        if !self.advance(poses) {
            self.counters.idle += 1;
            return &self.found;
        }
        self.found.clear();
        let now: f64 = self.fastest.iter().zip(self.way.iter().zip(&self.astray)).map(|(r, (w, a))| r * (w + a)).sum();
        let settled: f64 = self.fastest.iter().zip(&self.way).map(|(r, w)| r * w).sum();
        let scene = self.scene.clone();
        let (bodies, world) = (scene.bodies(), scene.world());
        let mut placed = false;
        let mut again = Vec::new();
        while let Some(&Reverse((Clock(due), g))) = self.due.peek() {
            if now < due {
                break;
            }
            self.due.pop();
            let (group, expiries) = (&world.groups[g as usize], &mut self.groups[g as usize]);
            let (mut clock, mut stray) = (0.0, 0.0);
            for (m, reach) in &group.travel {
                clock += reach * self.way[*m as usize];
                stray += reach * self.astray[*m as usize];
            }
            let mut first = f64::INFINITY;
            for (expiry, &(i, j)) in expiries.0.iter_mut().zip(&group.pairs) {
                if clock + stray < *expiry {
                    first = first.min(*expiry);
                    continue;
                }
                if !placed {
                    bodies.place(poses, &mut self.placement.frames);
                    placed = true;
                }
                self.placement.solid(&world.solids, i);
                self.placement.solid(&world.solids, j);
                self.counters.looked += 1;
                let enough = self.within + ROOM;
                let mut distance = bound(&world.solids, &self.placement, i, j, enough);
                if distance <= enough {
                    self.counters.measured += 1;
                    match measure(&world.solids, &self.placement, i, j, enough) {
                        Some(contact) => {
                            distance = contact.distance;
                            if distance < self.within || distance <= 0.0 {
                                self.found.push(contact);
                            }
                        }
                        None => distance = enough,
                    }
                }
                *expiry = clock + (distance - self.within) - stray - HAIR;
                first = first.min(*expiry);
            }
            again.push(Reverse((Clock(settled + (first - clock)), g)));
        }
        self.due.extend(again);
        if !placed {
            self.counters.idle += 1;
        }
        self.found.sort_unstable_by_key(|c| c.pair);
        &self.found
    }

    /// Runs the motors' ways on; false if no motor has moved at all.
    fn advance<P: AsRef<[f64]>>(&mut self, poses: &[P]) -> bool {
        let scene = self.scene.clone();
        let mut moved = false;
        let mut m = 0;
        for (r, robot) in scene.robots().iter().enumerate() {
            let pose = poses.get(r).map_or(&[][..], AsRef::as_ref);
            for (k, motor) in robot.motors.iter().enumerate() {
                let q = pose.get(k).copied().unwrap_or(motor.home);
                if q != self.last[m] {
                    moved = true;
                    self.last[m] = q;
                    let astray = (q - self.anchor[m]).abs();
                    if astray > BAND {
                        self.way[m] += astray;
                        self.anchor[m] = q;
                        self.astray[m] = 0.0;
                    } else {
                        self.astray[m] = astray;
                    }
                }
                m += 1;
            }
        }
        moved || scene.bodies().motors == 0
    }
}
