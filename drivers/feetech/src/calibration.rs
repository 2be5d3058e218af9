//! LeRobot's calibration files: read, checked and made.
//!
//! ```text
//! { "shoulder_pan": { "id": 1, "drive_mode": 0, "homing_offset": -12, "range_min": 741, "range_max": 3412 }, ... }
//! ```
//! LeRobot stores them in `~/.cache/huggingface/lerobot/calibration/robots/so101_follower/NAME.json`.

use crate::packet::MAX_ID;
use crate::registers::TURN_COUNTS;
use mobee_contract::KindError;
use mobee_model::file::{MIB, read_text};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The largest calibration file that is read.
const MAX_FILE_BYTES: u64 = MIB;
/// A joint that turns by less, counts, is no joint of an arm: 5 degrees.
const LEAST_RANGE: i32 = 57;
/// The greatest magnitude of an offset that a servo stores.
const MAX_OFFSET: i32 = 2047;

/// One motor of a calibration file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServoCalibration {
    /// The servo's id.
    pub id: u8,
    /// 0; LeRobot inverts some motors with 1, though not in degrees.
    pub drive_mode: u8,
    /// The offset that the servo stores, counts: it reports its magnet's angle less this.
    pub homing_offset: i32,
    /// The least position of the joint, counts.
    pub range_min: i32,
    /// The greatest position of the joint, counts.
    pub range_max: i32,
}

/// A calibration file: motors by name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ArmCalibration(pub BTreeMap<String, ServoCalibration>);

impl ArmCalibration {
    /// Reads a file.
    ///
    /// # Errors
    /// The first defect, with its place and a remedy.
    pub fn read(path: &Path) -> Result<ArmCalibration, KindError> {
        let help =
            "give the calibration that LeRobot made for this arm; its path is relative to the configuration file";
        let name = path.display();
        let text = read_text(path, MAX_FILE_BYTES)
            .map_err(|e| KindError::new("calibration", format!("{name} can't be read: {e}"), help))?;
        ArmCalibration::parse(&text).map_err(|mut e| {
            e.what = format!("{name}: {}", e.what);
            e.under("calibration")
        })
    }

    /// Parses the text of a file.
    ///
    /// # Errors
    /// The first defect, with its place and a remedy.
    pub fn parse(text: &str) -> Result<ArmCalibration, KindError> {
        let mut json = serde_json::Deserializer::from_str(text);
        let unreadable = |place: String, what: String| {
            KindError::new("", format!("{place}{what}"), "calibrate the arm again, or repair the file")
        };
        let motors: UniqueMotors = serde_path_to_error::deserialize(&mut json).map_err(|e| {
            let place = e.path().to_string();
            let place = if place == "." { String::new() } else { format!("`{place}`: ") };
            unreadable(place, e.into_inner().to_string())
        })?;
        json.end().map_err(|e| unreadable(String::new(), e.to_string()))?;
        let calibration = ArmCalibration(motors.0);
        calibration.check()?;
        Ok(calibration)
    }

    /// Checks ids, ranges and modes.
    ///
    /// # Errors
    /// The first motor that can't be used.
    pub fn check(&self) -> Result<(), KindError> {
        let mut ids: BTreeMap<u8, &str> = BTreeMap::new();
        let wrong = |name: &str, key: &str, what: String, help: &str| {
            Err(KindError::new("", format!("`{name}.{key}`: {what}"), help.to_owned()))
        };
        if self.0.is_empty() {
            return Err(KindError::new("", "there is no motor in it", "calibrate the arm"));
        }
        for (name, motor) in &self.0 {
            let ServoCalibration { id, drive_mode, homing_offset, range_min, range_max } = *motor;
            if id > MAX_ID {
                return wrong(name, "id", format!("{id} is not the id of a servo"), "ids are 0 to 253");
            }
            if let Some(other) = ids.insert(id, name) {
                return wrong(name, "id", format!("{id} is the id of `{other}`, too"), "give each motor its own id");
            }
            if drive_mode != 0 {
                let help =
                    "write 0, and `motors = [{ joint = ..., inverted = true }]` if the joint turns the other way";
                let what = format!("{drive_mode} does not apply to degrees, in which this driver counts");
                return wrong(name, "drive_mode", what, help);
            }
            if homing_offset.abs() > MAX_OFFSET {
                let what = format!("{homing_offset} is not an offset of a servo");
                return wrong(name, "homing_offset", what, "offsets are -2047 to 2047: calibrate the arm again");
            }
            let fits = 0 <= range_min && range_max < TURN_COUNTS;
            if !fits || range_max - range_min < LEAST_RANGE {
                let what = format!("{range_min} to {range_max} is not the range of a joint");
                let help = "ranges lie within 0 to 4095 and cover 5 degrees or more: calibrate the arm again";
                return wrong(name, "range_min", what, help);
            }
        }
        Ok(())
    }

    /// The text of a file that LeRobot reads.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(&self.0).unwrap_or_default() + "\n"
    }
}

/// A map in which each key may stand once.
struct UniqueMotors(BTreeMap<String, ServoCalibration>);

impl<'de> Deserialize<'de> for UniqueMotors {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<UniqueMotors, D::Error> {
        struct Motors;
        impl<'de> serde::de::Visitor<'de> for Motors {
            type Value = UniqueMotors;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("motors by name")
            }
            fn visit_map<A: serde::de::MapAccess<'de>>(self, mut map: A) -> Result<UniqueMotors, A::Error> {
                let mut motors = BTreeMap::new();
                while let Some((name, motor)) = map.next_entry::<String, ServoCalibration>()? {
                    if motors.insert(name.clone(), motor).is_some() {
                        return Err(serde::de::Error::custom(format!("motor `{name}` stands in it twice")));
                    }
                }
                Ok(UniqueMotors(motors))
            }
        }
        deserializer.deserialize_map(Motors)
    }
}

/// A motor whose range is recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SweptMotor {
    /// Its name in the robot model.
    pub name: String,
    /// The servo's id.
    pub id: u8,
    /// The offset of the frame in which it is recorded.
    pub homing_offset: i32,
    /// The least range of a joint that was moved to both of its ends, counts; `None` if it turns without end, and is not moved.
    pub least_range: Option<i32>,
}

/// The range of one motor so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SweptRange {
    /// Least, newest and greatest position, counts; `None` before the first reading.
    pub counts: Option<[i32; 3]>,
    /// True if the count has jumped from one end of the encoder's turn to the other.
    pub wrapped: bool,
}

/// Records the range of each joint while a person moves the limp arm, and makes a calibration of it.
#[derive(Clone, Debug)]
pub struct RangeRecorder {
    motors: Vec<SweptMotor>,
    ranges: Vec<SweptRange>,
}

impl RangeRecorder {
    /// A recorder of these motors.
    pub fn new(motors: Vec<SweptMotor>) -> RangeRecorder {
        let ranges = vec![SweptRange::default(); motors.len()];
        RangeRecorder { motors, ranges }
    }

    /// The motors, each with its range so far.
    pub fn ranges(&self) -> impl Iterator<Item = (&SweptMotor, &SweptRange)> {
        self.motors.iter().zip(&self.ranges)
    }

    /// Takes one reading, counts of each motor.
    pub fn record(&mut self, positions: &[i32]) {
        for (range, position) in self.ranges.iter_mut().zip(positions) {
            let [least, last, most] = range.counts.unwrap_or([*position; 3]);
            range.wrapped |= (position - last).abs() > TURN_COUNTS / 2;
            range.counts = Some([least.min(*position), *position, most.max(*position)]);
        }
    }

    /// The calibration.
    ///
    /// # Errors
    /// All motors that were not moved far enough, or passed the end of the encoder's turn.
    pub fn finish(&self) -> Result<ArmCalibration, KindError> {
        let found = KindError::gather(self.ranges().map(|(motor, range)| motor.calibration(range)))?;
        let calibration = ArmCalibration(self.motors.iter().map(|m| m.name.clone()).zip(found).collect());
        calibration.check().map_err(|e| KindError { help: "calibrate again".into(), ..e })?;
        Ok(calibration)
    }
}

impl SweptMotor {
    fn calibration(&self, range: &SweptRange) -> Result<ServoCalibration, KindError> {
        let SweptMotor { name, id, homing_offset, least_range } = self;
        let wrong = |what: String, help: &str| Err(KindError::new("", format!("`{name}` {what}"), help));
        let Some([min, _, max]) = range.counts else {
            return wrong("gave no reading".into(), "check its cable");
        };
        let [range_min, range_max] = match least_range {
            None => [0, TURN_COUNTS - 1],
            Some(_) if range.wrapped => {
                let help = "its range must not contain the end of the encoder's turn: put every joint at its middle, and calibrate \
                            with --write-offsets";
                return wrong("has jumped from one end of its encoder's turn to the other".into(), help);
            }
            Some(least) if max - min < *least => {
                let deg = |counts: i32| f64::from(counts) * 360.0 / f64::from(TURN_COUNTS - 1);
                let what = format!(
                    "was moved by {:.0} deg, and half of its model's range is {:.0} deg",
                    deg(max - min),
                    deg(*least)
                );
                return wrong(what, "move it slowly to both of its ends");
            }
            Some(_) => [min, max],
        };
        Ok(ServoCalibration { id: *id, drive_mode: 0, homing_offset: *homing_offset, range_min, range_max })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str =
        r#"{"pan": {"id": 1, "drive_mode": 0, "homing_offset": -12, "range_min": 741, "range_max": 3412}}"#;

    fn refused(text: &str) -> String {
        let e = ArmCalibration::parse(text).unwrap_err();
        format!("{} ({})", e.what, e.help)
    }

    #[test]
    fn a_file_of_lerobot_is_read() {
        let motor = ArmCalibration::parse(GOOD).unwrap().0["pan"];
        assert_eq!((motor.id, motor.homing_offset, motor.range_min, motor.range_max), (1, -12, 741, 3412));
    }

    /// Every key is used or refused, with its place.
    #[test]
    fn what_cannot_be_used_is_refused_with_its_place() {
        let with = |from: &str, to: &str| refused(&GOOD.replace(from, to));
        assert!(with("\"id\": 1", "\"id\": 254").contains("`pan.id`: 254"));
        assert!(with("\"drive_mode\": 0", "\"drive_mode\": 1").contains("`pan.drive_mode`"));
        assert!(with("-12", "3000").contains("`pan.homing_offset`: 3000"));
        assert!(with("3412", "760").contains("`pan.range_min`: 741 to 760"));
        assert!(with("3412", "4096").contains("`pan.range_min`: 741 to 4096"));
        assert!(with("\"id\": 1", "\"id\": 1, \"speed\": 3").contains("`pan"));
        assert!(with("\"id\": 1,", "").contains("missing field `id`"));
        assert!(with("-12", "1.5").contains("`pan.homing_offset`"));
        assert!(refused("{}").contains("no motor"));
        assert!(refused("[1]").contains("motors by name"));
        assert!(refused(&format!("{GOOD} x")).contains("trailing"));
        let one = &GOOD[1..GOOD.len() - 1];
        assert!(refused(&format!("{{{one}, {one}}}")).contains("twice"));
        assert!(refused(&format!("{{{one}, {}}}", one.replace("pan", "lift"))).contains("is the id of `lift`, too"));
    }

    fn swept(name: &str, id: u8, least_range: Option<i32>) -> SweptMotor {
        SweptMotor { name: name.into(), id, homing_offset: -12, least_range }
    }

    #[test]
    fn recorded_ranges_make_a_file_that_is_read() {
        let motors = vec![swept("pan", 1, Some(1000)), swept("lift", 2, Some(1000)), swept("roll", 5, None)];
        let mut recorder = RangeRecorder::new(motors);
        assert!(recorder.finish().unwrap_err().what.contains("`pan` gave no reading"));
        [[2000, 1000, 4090], [2100, 900, 3], [900, 2400, 7]].iter().for_each(|reading| recorder.record(reading));
        let calibration = recorder.finish().unwrap();
        assert_eq!((calibration.0["pan"].range_min, calibration.0["pan"].range_max), (900, 2100));
        assert_eq!((calibration.0["roll"].range_min, calibration.0["roll"].range_max), (0, 4095));
        assert_eq!(ArmCalibration::parse(&calibration.to_json()).unwrap(), calibration);
    }

    /// A joint that was hardly moved, or whose count jumped, is refused by its name.
    #[test]
    fn a_range_that_is_not_the_joints_is_refused() {
        let refused = |readings: &[i32]| {
            let mut recorder = RangeRecorder::new(vec![swept("pan", 1, Some(1251))]);
            readings.iter().for_each(|count| recorder.record(&[*count]));
            recorder.finish().unwrap_err()
        };
        let short = refused(&[2000, 3000]);
        assert!(
            short.what.contains("`pan` was moved by 88 deg, and half of its model's range is 110 deg"),
            "{short:?}"
        );
        let wrapped = refused(&[1000, 3, 4090, 3000]);
        assert!(wrapped.what.contains("`pan` has jumped") && wrapped.help.contains("--write-offsets"), "{wrapped:?}");
    }

    proptest! {
        /// Any text is a calibration or an error, and a calibration survives being written.
        #[test]
        fn any_text_is_judged(text in "\\PC{0,80}", offset in -3000i32..3000, min in -100i32..4200, max in -100i32..4200) {
            let _ = ArmCalibration::parse(&text);
            let made = GOOD.replace("-12", &offset.to_string()).replace("741", &min.to_string());
            if let Ok(read) = ArmCalibration::parse(&made.replace("3412", &max.to_string())) {
                prop_assert_eq!(ArmCalibration::parse(&read.to_json()).unwrap(), read);
            }
        }
    }
}
