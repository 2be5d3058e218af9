//! Far along: vertices of a plan that are left out where a straight line will do, and motions that are led elsewhere on the way.
//!
//! A map of poses a centimeter apart would be driven a centimeter at a time, and come to rest at each. So the line to the plan's end is
//! tried first, then to three quarters of the way, and so on: certified if edges are, and otherwise by driving it. It becomes an edge
//! of the map, and is learned of like any other.

use super::{Doing, Walker};
use mobee_contract::{EdgeState, Intent, MotionEnd, View};

/// The shares of a plan's vertices, in quarters, that are tried to be left out.
const QUARTERS: [usize; 4] = [4, 3, 2, 1];

impl Walker {
    /// The same, leaving out vertices on the way where it can.
    pub fn with_leaps(mut self) -> Walker {
        self.leaps = true;
        self
    }

    /// The plan without its first vertices as far as one line leads past them.
    pub(super) fn leap(&mut self, path: Vec<u32>, view: &View) -> Vec<u32> {
        let Some(at) = path.first().copied() else { return path };
        for quarters in QUARTERS {
            let far = path.len().saturating_sub(1) * quarters / 4;
            let Some(to) = path.get(far).copied().filter(|_| far > 1) else { continue };
            self.map.join(at, to);
            let may = |e: &crate::roadmap::Edge| matches!(e.state, EdgeState::Optimistic | EdgeState::Feasible);
            if !self.map.edge(at, to).is_some_and(may) || !self.validator.admits(&mut self.map, &[at, to], view) {
                continue;
            }
            return [at].into_iter().chain(path.into_iter().skip(far)).collect();
        }
        path
    }

    /// Leads the motion under way to a vertex, from where the robot is by now: whoever asks for it knows that the line is free.
    /// `None`: there is no such vertex.
    pub fn turn_to(&mut self, to: u32, view: &View) -> Option<Intent> {
        let target = self.target(to, view)?;
        self.progress.doing = Doing::Turned;
        self.goto(to);
        self.show(vec![to]);
        Some(Intent::MoveTo(target))
    }

    /// The motion that ended is learned from; what is next is asked for later.
    pub fn learn(&mut self, last: Option<MotionEnd>, view: &View) {
        self.settle(last, view);
    }

    /// Gives the motion under way up: it is taken back, and its edge is not to blame.
    pub fn give_up(&mut self) -> Intent {
        self.progress.doing = Doing::Turned;
        Intent::Stop
    }
}
