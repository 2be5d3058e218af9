//! A limp arm is calibrated: a hand (the test) moves its joints, and the driver accepts the calibration. Nothing is written unasked.

use crate::arm::{BAUD, robot};
use mobee_conformance::servos::{ServoTerminal, ServoWorld, SimulatedServo};
use mobee_contract::{Hardware, KindError};
use mobee_feetech::calibration::{ArmCalibration, SweptMotor};
use mobee_feetech::{ArmCalibrator, FeetechHardware, FeetechSettings};

/// Where the hand moves each joint, counts of the magnet: first end, other end, and where it stays.
const ENDS: [[f64; 3]; 6] = [
    [700.0, 3300.0, 2100.0],
    [900.0, 3000.0, 2000.0],
    [1000.0, 3100.0, 2050.0],
    [950.0, 3050.0, 2048.0],
    [2048.0, 2048.0, 2048.0],
    [2000.0, 3300.0, 2600.0],
];

struct Bench {
    terminal: ServoTerminal,
    folder: tempfile::TempDir,
}

impl Bench {
    /// Six servos that store these offsets, the calibrator's subject.
    fn new(offset: u16) -> Bench {
        let folder = tempfile::tempdir().unwrap();
        let terminal = ServoTerminal::start(&folder.path().join("tty"), ServoWorld::new(1..=6), BAUD).unwrap();
        terminal.with(|world| world.servos().for_each(|servo| servo.store(31, offset)));
        Bench { terminal, folder }
    }

    fn open(&self) -> Result<ArmCalibrator, KindError> {
        let motor = |(i, motor): (usize, &mobee_model::Motor)| SweptMotor {
            name: motor.name.clone(),
            id: i as u8 + 1,
            homing_offset: 0,
            least_range: (motor.name != "wrist_roll").then_some(600),
        };
        let motors = robot().motors.iter().enumerate().map(motor).collect();
        ArmCalibrator::open(&self.terminal.port().to_string_lossy(), BAUD, motors)
    }

    fn servo<T>(&self, id: u8, act: impl FnOnce(&mut SimulatedServo) -> T) -> T {
        self.terminal.with(|world| act(world.servo(id).unwrap()))
    }

    /// The hand moves every joint to one end, through its middle to the other, and leaves it.
    fn sweep(&self, arm: &mut ArmCalibrator, shift: f64) {
        for stop in [0, 2, 1, 2] {
            for (i, ends) in ENDS.iter().enumerate() {
                self.servo(i as u8 + 1, |servo| servo.place((ends[stop] + shift).rem_euclid(4096.0)));
                assert!(arm.record().unwrap());
            }
        }
    }

    fn stored(&self) -> u64 {
        self.terminal.with(|world| world.servos().map(|s| s.stored_writes).sum())
    }

    /// The driver, with this calibration.
    fn drives(&self, calibration: &ArmCalibration) -> Result<(), String> {
        let file = self.folder.path().join("arm.json");
        std::fs::write(&file, calibration.to_json()).unwrap();
        let port = self.terminal.port().to_string_lossy();
        let settings = FeetechSettings { calibration: Some(file), connect_s: 1.0, ..FeetechSettings::at(port) };
        let hardware = FeetechHardware::new(&settings, &robot()).map_err(|e| e.what)?;
        hardware.connect().map(drop).map_err(|e| e.to_string())
    }
}

/// By default nothing is written: the file has the offsets that the servos store, and the driver takes it.
#[test]
fn a_calibration_in_the_servos_own_frame_writes_nothing_and_is_driven() {
    let bench = Bench::new(100);
    let mut arm = bench.open().unwrap();
    bench.sweep(&mut arm, 0.0);
    let (calibration, remarks) = arm.finish().unwrap();
    drop(arm);
    let pan = calibration.0["shoulder_pan"];
    assert_eq!((pan.homing_offset, pan.range_min, pan.range_max, pan.id), (100, 600, 3200, 1));
    assert_eq!((calibration.0["wrist_roll"].range_min, calibration.0["wrist_roll"].range_max), (0, 4095));
    assert!(remarks.is_empty() && bench.stored() == 0, "{remarks:?}");
    bench.drives(&calibration).unwrap();
}

/// A range that ends a little beyond the stored limits ends at them; one that ends far beyond is refused.
#[test]
fn a_range_beyond_the_stored_limits_is_cut_or_refused() {
    let bench = Bench::new(0);
    bench.servo(1, |servo| (servo.store(9, 710), servo.store(11, 3290)));
    let mut arm = bench.open().unwrap();
    bench.sweep(&mut arm, 0.0);
    let (calibration, remarks) = arm.finish().unwrap();
    drop(arm);
    assert!(remarks.len() == 1 && remarks[0].contains("shoulder_pan"), "{remarks:?}");
    bench.drives(&calibration).unwrap();

    bench.servo(1, |servo| servo.store(9, 900));
    bench.terminal.with(|world| world.servos().for_each(|servo| servo.write(40, &[0])));
    let mut arm = bench.open().unwrap();
    bench.sweep(&mut arm, 0.0);
    let refused = arm.finish().unwrap_err();
    assert!(refused.what.contains("`shoulder_pan`") && refused.help.contains("--write-offsets"), "{refused:?}");
}

/// An arm whose range contains the end of the encoder's turn is refused in the servos' own frame. A new frame is stored in the servos, where it
/// survives a loss of the supply, and is driven.
#[test]
fn a_new_frame_is_stored_and_driven() {
    let (bench, shift) = (Bench::new(4), 2000.0);
    let mut arm = bench.open().unwrap();
    bench.sweep(&mut arm, shift);
    let refused = arm.finish().unwrap_err();
    assert!(refused.what.contains("has jumped") && refused.help.contains("--write-offsets"), "{refused:?}");

    for (i, [.., middle]) in ENDS.iter().enumerate() {
        bench.servo(i as u8 + 1, |servo| servo.place((middle + shift).rem_euclid(4096.0)));
    }
    arm.center().unwrap();
    bench.sweep(&mut arm, shift);
    let (calibration, _) = arm.finish().unwrap();
    assert_eq!(bench.stored(), 0, "nothing is written before it is asked for");
    assert!(
        arm.changes(&calibration)[0].contains("shoulder_pan (id 1): offset 4 -> "),
        "{:?}",
        arm.changes(&calibration)
    );
    arm.store(&calibration).unwrap();
    let pan = calibration.0["shoulder_pan"];
    assert_eq!((pan.range_min, pan.range_max), (647, 3247));
    bench.terminal.with(|world| world.servos().for_each(SimulatedServo::brown_out));
    let limits = bench.servo(1, |servo| servo.read(9, 4));
    assert_eq!(limits, [647u16.to_le_bytes(), 3247u16.to_le_bytes()].concat());
    bench.drives(&calibration).unwrap();
}

/// A servo that falls silent while the new frame is stored: those before it get their old values again.
#[test]
fn a_new_frame_is_stored_in_all_servos_or_in_none() {
    let bench = Bench::new(4);
    let mut arm = bench.open().unwrap();
    arm.center().unwrap();
    bench.sweep(&mut arm, 0.0);
    let (calibration, _) = arm.finish().unwrap();
    // it answers until it is written
    bench.servo(3, |servo| servo.mute_when_written = true);
    let failed = arm.store(&calibration).unwrap_err();
    assert!(
        failed.what.contains("elbow_flex (id 3)") && failed.help.contains("motor elbow_flex (id 3) may"),
        "{failed:?}"
    );
    for id in 1..=6 {
        let (offset, limits) = bench.servo(id, |servo| (servo.read(31, 2), servo.read(9, 4)));
        assert_eq!((offset, limits), (vec![4, 0], vec![0, 0, 0xFF, 0x0F]), "servo {id}");
    }
}

/// A servo that counts otherwise than its new offset requires: all servos get their old values again.
#[test]
fn an_offset_that_does_not_work_is_taken_back() {
    let bench = Bench::new(4);
    bench.servo(2, |servo| {
        servo.ignores_offset = true;
        servo.place(2300.0);
    });
    let mut arm = bench.open().unwrap();
    arm.center().unwrap();
    bench.sweep(&mut arm, 0.0);
    let (calibration, _) = arm.finish().unwrap();
    let failed = arm.store(&calibration).unwrap_err();
    assert!(failed.what.contains("shoulder_lift (id 2) is off by"), "{failed:?}");
    assert!(failed.help.contains("all servos have their old values again"), "{failed:?}");
    assert!((1..=6).all(|id| bench.servo(id, |servo| servo.read(31, 2)) == [4, 0]));
}

/// What can't be calibrated is named, and stays as it is.
#[test]
fn arms_that_cannot_be_calibrated_are_refused() {
    let refused = |change: fn(&mut SimulatedServo)| {
        let bench = Bench::new(0);
        bench.servo(3, change);
        let refused = bench.open().err().expect("a refusal");
        assert_eq!(bench.stored(), 0);
        format!("{} ({})", refused.what, refused.help)
    };
    let torque = refused(|servo| servo.write(40, &[1]));
    assert!(torque.contains("motor elbow_flex (id 3) has torque") && torque.contains("end the program"), "{torque}");
    let model = refused(|servo| servo.store(3, 0x0c04));
    assert!(model.contains("elbow_flex (id 3) is a servo of model 3076"), "{model}");
    let silent = refused(|servo| servo.answers = false);
    assert!(silent.contains("motor elbow_flex (id 3) does not answer"), "{silent}");
    let bench = Bench::new(0);
    bench.terminal.with(|world| world.servos().for_each(|servo| servo.answers = false));
    let dark = bench.open().err().expect("a refusal");
    assert!(dark.what.contains("no servo answers") && dark.help.contains("power supply"), "{dark:?}");
    let mut nowhere = bench;
    nowhere.terminal.unplug();
    let gone = nowhere.open().err().expect("a refusal");
    assert!(gone.what.contains("can't be opened"), "{gone:?}");
}

/// A servo that gets torque or falls silent while the joints are moved ends the calibration.
#[test]
fn a_disturbed_calibration_ends() {
    let bench = Bench::new(0);
    let mut arm = bench.open().unwrap();
    bench.servo(2, |servo| servo.write(40, &[1]));
    assert!(arm.record().unwrap_err().what.contains("shoulder_lift (id 2) has torque"));
    bench.servo(2, |servo| {
        servo.write(40, &[0]);
        servo.answers = false;
    });
    let end = (0..100).find_map(|_| arm.record().err()).expect("an end");
    assert!(end.what.contains("shoulder_lift (id 2) does not answer"), "{end:?}");
}
