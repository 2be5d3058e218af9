//! An SO-101 of six simulated servos at a pseudo-terminal.

use mobee_conformance::servos::{ServoTerminal, ServoWorld};
use mobee_contract::{Driver, DriverFault, Hardware, Sample, Time};
use mobee_feetech::{BusMotorSettings, FeetechHardware, FeetechSettings};
use mobee_model::Robot;
use std::path::Path;
use std::time::{Duration, Instant};

/// The bits per second of an arm's bus.
pub const BAUD: u32 = 1_000_000;

pub fn robot() -> Robot {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/so101.xml");
    mobee_model::load_robot(&file).expect("the SO-101").value
}

/// Settings of an arm with narrow ranges, so that tests that go to the limits are short.
pub fn settings(port: &Path, robot: &Robot) -> FeetechSettings {
    let motor = |(i, motor): (usize, &mobee_model::Motor)| BusMotorSettings {
        joint: motor.name.clone(),
        id: Some(i as u8 + 1),
        range: Some([1700, 2396]),
        offset_deg: if motor.name == "gripper" { 40.0 } else { 0.0 },
        inverted: i == 1,
        ..BusMotorSettings::default()
    };
    let motors = robot.motors.iter().enumerate().map(motor).collect();
    FeetechSettings { motors, connect_s: 2.0, ..FeetechSettings::at(port.to_string_lossy()) }
}

/// An arm, and the servos behind it. The arm is dropped first.
pub struct Arm {
    pub hardware: FeetechHardware,
    pub terminal: ServoTerminal,
    begun: Instant,
    _folder: tempfile::TempDir,
}

#[allow(clippy::disallowed_methods, reason = "a serial line lives in real time")]
impl Arm {
    pub fn new() -> Arm {
        Arm::with(|settings| settings)
    }

    pub fn with(change: impl FnOnce(FeetechSettings) -> FeetechSettings) -> Arm {
        let folder = tempfile::tempdir().expect("a folder");
        let port = folder.path().join("tty");
        let terminal = ServoTerminal::start(&port, ServoWorld::new(1..=6), BAUD).expect("a pseudo-terminal");
        let robot = robot();
        let settings = change(settings(&port, &robot));
        let hardware = FeetechHardware::new(&settings, &robot).expect("settings");
        Arm { hardware, terminal, begun: Instant::now(), _folder: folder }
    }

    pub fn now(&self) -> Time {
        Time(self.begun.elapsed().as_nanos() as u64 + 1_000_000_000)
    }

    pub fn connect(&self) -> Box<dyn Driver> {
        self.hardware.connect().expect("a connection")
    }

    pub fn pause(&self, time: Duration) {
        std::thread::sleep(time);
    }

    /// Renews the lease and reads for at most this long, until something holds.
    pub fn until<T>(
        &self,
        driver: &mut dyn Driver,
        patience: Duration,
        mut holds: impl FnMut(Result<Option<Sample>, DriverFault>) -> Option<T>,
    ) -> Option<T> {
        let end = Instant::now() + patience;
        while Instant::now() < end {
            let now = self.now();
            driver.lease(now, now + Duration::from_millis(200));
            if let Some(found) = holds(driver.sample(now)) {
                return Some(found);
            }
            let next = driver.next_sample(self.now());
            self.pause(next.since(self.now()).max(Duration::from_micros(500)));
        }
        None
    }

    /// Waits until all motors are done; the readings.
    pub fn until_done(&self, driver: &mut dyn Driver) -> Vec<Sample> {
        let mut all = Vec::new();
        let done = self.until(driver, Duration::from_secs(20), |read| {
            let sample = read.expect("no fault")?;
            let done = sample.done.iter().all(|d| *d);
            all.push(sample);
            done.then_some(())
        });
        assert!(done.is_some(), "not done within 20 s");
        all
    }

    /// The text of the next fault.
    pub fn fault(&self, driver: &mut dyn Driver, patience: Duration) -> String {
        let found = self.until(driver, patience, |read| match read {
            Err(DriverFault::Hardware(what)) => Some(what),
            _ => None,
        });
        found.expect("a fault")
    }

    /// Waits until readings come again; how long that took.
    pub fn recovered(&self, driver: &mut dyn Driver) -> Duration {
        let begun = Instant::now();
        let found = self.until(driver, Duration::from_secs(10), |read| read.ok().flatten());
        assert!(found.is_some(), "no reading within 10 s");
        begun.elapsed()
    }
}
