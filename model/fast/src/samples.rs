//! Samples of one line: fast, but not a proof.

use crate::fast::{FastError, FastScene};
use crate::lanes::{LaneMask, WIDTH};
use crate::limits::is_within;

impl FastScene {
    /// True if a straight line in joint space is free at evenly spaced poses. A search may call this before it has the
    /// relevant lines certified. For a blocked line often the first sixteen poses, which are spread over all of it, are
    /// sufficient.
    ///
    /// # Arguments
    /// * `edge`: the pose at its start, which is not tested, then that at its end, which is; each with the motors of
    ///   all robots in order, rad of encoder. Motors move straight.
    /// * `poses`: minimum number of tested poses; rounded up to a multiple of sixteen.
    ///
    /// # Errors
    /// If the length is not that of one edge.
    pub fn samples_free(&mut self, edge: &[f64], poses: usize) -> Result<bool, FastError> {
        let motors = self.motors();
        if motors == 0 || edge.len() != 2 * motors {
            return Err(FastError::Edges { given: edge.len(), motors });
        }
        let (from, to) = edge.split_at(motors);
        if edge.iter().any(|q| !q.is_finite()) {
            return Ok(false);
        }
        self.reuse_fixed(from, to);
        let blocks = poses.div_ceil(WIDTH).max(1);
        let count = (blocks * WIDTH) as f64;
        // The first block is spread over the whole line, and the others fill the gaps.
        Ok((0..blocks).all(|block| {
            let share: [f64; WIDTH] = std::array::from_fn(|lane| (lane * blocks + block + 1) as f64 / count);
            self.lanes_free(from, to, &share)
        }))
    }

    /// Reuses the placement of motors that do not move on this line and had the same position on the line before.
    fn reuse_fixed(&mut self, from: &[f64], to: &[f64]) {
        let is_still = |m: usize| from[m] == to[m] && is_within(from[m], self.program.limits[m]);
        let is_unchanged = |m: usize| match (self.block.still[m], is_still(m)) {
            (true, true) => self.block.motors[m].0[0] == from[m],
            (still, now) => still == now,
        };
        if (0..from.len()).all(is_unchanged) {
            return;
        }
        let still: Vec<bool> = (0..from.len()).map(is_still).collect();
        self.block.forget(&self.program);
        for (m, _) in still.iter().enumerate().filter(|(_, still)| **still) {
            self.block.motors[m].0 = [from[m]; WIDTH];
        }
        self.block.still = still;
    }

    /// True if the line is free at these sixteen fractions of it.
    fn lanes_free(&mut self, from: &[f64], to: &[f64], share: &[f64; WIDTH]) -> bool {
        for (m, row) in self.block.motors.iter_mut().enumerate().filter(|(m, _)| !self.block.still[*m]) {
            let (low, high) = self.program.limits[m];
            let step = to[m] - from[m];
            for (q, share) in row.0.iter_mut().zip(share) {
                *q = (from[m] + step * share).max(low).min(high);
            }
        }
        self.figures.poses += WIDTH as u64;
        let mut violated = 0;
        let mut doubtful = 0;
        if !self.program.clauses.is_empty() {
            (violated, doubtful) = self.runner.violated(&self.program, &self.block);
        }
        if violated != 0 {
            return false;
        }
        self.block.one_decides = true;
        let (live, _) = self.runner.judge(&self.program, &mut self.block, LaneMask::MAX, 0);
        self.block.one_decides = false;
        live == LaneMask::MAX && !self.doubt_blocks(from, to, share, doubtful)
    }

    /// True if any lane in doubt, because of a constraint or a pair, is not free according to the scalar engine.
    fn doubt_blocks(&mut self, from: &[f64], to: &[f64], share: &[f64; WIDTH], of_constraints: LaneMask) -> bool {
        let lanes = self.block.doubts.iter().fold(of_constraints, |all, (_, lanes)| all | lanes);
        (0..WIDTH).filter(|lane| lanes >> lane & 1 != 0).any(|lane| {
            self.figures.doubtful += 1;
            let pose: Vec<f64> = from.iter().zip(to).map(|(a, b)| a + (b - a) * share[lane]).collect();
            let violated = of_constraints >> lane & 1 != 0 && !self.reference.satisfies_constraints(&pose);
            violated || self.doubt_touches(&pose, 1 << lane)
        })
    }
}
