//! Reflex latency: from the encoder sample that shows a contact to the stop command at the driver, by the wall clock,
//! beside a bare control loop that stops at once, in the same run on the same machine. Then the same once more while a
//! viewer follows that takes the connection and never reads (I16).
//!
//! `cargo bench --bench reflex_latency [-- SECONDS]`

#![expect(clippy::disallowed_methods, reason = "latency is measured by the wall clock")]

use mobee::compose::compose;
use mobee::config::Config;
use mobee::run::{Folder, run};
use mobee_contract::{Board, Command, ControlMode, Driver, DriverFault, Hardware, Sample, Time};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Hardware whose drivers note how long after the newest sample a stop arrives.
struct Timed(Arc<dyn Hardware>, Arc<Mutex<Vec<Duration>>>);

struct TimedDriver {
    inner: Box<dyn Driver>,
    sampled: Option<Instant>,
    log: Arc<Mutex<Vec<Duration>>>,
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
            self.log.lock().expect("no panic").push(sampled.elapsed());
        }
        self.inner.command(now, command)
    }
    fn sample(&mut self, now: Time) -> Result<Option<Sample>, DriverFault> {
        let sample = self.inner.sample(now)?;
        if sample.is_some() {
            self.sampled = Some(Instant::now());
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

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let secs = std::env::args().find_map(|a| a.parse::<f64>().ok()).unwrap_or(60.0);
    let (alone, bare) = measure(secs, None)?;
    // its queue of connections is enough: what is sent is acknowledged by the system, and read by nobody
    let viewer = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    let (frozen, bare_then) = measure(secs, Some(viewer.local_addr()?))?;
    println!(
        "p99 over that of the bare loop: {:.2} alone, {:.2} with a frozen viewer",
        alone / bare,
        frozen / bare_then
    );
    Ok(())
}

/// The 99th percentiles of the reflex and of a bare loop beside it, seconds.
fn measure(secs: f64, viewer: Option<SocketAddr>) -> Result<(f64, f64), Box<dyn std::error::Error>> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/explore.toml");
    let mut set = vec!["clock=real".to_owned(), format!("for_s={secs:?}"), "robot.icub.agent.speed=0.4".to_owned()];
    // poses as quickly as they come, so that what waits for the viewer soon fills all that there is
    set.extend(viewer.iter().flat_map(|at| [format!("record.live=\"{at}\""), "record.poses_hz=100.0".to_owned()]));
    let (config, source) = Config::load(&file, &set)?;
    let mut composition = compose(config, &source)?;
    let (reflex, bare) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new(Vec::new())));
    composition.robots[0].hardware = Arc::new(Timed(composition.robots[0].hardware.clone(), reflex.clone()));

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
    let scratch = tempfile::tempdir()?;
    let (_controls, receiver) = tokio::sync::mpsc::channel(1);
    let done = run(composition, &Folder::create("latency", Some(scratch.path()))?, receiver, |_| ())?;
    over.store(true, Ordering::Relaxed);
    let _ = control.join();

    let how = if viewer.is_some() { "a viewer that is frozen" } else { "no viewer" };
    println!("{how}: {} rollbacks in {secs} s by the wall clock", done.end.counts.rolled_back);
    done.complaints.iter().for_each(|c| println!("{c}"));
    Ok((figures("reflex, sample to stop", &reflex), figures("bare loop, sample to stop", &bare)))
}

/// Prints the distribution and returns the 99th percentile, seconds.
fn figures(name: &str, log: &Mutex<Vec<Duration>>) -> f64 {
    let mut all: Vec<f64> = log.lock().expect("no panic").iter().map(Duration::as_secs_f64).collect();
    all.sort_by(f64::total_cmp);
    let at = |share: f64| {
        all.get(((all.len().saturating_sub(1)) as f64 * share).round() as usize).copied().unwrap_or(f64::NAN)
    };
    println!(
        "{name:26} n {:5}  p50 {:.4} ms  p99 {:.4} ms  max {:.4} ms",
        all.len(),
        at(0.5) * 1e3,
        at(0.99) * 1e3,
        at(1.0) * 1e3
    );
    at(0.99)
}
