//! What simulated cameras see.

use super::{LatestCell, SharedContext};
use mobee_contract::{Pose, Time, Truth};
use std::sync::{Arc, Weak};

/// The truth of a run, from when it has begun: cameras are made before that.
#[derive(Debug, Default)]
pub struct TruthCell(LatestCell<Weak<SharedContext>>);

impl TruthCell {
    /// The run has begun.
    pub(crate) fn begin(&self, shared: &Arc<SharedContext>) {
        *self.0.lock() = Arc::downgrade(shared);
    }

    /// The scene as it is, with the robots where their newest readings have them; `None` before all have been heard of.
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
