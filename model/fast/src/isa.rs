//! Selection of the vector instructions, determined once, when a scene is compiled.

use crate::clauses::violated;
use crate::intervals::{Intervals, sweep};
use crate::kernel::{Block, judge};
#[cfg(target_arch = "x86_64")]
use crate::lanes::{Avx2, Avx512};
use crate::lanes::{LaneMask, Portable};
use crate::program::Program;

/// A set of vector instructions that [`crate::FastScene`] supports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum InstructionSet {
    /// The baseline of the target architecture.
    Portable,
    /// AVX2 with FMA, x86-64.
    Avx2,
    /// AVX-512 (F, DQ, VL, BW), x86-64.
    Avx512,
}

impl InstructionSet {
    /// The sets that this processor supports, the best last.
    pub fn available() -> Vec<Self> {
        let mut all = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                all.push(Self::Avx2);
                let rest = is_x86_feature_detected!("avx512dq") && is_x86_feature_detected!("avx512vl");
                if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512bw") && rest {
                    all.push(Self::Avx512);
                }
            }
        }
        all
    }
}

/// Runs the kernel. A value is a proof that the processor has the instructions: only [`checked`] creates one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Runner(InstructionSet);

/// Creates a runner, if the processor has the instructions.
pub(crate) fn checked(set: InstructionSet) -> Option<Runner> {
    InstructionSet::available().contains(&set).then_some(Runner(set))
}

impl Runner {
    pub fn set(self) -> InstructionSet {
        self.0
    }

    /// Runs [`sweep`].
    pub fn sweep(self, program: &Program, block: &mut Block, intervals: &mut Intervals) {
        match self.0 {
            InstructionSet::Portable => sweep::<Portable>(program, block, intervals),
            // SAFETY: `checked` has verified that the processor has the instructions.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => unsafe { sweep_avx2(program, block, intervals) },
            // SAFETY: `checked` has verified that the processor has the instructions.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => unsafe { sweep_avx512(program, block, intervals) },
            #[cfg(not(target_arch = "x86_64"))]
            _ => sweep::<Portable>(program, block, intervals),
        }
    }

    /// Runs [`violated`].
    pub fn violated(self, program: &Program, block: &Block) -> (LaneMask, LaneMask) {
        match self.0 {
            InstructionSet::Portable => violated(program, block),
            // SAFETY: `checked` has verified that the processor has the instructions.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => unsafe { violated_avx2(program, block) },
            // SAFETY: `checked` has verified that the processor has the instructions.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => unsafe { violated_avx512(program, block) },
            #[cfg(not(target_arch = "x86_64"))]
            _ => violated(program, block),
        }
    }

    /// Runs [`judge`].
    pub fn judge(
        self,
        program: &Program,
        block: &mut Block,
        requested: LaneMask,
        cut: usize,
    ) -> (LaneMask, Option<usize>) {
        match self.0 {
            InstructionSet::Portable => judge::<Portable>(program, block, requested, cut),
            // SAFETY: `checked` has verified that the processor has the instructions.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => unsafe { judge_avx2(program, block, requested, cut) },
            // SAFETY: `checked` has verified that the processor has the instructions.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => unsafe { judge_avx512(program, block, requested, cut) },
            #[cfg(not(target_arch = "x86_64"))]
            _ => judge::<Portable>(program, block, requested, cut),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn judge_avx2(program: &Program, block: &mut Block, requested: LaneMask, cut: usize) -> (LaneMask, Option<usize>) {
    judge::<Avx2>(program, block, requested, cut)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,fma")]
fn judge_avx512(program: &Program, block: &mut Block, requested: LaneMask, cut: usize) -> (LaneMask, Option<usize>) {
    judge::<Avx512>(program, block, requested, cut)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn sweep_avx2(program: &Program, block: &mut Block, intervals: &mut Intervals) {
    sweep::<Avx2>(program, block, intervals)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,fma")]
fn sweep_avx512(program: &Program, block: &mut Block, intervals: &mut Intervals) {
    sweep::<Avx512>(program, block, intervals)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn violated_avx2(program: &Program, block: &Block) -> (LaneMask, LaneMask) {
    violated(program, block)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,fma")]
fn violated_avx512(program: &Program, block: &Block) -> (LaneMask, LaneMask) {
    violated(program, block)
}
