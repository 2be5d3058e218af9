//! Calibration of a limp arm: a person moves each joint through its range by hand.
//!
//! ```text
//! open (STS3215, position mode, no torque) ──> [center: a new frame] ──> record ... ──> finish ──> [store the new frame]
//! ```
//! Positions are in the frame of the servos' stored offsets, and nothing is written, unless [`ArmCalibrator::center`] has begun a new
//! frame. That one is computed here until [`ArmCalibrator::store`] writes it, so that a calibration that is broken off changes no servo.

use crate::bus::{BusError, ServoBus, open_port};
use crate::calibration::{ArmCalibration, RangeRecorder, ServoCalibration, SweptMotor, SweptRange};
use crate::identity::StoredSettings;
use crate::registers::{LIMITS, LOCK, OFFSET, ServoState, TURN_COUNTS, sign_magnitude};
use mobee_contract::KindError;
use std::time::Duration;

/// Longest time for the answers to one request: a servo that stores a value answers late.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(50);
/// Incomplete readings in a row after which a servo counts as silent.
const MAX_MISSED: u32 = 20;
/// The count of a joint at its middle, as LeRobot homes an arm.
const MIDDLE_COUNT: i32 = (TURN_COUNTS - 1) / 2;
/// The greatest magnitude of a stored offset.
const MAX_OFFSET: i32 = 2047;
/// A range that ends no farther than this beyond the servo's stored limit ends at the limit, counts: 2 degrees.
const LIMIT_TOLERANCE: i32 = 23;
/// Greatest difference between the position that a new offset must lead to and the reported one, counts: 5 degrees.
const OFFSET_TOLERANCE: i32 = 57;

/// A limp arm whose joints are moved by hand.
pub struct ArmCalibrator {
    bus: ServoBus,
    motors: Vec<SweptMotor>,
    stored: Vec<StoredSettings>,
    recorder: RangeRecorder,
    has_new_frame: bool,
    /// Incomplete readings in a row.
    missed: u32,
}

impl ArmCalibrator {
    /// Opens the port and checks that every servo is an STS3215 in position mode, without torque. The offsets of `motors` are replaced
    /// by those that the servos store.
    ///
    /// # Errors
    /// The first defect, with a remedy.
    pub fn open(port: &str, baud: u32, mut motors: Vec<SweptMotor>) -> Result<ArmCalibrator, KindError> {
        let line = open_port(port, baud).map_err(|what| KindError::new("port", what, "the arm is unchanged"))?;
        let mut bus = ServoBus::new(line, ANSWER_TIMEOUT);
        let mut stored = Vec::with_capacity(motors.len());
        let mut silent = Vec::new();
        for motor in &mut motors {
            match StoredSettings::read(&mut bus, motor.id).map_err(gone)? {
                Some(found) => {
                    let help = "calibrate an arm of STS3215 servos with --port; the arm is unchanged";
                    found.check_model(&motor.name, motor.id).map_err(|what| KindError::new("", what, help))?;
                    motor.homing_offset = found.offset;
                    stored.push(found);
                }
                None => silent.push(named(motor)),
            }
        }
        if silent.len() == motors.len() {
            let what = format!("no servo answers at {port}");
            return Err(KindError::new("", what, "switch the arm's power supply on, and check the cable and --baud"));
        }
        if !silent.is_empty() {
            return Err(does_not_answer(&silent));
        }
        let recorder = RangeRecorder::new(motors.clone());
        let mut arm = ArmCalibrator { bus, motors, stored, recorder, has_new_frame: false, missed: 0 };
        arm.positions()?;
        Ok(arm)
    }

    /// Begins a new frame, in which the joints are at the middle now. No servo is written.
    ///
    /// # Errors
    /// A servo that is silent or has torque.
    pub fn center(&mut self) -> Result<(), KindError> {
        let positions = self.positions()?;
        for (motor, position) in self.motors.iter_mut().zip(positions) {
            let magnet = (position + motor.homing_offset).rem_euclid(TURN_COUNTS);
            motor.homing_offset = (magnet - MIDDLE_COUNT).min(MAX_OFFSET);
        }
        self.has_new_frame = true;
        self.recorder = RangeRecorder::new(self.motors.clone());
        Ok(())
    }

    /// Reads and records the position of every joint; false if an answer was lost.
    ///
    /// # Errors
    /// The port is gone, a servo is silent, or has torque.
    pub fn record(&mut self) -> Result<bool, KindError> {
        let positions = self.read()?;
        if let Some(positions) = &positions {
            self.recorder.record(positions);
        }
        Ok(positions.is_some())
    }

    /// The motors, each with its range so far.
    pub fn ranges(&self) -> impl Iterator<Item = (&SweptMotor, &SweptRange)> {
        self.recorder.ranges()
    }

    /// The calibration; and for each joint that was moved a little beyond the limit that its servo stores, a remark: its range ends there.
    ///
    /// # Errors
    /// All joints that were not moved far enough, jumped, or were moved far beyond the limits that the servos store.
    pub fn finish(&self) -> Result<(ArmCalibration, Vec<String>), KindError> {
        let mut calibration = self.recorder.finish()?;
        let mut remarks = Vec::new();
        if self.has_new_frame {
            return Ok((calibration, remarks));
        }
        for (motor, stored) in self.motors.iter().zip(&self.stored) {
            let Some(made) = calibration.0.get_mut(&motor.name) else { continue };
            let range = (made.range_min, made.range_max);
            if stored.allows(range) {
                continue;
            }
            let (low, high) = stored.limits;
            let far = (low - range.0).max(range.1 - high);
            if motor.least_range.is_none() || far > LIMIT_TOLERANCE {
                let what = format!(
                    "`{}` covers counts {} to {}, and its servo stores the limits {low} to {high}",
                    motor.name, range.0, range.1
                );
                return Err(KindError::new("", what, "calibrate with --write-offsets, which stores new limits"));
            }
            (made.range_min, made.range_max) = (range.0.max(low), range.1.min(high));
            let name = &motor.name;
            remarks.push(format!("{name}: the range ends at the limits that its servo stores, {low} to {high}"));
        }
        Ok((calibration, remarks))
    }

    /// What [`ArmCalibrator::store`] changes, a line for each servo.
    pub fn changes(&self, calibration: &ArmCalibration) -> Vec<String> {
        let line = |(motor, stored): (&SweptMotor, &StoredSettings)| {
            let new = calibration.0.get(&motor.name)?;
            let (low, high) = stored.limits;
            Some(format!(
                "{}: offset {} -> {}, limits {low} to {high} -> {} to {}",
                named(motor),
                stored.offset,
                new.homing_offset,
                new.range_min,
                new.range_max
            ))
        };
        self.motors.iter().zip(&self.stored).filter_map(line).collect()
    }

    /// Writes offset and limits of each servo, reads them back, and checks that the positions follow. If one fails, those before it get
    /// their old values again.
    ///
    /// # Errors
    /// The servo that failed, and those that may have new values.
    pub fn store(mut self, calibration: &ArmCalibration) -> Result<(), KindError> {
        let before = self.positions()?;
        let old = self.stored.clone();
        for (at, motor) in self.motors.clone().iter().enumerate() {
            let Some(new) = calibration.0.get(&motor.name) else { continue };
            if let Err(what) = self.store_one(motor, frame(new)) {
                return Err(self.restored(old.get(..=at).unwrap_or(&old), what));
            }
        }
        // the servos have the new frame now
        for (stored, motor) in self.stored.iter_mut().zip(&self.motors) {
            stored.offset = motor.homing_offset;
        }
        let after = match self.positions() {
            Ok(after) => after,
            Err(e) => return Err(self.restored(&old, e.what)),
        };
        let turned = |(a, b): (&i32, &i32)| {
            let off = (a - b).rem_euclid(TURN_COUNTS);
            off.min(TURN_COUNTS - off)
        };
        let moved = before.iter().zip(&after).map(turned).zip(&self.motors).find(|(off, _)| *off > OFFSET_TOLERANCE);
        let wrong = moved.map(|(off, motor)| {
            format!(
                "the position of {} is off by {off} counts with its new offset: it was moved, or counts otherwise",
                named(motor)
            )
        });
        wrong.map_or(Ok(()), |what| Err(self.restored(&old, what)))
    }

    /// Writes these old values of the first servos again after a failure, and describes it.
    fn restored(&mut self, old: &[StoredSettings], what: String) -> KindError {
        let mut changed = Vec::new();
        for (motor, old) in self.motors.clone().iter().zip(old) {
            if self.store_one(motor, (old.offset, old.limits)).is_err() {
                changed.push(named(motor));
            }
        }
        let help = if changed.is_empty() {
            "all servos have their old values again: check the cables and the supply, and calibrate again".to_owned()
        } else {
            format!("{} may have new values: check the cables and the supply, and calibrate again", changed.join(", "))
        };
        KindError::new("", what, help)
    }

    /// Writes one servo's offset and limits, and reads them back.
    fn store_one(&mut self, motor: &SweptMotor, (offset, limits): (i32, (i32, i32))) -> Result<(), String> {
        let id = motor.id;
        let word = |value: i32, bit: u32| sign_magnitude(value, bit).to_le_bytes();
        let mut write = |address: u8, data: Vec<u8>| self.bus.write(id, address, data).map(drop);
        let written = write(LOCK, vec![0])
            .and_then(|()| write(OFFSET, word(offset, 11).to_vec()))
            .and_then(|()| write(LIMITS, [word(limits.0, 15), word(limits.1, 15)].concat()));
        // locked again in any case
        let locked = write(LOCK, vec![1]);
        let found = written.and(locked).and_then(|()| StoredSettings::read(&mut self.bus, id));
        match found {
            Err(e) => Err(format!("{} could not be written: {e}", named(motor))),
            Ok(Some(found)) if (found.offset, found.limits) == (offset, limits) => Ok(()),
            Ok(_) => Err(format!("{} does not store what was written", named(motor))),
        }
    }

    /// Positions of all joints, counts of the frame.
    fn positions(&mut self) -> Result<Vec<i32>, KindError> {
        loop {
            if let Some(positions) = self.read()? {
                return Ok(positions);
            }
        }
    }

    /// Positions of all joints, counts of the frame; `None` if an answer was lost.
    fn read(&mut self) -> Result<Option<Vec<i32>>, KindError> {
        let ids: Vec<u8> = self.motors.iter().map(|m| m.id).collect();
        let answers = self.bus.read_states(&ids).map_err(gone)?;
        let mut positions = Vec::with_capacity(ids.len());
        let mut silent = Vec::new();
        for (motor, stored) in self.motors.iter().zip(&self.stored) {
            let answer = answers.iter().find(|a| a.id == motor.id);
            let Some(state) = answer.and_then(|a| ServoState::decode(&a.data)) else {
                silent.push(named(motor));
                continue;
            };
            if state.torque {
                let help = "end the program that drives the arm; then hold the arm, and switch its power supply off and on: without torque \
                            it falls";
                return Err(KindError::new(
                    "",
                    format!("{} has torque, and can't be moved by hand", named(motor)),
                    help,
                ));
            }
            positions.push((state.position + stored.offset - motor.homing_offset).rem_euclid(TURN_COUNTS));
        }
        if silent.is_empty() {
            self.missed = 0;
            return Ok(Some(positions));
        }
        self.missed += 1;
        if self.missed >= MAX_MISSED { Err(does_not_answer(&silent)) } else { Ok(None) }
    }
}

/// Offset and limits of a servo with this calibration.
fn frame(calibration: &ServoCalibration) -> (i32, (i32, i32)) {
    (calibration.homing_offset, (calibration.range_min, calibration.range_max))
}

fn named(motor: &SweptMotor) -> String {
    format!("motor {} (id {})", motor.name, motor.id)
}

fn does_not_answer(silent: &[String]) -> KindError {
    let help = "check the power supply, the servo's cable and its id, and calibrate again";
    KindError::new("", format!("{} does not answer", silent.join(", ")), help)
}

fn gone(e: BusError) -> KindError {
    KindError::new("port", e.to_string(), "plug the arm's USB cable in, and calibrate again")
}
