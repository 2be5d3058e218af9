//! The state of an interrupted training, in FILE.part beside the future detector.

use super::MAX_DETECTOR_BYTES;
use miette::Report;
use mobee_compose::config::ConfigError;
use mobee_compose::maps::save_text;
use mobee_model::file::read_text;
use mobee_sensing::detectors::cgp::EvolutionState;
use mobee_sensing::detectors::file::DETECTOR_VERSION;
use mobee_sensing::detectors::picture::LabeledPicture;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// An unfinished training.
pub(super) struct TrainingPart {
    path: PathBuf,
    inputs: String,
    /// The state of the evolution, if it had begun.
    pub(super) state: Option<EvolutionState>,
    /// Duration so far, seconds.
    pub(super) seconds: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredTraining {
    inputs: String,
    seconds: f64,
    state: EvolutionState,
}

/// Digest of a training's inputs.
pub(super) fn digest(pictures: &[LabeledPicture], seed: u64) -> String {
    let mut hash = Sha256::new();
    hash.update(DETECTOR_VERSION.to_le_bytes());
    hash.update(seed.to_le_bytes());
    for p in pictures {
        hash.update(&p.picture.rgb);
        hash.update(p.mask.data.iter().map(|m| u8::from(*m)).collect::<Vec<u8>>());
    }
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

impl TrainingPart {
    /// Opens the unfinished training beside `out`, if there is one.
    pub(super) fn open(out: &Path, inputs: String) -> Result<TrainingPart, Report> {
        let mut name = out.as_os_str().to_owned();
        name.push(".part");
        let path = PathBuf::from(name);
        let mut part = TrainingPart { path, inputs, state: None, seconds: 0.0 };
        if !part.path.exists() {
            return Ok(part);
        }
        let at = part.path.display();
        let help = format!("remove {at} to start over");
        let text = read_text(&part.path, MAX_DETECTOR_BYTES)
            .map_err(|e| ConfigError::plain(format!("can't read {at}: {e}"), &help))?;
        let stored: StoredTraining =
            serde_json::from_str(&text).map_err(|e| ConfigError::plain(format!("{at} is damaged: {e}"), &help))?;
        if stored.inputs != part.inputs {
            let what = format!("{at} is of a training with other pictures or another seed");
            return Err(ConfigError::plain(what, help).into());
        }
        if !stored.state.is_sound() || !(0.0..1e9).contains(&stored.seconds) {
            return Err(ConfigError::plain(format!("{at} is damaged: no evolution can be as it says"), help).into());
        }
        (part.state, part.seconds) = (Some(stored.state), stored.seconds);
        Ok(part)
    }

    /// Stores the state of the evolution.
    pub(super) fn note(&self, state: &EvolutionState, seconds: f64) -> Result<(), Report> {
        let stored = StoredTraining { inputs: self.inputs.clone(), seconds, state: state.clone() };
        Ok(save_text(&self.path, &serde_json::to_string(&stored).unwrap_or_default())?)
    }

    /// Removes the file when the training is done.
    pub(super) fn remove(&self) -> Result<(), Report> {
        match std::fs::remove_file(&self.path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                let what = format!("can't remove {}: {e}", self.path.display());
                Err(ConfigError::plain(what, "remove it, or the next training goes on from it").into())
            }
            _ => Ok(()),
        }
    }
}
