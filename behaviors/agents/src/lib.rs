//! Agents, pure: an agent takes a [`View`](mobee_contract::View) and the outcome of its last motion, and returns an
//! [`Intent`](mobee_contract::Intent). To an agent, a motion that was rolled back is a motion that failed.
//!
//! Each is registered under the name that a configuration file gives as its `kind`: `explorer`, `roadmap`, `plan`,
//! `reach`, `scripted`, `random`, `jog`. A program must name this crate (`use mobee_agents as _;`), or the linker drops
//! the registrations.

mod explorer;
mod jog;
mod named;
mod plan;
mod random;
mod reach;
mod rest;
mod roadmap;
mod scripted;
mod tour;

pub use explorer::{Explorer, ExplorerSettings};
pub use jog::{Jog, JogBy, JogSettings};
pub use named::NamedPose;
pub use plan::{PlanAgent, PlanSettings};
pub use random::{Random, RandomSettings};
pub use reach::{GazeSettings, ReachAgent, ReachSettings};
pub use rest::RestAgent;
pub use roadmap::{RoadmapAgent, RoadmapSettings};
pub use scripted::{Scripted, ScriptedPose, ScriptedSettings};

use mobee_contract::{Refusal, Snapshot, settings};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Deserializes the state of a snapshot of this kind and version.
fn open<T: DeserializeOwned>(from: &Snapshot, kind: &str, version: u32) -> Result<T, Refusal> {
    if from.kind != kind || from.version != version {
        let found = format!("it is of kind {:?} version {}", from.kind, from.version);
        let what = format!("{found}, and this agent takes {kind:?} version {version}");
        return Err(Refusal::State { what });
    }
    settings(&from.state).map_err(mobee_planning::group::state)
}

fn seal<T: Serialize>(kind: &str, version: u32, state: &T) -> Snapshot {
    let state = serde_json::to_value(state).unwrap_or_default();
    Snapshot { kind: kind.to_owned(), version, state }
}

/// Seed and position of a random number generator: enough to resume it from a snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Dice {
    seed: u64,
    position: u64,
}

impl Dice {
    fn of(seed: u64, rng: &ChaCha8Rng) -> Dice {
        Dice { seed, position: u64::try_from(rng.get_word_pos()).unwrap_or(u64::MAX) }
    }

    fn rng(self) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_word_pos(u128::from(self.position));
        rng
    }
}
