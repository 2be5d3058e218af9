//! Reflex latency: wall-clock time from the encoder sample that shows a contact to the stop command at the driver, and
//! the period between samples, compared with a bare control loop that stops at once, in the same run on the same
//! machine.
//!
//! * an iCub that explores, with recording,
//! * the same with a connected viewer that never reads (I16),
//! * the complete system: an iCub that perceives and reaches (`reach.toml`: two cameras, detectors, locator, a map of
//!   thousands of configurations, recording), while an object is repeatedly moved into the path of its arm.
//!
//! `cargo bench --bench reflex_latency [-- SECONDS]`

#![expect(clippy::disallowed_methods, reason = "latency is measured by the wall clock")]

use mobee::compose::compose;
use mobee::config::Config;
use mobee::run::{Folder, run};
use mobee_contract::{Board, Command, ControlMode, Driver, DriverFault, Hardware, Sample, Time};
use std::fmt::Write;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Measurements at a driver.
#[derive(Default)]
struct Log {
    /// Delay of each stop command after the newest sample.
    stops: Vec<Duration>,
    /// Time between consecutive samples.
    periods: Vec<Duration>,
}

/// Hardware whose drivers log the times of samples and stop commands.
struct Timed(Arc<dyn Hardware>, Arc<Mutex<Log>>);

struct TimedDriver {
    inner: Box<dyn Driver>,
    sampled: Option<Instant>,
    log: Arc<Mutex<Log>>,
}

impl Hardware for Timed {
    fn connect(&self) -> Result<Box<dyn Driver>, DriverFault> {
        Ok(Box::new(TimedDriver { inner: self.0.connect()?, sampled: None, log: self.1.clone() }))
    }
}

impl Driver for TimedDriver {
    fn board(&self) -> &Board {
        self.inner.board()
    }
    fn command(&mut self, now: Time, command: &Command) -> Result<(), DriverFault> {
        if let (Command::Stop { .. }, Some(sampled)) = (command, self.sampled) {
            self.log.lock().expect("no panic").stops.push(sampled.elapsed());
        }
        self.inner.command(now, command)
    }
    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let sample = self.inner.sample(now)?;
        if sample.is_some() {
            let before = self.sampled.replace(Instant::now());
            self.log.lock().expect("no panic").periods.extend(before.map(|before| before.elapsed()));
        }
        Ok(sample)
    }
    fn next_sample(&self, now: Time) -> Time {
        self.inner.next_sample(now)
    }
    fn lease(&mut self, now: Time, until: Time) {
        self.inner.lease(now, until);
    }
    fn modes(&self) -> Vec<ControlMode> {
        self.inner.modes()
    }
}

/// Period of the disturbances, s, and their position, m, on the path of the arm.
const DISTURBED_S: f64 = 4.0;
const FOREARM: [f64; 3] = [-0.30, 0.20, 0.05];

/// Load of the system during a measurement.
enum Load {
    /// The iCub explores; optionally with a viewer that does not read.
    Explore(Option<SocketAddr>),
    /// It perceives and reaches, with disturbances.
    Reach,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let secs = std::env::args().find_map(|a| a.parse::<f64>().ok()).unwrap_or(60.0);
    // The listen queue suffices: the operating system acknowledges the data, and no process reads it.
    let viewer = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    let frozen = Load::Explore(Some(viewer.local_addr()?));
    let loads = [("explore", Load::Explore(None)), ("explore, a viewer is frozen", frozen), ("reach", Load::Reach)];
    for (name, load) in loads {
        let (stops, periods) = measure(secs, name, &load)?;
        println!("{name}: p99 over that of the bare loop: sample to stop {stops:.2}, period {periods:.3}\n");
    }
    Ok(())
}

/// The behavior file and settings of a run.
fn behavior(load: &Load, secs: f64, dir: &Path) -> Result<(PathBuf, Vec<String>), std::io::Error> {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors");
    let mut set = vec!["clock=real".to_owned(), format!("for_s={secs:?}")];
    match load {
        Load::Explore(viewer) => {
            set.push("robot.icub.agent.speed=0.4".to_owned());
            // Configurations at the full rate, so that the data for the viewer soon fills all buffers.
            let live = |at: &SocketAddr| [format!("record.live=\"{at}\""), "record.poses_hz=100.0".to_owned()];
            set.extend(viewer.iter().flat_map(live));
            Ok((configs.join("explore.toml"), set))
        }
        Load::Reach => {
            let mut text = format!("include = [{:?}]\n", configs.join("reach.toml").display().to_string());
            // An object in the arm's path for 0.3 s.
            for k in 1..(secs / DISTURBED_S) as u32 {
                for (after, x) in [(0.0, FOREARM[0]), (0.3, 2.0)] {
                    let at = f64::from(k) * DISTURBED_S + after;
                    let [_, y, z] = FOREARM;
                    let edit = format!("{{ object = \"lamp\", position_m = [{x}, {y}, {z}] }}");
                    let _ = writeln!(text, "[[script]]\nwhen.at_s = {at:.1}\nedit = {edit}");
                }
            }
            let file = dir.join("disturbed.toml");
            std::fs::write(&file, text)?;
            // Without replanning only the reflex stops a motion.
            set.extend(["follow=false", "repeat=0", "wait_s=0"].map(|s| format!("robot.icub.agent.{s}")));
            Ok((file, set))
        }
    }
}

/// Ratios of the 99th percentiles of the reflex to those of a concurrent bare loop: sample to stop, and period.
fn measure(secs: f64, name: &str, load: &Load) -> Result<(f64, f64), Box<dyn std::error::Error>> {
    let scratch = tempfile::tempdir()?;
    let (file, set) = behavior(load, secs, scratch.path())?;
    let (config, source) = Config::load(&file, &set)?;
    let mut composition = compose(config, &source)?;
    let ours = Arc::<Mutex<Log>>::default();
    let bare = Arc::<Mutex<Log>>::default();
    composition.robots[0].hardware = Arc::new(Timed(composition.robots[0].hardware.clone(), ours.clone()));

    let (config, source) = Config::load(&file, &[])?;
    let bare_hardware = Timed(compose(config, &source)?.robots[0].hardware.clone(), bare.clone());
    let over = Arc::new(AtomicBool::new(false));
    let stop = over.clone();
    let control = std::thread::spawn(move || {
        let Ok(mut driver) = bare_hardware.connect() else { return };
        let start = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let now = Time::ZERO + start.elapsed();
            if matches!(driver.sample(now), Ok(Some(_))) {
                let _ = driver.command(now, &Command::Stop { motors: Vec::new() });
            }
            std::thread::sleep(driver.next_sample(now).since(now).max(Duration::from_millis(1)));
        }
    });
    let (_controls, receiver) = tokio::sync::mpsc::channel(1);
    let done = run(composition, &Folder::create("latency", Some(&scratch.path().join("run")))?, receiver, |_| ())?;
    over.store(true, Ordering::Relaxed);
    let _ = control.join();

    println!("{name}: {} rollbacks in {secs} s by the wall clock", done.end.counts.rolled_back);
    done.complaints.iter().for_each(|c| println!("{c}"));
    done.overload.iter().for_each(|(c, _)| println!("{c}"));
    let [ours, bare] = [ours, bare].map(|log| std::mem::take(&mut *log.lock().expect("no panic")));
    let stops = figures("sample to stop", ours.stops) / figures("  bare loop", bare.stops);
    Ok((stops, figures("period", ours.periods) / figures("  bare loop", bare.periods)))
}

/// Prints the distribution, and returns the 99th percentile, seconds.
fn figures(name: &str, mut all: Vec<Duration>) -> f64 {
    all.sort();
    let at = |share: f64| {
        let at = all.get(((all.len().saturating_sub(1)) as f64 * share).round() as usize);
        at.map_or(f64::NAN, Duration::as_secs_f64)
    };
    println!(
        "{name:16} n {:5}  p50 {:.4} ms  p99 {:.4} ms  max {:.4} ms",
        all.len(),
        at(0.5) * 1e3,
        at(0.99) * 1e3,
        at(1.0) * 1e3
    );
    at(0.99)
}
