//! Streams of set-points as transactions.

use super::{SuperviseCore, SuperviseOut};
use mobee_contract::{Refusal, Setpoints, Time, Verdict};

impl SuperviseCore {
    /// Set-points arrive.
    pub(super) fn stream(&mut self, _: &str, _: Setpoints, _: Time, _: &mut Vec<SuperviseOut>) -> Verdict {
        Err(Refusal::NotReady { missing: "streams".into() })
    }
}
