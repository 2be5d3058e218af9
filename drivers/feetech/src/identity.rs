//! What a servo stores: read at the connection, and compared with the settings before the servo gets torque.

use crate::bus::{BusError, ServoBus};
use crate::joint::ServoJoint;
use crate::registers::{IDENTITY_BYTES, LIMITS, MODEL, OFFSET, OPERATING_MODE, STS3215, signed, word};

/// Attempts to read what a servo stores.
const ATTEMPTS: usize = 3;

/// What a servo stores, as far as it matters here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoredSettings {
    model: u16,
    mode: u8,
    /// Offset between magnet and position, counts.
    pub offset: i32,
    /// Least and greatest goal, counts; equal: none.
    pub limits: (i32, i32),
}

impl StoredSettings {
    /// Reads them; `None` if the servo is silent.
    ///
    /// # Errors
    /// If the port is gone.
    pub fn read(bus: &mut ServoBus, id: u8) -> Result<Option<StoredSettings>, BusError> {
        for _ in 0..ATTEMPTS {
            match bus.read(id, 0, IDENTITY_BYTES) {
                Err(BusError::Silent { .. }) => {}
                answer => return answer.map(|answer| Some(StoredSettings::decode(&answer.data))),
            }
        }
        Ok(None)
    }

    fn decode(stored: &[u8]) -> StoredSettings {
        let at = |register: u8| word(stored, usize::from(register)).unwrap_or_default();
        StoredSettings {
            model: at(MODEL),
            mode: stored.get(usize::from(OPERATING_MODE)).copied().unwrap_or_default(),
            offset: signed(at(OFFSET), 11),
            limits: (i32::from(at(LIMITS)), i32::from(at(LIMITS + 2))),
        }
    }

    /// Checks that these are an STS3215's, in position mode.
    ///
    /// # Errors
    /// The difference, with a remedy.
    pub fn check_model(&self, name: &str, id: u8) -> Result<(), String> {
        let StoredSettings { model, mode, .. } = self;
        if *model != STS3215 {
            return Err(format!("motor {name} (id {id}) is a servo of model {model}, not an STS3215 ({STS3215})"));
        }
        if *mode != 0 {
            return Err(format!(
                "motor {name} (id {id}) is in operating mode {mode}, not in position mode: set register 33 to 0 by Feetech's tool"
            ));
        }
        Ok(())
    }

    /// True if a servo with these limits takes all goals of this range.
    pub fn allows(&self, (first, last): (i32, i32)) -> bool {
        let (low, high) = self.limits;
        high <= low || (low <= first && last <= high)
    }

    /// Checks them against the settings of a joint.
    ///
    /// # Errors
    /// The first difference, with a remedy.
    pub fn check(&self, joint: &ServoJoint) -> Result<(), String> {
        let ServoJoint { name, id, .. } = joint;
        self.check_model(name, *id)?;
        if let Some(expected) = joint.homing_offset.filter(|expected| *expected != self.offset) {
            return Err(format!(
                "motor {name} (id {id}) stores homing offset {}, the calibration has {expected}: this is another arm's file, or the arm \
                 was calibrated since; give its newest calibration",
                self.offset
            ));
        }
        if !self.allows(joint.range) {
            let ((first, last), (low, high)) = (joint.range, self.limits);
            return Err(format!(
                "motor {name} (id {id}) allows counts {low} to {high}, less than its range {first} to {last}: calibrate the arm again, or \
                 narrow the range"
            ));
        }
        Ok(())
    }
}
