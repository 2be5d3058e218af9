//! Outcomes of reaches: counts, misses by their cause, and the fallbacks if no path leads on.

use super::choice::{BATCHES_AT_REST, NoChoice};
use super::look::middle;
use super::{MAX_HOMEWARD, MAX_OTHER_POSTURES, MAX_PLANS, ReachAgent, ReachPhase};
use mobee_contract::{Intent, Summary, Time, View};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Duration;

/// Counts of the outcomes so far: part of the agent's state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Counts {
    /// Number of times that a hand was in the grasp posture.
    pub reached: u32,
    /// The same, by hand.
    #[serde(default)]
    pub by_hand: Vec<u32>,
    /// Number of misses, by cause.
    pub missed: BTreeMap<Miss, u32>,
    /// Number of times that the object moved during a reach and new postures were chosen.
    pub replanned: u32,
    /// Number of paths that a planner found.
    pub planned: u32,
    /// Time at which the hand set out, if it has not arrived yet.
    under_way: Option<Time>,
    /// Number of arrivals at the pre-grasp posture.
    arrivals: u32,
    /// Total time of these arrivals, seconds.
    seconds: f64,
    /// Largest distance of the hand from the pre-grasp position at an arrival, meters.
    off: f64,
    /// Longest time between the detection of the object and the start of the hand, seconds.
    delay: f64,
    /// Position of the object for which postures were last chosen, world frame, meters.
    pub object: [f64; 3],
    /// Position of the hand at the last arrival, world frame, meters.
    at: [f64; 3],
}

/// Cause of a miss.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Miss {
    /// No sensor detected the object, wherever the eyes looked.
    Unseen,
    /// The hand can't be brought to the object.
    OutOfReach,
    /// It can, but something blocks its last lines.
    NotFree,
    /// No path was found to the posture before it.
    NoWay,
    /// The last line failed.
    Approach,
}

impl Miss {
    const ALL: [(Miss, &str); 5] = [
        (Miss::Unseen, "missed_unseen"),
        (Miss::OutOfReach, "missed_out_of_reach"),
        (Miss::NotFree, "missed_not_free"),
        (Miss::NoWay, "missed_no_way"),
        (Miss::Approach, "missed_approach"),
    ];
}

impl Counts {
    /// Records that the hand sets out for an object first seen at `seen`.
    pub fn set_out(&mut self, now: Time, seen: Option<Time>) {
        self.under_way = Some(now);
        self.delay = seen.map_or(0.0, |seen| now.since(seen).as_secs_f64()).max(self.delay);
    }

    /// Records an arrival at the pre-grasp posture: hand position and error, meters. Repeated if
    /// the object moved on in the meantime.
    pub fn before(&mut self, now: Time, at: [f64; 3], off: f64) {
        self.at = at;
        self.off = self.off.max(off);
        if let Some(since) = self.under_way.take() {
            self.arrivals += 1;
            self.seconds += now.since(since).as_secs_f64();
        }
    }

    /// Records that a hand, an index, was in the grasp posture.
    pub fn reached_by(&mut self, hand: usize) {
        self.reached = self.reached.saturating_add(1);
        self.by_hand.resize(self.by_hand.len().max(hand + 1), 0);
        if let Some(count) = self.by_hand.get_mut(hand) {
            *count = count.saturating_add(1);
        }
    }

    pub fn ended(&self) -> u32 {
        self.missed.values().fold(self.reached, |a, b| a.saturating_add(*b))
    }
}

/// A miss: its cause, and a description.
pub(super) struct Missed {
    pub miss: Miss,
    pub why: String,
}

impl From<NoChoice> for Missed {
    fn from(why: NoChoice) -> Missed {
        match why {
            NoChoice::OutOfReach => Missed { miss: Miss::OutOfReach, why: "it is out of reach".to_owned() },
            NoChoice::NotFree(by) => Missed { miss: Miss::NotFree, why: format!("in the way: {by}") },
        }
    }
}

impl ReachAgent {
    pub(super) fn miss(&mut self, Missed { miss, why }: &Missed) {
        let count = self.mind.counts.missed.entry(*miss).or_default();
        *count = count.saturating_add(1);
        (self.mind.checks, self.mind.bumped) = (0, false);
        self.walker.log(format!("{} is not reached: {why}", self.settings.object));
    }

    /// Returns whether the number of reaches, successful or not, is complete.
    pub(super) fn is_done(&self) -> bool {
        self.settings.repeat > 0 && self.mind.counts.ended() >= self.settings.repeat
    }

    /// Handles a vertex that no path leads to. `None`: the next step of the loop continues.
    pub(super) fn no_way(&mut self, goal: u32, view: &View) -> Option<Intent> {
        let may_plan = self.mind.plans < MAX_PLANS || self.mind.phase == ReachPhase::Home;
        self.mind.plans = self.mind.plans.saturating_add(1);
        let found = if may_plan && self.mind.phase != ReachPhase::Approach { self.plan(goal, view) } else { None };
        if let Some(text) = found.as_ref().and_then(|found| found.as_ref().err()) {
            self.walker.log(format!("no plan either: {text}"));
        } else if found.is_some() {
            self.walker.goto(goal);
            return None;
        }
        // The estimated position of the object changed slightly in the meantime: choose other
        // postures from here.
        if self.mind.phase == ReachPhase::Approach && may_plan && self.choose_again(view) {
            return None;
        }
        // Other postures may be easier to reach.
        if self.mind.phase == ReachPhase::Go
            && self.mind.tried.len() < MAX_OTHER_POSTURES
            && let Some(from) = self.mind.place.as_ref().map(|place| place.from)
        {
            self.mind.tried.insert(from);
            if self.choose_again(view) {
                self.mind.plans = 0;
                return None;
            }
        }
        match self.mind.phase {
            ReachPhase::Go => self.miss(&Missed { miss: Miss::NoWay, why: "no way leads there".to_owned() }),
            ReachPhase::Approach => self.miss(&Missed { miss: Miss::Approach, why: "the last line failed".to_owned() }),
            ReachPhase::Home if self.mind.homeward >= MAX_HOMEWARD => {
                return Some(self.done("no way leads back to where the arm rests"));
            }
            ReachPhase::Home => {
                self.mind.homeward += 1;
                return Some(Intent::Wait(Duration::from_secs(1)));
            }
            ReachPhase::Look | ReachPhase::Back => {}
        }
        self.go_home();
        None
    }

    /// Handles a robot that can't reach any vertex from where it rests. The obstacle may be an
    /// outdated estimate of an object that a sensor corrects soon, so the agent waits.
    pub(super) fn lost(&mut self, why: &str) -> Intent {
        self.mind.homeward += 1;
        if self.mind.homeward > MAX_HOMEWARD {
            return self.done(why);
        }
        self.walker.log(why);
        Intent::Wait(Duration::from_secs(1))
    }

    /// Chooses postures for the current position of the object. Returns whether there are any.
    fn choose_again(&mut self, view: &View) -> bool {
        let object = middle(&self.settings.object, view);
        let pre = object.and_then(|object| self.set_out(object, &BATCHES_AT_REST, view).ok());
        pre.is_some_and(|pre| {
            self.enter_phase(ReachPhase::Go, pre);
            true
        })
    }

    pub(super) fn done(&mut self, text: &str) -> Intent {
        self.walker.show(Vec::new());
        let counts = &self.mind.counts;
        let progress = self.walker.progress();
        let mean = if counts.arrivals > 0 { counts.seconds / f64::from(counts.arrivals) } else { 0.0 };
        let object = counts.object;
        let missed = Miss::ALL.map(|(miss, name)| (name, counts.missed.get(&miss).copied().unwrap_or(0).into()));
        let others = [
            ("replanned", f64::from(counts.replanned)),
            ("plans", f64::from(counts.planned)),
            ("motions_along_edges", f64::from(progress.driven)),
            ("motions_failed", f64::from(progress.failed)),
            ("set_out_s", counts.delay),
            ("pre_grasp_s", mean),
            ("pre_grasp_off_mm", 1e3 * counts.off),
            ("object_x_mm", 1e3 * object[0]),
            ("object_y_mm", 1e3 * object[1]),
            ("object_z_mm", 1e3 * object[2]),
            ("hand_x_mm", 1e3 * counts.at[0]),
            ("hand_y_mm", 1e3 * counts.at[1]),
            ("hand_z_mm", 1e3 * counts.at[2]),
        ];
        let all = [("reached", f64::from(counts.reached))].into_iter().chain(missed).chain(others);
        let mut figures: Vec<(String, f64)> = all.map(|(name, n)| (name.to_owned(), n)).collect();
        let by = |i: usize| f64::from(counts.by_hand.get(i).copied().unwrap_or(0));
        let by_hand = (0..self.hands.len()).filter_map(|i| Some((format!("reached_by_{}", self.name_of(i)?), by(i))));
        figures.extend(by_hand.filter(|_| self.hands.len() > 1));
        Intent::Done(Summary { text: text.to_owned(), figures })
    }
}
