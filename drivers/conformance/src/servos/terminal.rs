//! The pseudo-terminal in front of simulated servos.

use super::ServoWorld;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::fs::File;
use std::io::{self, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Bytes that are read at once.
const READ_AT_ONCE: usize = 4096;
/// The longest wait for a request, ns: the servos move on meanwhile.
const WAIT_NS: i64 = 2_000_000;
/// Between request and answer.
const TURN_AROUND: Duration = Duration::from_micros(100);
/// Bits of a byte on the wire.
const WIRE_BITS: u32 = 10;

/// Servos behind a serial port of this machine, whose name is a link that stays while the cable is pulled and plugged in again.
pub struct ServoTerminal {
    world: Arc<Mutex<ServoWorld>>,
    link: PathBuf,
    baud: u32,
    begun: Instant,
    plugged: Option<(Arc<AtomicBool>, JoinHandle<()>)>,
}

impl ServoTerminal {
    /// Servos at the port `link`. At a baud rate above 0, each exchange takes as long as it would on the wire.
    ///
    /// # Errors
    /// If the system has no pseudo-terminal left, or the link can't be made.
    pub fn start(link: &Path, world: ServoWorld, baud: u32) -> io::Result<ServoTerminal> {
        let world = Arc::new(Mutex::new(world));
        let mut terminal = ServoTerminal { world, link: link.into(), baud, begun: instant(), plugged: None };
        terminal.plug_in()?;
        Ok(terminal)
    }

    /// The serial port.
    pub fn port(&self) -> &Path {
        &self.link
    }

    /// Looks at the servos, or changes them.
    pub fn with<T>(&self, act: impl FnOnce(&mut ServoWorld) -> T) -> T {
        let mut world = self.world.lock().unwrap_or_else(PoisonError::into_inner);
        world.advance(self.begun.elapsed());
        act(&mut world)
    }

    /// Pulls the cable: the port is gone.
    pub fn unplug(&mut self) {
        if let Some((end, thread)) = self.plugged.take() {
            end.store(true, Ordering::Relaxed);
            // a thread that panicked has ended as well
            let _ = thread.join();
        }
        let _ = std::fs::remove_file(&self.link);
    }

    /// Plugs the cable in.
    ///
    /// # Errors
    /// As for [`ServoTerminal::start`].
    pub fn plug_in(&mut self) -> io::Result<()> {
        self.unplug();
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let name = ptsname(&master, Vec::new())?;
        let name = Path::new(std::ffi::OsStr::from_bytes(name.as_bytes())).to_owned();
        // held open: a terminal that nobody has open hangs up
        let slave = rustix::fs::open(&name, OFlags::RDWR | OFlags::NOCTTY, Mode::empty())?;
        let mut termios = tcgetattr(&slave)?;
        termios.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &termios)?;
        std::os::unix::fs::symlink(&name, &self.link)?;
        let end = Arc::new(AtomicBool::new(false));
        let line = TerminalEnd {
            master: File::from(master),
            _slave: slave,
            world: self.world.clone(),
            baud: self.baud,
            begun: self.begun,
            end: end.clone(),
        };
        let thread = std::thread::Builder::new().name("servos".into()).spawn(move || line.serve())?;
        self.plugged = Some((end, thread));
        Ok(())
    }
}

impl Drop for ServoTerminal {
    fn drop(&mut self) {
        self.unplug();
    }
}

/// The servos' end of the terminal.
struct TerminalEnd {
    master: File,
    _slave: OwnedFd,
    world: Arc<Mutex<ServoWorld>>,
    baud: u32,
    begun: Instant,
    end: Arc<AtomicBool>,
}

impl TerminalEnd {
    fn serve(mut self) {
        let wait = Timespec { tv_sec: 0, tv_nsec: WAIT_NS };
        let mut bytes = vec![0; READ_AT_ONCE];
        while !self.end.load(Ordering::Relaxed) {
            let ready = poll(&mut [PollFd::new(&self.master, PollFlags::IN)], Some(&wait)).unwrap_or(0) > 0;
            // so that no answer has much to make up for
            self.world.lock().unwrap_or_else(PoisonError::into_inner).advance(self.begun.elapsed());
            if !ready {
                continue;
            }
            let Ok(count) = self.master.read(&mut bytes) else { return };
            let (back, late) = {
                let mut world = self.world.lock().unwrap_or_else(PoisonError::into_inner);
                (world.feed(bytes.get(..count).unwrap_or_default()), world.late)
            };
            if back.is_empty() {
                continue;
            }
            let bits = WIRE_BITS * (count + back.len()) as u32;
            let wire =
                if self.baud > 0 { bits * Duration::from_secs(1) / self.baud + TURN_AROUND } else { Duration::ZERO };
            pause(wire + late);
            if self.master.write_all(&back).is_err() {
                return;
            }
        }
    }
}

#[expect(clippy::disallowed_methods, reason = "a serial line lives in real time")]
fn pause(time: Duration) {
    if !time.is_zero() {
        std::thread::sleep(time);
    }
}

#[expect(clippy::disallowed_methods, reason = "a serial line lives in real time")]
fn instant() -> Instant {
    Instant::now()
}
