//! Access to the true scene for simulated cameras.

use super::{LatestCell, SharedContext};
use mobee_contract::{Pose, Time, Truth};
use std::sync::{Arc, Weak};

/// The truth of a run, available from its start: cameras are created before that.
#[derive(Debug, Default)]
pub struct TruthCell(LatestCell<Weak<SharedContext>>);

impl TruthCell {
    /// Connects the cell to a run that has started.
    pub(crate) fn begin(&self, shared: &Arc<SharedContext>) {
        *self.0.lock() = Arc::downgrade(shared);
    }

    /// The present true scene, with the robots in their newest measured configurations; `None` before all have
    /// been read.
    pub fn now(&self) -> Option<Truth> {
        let shared = self.0.lock().upgrade()?;
        let pose = |w: &Arc<super::RobotContext>| {
            let latest = w.latest.lock();
            (latest.at > Time::ZERO).then(|| latest.q.clone())
        };
        let poses: Vec<Pose> = shared.robots.iter().map(pose).collect::<Option<_>>()?;
        Some(Truth { scene: shared.truth.lock().clone(), poses })
    }
}
