//! Write a driver for hardware on a byte stream: a thread of its own owns the wire, and the driver never waits for it.
//!
//! ```text
//! Command, lease ─> Plant ─goals─> [latest value] ─> bus thread ═ wire ═ device
//!                   Sample <──────── [latest value] <─┘
//! ```
//! The device is a thread at the other end of a socket pair. A serial port has the same `Read` and `Write` (crate `serialport`).
//! `mobee new --crate NAME` writes a crate with such a driver and a test of every promise that drivers make.
//!
//! `cargo run --release --example 13_write_your_own_driver`

#![expect(clippy::disallowed_methods, reason = "a bus thread waits for real hardware, by the real clock")]

use mobee_contract::{
    Axis, Board, Command, Context, ControlMode, Driver, DriverFault, Hardware, Kind, KindError, Registered, Sample,
    Time,
};
use mobee_model::Motor;
use mobee_sim::{Plant, path::Profile};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_millis(10);
/// An answer that takes longer is a lost one.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(20);
/// A reading that is older than this means that the device does not answer.
const LOST_AFTER: Duration = Duration::from_millis(200);

/// The values that driver and bus thread exchange. Each side overwrites its own; neither waits for the other.
struct Latest {
    plant: Plant,
    measured: Vec<f64>,
    seq: u64,
    read_at: Instant,
}

/// Locks for the time of a copy. A panic of the other side leaves valid values.
fn lock(latest: &Mutex<Latest>) -> MutexGuard<'_, Latest> {
    latest.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The bus thread: writes the goals and reads the positions, until the hardware is dropped or the wire breaks.
fn bus(mut wire: UnixStream, latest: &Weak<Mutex<Latest>>) -> std::io::Result<()> {
    wire.set_read_timeout(Some(ANSWER_TIMEOUT))?;
    while let Some(latest) = latest.upgrade() {
        let begun = Instant::now();
        let goals: Vec<u8> = lock(&latest).plant.positions().flat_map(f64::to_le_bytes).collect();
        wire.write_all(&goals)?;
        let mut answer = vec![0; goals.len()];
        wire.read_exact(&mut answer)?;
        let values = answer.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
        {
            let mut latest = lock(&latest);
            latest.measured = values;
            latest.seq += 1;
            latest.read_at = Instant::now();
        }
        std::thread::sleep(PERIOD.saturating_sub(begun.elapsed()));
    }
    Ok(())
}

struct WireArm {
    facts: Board,
    latest: Arc<Mutex<Latest>>,
}

impl WireArm {
    fn open(context: &Context) -> std::io::Result<WireArm> {
        let motors = &context.robot.motors;
        let limits = Axis { max_speed: 1.0, max_acceleration: 4.0, ..Axis::default() };
        let axis = |m: &Motor| Axis { name: m.name.clone(), min: m.min, max: m.max, ..limits.clone() };
        let axes: Vec<Axis> = motors.iter().map(axis).collect();
        let start: Vec<f64> = motors.iter().map(|m| m.home).collect();
        let plant = Plant::new(axes.clone(), &start, Profile::Trapezoidal);
        let latest = Latest { plant, measured: start, seq: 0, read_at: Instant::now() };
        let latest = Arc::new(Mutex::new(latest));
        let (ours, mut device) = UnixStream::pair()?;
        // the device moves its motors to each goal at once, and answers with their positions
        let mut frame = vec![0; axes.len() * 8];
        std::thread::spawn(
            move || while device.read_exact(&mut frame).and_then(|()| device.write_all(&frame)).is_ok() {},
        );
        let shared = Arc::downgrade(&latest);
        std::thread::spawn(move || bus(ours, &shared));
        let facts = Board { axes, period: PERIOD, latency: 2 * PERIOD, position_direct: true };
        Ok(WireArm { facts, latest })
    }
}

impl Hardware for WireArm {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        Ok(Box::new(WireDriver { facts: self.facts.clone(), latest: self.latest.clone(), fetched: 0 }))
    }
}

struct WireDriver {
    facts: Board,
    latest: Arc<Mutex<Latest>>,
    fetched: u64,
}

impl Driver for WireDriver {
    fn board(&self) -> &Board {
        &self.facts
    }
    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        lock(&self.latest).plant.command(now, command, Duration::ZERO).map_err(DriverFault::Refused)
    }
    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let mut latest = lock(&self.latest);
        latest.plant.advance(now);
        let age = latest.read_at.elapsed();
        if age > LOST_AFTER {
            return Err(DriverFault::Lost);
        }
        if latest.seq == self.fetched {
            return Ok(None);
        }
        self.fetched = latest.seq;
        let at = Time(now.0.saturating_sub(age.as_nanos() as u64));
        let done = latest.plant.done();
        Ok(Some(Sample { seq: latest.seq, at, q: latest.measured.clone().into(), done, ..Sample::default() }))
    }
    fn next_sample(&self, now: Time) -> Time {
        now + PERIOD / 2
    }
    fn lease(&mut self, now: Time, until: Time) {
        lock(&self.latest).plant.lease(now, until);
    }
    fn modes(&self) -> Vec<ControlMode> {
        lock(&self.latest).plant.modes()
    }
}

inventory::submit! {
    Registered(&Kind::<dyn Hardware> {
        name: "wire",
        doc: "An arm on a byte stream.",
        schema: || schemars::schema_for!(()),
        example: |_| Err("its device is a thread of this example"),
        build: |_, context| {
            let broken = |e: std::io::Error| KindError::new("", e.to_string(), "close other programs");
            Ok(Arc::new(WireArm::open(context).map_err(broken)?))
        },
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let driver = r#"robot.icub.driver={ kind = "wire" }"#;
    let settings = [driver, "clock=\"real\"", "robot.icub.agent.speed=0.4", "for_s=10", "record.enabled=false"];
    let done = mobee::run::example("configs/behaviors/explore.toml", &settings)?;
    let summary = mobee::run::summary(&done);
    println!("{}", serde_json::to_string_pretty(&summary)?);
    assert!(mobee::run::in_order(&done.end), "the run ends in order");
    assert!(summary["counters"]["commits"].as_u64() > Some(1), "motions end on the wire");
    Ok(())
}
