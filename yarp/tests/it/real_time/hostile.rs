//! Hostile peers: whatever they send or withhold, others go on being served, and nothing of it stays.

use crate::common::names;
use mobee_yarp::wire::{frame, handshake};
use mobee_yarp::{Bottle, Carrier, Contact, Dialect, Handler, InputPort, Message, Payload, PortOptions, Queue};
use mobee_yarp::{Delivery, OutputPort, RpcClient, RpcServer, SendError, Sender, Value};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Handle;
use tokio::time::timeout;

const PATIENCE: Duration = Duration::from_secs(60);
const LIMIT: Duration = Duration::from_secs(1);

async fn soon<T>(work: impl Future<Output = T>) -> T {
    timeout(PATIENCE, work).await.expect("it hangs")
}

struct Echo;

impl Handler for Echo {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        Box::pin(async move { Some(request.payload) })
    }
}

fn strict() -> PortOptions {
    PortOptions { handshake: LIMIT, message: LIMIT, write: LIMIT, ack: LIMIT, ..PortOptions::default() }
}

/// A small generator of arbitrary numbers, the same in every run.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn bytes(&mut self) -> Vec<u8> {
        (0..self.next() % 300).map(|_| self.next() as u8).collect()
    }
}

/// Open files and tasks alive.
fn used() -> (usize, usize) {
    (std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count), Handle::current().metrics().num_alive_tasks())
}

/// Address space of this process, bytes.
fn address_space() -> usize {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    pages.split(' ').next().and_then(|it| it.parse().ok()).unwrap_or(0_usize) * 4096
}

async fn raw(to: &Contact, first: &[u8]) -> TcpStream {
    let mut stream = TcpStream::connect((to.host.as_str(), to.port)).await.unwrap();
    // the other side may have closed already
    let _ = stream.write_all(first).await;
    stream
}

/// A connection after its handshake.
async fn greeted(to: &Contact, name: &str) -> TcpStream {
    let mut stream = raw(to, &handshake::encode(Carrier::Tcp, name)).await;
    stream.read_exact(&mut [0; 8]).await.unwrap();
    stream
}

/// Waits until the other side closes.
async fn closed(mut stream: TcpStream) {
    let mut buffer = vec![0; 1 << 16];
    soon(async { while stream.read(&mut buffer).await.is_ok_and(|n| n > 0) {} }).await;
}

async fn served(client: &mut RpcClient) {
    let request = Bottle(vec![Value::Int32(7), Value::String("still here".into())]);
    assert_eq!(soon(client.call(&request)).await.unwrap(), request);
}

#[tokio::test]
async fn hostile_peers_harm_nobody_and_leave_nothing() {
    let (_names, network) = names().await;
    let server = RpcServer::open_with(&network, "/echo", Arc::new(Echo), strict()).await.unwrap();
    let reader = InputPort::open_with(&network, "/reader", Queue::Newest, strict()).await.unwrap();
    let mut good = RpcClient::connect(&network, "/good", "/echo", Carrier::Tcp).await.unwrap();
    served(&mut good).await;
    let (before, space) = (used(), address_space());
    let ports = [server.contact().clone(), reader.contact().clone()];
    let mut noise = Noise(0x9e37_79b9_7f4a_7c15);

    // Random bytes, at once or after a handshake.
    for round in 0..150 {
        let to = &ports[round % 2];
        let mut stream = if round % 3 == 0 { raw(to, b"").await } else { greeted(to, "/noise").await };
        let _ = stream.write_all(&noise.bytes()).await;
        if round % 10 == 0 {
            served(&mut good).await;
        }
    }

    // More connections than allowed: those that say nothing are closed in time.
    let mut crowd = Vec::new();
    for _ in 0..300 {
        crowd.push(raw(&ports[0], b"").await);
    }
    served(&mut good).await;
    for stream in crowd {
        closed(stream).await;
    }
    served(&mut good).await;

    // Half messages, a wrong index, claims of much more than comes: closed, and nothing is set aside for the claims.
    let mut held = Vec::new();
    for i in 0..120 {
        let mut stream = greeted(&ports[i % 2], &format!("/half{i}")).await;
        let claim = frame::encode(b'd', None, 60 << 20);
        let message = match i % 4 {
            0 => &claim[..claim.len() / 2],
            1 => b"YA\x0b\0\0\0RP",
            _ => &claim,
        };
        let _ = stream.write_all(message).await;
        held.push(stream);
    }
    served(&mut good).await;
    let grown = address_space().saturating_sub(space);
    assert!(grown < 512 << 20, "{} MiB were set aside for claims of 3600 MiB", grown >> 20);
    for stream in held {
        closed(stream).await;
    }
    let over = greeted(&ports[1], "/over").await;
    let mut over = over;
    let _ = over.write_all(&frame::encode(b'd', None, 65 << 20)).await;
    closed(over).await;

    // Lines without an end, and deep nesting.
    let mut text = raw(&ports[1], b"CONNECT /text\r\nd\r\n").await;
    let _ = text.write_all("(".repeat(100_000).as_bytes()).await;
    let mut nested = raw(&ports[0], b"CONNACK /nested\r\na\r\n").await;
    let _ = nested.write_all(format!("{}{}\r\n", "(".repeat(100_000), ")".repeat(100_000)).as_bytes()).await;
    closed(text).await;
    served(&mut good).await;
    drop(nested);

    // One that asks for long replies and does not read them.
    let mut deaf = greeted(&ports[0], "/deaf").await;
    let payload = Bottle(vec![Value::Blob(vec![7; 4 << 20])]).encode(Dialect::V3);
    let _ = deaf.write_all(&frame::encode(b'd', None, payload.len())).await;
    let asking = timeout(PATIENCE, async {
        while deaf.write_all(&payload).await.is_ok()
            && deaf.write_all(&frame::encode(b'd', None, payload.len())).await.is_ok()
        {}
    });
    let (asked, ()) = tokio::join!(asking, async {
        for _ in 0..20 {
            served(&mut good).await;
        }
    });
    asked.expect("a client that does not read is closed");
    drop(deaf);

    soon(async {
        while used().0 > before.0 || used().1 > before.1 {
            served(&mut good).await;
        }
    })
    .await;
    good.close().await;
    server.close().await;
    reader.close().await;
}

#[tokio::test]
async fn a_stuck_acknowledgement_ends_in_a_new_connection() {
    let (_names, network) = names().await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let number = listener.local_addr().unwrap().port();
    network.register("/stuck", "127.0.0.1", number).await.unwrap();
    let writer = OutputPort::open_with(&network, "/writer", Delivery::Strict(10), strict()).await.unwrap();
    let hello = handshake::encode(Carrier::Tcp, "/writer");
    let accept = async || {
        let (mut stream, _) = listener.accept().await.unwrap();
        let mut got = vec![0; hello.len()];
        stream.read_exact(&mut got).await.unwrap();
        assert_eq!(got, hello);
        stream.write_all(&frame::numbered(1)).await.unwrap();
        stream
    };
    let (connected, _silent) = tokio::join!(writer.connect("/stuck", Carrier::Tcp), accept());
    connected.unwrap();
    writer.write(Bottle(vec![Value::Int32(1)]), None);
    writer.write(Bottle(vec![Value::Int32(2)]), None);
    let mut second = soon(accept()).await;
    let mut head = [0; 34];
    soon(second.read_exact(&mut head)).await.unwrap();
    assert_eq!(&head[..8], &frame::numbered(10));
    second.write_all(Carrier::Tcp.ack()).await.unwrap();
    soon(writer.drained()).await;
    assert_eq!((writer.peers(), writer.dropped()), (vec!["/stuck".to_owned()], 1));

    // A sender tells its owner.
    let contact = Contact::new("", "tcp", "127.0.0.1", number).to_string();
    let (sender, _silent) =
        tokio::join!(Sender::connect_with(&network, "/writer", &contact, Carrier::Tcp, strict()), accept());
    let sent = soon(sender.unwrap().send(Bottle::default(), None)).await;
    assert!(matches!(sent, Err(SendError::Broken { .. })), "{sent:?}");
}

#[tokio::test]
async fn connections_that_say_nothing_are_tolerated() {
    let (_names, network) = names().await;
    let mut reader = InputPort::open(&network, "/reader", Queue::Bounded(4)).await.unwrap();
    for _ in 0..10 {
        drop(raw(reader.contact(), b"").await);
    }
    let mut sender = Sender::connect(&network, "/s", "/reader", Carrier::Tcp).await.unwrap();
    sender.send(Bottle(vec![Value::Int32(1)]), None).await.unwrap();
    assert!(soon(reader.recv()).await.is_some());
}

#[tokio::test]
async fn unfinished_messages_share_a_bounded_room() {
    let (_names, network) = names().await;
    let patient = Duration::from_secs(3600);
    let options = PortOptions { max_buffered: 24 << 20, message: patient, write: patient, ..PortOptions::default() };
    let server = RpcServer::open_with(&network, "/echo", Arc::new(Echo), options).await.unwrap();
    let mut good = RpcClient::connect(&network, "/good", "/echo", Carrier::Tcp).await.unwrap();
    let part = vec![0; 3 << 20];
    let mut held = Vec::new();
    for i in 0..20 {
        let mut stream = greeted(server.contact(), &format!("/part{i}")).await;
        let _ = stream.write_all(&frame::encode(b'd', None, 60 << 20)).await;
        let _ = stream.write_all(&part).await;
        held.push(stream);
    }
    // Nothing but the lack of room ends them here, and there is room for twelve at most.
    soon(async {
        while server.peers().len() > 13 {
            served(&mut good).await;
        }
    })
    .await;
    drop(held);
    soon(async {
        while server.peers().len() > 1 {
            served(&mut good).await;
        }
    })
    .await;
    let long = Bottle(vec![Value::Blob(vec![7; 5 << 20])]);
    assert_eq!(soon(good.call(&long)).await.unwrap(), long, "the room is free again");
}
