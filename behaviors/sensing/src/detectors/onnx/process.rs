//! A network in its own process. Whatever its file makes the runtime do (unbounded recursion,
//! terabytes of memory, endless loops), only that process ends.
//!
//! ```text
//! detector ──setup, images────> stdin  ┌ onnx-worker: limits of memory and processor time ┐ stdout ──size, outputs──> detector
//!                                      └ its end: a failure of this detector alone        ┘
//! ```
//! A message is its length (8 bytes, little endian) and its bytes.

use super::network::{NetworkOutput, NetworkSetup, OnnxNetwork};
use crate::detectors::picture::Picture;
use mobee_contract::KindError;
use std::ffi::OsString;
use std::io::{BufReader, BufWriter, Error, ErrorKind, Read, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::OnceLock;

/// Maximum length of a message: an image of 4096x4096 pixels, or 64 million numbers.
const MAX_MESSAGE_BYTES: u64 = 256 << 20;
/// Signal that ends a process once its processor time is used up.
const SIGXCPU: i32 = 24;
/// Maximum length of the error output of an ended process that is read.
const MAX_STDERR_BYTES: u64 = 4096;

/// Program and arguments that start [`serve`].
static PROGRAM: OnceLock<(OsString, Vec<OsString>)> = OnceLock::new();

/// Makes every network run in its own process from now on: `program` with these arguments must call
/// [`serve`] at once. Without this, networks run in the calling process, and a broken one may end
/// it.
pub fn use_process(program: impl Into<OsString>, arguments: &[&str]) {
    // Only the first call has an effect.
    let _ = PROGRAM.set((program.into(), arguments.iter().map(Into::into).collect()));
}

/// Runs one network for the process that started this one, until its input ends.
///
/// # Errors
/// If the connection breaks or the limits can't be set.
pub fn serve() -> std::io::Result<()> {
    // A panic is reported as an answer.
    std::panic::set_hook(Box::new(|_| {}));
    let mut from = BufReader::new(std::io::stdin().lock());
    let mut to = BufWriter::new(std::io::stdout().lock());
    let Some(setup) = receive(&mut from)? else { return Ok(()) };
    let setup: NetworkSetup = serde_json::from_slice(&setup)?;
    let memory = (setup.limits.memory_mib << 20).min(rlimit::getrlimit(rlimit::Resource::AS)?.1);
    rlimit::setrlimit(rlimit::Resource::AS, memory, memory)?;
    rlimit::setrlimit(rlimit::Resource::CORE, 0, 0)?;
    let allow = || allow_seconds(setup.limits.seconds);
    allow()?;
    let network = match OnnxNetwork::load(&setup) {
        Ok(network) => network,
        Err(e) => return send(&mut to, &[&[1], e.path.as_bytes(), &[0], e.what.as_bytes(), &[0], e.help.as_bytes()]),
    };
    let [width, height] = network.size.map(|n| (n as u32).to_le_bytes());
    send(&mut to, &[&[0], &width, &height])?;
    while let Some(message) = receive(&mut from)? {
        allow()?;
        let invalid = || Error::from(ErrorKind::InvalidData);
        let (size, rgb) = message.split_at_checked(8).ok_or_else(invalid)?;
        let [width, height] = numbers(size).ok_or_else(invalid)?;
        match network.run(&Picture { width, height, rgb: rgb.to_vec() }) {
            Err(why) => send(&mut to, &[&[1], why.as_bytes()])?,
            Ok(NetworkOutput { shape, numbers }) => {
                let shape: Vec<u8> = shape.iter().flat_map(|n| (*n as u32).to_le_bytes()).collect();
                let numbers: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
                if (shape.len() + numbers.len()) as u64 + 2 > MAX_MESSAGE_BYTES || shape.len() > 255 {
                    send(&mut to, &[&[1], b"its output has more than 64 million numbers"])?;
                } else {
                    send(&mut to, &[&[0, shape.len() as u8], &shape, &numbers])?;
                }
            }
        }
    }
    Ok(())
}

/// Limits the processor time of this process to this many seconds from now on.
fn allow_seconds(seconds: u64) -> std::io::Result<()> {
    let used = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime).tv_sec.unsigned_abs();
    let most = rlimit::getrlimit(rlimit::Resource::CPU)?.1;
    rlimit::setrlimit(rlimit::Resource::CPU, (used + seconds + 1).min(most), most)
}

fn receive(from: &mut impl Read) -> std::io::Result<Option<Vec<u8>>> {
    let mut length = [0; 8];
    match from.read_exact(&mut length) {
        Err(e) if e.kind() == ErrorKind::UnexpectedEof => return Ok(None),
        done => done?,
    }
    let length = u64::from_le_bytes(length);
    if length > MAX_MESSAGE_BYTES {
        return Err(ErrorKind::InvalidData.into());
    }
    let mut message = Vec::new();
    from.take(length).read_to_end(&mut message)?;
    if message.len() as u64 == length { Ok(Some(message)) } else { Err(ErrorKind::UnexpectedEof.into()) }
}

fn send(to: &mut impl Write, parts: &[&[u8]]) -> std::io::Result<()> {
    let length: usize = parts.iter().map(|p| p.len()).sum();
    to.write_all(&(length as u64).to_le_bytes())?;
    parts.iter().try_for_each(|part| to.write_all(part))?;
    to.flush()
}

/// Parses two integers of 4 bytes each.
fn numbers(bytes: &[u8]) -> Option<[usize; 2]> {
    match bytes {
        [a, b, c, d, e, f, g, h] => {
            Some([[*a, *b, *c, *d], [*e, *f, *g, *h]].map(|four| u32::from_le_bytes(four) as usize))
        }
        _ => None,
    }
}

/// Reason why a network has no output for an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum NetworkRunError {
    /// The network can't be run on the image.
    Refused(String),
    /// The network's process has ended.
    Ended(String),
}

/// A network that is ready to run, in this process or its own.
pub(super) enum NetworkRunner {
    Here(Box<OnnxNetwork>),
    Process(NetworkProcess),
}

impl NetworkRunner {
    /// Loads a network, and returns it with the width and height of its input, pixels.
    ///
    /// # Errors
    /// As for [`OnnxNetwork::load`], and a process that can't be started or ends.
    pub(super) fn start(setup: &NetworkSetup) -> Result<(NetworkRunner, [usize; 2]), KindError> {
        match PROGRAM.get() {
            None => {
                let network = OnnxNetwork::load(setup)?;
                let size = network.size;
                Ok((NetworkRunner::Here(Box::new(network)), size))
            }
            Some((program, arguments)) => {
                let (process, size) = NetworkProcess::start(program, arguments, setup)?;
                Ok((NetworkRunner::Process(process), size))
            }
        }
    }

    /// Runs the network on an image.
    ///
    /// # Errors
    /// The reason why there is no output.
    pub(super) fn run(&mut self, picture: &Picture) -> Result<NetworkOutput, NetworkRunError> {
        match self {
            NetworkRunner::Here(network) => network.run(picture).map_err(NetworkRunError::Refused),
            NetworkRunner::Process(process) => process.run(picture),
        }
    }
}

/// The process of a network. It is killed on drop.
pub(super) struct NetworkProcess {
    child: Child,
    to: BufWriter<ChildStdin>,
    from: BufReader<ChildStdout>,
    limits: super::OnnxLimits,
}

impl NetworkProcess {
    fn start(
        program: &OsString,
        arguments: &[OsString],
        setup: &NetworkSetup,
    ) -> Result<(NetworkProcess, [usize; 2]), KindError> {
        let no_process = |e: Error| {
            let help = "check that the program may start processes (`ulimit -u`)";
            KindError::new("file", format!("no process can be started to run the network in: {e}"), help)
        };
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Ctrl-C is handled by the run, which ends its parts in order.
        let mut child = command.process_group(0).spawn().map_err(no_process)?;
        let (Some(to), Some(from)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(no_process(ErrorKind::BrokenPipe.into()));
        };
        let to = BufWriter::with_capacity(1 << 16, to);
        let from = BufReader::with_capacity(1 << 16, from);
        let mut process = NetworkProcess { child, to, from, limits: setup.limits };
        let setup = serde_json::to_vec(setup).unwrap_or_default();
        let answer = process.call(&[&setup]).map_err(|why| {
            let help = "export a simpler network, or raise `limits`";
            KindError::new("file", format!("it can't be loaded: {why}"), help)
        })?;
        let size = match answer.split_first() {
            Some((0, size)) => numbers(size),
            Some((_, fault)) => {
                let mut parts = fault.splitn(3, |b| *b == 0).map(|p| String::from_utf8_lossy(p).into_owned());
                let mut part = || parts.next().unwrap_or_default();
                return Err(KindError::new(part(), part(), part()));
            }
            None => None,
        };
        let size = size.ok_or_else(|| no_process(ErrorKind::InvalidData.into()))?;
        Ok((process, size))
    }

    fn run(&mut self, picture: &Picture) -> Result<NetworkOutput, NetworkRunError> {
        let [width, height] = [picture.width, picture.height].map(|n| (n as u32).to_le_bytes());
        let answer = self.call(&[&width, &height, &picture.rgb]).map_err(NetworkRunError::Ended)?;
        let output = match answer.split_first() {
            Some((0, rest)) => rest.split_first().and_then(|(bytes, rest)| rest.split_at_checked(usize::from(*bytes))),
            Some((_, why)) => return Err(NetworkRunError::Refused(String::from_utf8_lossy(why).into_owned())),
            None => None,
        };
        let (shape, values) = output.ok_or_else(|| NetworkRunError::Ended("its answer is damaged".into()))?;
        let four = |b: &[u8]| [b[0], b[1], b[2], b[3]];
        Ok(NetworkOutput {
            shape: shape.chunks_exact(4).map(|b| u32::from_le_bytes(four(b)) as usize).collect(),
            numbers: values.chunks_exact(4).map(|b| f32::from_le_bytes(four(b))).collect(),
        })
    }

    /// Sends a message and blocks until the answer is received.
    fn call(&mut self, message: &[&[u8]]) -> Result<Vec<u8>, String> {
        let answer = send(&mut self.to, message).and_then(|()| receive(&mut self.from));
        answer.ok().flatten().ok_or_else(|| self.failure())
    }

    /// Ends the process and returns the reason why it failed.
    fn failure(&mut self) -> String {
        let _ = self.child.kill();
        let mut bytes = Vec::new();
        if let Some(errors) = self.child.stderr.take() {
            let _ = errors.take(MAX_STDERR_BYTES).read_to_end(&mut bytes);
        }
        let stderr = String::from_utf8_lossy(&bytes).into_owned();
        let super::OnnxLimits { memory_mib, seconds } = self.limits;
        match self.child.wait() {
            _ if stderr.contains("overflowed its stack") => "its operations are nested too deeply".into(),
            _ if stderr.contains("memory allocation of") => format!("it needs more than {memory_mib} MiB of memory"),
            Ok(status) if status.signal() == Some(SIGXCPU) => {
                format!("it needs more than {seconds} s of processor time for one image")
            }
            Ok(status) => match stderr.lines().next() {
                Some(line) => format!("its process ended ({status}): {line}"),
                None => format!("its process ended ({status})"),
            },
            Err(e) => format!("its process can't be reached: {e}"),
        }
    }
}

impl Drop for NetworkProcess {
    fn drop(&mut self) {
        // An error means that the process has already ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
