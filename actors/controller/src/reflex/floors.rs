//! Least distances that pairs may come to while a robot moves out of contact: those that they had on the way there.

use crate::Rules;
use mobee_contract::Time;
use mobee_model::Contact;
use std::collections::VecDeque;

/// Number of motions with recorded distances.
const MAX_MOTIONS: usize = 64;
/// Least distance of a pair that must stay separate, meters: a few times the effect of encoder noise on a distance. A
/// pair that was less than twice as far apart at the start counts as touching.
const MIN_SEPARATION_M: f64 = 3e-4;

/// Least distances of the pairs while the robot moves out of contact: no contact may begin, and none may get deeper
/// than before.
///
/// The margin alone is no criterion: a retreat begins in contact, so a watch that stops at the margin would stop
/// every retreat at once, and without a watch the robot would push through objects that have come into its way since
/// (I9, I24).
#[derive(Clone, Debug, Default)]
pub struct ClearanceFloors {
    /// Floor of a pair that has not been closer, meters.
    margin: f64,
    /// Contacts with the least distances read so far.
    least: Vec<Contact>,
}

impl ClearanceFloors {
    /// Starts with the pairs near the robot as it was stopped or sets out.
    pub fn new(margin: f64, near: &[Contact]) -> ClearanceFloors {
        ClearanceFloors { margin, least: near.to_vec() }
    }

    /// Includes the pairs near the robot in another reading before its retreat, whose path leads through there again.
    /// The least distance of each pair counts.
    pub fn note(&mut self, near: &[Contact]) {
        for c in near {
            match self.least.iter_mut().find(|l| l.pair == c.pair) {
                Some(least) if least.distance <= c.distance => {}
                Some(least) => *least = *c,
                None => self.least.push(*c),
            }
        }
    }

    /// Includes the least distances of other floors.
    pub fn join(&mut self, others: ClearanceFloors) {
        self.note(&others.least);
    }

    /// Returns the pairs that touched, each at its least distance: the contacts of the retreat in the journal.
    pub fn touched(&self) -> Vec<Contact> {
        self.least.iter().filter(|c| c.distance < self.margin).copied().collect()
    }

    /// Returns the first pair that is closer than its floor by more than [`Rules::floor_allowance`], since an object
    /// that the robot presses against yields a little as the robot starts. Separate pairs must stay separate.
    pub fn broken<'a>(&self, near: &'a [Contact], rules: &Rules) -> Option<&'a Contact> {
        near.iter().find(|c| {
            let least = self.least.iter().find(|l| l.pair == c.pair).map_or(self.margin, |l| l.distance);
            let start = least.min(self.margin);
            let touches = start > 2.0 * MIN_SEPARATION_M && c.distance < MIN_SEPARATION_M;
            touches || c.distance < start - rules.floor_allowance(start)
        })
    }
}

/// Least distances in the robot's latest motions: a retreat through several of them passes there again.
#[derive(Clone, Debug)]
pub struct RecentClearances {
    /// Distance below which a pair is recorded, meters.
    margin: f64,
    /// For each motion, oldest first: the time of the last reading with a recorded pair, and the least distances.
    motions: VecDeque<(Time, ClearanceFloors)>,
}

impl RecentClearances {
    /// Starts without motions.
    pub fn new(margin: f64) -> RecentClearances {
        RecentClearances { margin, motions: VecDeque::new() }
    }

    /// Begins a motion.
    pub fn begin(&mut self) {
        // A motion without recorded pairs is removed.
        self.motions.pop_back_if(|(_, floors)| floors.least.is_empty());
        if self.motions.len() >= MAX_MOTIONS {
            self.motions.pop_front();
        }
        self.motions.push_back((Time::ZERO, ClearanceFloors::new(self.margin, &[])));
    }

    /// Records the pairs near the robot in a reading of the newest motion.
    pub fn note(&mut self, near: &[Contact], at: Time) {
        let Some((last, floors)) = self.motions.back_mut() else { return };
        for c in near.iter().filter(|c| c.distance < self.margin) {
            *last = at;
            floors.note(std::slice::from_ref(c));
        }
    }

    /// Returns the least distances in all motions with a recorded pair at or after this time.
    pub fn since(&self, time: Time) -> ClearanceFloors {
        let mut all = ClearanceFloors::new(self.margin, &[]);
        self.motions.iter().filter(|(last, _)| *last >= time).for_each(|(_, floors)| all.note(&floors.least));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DEEPER;
    use crate::joint_retreat::tests::rules;
    use crate::reflex::contacts::tests::{MARGIN, near};
    use mobee_contract::Axis;

    /// A retreat through several motions may come as close as each of them did, and no closer.
    #[test]
    fn least_distances_are_recorded_per_motion() {
        let mut recent = RecentClearances::new(MARGIN);
        recent.note(&[near(9, 1.0)], Time::ZERO);
        let at = Time::from_secs;
        for (secs, mm) in [(1.0, 4.0), (2.0, 6.0), (3.0, 20.0), (4.0, 8.0)] {
            recent.begin();
            recent.note(&[near(1, mm)], at(secs));
            recent.note(&[near(1, mm + 1.0), near(2, 30.0)], at(secs + 0.1));
            recent.note(&[], at(secs + 0.9));
        }
        let nearest = |recent: &RecentClearances, secs: f64| {
            recent.since(at(secs)).touched().first().map(|c| (c.distance * 1e3).round())
        };
        assert_eq!(
            [0.0, 1.1, 1.5, 2.1, 2.5, 4.1, 4.5].map(|secs| nearest(&recent, secs)),
            [Some(4.0), Some(4.0), Some(6.0), Some(6.0), Some(8.0), Some(8.0), None]
        );
        for secs in 5..5 + MAX_MOTIONS {
            recent.begin();
            recent.note(&[near(1, 9.0)], at(secs as f64));
        }
        assert_eq!(nearest(&recent, 0.0), Some(9.0), "older ones are forgotten");
    }

    /// On its way out of contact the robot may come as close as it has been, and to the margin elsewhere, with a
    /// tolerance of a millimeter.
    #[test]
    fn nothing_comes_nearer_than_it_has_been() {
        let mut floors = ClearanceFloors::new(MARGIN, &[near(1, 4.0), near(2, 15.0)]);
        let rules = rules(true);
        let broken = |floors: &ClearanceFloors, node, mm| {
            let near = [near(9, 30.0), near(node, mm)];
            floors.broken(&near, &rules).map(|c| c.pair)
        };
        let hit = |node| Some(near(node, 0.0).pair);
        assert_eq!((broken(&floors, 1, 3.1), broken(&floors, 1, 2.9)), (None, hit(1)));
        assert_eq!((broken(&floors, 2, 9.1), broken(&floors, 2, 8.9)), (None, hit(2)), "it was free");
        assert_eq!((broken(&floors, 3, 9.1), broken(&floors, 3, 8.9)), (None, hit(3)), "it was not near");
        let apart = ClearanceFloors::new(MARGIN, &[near(1, 0.8), near(2, 0.15)]);
        assert_eq!((broken(&apart, 1, 0.4), broken(&apart, 1, 0.2)), (None, hit(1)), "separate pairs stay separate");
        assert_eq!(broken(&apart, 2, -0.5), None, "within encoder noise of touching");
        let granted = Contact { distance: MARGIN - DEEPER, ..near(3, 0.0) };
        assert_eq!(floors.broken(&[granted], &rules), None, "all of the millimeter");
        floors.note(&[near(1, 2.0), near(2, 16.0), near(3, 5.0)]);
        floors.note(&[near(1, 6.0)]);
        assert_eq!((broken(&floors, 1, 1.1), broken(&floors, 1, 0.9)), (None, hit(1)), "the deepest counts");
        assert_eq!((broken(&floors, 3, 4.1), broken(&floors, 3, 3.9)), (None, hit(3)));
        assert_eq!(floors.touched(), [near(1, 2.0), near(3, 5.0)]);
        assert_eq!(ClearanceFloors::new(MARGIN, &[near(1, 10.0)]).touched(), []);
    }

    /// An arm that sags leaves its recorded path: a pair may get half as close as it has been.
    #[test]
    fn an_arm_whose_joints_give_way_is_granted_half_of_the_distance() {
        let mut rules = Rules::clone(&rules(true));
        rules.axes = rules.axes.iter().map(|axis| Axis { deflection: 0.02, ..axis.clone() }).collect();
        let floors = ClearanceFloors::new(MARGIN, &[near(1, 4.0), near(2, 0.8)]);
        for (node, mm, stops) in [(1, 2.1, false), (1, 1.9, true), (3, 5.1, false), (3, 4.9, true), (2, 0.25, true)] {
            assert_eq!(floors.broken(&[near(node, mm)], &rules).is_some(), stops, "{node} at {mm} mm");
        }
    }
}
