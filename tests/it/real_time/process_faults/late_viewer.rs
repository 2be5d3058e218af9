//! `mobee ctl record`: a viewer that comes while a run goes on is shown how everything is, and follows; the recording is
//! switched off and on.

use super::{Run, count, holds, mobee, said, text};
use mobee_recorder::Contents;
use std::io::Read;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::Path;
use std::process::Output;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// As much of a Rerun viewer as a run sees: it takes what is sent, and keeps it.
struct Viewer {
    address: SocketAddr,
    /// Call by call.
    taken: Arc<Mutex<Vec<Vec<u8>>>>,
}

impl Viewer {
    fn start() -> Viewer {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
        listener.set_nonblocking(true).expect("a listener");
        let address = listener.local_addr().expect("an address");
        let taken: Arc<Mutex<Vec<Vec<u8>>>> = Arc::default();
        let keep = taken.clone();
        std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
            runtime.block_on(async move {
                let listener = tokio::net::TcpListener::from_std(listener).expect("a listener");
                while let Ok((socket, _)) = listener.accept().await {
                    tokio::spawn(take(socket, keep.clone()));
                }
            });
        });
        Viewer { address, taken }
    }

    /// What it would show. `recording` is a file of the same writer, which begins as each does.
    fn shows(&self, recording: &Path) -> Contents {
        let mut file = std::fs::read(recording).expect("a recording");
        file.truncate(12);
        let taken = self.taken.lock().expect("nobody panicked").clone();
        for call in taken {
            // its messages: a mark, their length, and within two shells the message as a file has it
            let mut rest = call.as_slice();
            while let Some((head, more)) = rest.split_at_checked(5) {
                let length = u32::from_be_bytes(head[1..].try_into().expect("four bytes")) as usize;
                let Some((message, more)) = more.split_at_checked(length) else { break };
                let (kind, message) = shell(shell(message).1);
                file.extend(kind.to_le_bytes());
                file.extend((message.len() as u64).to_le_bytes());
                file.extend(message);
                rest = more;
            }
        }
        let copy = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(copy.path(), file).expect("a file");
        Contents::read(copy.path()).unwrap_or_default()
    }
}

/// The number and the content of a message's first field.
fn shell(message: &[u8]) -> (u64, &[u8]) {
    let number = u64::from(message[0] >> 3);
    let digits = message[1..].iter().position(|b| b & 0x80 == 0).expect("a length") + 2;
    (number, &message[digits..])
}

async fn take(socket: tokio::net::TcpStream, keep: Arc<Mutex<Vec<Vec<u8>>>>) {
    let Ok(mut connection) = h2::server::handshake(socket).await else { return };
    while let Some(Ok((request, respond))) = connection.accept().await {
        let keep = keep.clone();
        let call = {
            let mut calls = keep.lock().expect("nobody panicked");
            calls.push(Vec::new());
            calls.len() - 1
        };
        tokio::spawn(async move {
            let mut body = request.into_body();
            while let Some(Ok(data)) = body.data().await {
                keep.lock().expect("nobody panicked")[call].extend_from_slice(&data);
                let _ = body.flow_control().release_capacity(data.len());
            }
            // who asks waits for an answer as long as this is kept
            drop(respond);
        });
    }
}

fn record(run: &Run, words: &[&str]) -> Output {
    mobee().args(["ctl", "--run", text(&run.out), "record"]).args(words).output().expect("mobee starts")
}

fn refuses(run: &Run, words: &[&str], why: &str) {
    let out = record(run, words);
    assert!(out.status.code() == Some(2) && said(&out).contains(why), "{words:?}: {}", said(&out));
}

fn connects(run: &Run, address: SocketAddr) {
    let out = record(run, &["connect", &address.to_string()]);
    assert!(out.status.success() && said(&out).contains("follows from now on"), "{}", said(&out));
}

/// Looks again until it is so.
fn until(mut so: impl FnMut() -> bool) {
    while !so() {
        std::thread::park_timeout(Duration::from_millis(200));
    }
}

#[test]
fn a_viewer_that_comes_later_is_shown_everything_and_follows() {
    let scratch = tempfile::tempdir().expect("a folder");
    let args = ["configs/behaviors/explore.toml", "--for", "500"];
    let mut run = Run::start(scratch.path().join("run"), &args);
    let recording = run.out.join("recording.rrd");
    run.wait(|all| count(all, "outcome") > 0);

    refuses(&run, &["connect", "there"], "give one such as 127.0.0.1:9876");
    let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port").local_addr().expect("an address");
    refuses(&run, &["connect", &port.to_string()], &format!("start one with `rerun --port {}`", port.port()));
    let other = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    let address = other.local_addr().expect("an address");
    std::thread::spawn(move || other.incoming().flatten().for_each(|mut s| drop(s.read(&mut [0]))));
    refuses(&run, &["connect", &address.to_string()], "is not a viewer");
    refuses(&run, &["conect"], "`record connect [ADDRESS:PORT]`");

    // one that takes the connection and never reads, and then another one
    let frozen = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    record(&run, &["connect", &frozen.local_addr().expect("an address").to_string()]);
    let (first, second) = (Viewer::start(), Viewer::start());
    connects(&run, first.address);
    // each entity comes by itself
    let drawn = [
        "/world/icub",
        "/world/objects/table_0",
        "/world/roadmap/icub/vertices",
        "/roadmap/icub/untried",
        "/state/icub/filter",
        "/joints/icub/left_arm",
    ];
    let mut shown = Contents::default();
    until(|| {
        shown = first.shows(&recording);
        drawn.iter().all(|entity| shown.rows.contains_key(*entity))
    });
    assert_eq!(shown.properties.get("clock").map(String::as_str), Some("real"));

    connects(&run, second.address);
    // it took the place of the first one, to which comes what was on its way and no more
    until(|| second.shows(&recording).until > first.shows(&recording).until + Duration::from_secs(1));
    until(|| second.shows(&recording).rows.contains_key("/world/roadmap/icub/vertices"));
    assert!(record(&run, &["off"]).status.success() && record(&run, &["on"]).status.success());

    let stopped = mobee().args(["ctl", "--run", text(&run.out), "stop"]).output().expect("mobee starts");
    assert!(stopped.status.success(), "{}", said(&stopped));
    let out = run.out.clone();
    let end = run.end();
    assert!(end.status.success(), "{}", said(&end));
    assert!(!said(&end).contains("journal:"), "{}", said(&end));
    holds(&out);
}
