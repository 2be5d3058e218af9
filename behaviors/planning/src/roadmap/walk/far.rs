//! Long motions: vertices of a path are skipped if a straight line is free, and motions are
//! redirected on the way.
//!
//! On a map of poses a centimeter apart, the robot would move a centimeter at a time and stop at
//! each. Therefore the line to the end of the path is tried first, then to three quarters of it,
//! and so on: certified if edges are, and otherwise by driving it. The line becomes an edge of the
//! map like any other.

use super::{Doing, Walker};
use mobee_contract::{EdgeState, Intent, MotionEnd, View};

/// Shares of a path's vertices, in quarters, that are tried to be skipped.
const QUARTERS: [usize; 4] = [4, 3, 2, 1];

impl Walker {
    /// Makes it skip vertices of a path where possible.
    pub fn with_leaps(mut self) -> Walker {
        self.leaps = true;
        self
    }

    /// Returns the path without its first vertices, as far as one line passes them.
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

    /// Redirects the motion in progress to a vertex, from the robot's current configuration. The
    /// caller ensures that the line is free. `None`: there is no such vertex.
    pub fn turn_to(&mut self, to: u32, view: &View) -> Option<Intent> {
        let target = self.target(to, view)?;
        self.progress.doing = Doing::Turned;
        self.goto(to);
        self.show(vec![to]);
        Some(Intent::MoveTo(target))
    }

    /// Evaluates the motion that ended, without choosing the next one.
    pub fn learn(&mut self, last: Option<MotionEnd>, view: &View) {
        self.settle(last, view);
    }

    /// Aborts the motion in progress: it is rolled back, and its edge does not count as failed.
    pub fn give_up(&mut self) -> Intent {
        self.progress.doing = Doing::Turned;
        Intent::Stop
    }
}
