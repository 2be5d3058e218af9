//! Common parts of files with trained models: JSON with a format name and a version, which is
//! accepted completely or not at all.

use serde::Deserialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

/// Reason why a file with a trained model is rejected.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{what}")]
pub struct LearnedFault {
    /// The error, and its place.
    pub what: String,
    /// Remedy.
    pub help: String,
}

/// Reads a trained model from JSON. `noun`: the word for it (`detector`); `known`: the supported
/// version.
///
/// # Errors
/// Text of another format, an incomplete file, another version, or an error found by `wrong`.
pub(crate) fn parse<T: DeserializeOwned>(
    text: &str,
    noun: &str,
    known: u32,
    wrong: impl FnOnce(&T) -> Option<String>,
) -> Result<T, LearnedFault> {
    let fault = |what: String| {
        let help = format!("give a file as `mobee {noun} train` of this program wrote it, or train it again");
        LearnedFault { what, help }
    };
    #[derive(Deserialize)]
    struct LearnedHead {
        format: String,
        version: u32,
    }
    let LearnedHead { format, version } =
        serde_json::from_str(text).map_err(|e| fault(format!("this is no {noun} file: {e}")))?;
    if format != format_name(noun) {
        return Err(fault(format!("this is no {noun} file, but of the format {format:?}")));
    }
    if version != known {
        return Err(fault(format!("this {noun} file has version {version}, and {known} is known")));
    }
    let learned: T = serde_json::from_str(text).map_err(|e| fault(e.to_string()))?;
    match wrong(&learned) {
        Some(what) => Err(fault(format!("this {noun} file is damaged: {what}"))),
        None => Ok(learned),
    }
}

/// Returns the format name of such a file.
pub(crate) fn format_name(noun: &str) -> String {
    format!("mobee-{noun}")
}
