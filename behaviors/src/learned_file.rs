//! What files of learned things have in common: JSON that says what it is and of which version, and is taken whole or not at all.

use serde::Deserialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

/// Why a file of something learned is refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{what}")]
pub struct LearnedFault {
    /// What is wrong with it, and where.
    pub what: String,
    /// What to do about it.
    pub help: String,
}

/// Reads what is learned from JSON: the word for what it is (`detector`), and the version that is known.
///
/// # Errors
/// Text that is no such file or not whole, another version, or what `wrong` finds: nothing of it is taken then.
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
    struct Head {
        format: String,
        version: u32,
    }
    let Head { format, version } =
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

/// What such a file says it is.
pub(crate) fn format_name(noun: &str) -> String {
    format!("mobee-{noun}")
}
