//! Processing of sixteen intervals of edges: setup of the lanes, and evaluation of their results.

use crate::bound::REFERENCE;
use crate::edges::{Edges, Interval, Obstruction};
use crate::fast::FastScene;
use crate::intervals::{NONE, Stuck};
use crate::lanes::{LaneMask, WIDTH};

impl FastScene {
    /// Checks sixteen intervals; those that are not proved are added to `next`, undivided.
    pub(crate) fn judge_block(&mut self, edges: &[f64], block: &[Interval], level: u32, all: &mut Edges) {
        let motors = self.motors();
        let parts = f64::from(1u32 << level);
        for (lane, interval) in block.iter().enumerate() {
            let edge = &edges[interval.edge as usize * 2 * motors..][..2 * motors];
            let (from, to) = edge.split_at(motors);
            let at = middle(interval, level);
            for &m in &all.moving {
                let step = to[m] - from[m];
                let (low, high) = self.program.limits[m];
                self.block.motors[m].0[lane] = (from[m] + step * at).max(low).min(high);
                self.intervals.motions.steps[m].0[lane] = (step * 0.5 / parts) as f32;
            }
        }
        self.collect_queries(block, all);
        self.runner.sweep(&self.program, &mut self.block, &mut self.intervals);
        self.figures.intervals += block.len() as u64;
        self.resolve_stuck(edges, block, level, &mut all.pose);
        for (lane, interval) in block.iter().enumerate() {
            let bit = 1 << lane;
            let first = all.next_units.len() as u32;
            let open = self.intervals.open.iter().filter(|(_, lanes)| lanes & bit != 0);
            all.next_units.extend(open.map(|(unit, _)| *unit));
            let end = all.next_units.len() as u32;
            if end == first {
                continue;
            }
            all.next.push(Interval { first, end, ..*interval });
            let at = middle(interval, level);
            let state = &mut all.states[interval.edge as usize];
            let mut pair = Some(self.intervals.touching[lane]).filter(|pair| *pair != NONE);
            if pair.is_none() && level >= state.levels {
                pair = self.in_doubt(edges, interval.edge as usize, at, lane, &mut all.pose);
            }
            if let Some(pair) = pair
                && state.blocked.is_none_or(|b| at < b.at)
            {
                let (a, b) = self.program.ids(pair);
                let ids = self.reference.shape_id(a).zip(self.reference.shape_id(b));
                state.blocked = Some(Obstruction { at, pair: ids });
            }
        }
    }

    /// Collects the units to test, with the lanes in which each is tested.
    fn collect_queries(&mut self, block: &[Interval], all: &mut Edges) {
        self.intervals.requested.clear();
        let mut lane = 0;
        // Both halves of an interval, and edges that start at this level, share their units.
        for alike in block.chunk_by(|a, b| a.first == b.first) {
            let lanes = (LaneMask::MAX >> (WIDTH - alike.len())) << lane;
            for unit in &all.units[alike[0].first as usize..alike[0].end as usize] {
                all.lanes[*unit as usize] |= lanes;
                all.wanted[*unit as usize / 64] |= 1 << (unit % 64);
            }
            lane += alike.len();
        }
        for (word, bits) in all.wanted.iter_mut().enumerate() {
            while *bits != 0 {
                let unit = word * 64 + bits.trailing_zeros() as usize;
                *bits &= *bits - 1;
                self.intervals.requested.push((unit as u32, std::mem::take(&mut all.lanes[unit])));
            }
        }
    }

    /// Decides with the scalar engine what the lanes could not: if a pair may touch on the interval, and if so, if it
    /// touches at the midpoint. One contact decides a lane, so that a deep contact is not bisected down to the
    /// resolution.
    fn resolve_stuck(&mut self, edges: &[f64], block: &[Interval], level: u32, pose: &mut Vec<f64>) {
        let stuck = std::mem::take(&mut self.intervals.stuck);
        let lanes = stuck.iter().fold(0, |all, s| all | s.lanes);
        for (lane, interval) in block.iter().enumerate().filter(|(lane, _)| lanes >> lane & 1 != 0) {
            let mut is_placed = false;
            for Stuck { unit, pair, motion, .. } in stuck.iter().filter(|s| s.lanes >> lane & 1 != 0) {
                // In a lane with a contact only the possibility of further contacts matters.
                if self.intervals.touching[lane] == NONE {
                    if !is_placed {
                        self.pose_at(edges, interval.edge as usize, middle(interval, level), pose);
                        self.reference.place(pose);
                        is_placed = true;
                    }
                    let ids = self.program.ids(*pair);
                    let clearance = self.reference.clearance(ids, self.clearance);
                    let margin = clearance + f64::from(motion.0[lane]) + REFERENCE;
                    self.figures.stuck += 1;
                    if !self.reference.touches(ids, margin) {
                        continue;
                    }
                    if self.reference.touches(ids, clearance) {
                        self.intervals.touching[lane] = *pair;
                    }
                }
                match self.intervals.open.iter_mut().find(|(open, _)| open == unit) {
                    Some((_, open)) => *open |= 1 << lane,
                    None => self.intervals.open.push((*unit, 1 << lane)),
                }
            }
        }
        self.intervals.stuck = stuck;
    }

    fn pose_at(&self, edges: &[f64], edge: usize, at: f64, pose: &mut Vec<f64>) {
        let motors = self.motors();
        let (from, to) = edges[edge * 2 * motors..][..2 * motors].split_at(motors);
        pose.clear();
        pose.extend(from.iter().zip(to).map(|(a, b)| a + (b - a) * at));
    }

    /// The pair, among those in doubt in a lane, that touches according to the scalar engine.
    fn in_doubt(&mut self, edges: &[f64], edge: usize, at: f64, lane: usize, pose: &mut Vec<f64>) -> Option<usize> {
        self.pose_at(edges, edge, at, pose);
        let doubts = self.intervals.doubts.iter().filter(|(_, lanes)| lanes >> lane & 1 != 0);
        let mut pairs = doubts.map(|(pair, _)| *pair);
        pairs.find(|p| self.reference.any_touches(pose, [self.program.ids(*p)].into_iter(), self.clearance))
    }
}

/// Position of an interval's midpoint on its edge, 0 to 1.
pub(crate) fn middle(interval: &Interval, level: u32) -> f64 {
    (f64::from(interval.index) + 0.5) / f64::from(1u32 << level)
}
