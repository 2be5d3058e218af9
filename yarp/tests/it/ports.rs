//! Ports of ours among each other, over all carriers.

use crate::common::names;
use mobee_yarp::{Bottle, Carrier, Delivery, Handler, InputPort, Message, Payload, Queue, RpcClient, RpcServer};
use mobee_yarp::{CallError, Dialect, NameServer, OutputPort, PortOptions, Sender, ServerOptions, Stamp, StreamSource};
use mobee_yarp::{Value, Vocab, remote};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;

const PATIENCE: Duration = Duration::from_secs(20);

async fn soon<T>(work: impl Future<Output = T>) -> T {
    timeout(PATIENCE, work).await.expect("it hangs")
}

fn greeting(n: i32) -> Bottle {
    Bottle(vec![Value::String("hello (\"you\")".into()), Value::Int32(n), Value::Float64(0.1)])
}

fn content(message: &Message) -> Bottle {
    message.payload.bottle(Dialect::V3).unwrap()
}

#[tokio::test]
async fn a_reader_gets_what_a_writer_writes_over_every_carrier() {
    let (_names, network) = names().await;
    for carrier in Carrier::ALL {
        let mut reader = InputPort::open(&network, &format!("/reader/{carrier}"), Queue::Bounded(10)).await.unwrap();
        let writer = OutputPort::open(&network, &format!("/writer/{carrier}"), Delivery::Strict(10)).await.unwrap();
        writer.connect(reader.name(), carrier).await.unwrap();
        assert_eq!(writer.peers(), [reader.name()]);
        for n in 0..3 {
            writer.write(greeting(n), Some(Stamp { count: n as u32, time: 12.5 }.envelope()));
            let message = soon(reader.recv()).await.unwrap();
            assert_eq!(content(&message), greeting(n), "{carrier}");
            assert_eq!(message.stamp(), Some(Stamp { count: n as u32, time: 12.5 }));
            assert_eq!(message.from, writer.name());
        }
        let mut sender = Sender::connect(&network, "/sender", reader.name(), carrier).await.unwrap();
        sender.send(greeting(7), None).await.unwrap();
        assert_eq!(content(&soon(reader.recv()).await.unwrap()), greeting(7), "{carrier}");
        sender.close().await;
        assert!(writer.disconnect(reader.name()).await);
        assert!(writer.peers().is_empty());
        soon(async {
            while !reader.peers().is_empty() {
                tokio::task::yield_now().await;
            }
        })
        .await;
        writer.close().await;
        reader.close().await;
        assert_eq!(network.query(&format!("/reader/{carrier}")).await.unwrap(), None);
    }
}

#[tokio::test]
async fn long_messages_arrive_whole_over_every_carrier() {
    let (_names, network) = names().await;
    // datagrams that come faster than they are read get lost, so not longer than the system holds
    let numbers = Bottle((0..15_000).map(|i| Value::Float64(f64::from(i) / 7.0)).collect());
    for carrier in Carrier::ALL {
        let mut reader = InputPort::open(&network, &format!("/reader/{carrier}"), Queue::Newest).await.unwrap();
        let mut sender = Sender::connect(&network, "/sender", reader.name(), carrier).await.unwrap();
        sender.send(&numbers, None).await.unwrap();
        assert_eq!(content(&soon(reader.recv()).await.unwrap()), numbers, "{carrier}");
    }
}

struct Echo;

impl Handler for Echo {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        Box::pin(async move {
            let request = request.payload.bottle(Dialect::V3).unwrap_or_default();
            if request.0.is_empty() { None } else { Some(Bottle(vec![Value::List(request)]).into()) }
        })
    }
}

#[tokio::test]
async fn requests_are_answered_over_every_carrier_with_replies() {
    let (_names, network) = names().await;
    let server = RpcServer::open(&network, "/echo", Arc::new(Echo)).await.unwrap();
    for carrier in [Carrier::Tcp, Carrier::FastTcp, Carrier::Text, Carrier::TextAck] {
        let mut client = RpcClient::connect(&network, "/me", "/echo", carrier).await.unwrap();
        for n in 0..3 {
            let reply = soon(client.call(&greeting(n))).await.unwrap();
            assert_eq!(reply, Bottle(vec![Value::List(greeting(n))]), "{carrier}");
        }
        let raw = client.call_raw(&greeting(9).encode(Dialect::V3)).await.unwrap();
        assert_eq!(raw, Bottle(vec![Value::List(greeting(9))]).encode(Dialect::V3));
        let version = client.admin(&Bottle(vec![Value::Vocab(Vocab::new("ver"))])).await.unwrap();
        assert_eq!(version.to_string(), "[ver] 1 2 3");
        client.close().await;
    }
    let mut client = RpcClient::connect(&network, "/me", "/echo", Carrier::Tcp).await.unwrap();
    assert!(matches!(client.call(&Bottle::default()).await, Err(CallError::NoReply(_))));
    assert!(client.call(&greeting(1)).await.is_ok(), "an acknowledgement without a reply does no harm");
    server.close().await;
}

#[tokio::test]
async fn the_newest_message_replaces_an_unsent_one_and_slow_readers_hold_up_nobody() {
    let (_names, network) = names().await;
    let mut fast = InputPort::open(&network, "/fast", Queue::Newest).await.unwrap();
    let slow = InputPort::open(&network, "/slow", Queue::Bounded(1)).await.unwrap();
    let writer = OutputPort::open(&network, "/writer", Delivery::Newest).await.unwrap();
    writer.connect("/fast", Carrier::Tcp).await.unwrap();
    writer.connect("/slow", Carrier::Tcp).await.unwrap();
    for n in 0..100 {
        writer.write(greeting(n), None);
        assert_eq!(content(&soon(fast.recv()).await.unwrap()), greeting(n));
    }
    assert!(writer.dropped() >= 60, "the slow one took at most a few: {}", writer.dropped());
    assert_eq!(fast.dropped(), 0);
    drop(slow);
    writer.close().await;
}

#[tokio::test]
async fn a_writer_is_connected_by_asking_it_and_says_no_to_what_it_does_not_know() {
    let (_names, network) = names().await;
    let mut reader = InputPort::open(&network, "/reader", Queue::Newest).await.unwrap();
    let writer = OutputPort::open(&network, "/writer", Delivery::Newest).await.unwrap();
    reader.connect_from("/writer", Carrier::FastTcp).await.unwrap();
    reader.connect_from("/writer", Carrier::TextAck).await.unwrap();
    writer.write(greeting(1), None);
    assert_eq!(content(&soon(reader.recv()).await.unwrap()), greeting(1));
    let mut admin = RpcClient::connect(&network, "admin", "/writer", Carrier::TextAck).await.unwrap();
    for (ask, answer) in [
        ("[list] [out]", "\"/reader\""),
        ("[list] [out] /reader", "(from \"/writer\") (to \"/reader\") (carrier text_ack)"),
        ("[add] tcp://nobody", "-1 \"Do not know how to connect to tcp://nobody\\r\\n\""),
        ("[add] mcast://reader", "-1 \"Cannot connect to mcast://reader\\r\\n\""),
        ("[del] /reader", "0 \"Removed connection from /writer to /reader\\r\\n\""),
        ("[list] [out]", ""),
    ] {
        let reply = admin.admin(&Bottle::parse(ask, Dialect::V3).unwrap()).await.unwrap();
        assert_eq!(reply.to_string(), answer, "{ask}");
    }
    let mut admin = RpcClient::connect(&network, "admin", "/reader", Carrier::Tcp).await.unwrap();
    let reply = admin.admin(&Bottle::parse("[add] /writer", Dialect::V3).unwrap()).await.unwrap();
    assert_eq!(reply.to_string(), "-1 \"Outputs not allowed\\r\\n\"");
}

#[tokio::test]
async fn lost_connections_come_back_by_themselves() {
    let (_names, network) = names().await;
    let mut client = RpcClient::keep(&network, "/me", "/echo", Carrier::Tcp);
    let mut sender = Sender::keep(&network, "/out", "/reader", Carrier::Tcp);
    assert!(client.call(&greeting(0)).await.is_err());
    assert!(sender.send(greeting(0), None).await.is_err());
    for round in 1..3 {
        let server = RpcServer::open(&network, "/echo", Arc::new(Echo)).await.unwrap();
        let mut reader = InputPort::open(&network, "/reader", Queue::Newest).await.unwrap();
        soon(async {
            while client.call(&greeting(round)).await.is_err() {
                client.pause().await;
            }
            // the pause goes by for who does not wait for it, too
            while sender.send(greeting(round), None).await.is_err() {
                tokio::task::yield_now().await;
            }
        })
        .await;
        assert_eq!(content(&soon(reader.recv()).await.unwrap()), greeting(round));
        server.close().await;
        reader.close().await;
        // What was lost shows at the next use at the latest.
        assert!(client.call(&greeting(round)).await.is_err());
        assert!(sender.send(greeting(round), None).await.is_err());
    }
}

#[tokio::test]
async fn a_late_reply_is_never_taken_for_the_next_one() {
    struct Slow;
    impl Handler for Slow {
        fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
            Box::pin(async move {
                if request.payload.bottle(Dialect::V3).is_ok_and(|it| it == greeting(1)) {
                    std::future::pending::<()>().await;
                }
                Some(request.payload)
            })
        }
    }
    let (_names, network) = names().await;
    let _server = RpcServer::open(&network, "/slow", Arc::new(Slow)).await.unwrap();
    let client = RpcClient::keep(&network, "/me", "/slow", Carrier::Tcp);
    let mut client = client.with_timeout(Duration::from_millis(200));
    assert!(matches!(client.call(&greeting(1)).await, Err(CallError::Late { .. })));
    assert!(!client.is_connected());
    client.pause().await;
    assert_eq!(soon(client.call(&greeting(2))).await.unwrap(), greeting(2));
}

/// A line for stops finds its board without a name server, too; any other asks first who is there now.
#[tokio::test]
async fn a_client_that_remembers_needs_no_name_server_to_connect_anew() {
    struct LateOnce;
    impl Handler for LateOnce {
        fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
            let late = content(&request) == greeting(1);
            Box::pin(async move {
                if late {
                    tokio::time::sleep(Duration::from_secs(1)).await;
                }
                Some(request.payload)
            })
        }
    }
    let (names, network) = names().await;
    let _server = RpcServer::open(&network, "/board", Arc::new(LateOnce)).await.unwrap();
    let client =
        |name| RpcClient::keep(&network, name, "/board", Carrier::Tcp).with_timeout(Duration::from_millis(200));
    let (mut asks, mut remembers) = (client("/a"), client("/b").remembering());
    for client in [&mut asks, &mut remembers] {
        assert_eq!(soon(client.call(&greeting(0))).await.unwrap(), greeting(0));
        assert!(matches!(client.call(&greeting(1)).await, Err(CallError::Late { .. })));
    }
    names.close().await;
    assert!(soon(asks.call(&greeting(2))).await.is_err());
    assert_eq!(soon(remembers.call(&greeting(2))).await.unwrap(), greeting(2));
}

#[tokio::test]
async fn ports_register_again_when_the_name_server_forgot_them() {
    let (first, network) = names().await;
    let options = PortOptions { renew: Duration::from_millis(50), ..PortOptions::default() };
    let reader = InputPort::open_with(&network, "/reader", Queue::Newest, options).await.unwrap();
    let contact = network.query("/reader").await.unwrap();
    let address = first.address();
    first.close().await;
    let again = soon(async {
        loop {
            if let Ok(server) = NameServer::bind(address, ServerOptions::default()).await {
                return server;
            }
            tokio::task::yield_now().await;
        }
    })
    .await;
    soon(async {
        while network.query("/reader").await.unwrap() != contact {
            tokio::task::yield_now().await;
        }
    })
    .await;
    // Who takes the name keeps it, also when the first owner leaves.
    network.unregister("/reader").await.unwrap();
    network.register("/reader", "127.0.0.1", 9).await.unwrap();
    reader.close().await;
    assert_eq!(network.query("/reader").await.unwrap().map(|it| it.port), Some(9));
    again.close().await;
}

#[tokio::test]
async fn a_name_stays_with_the_port_that_answers_and_comes_back_from_one_that_does_not() {
    let (_names, network) = names().await;
    let options = PortOptions { renew: Duration::from_millis(10), ..PortOptions::default() };
    let first = InputPort::open_with(&network, "/a", Queue::Newest, options).await.unwrap();
    let refused = OutputPort::open(&network, "/a", Delivery::Newest).await.err().unwrap().to_string();
    assert!(refused.contains("another program holds the port name /a (at 127.0.0.1:"), "{refused}");
    assert_eq!(network.query("/a").await.unwrap().as_ref(), Some(first.contact()));
    // a program that takes names without asking, and has died
    network.unregister("/a").await.unwrap();
    network.register("/a", "127.0.0.1", 1).await.unwrap();
    soon(async { while network.query("/a").await.unwrap().as_ref() != Some(first.contact()) {} }).await;
    // who is about to close gets a moment
    let (closed, opened) = tokio::join!(first.close(), OutputPort::open(&network, "/a", Delivery::Newest));
    let ((), second) = (closed, opened.unwrap());
    assert_eq!(network.query("/a").await.unwrap().as_ref(), Some(second.contact()));
}

/// A program that was killed leaves its name behind, and the system gives the number to another port.
#[tokio::test]
async fn the_number_of_a_dead_port_may_be_another_ports_since() {
    let (_names, network) = names().await;
    let other = InputPort::open(&network, "/other", Queue::Newest).await.unwrap();
    let number = other.contact().port;
    network.register("/dead", "127.0.0.1", number).await.unwrap();
    assert!(!remote::exists(&network, "/dead").await.unwrap() && remote::exists(&network, "/other").await.unwrap());
    let again = InputPort::open(&network, "/dead", Queue::Newest).await.unwrap();
    assert_eq!(network.query("/dead").await.unwrap().as_ref(), Some(again.contact()));
    // a longer name is another one
    network.register("/oth", "127.0.0.1", number).await.unwrap();
    InputPort::open(&network, "/oth", Queue::Newest).await.unwrap().close().await;
}

/// The original gives any name to the last that requests it.
#[tokio::test]
async fn our_name_server_gives_the_name_of_a_live_port_to_no_other() {
    let (_names, network) = names().await;
    let port = InputPort::open(&network, "/a", Queue::Newest).await.unwrap();
    let (ours, other) = (port.contact().clone(), InputPort::open(&network, "/b", Queue::Newest).await.unwrap());
    let refused = network.register("/a", "127.0.0.1", other.contact().port).await;
    assert!(refused.is_err(), "{refused:?}");
    assert!(network.register("/a", "...", 0).await.is_err());
    assert_eq!(network.query("/a").await.unwrap().as_ref(), Some(&ours));
    // of many that start at one moment, one gets it
    let open = || OutputPort::open(&network, "/c", Delivery::Newest);
    let (one, two, three) = tokio::join!(open(), open(), open());
    let opened: Vec<_> = [one, two, three].into_iter().flatten().collect();
    assert_eq!(opened.len(), 1);
    assert_eq!(network.query("/c").await.unwrap().as_ref(), Some(opened[0].contact()));
}

/// A suspended program still has its port: connections are accepted by the system.
#[tokio::test]
async fn a_program_that_does_not_answer_keeps_its_name() {
    let (_names, network) = names().await;
    let network = network.with_timeout(Duration::from_millis(200));
    let suspended = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    network.register("/a", "127.0.0.1", suspended.local_addr().unwrap().port()).await.unwrap();
    let refused = InputPort::open(&network, "/a", Queue::Newest).await.err().unwrap().to_string();
    assert!(refused.contains("that does not answer: it may be suspended"), "{refused}");
    drop(suspended);
    InputPort::open(&network, "/a", Queue::Newest).await.unwrap();
}

/// Another program that is connected, or the remains of a connection that broke without notice, count as no source.
#[tokio::test]
async fn a_source_that_is_silent_is_asked_to_connect_again_whoever_else_is_connected() {
    let (_names, network) = names().await;
    let mut reader = InputPort::open(&network, "/reader", Queue::Newest).await.unwrap();
    let strangers = OutputPort::open(&network, "/stranger", Delivery::Newest).await.unwrap();
    strangers.connect("/reader", Carrier::Tcp).await.unwrap();
    let mut source = StreamSource::new("/writer", Carrier::Tcp, Duration::from_millis(50));
    for round in 0..3 {
        // each life of the writer knows nothing of the connections of the one before
        let writer = OutputPort::open(&network, "/writer", Delivery::Newest).await.unwrap();
        soon(async {
            loop {
                tokio::select! {
                    message = source.recv(&mut reader) => match message {
                        Ok(message) if message.as_ref().is_some_and(|m| m.from == "/writer") => {
                            assert_eq!(content(&message.unwrap()), greeting(round));
                            return;
                        }
                        _ => {}
                    },
                    () = tokio::time::sleep(Duration::from_millis(5)) => {
                        strangers.write(greeting(-1), None);
                        writer.write(greeting(round), None);
                    }
                }
            }
        })
        .await;
        writer.close().await;
    }
}
