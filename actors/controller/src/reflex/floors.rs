//! How near pairs may come while a robot backs out of contact: as near as they have been, on the way there.

use crate::Rules;
use mobee_contract::Time;
use mobee_model::Contact;
use std::collections::VecDeque;

/// Of how many motions that came near something it is known how near.
const MOTIONS: usize = 64;
/// What does not touch keeps so far apart, meters: a few times what encoders' noise makes of a distance. What was less than twice as far apart
/// as it set out can't be told from what touches.
const APART: f64 = 3e-4;

/// How near pairs may come while the robot backs out of contact: none begins, none gets deeper than it has been.
///
/// The margin alone can't tell: a retreat begins in contact, so a watch that stops at the margin would stop every
/// retreat at once, and one that is off would push through whatever came into the way since (I9, I24).
#[derive(Clone, Debug, Default)]
pub struct Floors {
    /// What a pair may come to that has not been nearer, meters.
    margin: f64,
    /// The least distances that were read so far.
    least: Vec<Contact>,
}

impl Floors {
    /// From the pairs near the robot as it was stopped, or sets out.
    pub fn new(margin: f64, near: &[Contact]) -> Floors {
        Floors { margin, least: near.to_vec() }
    }

    /// The pairs near it in another reading, before it is taken back: the way leads through there again. The nearest of
    /// each pair counts.
    pub fn note(&mut self, near: &[Contact]) {
        for c in near {
            match self.least.iter_mut().find(|l| l.pair == c.pair) {
                Some(least) if least.distance <= c.distance => {}
                Some(least) => *least = *c,
                None => self.least.push(*c),
            }
        }
    }

    /// What else pairs have come to.
    pub fn join(&mut self, others: Floors) {
        self.note(&others.least);
    }

    /// The pairs that touched, each where it was nearest: what the journal tells a retreat to be from.
    pub fn touched(&self) -> Vec<Contact> {
        self.least.iter().filter(|c| c.distance < self.margin).copied().collect()
    }

    /// The first pair that is nearer than it may be, by more than [`Rules::floor_allowance`]: what presses against something gives a
    /// little as it starts. What was apart stays apart.
    pub fn broken<'a>(&self, near: &'a [Contact], rules: &Rules) -> Option<&'a Contact> {
        near.iter().find(|c| {
            let least = self.least.iter().find(|l| l.pair == c.pair).map_or(self.margin, |l| l.distance);
            let start = least.min(self.margin);
            let touches = start > 2.0 * APART && c.distance < APART;
            touches || c.distance < start - rules.floor_allowance(start)
        })
    }
}

/// How near pairs came in the robot's latest motions: a way back that leads through several of them passes there once more.
#[derive(Clone, Debug)]
pub struct Lately {
    /// What counts as near, meters.
    margin: f64,
    /// Of each motion, oldest first: the last reading in which something was near, and how near pairs came in it.
    motions: VecDeque<(Time, Floors)>,
}

impl Lately {
    /// None yet.
    pub fn new(margin: f64) -> Lately {
        Lately { margin, motions: VecDeque::new() }
    }

    /// A motion begins.
    pub fn begin(&mut self) {
        // one that came near nothing is not kept
        self.motions.pop_back_if(|(_, floors)| floors.least.is_empty());
        if self.motions.len() >= MOTIONS {
            self.motions.pop_front();
        }
        self.motions.push_back((Time::ZERO, Floors::new(self.margin, &[])));
    }

    /// The pairs near the robot in a reading of the newest motion.
    pub fn note(&mut self, near: &[Contact], at: Time) {
        let Some((last, floors)) = self.motions.back_mut() else { return };
        for c in near.iter().filter(|c| c.distance < self.margin) {
            *last = at;
            floors.note(std::slice::from_ref(c));
        }
    }

    /// How near pairs came in all motions that were near something since then.
    pub fn since(&self, time: Time) -> Floors {
        let mut all = Floors::new(self.margin, &[]);
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

    /// A way back through several motions may come as near as each of them did, and no nearer.
    #[test]
    fn what_was_passed_lately_is_known_of_each_motion() {
        let mut lately = Lately::new(MARGIN);
        lately.note(&[near(9, 1.0)], Time::ZERO);
        let at = Time::from_secs;
        for (secs, mm) in [(1.0, 4.0), (2.0, 6.0), (3.0, 20.0), (4.0, 8.0)] {
            lately.begin();
            lately.note(&[near(1, mm)], at(secs));
            lately.note(&[near(1, mm + 1.0), near(2, 30.0)], at(secs + 0.1));
            lately.note(&[], at(secs + 0.9));
        }
        let nearest =
            |lately: &Lately, secs: f64| lately.since(at(secs)).touched().first().map(|c| (c.distance * 1e3).round());
        assert_eq!(
            [0.0, 1.1, 1.5, 2.1, 2.5, 4.1, 4.5].map(|secs| nearest(&lately, secs)),
            [Some(4.0), Some(4.0), Some(6.0), Some(6.0), Some(8.0), Some(8.0), None]
        );
        for secs in 5..5 + MOTIONS {
            lately.begin();
            lately.note(&[near(1, 9.0)], at(secs as f64));
        }
        assert_eq!(nearest(&lately, 0.0), Some(9.0), "older ones are forgotten");
    }

    /// On its way out of contact the robot may come as near as it has been, and to the margin elsewhere; a millimeter
    /// is granted.
    #[test]
    fn nothing_comes_nearer_than_it_has_been() {
        let mut floors = Floors::new(MARGIN, &[near(1, 4.0), near(2, 15.0)]);
        let rules = rules(true);
        let broken = |floors: &Floors, node, mm| {
            let near = [near(9, 30.0), near(node, mm)];
            floors.broken(&near, &rules).map(|c| c.pair)
        };
        let hit = |node| Some(near(node, 0.0).pair);
        assert_eq!((broken(&floors, 1, 3.1), broken(&floors, 1, 2.9)), (None, hit(1)));
        assert_eq!((broken(&floors, 2, 9.1), broken(&floors, 2, 8.9)), (None, hit(2)), "it was free");
        assert_eq!((broken(&floors, 3, 9.1), broken(&floors, 3, 8.9)), (None, hit(3)), "it was not near");
        let apart = Floors::new(MARGIN, &[near(1, 0.8), near(2, 0.15)]);
        assert_eq!((broken(&apart, 1, 0.4), broken(&apart, 1, 0.2)), (None, hit(1)), "what is apart stays apart");
        assert_eq!(broken(&apart, 2, -0.5), None, "that touches, as far as encoders can tell");
        let granted = Contact { distance: MARGIN - DEEPER, ..near(3, 0.0) };
        assert_eq!(floors.broken(&[granted], &rules), None, "all of the millimeter");
        floors.note(&[near(1, 2.0), near(2, 16.0), near(3, 5.0)]);
        floors.note(&[near(1, 6.0)]);
        assert_eq!((broken(&floors, 1, 1.1), broken(&floors, 1, 0.9)), (None, hit(1)), "the deepest counts");
        assert_eq!((broken(&floors, 3, 4.1), broken(&floors, 3, 3.9)), (None, hit(3)));
        assert_eq!(floors.touched(), [near(1, 2.0), near(3, 5.0)]);
        assert_eq!(Floors::new(MARGIN, &[near(1, 10.0)]).touched(), []);
    }

    /// An arm that sags is not on its recorded path: it may come half as near as it has been.
    #[test]
    fn an_arm_whose_joints_give_way_is_granted_half_of_the_distance() {
        let mut rules = Rules::clone(&rules(true));
        rules.axes = rules.axes.iter().map(|axis| Axis { deflection: 0.02, ..axis.clone() }).collect();
        let floors = Floors::new(MARGIN, &[near(1, 4.0), near(2, 0.8)]);
        for (node, mm, stops) in [(1, 2.1, false), (1, 1.9, true), (3, 5.1, false), (3, 4.9, true), (2, 0.25, true)] {
            assert_eq!(floors.broken(&[near(node, mm)], &rules).is_some(), stops, "{node} at {mm} mm");
        }
    }
}
