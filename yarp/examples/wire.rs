//! Compares our ports with those of the real YARP over loopback: RPC round trips, a stream of 16 joints at 1 kHz, and
//! 320x240 pictures at 30 Hz.
//!
//!     cargo run --release -p mobee-yarp --example wire -- all [PROGRAM]
//!
//! PROGRAM is `tests/yarp/wire.cpp` built against the real library; without it only our side is measured. For a fair
//! comparison the library must be optimized, which the one for the tests is not (see `tests/yarp/install.sh`):
//!
//!     MOBEE_YARP=$HOME/.cache/mobee/yarp-fast MOBEE_YARP_FLAGS="-O3 -DNDEBUG" tests/yarp/install.sh
//!     cargo run --release -p mobee-yarp --example wire -- all $HOME/.cache/mobee/yarp-fast/programs/wire

use std::error::Error;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use mobee_yarp::payload::vector;
use mobee_yarp::{
    Bottle, Carrier, Delivery, Dialect, Handler, Image, InputPort, Message, NameServer, Network, OutputPort, Payload,
    PixelCode, Queue, RpcClient, RpcServer, ServerOptions, Stamp, Vocab,
};

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

fn main() -> Outcome {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    if let ["all", real @ ..] = args.as_slice() {
        return compare(real.first().map(|program| PathBuf::from(*program)));
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        match args.as_slice() {
            ["names"] => names().await,
            ["serve", _, name, ..] => serve(name).await,
            ["call", _, name, server, count, carrier] => call(name, server, count.parse()?, carrier.parse()?).await,
            ["publish", kind, name, period, count, ..] => publish(kind, name, period.parse()?, count.parse()?).await,
            ["watch", kind, name, source, count, carrier] => {
                watch(kind, name, source, count.parse()?, carrier.parse()?).await
            }
            _ => Err("usage: wire all [PROGRAM]".into()),
        }
    })
}

// ---- the roles, the same as in wire.cpp ----

/// Seconds since 1970: the only clock that two processes share.
#[expect(clippy::disallowed_methods, reason = "a measurement of real time, not part of any program")]
fn now() -> f64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

async fn names() -> Outcome {
    let server = NameServer::bind(([127, 0, 0, 1], 0).into(), ServerOptions::default()).await?;
    println!("ready {}", server.address().port());
    until_told().await
}

async fn until_told() -> Outcome {
    Ok(tokio::task::spawn_blocking(|| std::io::stdin().read(&mut [0]).map(drop)).await??)
}

struct Answers;

impl Handler for Answers {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        let request = request.payload.bottle(Dialect::V3);
        Box::pin(async move {
            request.ok()?;
            let values = Bottle::of((0..16).map(|i| 0.1 * f64::from(i)));
            let reply = Bottle::of([Vocab::new("is"), Vocab::new("encs")]).with(values).with(Vocab::new("ok"));
            Some(reply.into())
        })
    }
}

async fn serve(name: &str) -> Outcome {
    let _port = RpcServer::open(&Network::from_env()?, name, Arc::new(Answers)).await?;
    println!("ready");
    until_told().await
}

async fn call(name: &str, server: &str, count: usize, carrier: Carrier) -> Outcome {
    let mut port = RpcClient::connect(&Network::from_env()?, name, server, carrier).await?;
    let request = Bottle::of([Vocab::new("get"), Vocab::new("encs")]);
    let mut seconds = Vec::new();
    for i in 0..count + 100 {
        let start = now();
        let reply = port.call(&request).await?;
        if reply.len() != 4 {
            return Err(format!("a reply of {reply}").into());
        }
        if i >= 100 {
            seconds.push(now() - start);
        }
    }
    port.close().await;
    say(seconds, count)
}

async fn publish(kind: &str, name: &str, period: f64, count: usize) -> Outcome {
    let writer = OutputPort::open(&Network::from_env()?, name, Delivery::Newest).await?;
    println!("ready");
    while writer.peers().is_empty() {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    tokio::time::sleep(Duration::from_millis(200)).await;
    let kind = kind.to_string();
    tokio::task::spawn_blocking(move || {
        write_all(&writer, &kind, period, count).map_err(|error| error.to_string())?;
        // stays until it is told to end
        std::io::stdin().read(&mut [0]).map(drop).map_err(|error| error.to_string())
    })
    .await??;
    Ok(())
}

/// Writes from a thread of its own, since the runtime's clock ticks only once in a millisecond.
fn write_all(writer: &OutputPort, kind: &str, period: f64, count: usize) -> Outcome {
    let mut image = Image::new(PixelCode::RGB, 320, 240, &vec![0; 320 * 240 * 3])?;
    let mut next = now();
    for i in 0..count {
        pause(next - now());
        next += period;
        let head = [now(), i as f64];
        let payload = match kind {
            "image" => {
                for (place, byte) in image.rows.iter_mut().zip(head.iter().flat_map(|x| x.to_le_bytes())) {
                    *place = byte;
                }
                image.encode()
            }
            _ => {
                let mut joints = [0.0; 16];
                joints[..2].copy_from_slice(&head);
                vector::encode(&joints, Dialect::V3)
            }
        };
        let stamp = Stamp { count: i as u32, time: head[0] };
        writer.write(payload, Some(stamp.envelope()));
    }
    Ok(())
}

#[expect(clippy::disallowed_methods, reason = "the pace of a measurement in real time")]
fn pause(seconds: f64) {
    std::thread::sleep(Duration::from_secs_f64(seconds.max(0.0)));
}

async fn watch(kind: &str, name: &str, source: &str, count: usize, carrier: Carrier) -> Outcome {
    let mut reader = InputPort::open(&Network::from_env()?, name, Queue::Bounded(1000)).await?;
    reader.connect_from(source, carrier).await?;
    let mut seconds = Vec::new();
    while seconds.len() < count {
        let Ok(Some(message)) = tokio::time::timeout(Duration::from_secs(2), reader.recv()).await else { break };
        let bytes = message.payload.binary(Dialect::V3)?;
        let made = match kind {
            "image" => {
                let image = Image::decode(&bytes, Dialect::V3)?;
                image.rows.first_chunk::<8>().map(|made| f64::from_le_bytes(*made))
            }
            _ => vector::decode(&bytes, Dialect::V3)?.first().copied(),
        };
        seconds.push(now() - made.ok_or("an empty message")?);
    }
    reader.close().await;
    say(seconds, count)
}

fn say(mut seconds: Vec<f64>, sent: usize) -> Outcome {
    seconds.sort_by(f64::total_cmp);
    let at = |part: f64| {
        let place = ((part * seconds.len() as f64) as usize).min(seconds.len().saturating_sub(1));
        seconds.get(place).map_or(0.0, |s| s * 1e6)
    };
    println!("result {:.1} {:.1} {:.1} {} {sent}", at(0.5), at(0.99), at(1.0), seconds.len());
    Ok(())
}

// ---- the comparison ----

/// A role running in a process of its own; told to end when dropped.
struct Role {
    child: Child,
    lines: BufReader<std::process::ChildStdout>,
}

impl Role {
    fn start(program: &Path, home: &Path, args: &[&str]) -> Outcome<Role> {
        let mut child = Command::new(program)
            .args(args)
            .env("YARP_CONFIG_HOME", home)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()?;
        let lines = BufReader::new(child.stdout.take().ok_or("no output")?);
        Ok(Role { child, lines })
    }

    /// The rest of the line that begins with a word.
    fn line(&mut self, word: &str) -> Outcome<String> {
        let mut line = String::new();
        while self.lines.read_line(&mut line)? > 0 {
            if let Some(rest) = line.strip_prefix(word) {
                return Ok(rest.trim().into());
            }
            line.clear();
        }
        Err(format!("a process ended without saying \"{word}\"").into())
    }
}

impl Drop for Role {
    fn drop(&mut self) {
        drop(self.child.stdin.take());
        for _ in 0..30 {
            if matches!(self.child.try_wait(), Ok(Some(_))) {
                return;
            }
            pause(0.1);
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

struct Measure {
    title: &'static str,
    serves: [&'static str; 2],
    asks: [&'static str; 2],
    period: &'static str,
    count: &'static str,
    carriers: &'static [&'static str],
}

const MEASURES: [Measure; 3] = [
    Measure {
        title: "RPC round trip",
        serves: ["serve", "rpc"],
        asks: ["call", "rpc"],
        period: "0",
        count: "5000",
        carriers: &["tcp", "fast_tcp"],
    },
    Measure {
        title: "16 joints at 1 kHz",
        serves: ["publish", "joints"],
        asks: ["watch", "joints"],
        period: "0.001",
        count: "10000",
        carriers: &["tcp", "fast_tcp", "udp"],
    },
    Measure {
        title: "320x240 rgb at 30 Hz",
        serves: ["publish", "image"],
        asks: ["watch", "image"],
        period: "0.033333",
        count: "300",
        carriers: &["tcp", "fast_tcp"],
    },
];

fn compare(real: Option<PathBuf>) -> Outcome {
    let ours = std::env::current_exe()?;
    let home = tempfile::tempdir()?;
    let mut names = Role::start(&ours, home.path(), &["names"])?;
    let port = names.line("ready")?;
    std::fs::write(home.path().join("yarp.conf"), format!("127.0.0.1 {port} yarp\n"))?;

    let mut pairs = vec![("ours -> ours", &ours, &ours)];
    if let Some(real) = &real {
        pairs.extend([("real -> real", real, real), ("ours -> real", &ours, real), ("real -> ours", real, &ours)]);
    }
    println!("| measure | carrier | from -> to | p50 us | p99 us | max us | lost |\n|---|---|---|---|---|---|---|");
    let mut run = 0;
    for Measure { title, serves, asks, period, count, carriers } in MEASURES {
        for carrier in carriers {
            for (pair, server, client) in &pairs {
                run += 1;
                let (one, other) = (format!("/wire/{run}/a"), format!("/wire/{run}/b"));
                let measured = || -> Outcome<String> {
                    let mut first = Role::start(server, home.path(), &[serves[0], serves[1], &one, period, count])?;
                    first.line("ready")?;
                    let asked = [asks[0], asks[1], &other, &one, count, carrier];
                    Role::start(client, home.path(), &asked)?.line("result")
                };
                let result = match measured() {
                    Ok(result) => result,
                    Err(error) => {
                        println!("| {title} | {carrier} | {pair} | {error} | | | |");
                        continue;
                    }
                };
                let figures: Vec<&str> = result.split(' ').collect();
                let [p50, p99, max, got, sent] = figures.as_slice() else { return Err(result.into()) };
                let lost = sent.parse::<usize>()?.saturating_sub(got.parse()?);
                println!("| {title} | {carrier} | {pair} | {p50} | {p99} | {max} | {lost} of {sent} |");
            }
        }
    }
    Ok(())
}
