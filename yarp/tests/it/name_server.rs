//! The name server's exchanges, as captured from the real one: our server answers them byte for byte, our client says
//! and understands them. A vector that no case covers fails the test.

use mobee_yarp::auth::Key;
use mobee_yarp::{Bottle, Contact, Delivery, InputPort, NameServer, Network, OutputPort, Queue, ServerOptions, remote};
use serde_json::Value;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::timeout;

const LIMIT: Duration = Duration::from_secs(20);

/// One message of a vector: whether the client said it, and its bytes.
struct Step {
    client: bool,
    bytes: Vec<u8>,
}

fn vectors(prefix: &str) -> Vec<(String, Vec<Step>)> {
    let default = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data/yarp-vectors");
    let folder = std::env::var_os("YARP_VECTORS").map_or(default, PathBuf::from);
    let mut found: Vec<_> = std::fs::read_dir(&folder)
        .unwrap_or_else(|e| panic!("{}: {e}", folder.display()))
        .map(|entry| entry.unwrap().path())
        .filter(|p| p.file_stem().is_some_and(|n| n.to_string_lossy().starts_with(prefix)))
        .map(|path| {
            let vector: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
            let steps = vector["steps"].as_array().unwrap().iter().map(step).collect();
            (path.file_stem().unwrap().to_string_lossy().into_owned(), steps)
        })
        .collect();
    found.sort_by(|a, b| a.0.cmp(&b.0));
    assert!(
        !found.is_empty() || std::env::var_os("YARP_VECTORS").is_some(),
        "no vectors {prefix}* in {}",
        folder.display()
    );
    found
}

fn step(step: &Value) -> Step {
    let hex = step["hex"].as_str().unwrap();
    let bytes = (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap()).collect();
    Step { client: step["dir"] == "client->server", bytes }
}

async fn server() -> NameServer {
    NameServer::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), ServerOptions::default()).await.unwrap()
}

/// Says lines in the plain form, each on a connection of its own, and waits for every answer.
async fn prepare(network: &Network, lines: &[&str]) {
    for line in lines {
        network.ask(&line.split(' ').collect::<Vec<_>>()).await.unwrap();
    }
}

/// What has to be known to the server before a vector is replayed; `None` if we don't know the vector.
fn before(name: &str) -> Option<Vec<&'static str>> {
    const READER: &str = "register /reader tcp 127.0.0.1 10003";
    const ALL: [&str; 12] = [
        "register /fakeFrameGrabber/rpc tcp 127.0.0.1 10016",
        "register /icubSim/cam/left tcp 127.0.0.1 10013",
        "register /icubSim/cam/left/quit tcp 127.0.0.1 10017",
        "register /icubSim/cam/left/rpc tcp 127.0.0.1 10011",
        "register /icubSim/right_arm/command:i tcp 127.0.0.1 10012",
        "register /icubSim/right_arm/quit tcp 127.0.0.1 10018",
        "register /icubSim/right_arm/rpc:i tcp 127.0.0.1 10010",
        "register /icubSim/right_arm/state:o tcp 127.0.0.1 10014",
        "register /icubSim/right_arm/stateExt:o tcp 127.0.0.1 10015",
        "register /srv tcp 127.0.0.1 10005",
        "register /tmp/port/2 mcast 224.1.1.3 10008",
        "register /writer tcp 127.0.0.1 10004",
    ];
    Some(match name {
        "ns-list" | "ns-bot-list" => [READER].into_iter().chain(ALL).collect(),
        "ns-check" => vec![READER, "set /reader k v w"],
        "ns-get" => vec![READER, "set /reader k v w"],
        "ns-subscribe-list" => vec!["subscribe /a /b"],
        "ns-unregister" => vec!["register /vec/a tcp 127.0.0.1 10095"],
        "ns-query" | "ns-bot-query" | "ns-set" | "ns-tcp" | "ns-text-ack" | "ns-two-commands" | "ns-announce" => {
            vec![READER]
        }
        "ns-bot-query-unknown"
        | "ns-get-unknown"
        | "ns-help"
        | "ns-query-unknown"
        | "ns-register-anonymous"
        | "ns-register-explicit"
        | "ns-register-open-close"
        | "ns-register-partial"
        | "ns-route"
        | "ns-subscribe"
        | "ns-unknown-command"
        | "ns-unregister-unknown"
        | "ns-unsubscribe" => vec![],
        _ => return None,
    })
}

/// What varies from one name server to the next: its own port number, and the numbers that it gives.
fn masked(name: &str, bytes: &[u8], own: u16) -> Vec<u8> {
    let Ok(text) = std::str::from_utf8(bytes) else { return bytes.to_vec() };
    let given = ["ns-register-anonymous", "ns-register-partial", "ns-register-open-close"].contains(&name);
    let mut after_port = false;
    let words = text.split(' ').map(|word| {
        let number = given && after_port;
        after_port = word == "port";
        if number { "NUMBER" } else { word }
    });
    let text = words.collect::<Vec<_>>().join(" ");
    let root = |text: String, form: [&str; 2]| text.replace(&form.join(&own.to_string()), &form.join("10000"));
    let text = root(text, ["name /root ip 127.0.0.1 port ", " type"]);
    root(text, ["(name \"/root\") (ip \"127.0.0.1\") (port_number ", ")"]).into_bytes()
}

#[tokio::test]
async fn our_server_answers_as_the_real_one() {
    for (name, steps) in vectors("ns-") {
        let before = before(&name).unwrap_or_else(|| panic!("{name}: no case for this vector"));
        let server = server().await;
        prepare(&server.network(), &before).await;
        let mut stream = TcpStream::connect(server.address()).await.unwrap();
        for (i, Step { client, bytes }) in steps.iter().enumerate() {
            if *client {
                // in this vector every request is on a connection of its own
                if name == "ns-register-open-close" {
                    stream = TcpStream::connect(server.address()).await.unwrap();
                }
                stream.write_all(bytes).await.unwrap();
                continue;
            }
            if name == "ns-tcp" && i == 1 {
                // the handshake's reply: YA, the server's own port number, RP
                let mut reply = [0; 8];
                stream.read_exact(&mut reply).await.unwrap();
                assert_eq!(reply[2..6], u32::from(server.address().port()).to_le_bytes(), "{name}");
                continue;
            }
            let wanted = masked(&name, bytes, server.address().port());
            let mut got = Vec::new();
            while masked(&name, &got, server.address().port()) != wanted {
                let more = timeout(LIMIT, stream.read_buf(&mut got)).await;
                assert!(
                    matches!(more, Ok(Ok(n)) if n > 0) && got.len() <= bytes.len() + 1000,
                    "{name}, step {i}:\nwanted {}\ngot    {}",
                    String::from_utf8_lossy(bytes),
                    String::from_utf8_lossy(&got)
                );
            }
        }
        server.close().await;
    }
}

/// A server that replays a vector's plain-text answers, and the requests that it got.
async fn replay(steps: Vec<Step>) -> (Network, tokio::task::JoinHandle<Vec<String>>) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let network = Network::at(listener.local_addr().unwrap()).with_timeout(LIMIT);
    let task = tokio::spawn(async move {
        let mut requests = Vec::new();
        for answer in steps.iter().filter(|s| !s.client) {
            let (mut stream, _) = listener.accept().await.unwrap();
            let mut request = Vec::new();
            while request.last() != Some(&b'\n') {
                stream.read_buf(&mut request).await.unwrap();
            }
            stream.write_all(&answer.bytes).await.unwrap();
            requests.push(String::from_utf8(request).unwrap());
        }
        requests
    });
    (network, task)
}

#[tokio::test]
async fn our_client_says_and_understands_what_real_ones_do() {
    let reader = Contact::new("/reader", "tcp", "127.0.0.1", 10003);
    for (name, steps) in vectors("ns-") {
        // both are about carriers, on which our client does not speak to a name server
        if ["ns-tcp", "ns-text-ack"].contains(&name.as_str()) {
            continue;
        }
        let said: Vec<String> = steps
            .iter()
            .filter(|s| s.client)
            .map(|s| String::from_utf8(s.bytes.clone()).unwrap().trim_end().to_string())
            .collect();
        let (n, task) = replay(steps).await;
        match name.as_str() {
            "ns-query" => assert_eq!(n.query("/reader").await.unwrap(), Some(reader.clone())),
            "ns-query-unknown" => assert_eq!(n.query("/nope").await.unwrap(), None),
            "ns-two-commands" => {
                assert_eq!(n.query("/reader").await.unwrap(), Some(reader.clone()));
                assert_eq!(n.query("/root").await.unwrap().unwrap().port, 10000);
            }
            "ns-register-explicit" => {
                let made = n.register("/vec/a", "127.0.0.1", 10095).await.unwrap();
                assert_eq!(made, Contact::new("/vec/a", "tcp", "127.0.0.1", 10095));
            }
            "ns-unregister" => n.unregister("/vec/a").await.unwrap(),
            "ns-unregister-unknown" => n.unregister("/nope").await.unwrap(),
            "ns-list" => {
                let all = n.list("").await.unwrap();
                assert_eq!((all.len(), &all[9]), (15, &reader));
            }
            "ns-set" => n.set("/reader", "k", &["v", "w"]).await.unwrap(),
            "ns-get" => assert_eq!(n.get("/reader", "k").await.unwrap().as_deref(), Some("v w")),
            "ns-get-unknown" => assert_eq!(n.get("/nope", "k").await.unwrap(), None),
            "ns-announce" => n.announce("/reader").await.unwrap(),
            "ns-register-open-close" => {
                for line in &said {
                    let words: Vec<&str> = line.trim_start_matches("NAME_SERVER ").split(' ').collect();
                    n.ask(&words).await.unwrap();
                }
            }
            "ns-bot-list"
            | "ns-bot-query"
            | "ns-bot-query-unknown"
            | "ns-check"
            | "ns-help"
            | "ns-register-anonymous"
            | "ns-register-partial"
            | "ns-route"
            | "ns-subscribe"
            | "ns-subscribe-list"
            | "ns-unknown-command"
            | "ns-unsubscribe" => {
                // said by people, through the tool: any words, any answer
                let words: Vec<&str> = said[0].trim_start_matches("NAME_SERVER ").split(' ').collect();
                n.ask(&words).await.unwrap();
            }
            _ => panic!("{name}: no case for this vector"),
        }
        let requests: Vec<String> = task.await.unwrap().iter().map(|r| r.trim_end().to_string()).collect();
        assert_eq!(requests, said, "{name}");
    }
}

#[tokio::test]
async fn persistent_connections_are_made_whichever_end_comes_first() {
    for reader_first in [true, false] {
        let server = server().await;
        let network = server.network().with_timeout(LIMIT);
        network.ask(&["subscribe", "/w", "fast_tcp://r"]).await.unwrap();
        let (writer, mut reader);
        if reader_first {
            reader = InputPort::open(&network, "/r", Queue::Bounded(10)).await.unwrap();
            writer = OutputPort::open(&network, "/w", Delivery::Strict(10)).await.unwrap();
        } else {
            writer = OutputPort::open(&network, "/w", Delivery::Strict(10)).await.unwrap();
            reader = InputPort::open(&network, "/r", Queue::Bounded(10)).await.unwrap();
        }
        let made = async {
            while writer.peers().is_empty() {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        timeout(LIMIT, made).await.unwrap();
        assert_eq!(remote::connection(&network, "/w", "/r").await.unwrap().unwrap().carrier, "fast_tcp");
        writer.write(Bottle::of([7]), None);
        assert!(timeout(LIMIT, reader.recv()).await.unwrap().is_some());
        writer.close().await;
        reader.close().await;
        server.close().await;
    }
}

#[tokio::test]
async fn only_who_knows_the_key_is_served() {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let options = ServerOptions { auth: Some(Key::new("secret")), ..ServerOptions::default() };
    let server = NameServer::bind(address, options).await.unwrap();
    let network = server.network();
    network.register("/a", "127.0.0.1", 5000).await.unwrap();
    let mut reader = InputPort::open(&network, "/r", Queue::Newest).await.unwrap();
    let writer = OutputPort::open(&network, "/w", Delivery::Strict(10)).await.unwrap();
    remote::connect(&network, "/w", "/r", None).await.unwrap();
    writer.write(Bottle::of([7]), None);
    assert!(timeout(LIMIT, reader.recv()).await.unwrap().is_some());
    let keyless = network.clone().with_auth(None).query("/a").await.unwrap_err().to_string();
    assert!(keyless.contains("auth.conf"), "{keyless}");
    let wrong = network.clone().with_auth(Some(Key::new("other"))).query("/a").await.unwrap_err().to_string();
    assert!(wrong.contains("key"), "{wrong}");
}

#[tokio::test]
async fn too_many_connections_are_closed_and_the_others_go_on() {
    let options = ServerOptions { max_connections: 3, ..ServerOptions::default() };
    let server = NameServer::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), options).await.unwrap();
    let mut held = Vec::new();
    for _ in 0..3 {
        let mut stream = TcpStream::connect(server.address()).await.unwrap();
        stream.write_all(b"NAME_SERVER query /root\n").await.unwrap();
        assert!(stream.read_u8().await.is_ok());
        held.push(stream);
    }
    let mut fourth = TcpStream::connect(server.address()).await.unwrap();
    assert_eq!(timeout(LIMIT, fourth.read(&mut [0; 8])).await.unwrap().unwrap_or(0), 0);
    held.clear();
    // the places are free again as soon as the server has seen the ends
    let network = server.network();
    let asked = async { while network.query("/root").await.is_err() {} };
    timeout(LIMIT, asked).await.unwrap();
}

#[tokio::test]
async fn a_server_is_for_this_computer_unless_told_otherwise() {
    let anywhere = SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0));
    let refused = NameServer::bind(anywhere, ServerOptions::default()).await.unwrap_err().to_string();
    assert!(refused.contains("no encryption"), "{refused}");
    let options = ServerOptions { public: true, host: Some("robot".into()), ..ServerOptions::default() };
    let server = NameServer::bind(anywhere, options).await.unwrap();
    let network = server.network();
    assert_eq!(network.query("/root").await.unwrap().unwrap().host, "robot");
    // a host of "..." is the one that the server sees
    assert_eq!(network.register("/a", "...", 5000).await.unwrap().host, "127.0.0.1");
    let address = server.address();
    server.close().await;
    assert!(TcpListener::bind(address).await.is_ok(), "the address is free again");
}
