//! Recorded sessions of clients, said again to boards directly and through the port filter: the same replies, byte for byte
//! but for the stamps. Prints what the filter adds to the time of a request (`MOBEE_ROUNDS` requests, default 300).

use crate::common::{HOLD, Network, Run, network, sim};
use mobee_yarp::{Bottle, Carrier, Dialect, InputPort, JointData, Queue, RpcClient, Stamp, Value, Vocab};
use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// What the filter refuses on purpose where a board obeys, by the second word: joints that yield have no safe pose.
const REFUSED: [&str; 1] = ["intm"];

/// One client's line to each of: a board of its own, the board behind the filter, the filter.
struct Lines {
    twin: RpcClient,
    board: RpcClient,
    filter: RpcClient,
}

async fn line(network: &Network, own: &str, port: &str) -> RpcClient {
    let yarp = mobee_yarp::Network::at(SocketAddr::from((Ipv4Addr::LOCALHOST, network.port)));
    let client = RpcClient::connect(&yarp, own, port, Carrier::FastTcp).await.expect("a connection");
    client.with_timeout(Duration::from_secs(30))
}

fn bottle(text: &str) -> Bottle {
    Bottle::parse(text, Dialect::V3).expect("a bottle")
}

/// A reply without its stamp, which no two replies share.
fn unstamped(reply: &Bottle) -> Vec<u8> {
    let mut words = reply.0.clone();
    if let Some(at) = words.iter().position(|v| *v == Value::Vocab(Vocab::new("tsta"))) {
        for word in words.iter_mut().skip(at + 1).take(2) {
            *word = Value::Int32(0);
        }
    }
    Bottle(words).encode(Dialect::V3)
}

/// The recorded requests to boards, as the bytes that were sent.
fn recorded() -> Vec<(String, Bottle)> {
    let folder = std::env::var_os("YARP_VECTORS")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/yarp-vectors"), PathBuf::from);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).expect("vectors").map(|f| f.expect("a file").path()).collect();
    files.sort();
    let mut all = Vec::new();
    for path in files {
        let file = path.file_stem().expect("a name").to_string_lossy().into_owned();
        if !["cb-", "cb2-", "icubsim-right-arm"].iter().any(|p| file.starts_with(p)) || file == "cb-stream-commands" {
            continue;
        }
        let vector: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).expect("a vector")).expect("JSON");
        for pair in vector["steps"].as_array().expect("steps").chunks(2) {
            let hex = pair[0]["hex"].as_str().expect("hex");
            let message: Vec<u8> =
                (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).expect("hex")).collect();
            // the index (8 + 2 + 8 bytes, a length per block, one zero) and the command of 8 bytes
            let head = 8 + 10 + 4 * usize::from(message[8]) + 4 + 8;
            all.push((file.clone(), Bottle::decode(&message[head..], Dialect::V3).expect("a bottle")));
        }
    }
    all
}

/// A session of a program that moves the arm, as those that were recorded had boards with fewer joints.
const MOVES: [&str; 16] = [
    "[get] [prot]",
    "[get] [axes]",
    "[set] [vels] (20 20 20 20 20 20 20)",
    "[get] [vels]",
    "[set] [accs] (90 90 90 90 90 90 90)",
    "[get] [accs]",
    "[set] [pos] 0 -20.0",
    "[get] [pos] 0",
    "[set] [posg] 2 (1 2) (60.0 10.0)",
    "[set] [rel] 0 5.0",
    "[set] [stos]",
    "[set] [poss] (-20 75 0 60 10 -15 5)",
    "[get] [poss]",
    "[get] [dons]",
    "[set] [pos] 99 0.0",
    "[set] [pos] 0",
];

impl Lines {
    async fn settle(&mut self) {
        for client in [&mut self.twin, &mut self.filter] {
            loop {
                let said = client.call(&bottle("[get] [dons]")).await.expect("an answer").to_string();
                if said.starts_with("[is] [dons] 1") {
                    break;
                }
                assert_ne!(said, "[fail]", "the motion failed");
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        }
    }

    /// Whether the filter answers as a board does; `None`: it refuses on purpose.
    async fn compare(&mut self, name: &str, request: &Bottle) -> Option<()> {
        let asks = request.0.first().and_then(Value::as_vocab) == Some(Vocab::new("get"));
        let own = unstamped(&self.twin.call(request).await.expect("an answer"));
        let behind = match asks {
            true => unstamped(&self.board.call(request).await.expect("an answer")),
            false => own.clone(),
        };
        let said = self.filter.call(request).await.expect("an answer");
        let filtered = unstamped(&said);
        self.settle().await;
        if filtered == own || filtered == behind {
            return Some(());
        }
        let word = request.0.get(1).and_then(Value::as_text).unwrap_or_default().into_owned();
        let word = request.0.get(1).and_then(Value::as_vocab).map_or(word, |v| v.to_string());
        let own = Bottle::decode(&own, Dialect::V3).expect("a bottle");
        assert!(
            said.to_string() == "[fail]" && REFUSED.iter().any(|w| word.trim_matches(['[', ']']) == *w),
            "{name}: {request}\n the filter says {said}\n a board       {own}"
        );
        None
    }
}

#[tokio::test(flavor = "current_thread")]
async fn recorded_sessions_get_the_boards_own_replies_through_the_filter() {
    let network = network();
    let quiet = ["noise_deg", "resolution_deg", "jitter_ms"].map(|key| format!("robot.icub.driver.{key}=0"));
    let _behind = sim(&network, "configs/behaviors/explore.toml", "/icubSim", &quiet);
    // the machine may take all processors away for half a second
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/icubSim-yarp.toml");
    let patient = network.path().join("patient.toml");
    let driver = "[[robot]]\nname = \"icub\"\n[robot.driver]\ntimeout_ms = 5000\nstale_ms = 3000\n";
    std::fs::write(&patient, format!("include = [{shipped:?}]\n{driver}")).expect("a file");
    let mut run = Run::start(&network, &patient.display().to_string());
    run.wait_for_port("/MoBeE/icub/right_arm/rpc:i");
    let _twin = sim(&network, "configs/behaviors/explore.toml", "/twin", &quiet);
    run.wait_for_port("/twin/right_arm/rpc:i");
    let mut lines = Lines {
        twin: line(&network, "/a", "/twin/right_arm/rpc:i").await,
        board: line(&network, "/b", "/icubSim/right_arm/rpc:i").await,
        filter: line(&network, "/c", "/MoBeE/icub/right_arm/rpc:i").await,
    };
    while lines.filter.call(&bottle("[get] [axes]")).await.expect("an answer").to_string().starts_with("[fail]") {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let (mut equal, mut refused) = (0, Vec::new());
    let moves = MOVES.iter().map(|text| ("moves".to_owned(), bottle(text)));
    for (name, request) in moves.chain(recorded()) {
        match lines.compare(&name, &request).await {
            Some(()) => equal += 1,
            None => refused.push(name),
        }
    }
    println!("{equal} replies equal; refused on purpose: {}", refused.join(" "));
    assert!(equal >= 100, "{equal} equal");
    latency(&mut lines).await;
    states(&network).await;
    let journal = run.end();
    assert!(journal.contains(HOLD), "{journal}");
}

/// Prints what the filter adds to a request, asked in turn here and there.
#[expect(clippy::disallowed_methods, reason = "latency is measured by the wall clock")]
async fn latency(lines: &mut Lines) {
    let rounds = std::env::var("MOBEE_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(300);
    let request = bottle("[get] [encs]");
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..rounds {
        for (client, times) in [&mut lines.board, &mut lines.filter].into_iter().zip(&mut times) {
            let begun = std::time::Instant::now();
            client.call(&request).await.expect("an answer");
            times.push(begun.elapsed().as_secs_f64() * 1e3);
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    let mut added: Vec<f64> = times[0].iter().zip(&times[1]).map(|(direct, filtered)| filtered - direct).collect();
    let [direct, filtered] = &mut times;
    for (what, list) in [("direct", direct), ("through the filter", filtered), ("added", &mut added)] {
        list.sort_by(f64::total_cmp);
        let at = |share: f64| list[((list.len() - 1) as f64 * share) as usize];
        println!("{what}: p50 {:.3} ms, p99 {:.3} ms", at(0.5), at(0.99));
    }
}

/// What is read of the states that a port publishes: the first fifty, by their numbers.
async fn read(network: &mobee_yarp::Network, own: &str, port: &str) -> BTreeMap<u32, (f64, JointData)> {
    let mut reader = InputPort::open(network, own, Queue::Bounded(64)).await.expect("a port");
    reader.connect_from(port, Carrier::FastTcp).await.expect("a connection");
    let mut all = BTreeMap::new();
    while all.len() < 50 {
        let message = reader.recv().await.expect("a state");
        let stamp = message.envelope.as_deref().and_then(Stamp::from_envelope).expect("a stamp");
        let bytes = message.payload.binary(Dialect::V3).expect("bytes");
        all.insert(stamp.count, (stamp.time, JointData::decode(&bytes, Dialect::V3).expect("a state")));
    }
    all
}

/// What the board publishes comes through the filter as it is, with its own stamp by the time of day: accelerations, too, of
/// which the filter itself knows nothing.
#[expect(clippy::disallowed_methods, reason = "stamps tell the time of day")]
async fn states(network: &Network) {
    let yarp = mobee_yarp::Network::at(SocketAddr::from((Ipv4Addr::LOCALHOST, network.port)));
    let (behind, shown) = tokio::join!(
        read(&yarp, "/watch/board:i", "/icubSim/right_arm/stateExt:o"),
        read(&yarp, "/watch/filter:i", "/MoBeE/icub/right_arm/stateExt:o")
    );
    let both: Vec<u32> = behind.keys().filter(|count| shown.contains_key(count)).copied().collect();
    assert!(both.len() > 20, "{} states came both ways", both.len());
    for count in &both {
        assert_eq!(behind.get(count), shown.get(count), "state {count}");
    }
    let (time, state) = shown.last_key_value().expect("states").1;
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).expect("a time").as_secs_f64();
    assert!((now - time).abs() < 10.0 && state.acceleration.valid, "{time} at {now}");
}
