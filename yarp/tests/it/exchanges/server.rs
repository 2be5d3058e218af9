//! Our ports as listeners: they get the client's bytes as captured and must answer the server's.

use super::script::{Exchange, Outcome, Said, Step, data, hello, masked};
use crate::common::names;
use mobee_yarp::{Bottle, Carrier, Contact, Delivery, Dialect, Handler, Message, NameServer, Payload, Queue};
use mobee_yarp::{InputPort, OutputPort, RpcClient, RpcServer};
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpStream, UdpSocket};

/// The ports that an exchange needs.
struct Scene {
    names: NameServer,
    /// A name server that knows none of the ports, so that it does nothing about them.
    other_names: NameServer,
    reader: InputPort,
    writer: Option<OutputPort>,
    rpc: Option<RpcServer>,
}

pub async fn replay(exchange: &Exchange) -> Outcome {
    let (names, network) = names().await;
    // The stream vectors were recorded by a listening port, the others by one named /reader.
    let reader = InputPort::open(&network, "/reader", Queue::Bounded(10)).await.unwrap();
    let name = exchange.name.as_str();
    let with_writer = ["admin-add-del", "admin-add-unknown", "connect-admin", "persist-connect"].contains(&name);
    let writer = if with_writer {
        Some(OutputPort::open(&network, "/writer", Delivery::Strict(10)).await.unwrap())
    } else {
        None
    };
    let rpc = if name.starts_with("rpc-") {
        Some(RpcServer::open(&network, "/rpc", Arc::new(Recorded::of(exchange))).await.unwrap())
    } else {
        None
    };
    if name == "admin-prop-get-key" {
        let mut admin = RpcClient::connect(&network, "first", "/reader", Carrier::TextAck).await.unwrap();
        let set = Bottle::parse("[prop] [set] colour red", Dialect::V3).unwrap();
        assert_eq!(admin.admin(&set).await.unwrap().to_string(), "[ok]");
        admin.close().await;
    }
    let (other_names, _) = crate::common::names().await;
    let mut scene = Scene { names, other_names, reader, writer, rpc };
    let end =
        if name == "udp-session" { datagrams(&mut scene, exchange).await } else { stream(&mut scene, exchange).await };
    if let Some(rpc) = scene.rpc {
        rpc.close().await;
    }
    if let Some(writer) = scene.writer {
        writer.close().await;
    }
    scene.reader.close().await;
    scene.names.close().await;
    scene.other_names.close().await;
    end
}

/// Answers requests with the recorded replies.
struct Recorded(Mutex<VecDeque<Payload>>);

impl Recorded {
    fn of(exchange: &Exchange) -> Recorded {
        let mut carrier = Carrier::Tcp;
        let mut replies = VecDeque::new();
        for step in &exchange.steps {
            match hello(&step.bytes) {
                Some((wanted, _)) if step.from_client => carrier = wanted,
                _ if step.from_client || step.bytes.starts_with(b"YA") || step.bytes.starts_with(b"Welcome") => {}
                _ => {
                    let reply = step.bytes.strip_suffix(carrier.ack()).unwrap_or(&step.bytes);
                    let line = reply.strip_suffix(b"\r\n").unwrap_or(reply);
                    let text = carrier.is_text();
                    replies.push_back(if text { Payload::Text(line.into()) } else { reply.to_vec().into() });
                }
            }
        }
        Recorded(Mutex::new(replies))
    }
}

impl Handler for Recorded {
    fn call(&self, request: Message) -> Pin<Box<dyn Future<Output = Option<Payload>> + Send>> {
        let reply = if request.wants_reply { self.0.lock().unwrap().pop_front() } else { None };
        Box::pin(async move { reply })
    }
}

fn address(contact: &Contact) -> SocketAddr {
    SocketAddr::new(contact.host.parse().unwrap(), contact.port)
}

async fn stream(scene: &mut Scene, exchange: &Exchange) -> Outcome {
    let mut connection: Option<(TcpStream, Carrier)> = None;
    let mut greeted = false;
    let steps = &exchange.steps;
    for (i, step) in steps.iter().enumerate() {
        let at = |why: String| format!("step {i}: {why}");
        let io = |e: std::io::Error| at(e.to_string());
        if step.from_client && !step.event.is_empty() {
            connection = None;
        } else if step.from_client {
            if let Some((carrier, _)) = hello(&step.bytes) {
                let to = target(scene, exchange, step);
                connection = Some((TcpStream::connect(to).await.map_err(io)?, carrier));
                greeted = false;
            } else if connection.is_none() {
                let to = target(scene, exchange, step);
                connection = Some((TcpStream::connect(to).await.map_err(io)?, Carrier::Text));
            }
            let (stream, carrier) = connection.as_mut().ok_or_else(|| at("no connection".into()))?;
            let expected = data(*carrier, &step.bytes);
            // in two pieces, which TCP may do anywhere
            let (one, two) = step.bytes.split_at(step.bytes.len() / 2);
            stream.write_all(one).await.map_err(io)?;
            tokio::task::yield_now().await;
            stream.write_all(two).await.map_err(io)?;
            if scene.rpc.is_none() && !step.meaning.contains("name server") {
                arrived(&mut scene.reader, *carrier, expected).await.map_err(at)?;
            }
        } else if step.event.starts_with("nothing sent") {
            // the answers that follow would not be where they belong
        } else if !step.event.is_empty() {
            let (stream, _) = connection.as_mut().ok_or_else(|| at("no connection".into()))?;
            let mut rest = Vec::new();
            stream.read_to_end(&mut rest).await.map_err(io)?;
            if !rest.is_empty() {
                return Err(at(format!("bytes before the end: {rest:02x?}")));
            }
            connection = None;
        } else {
            let (stream, carrier) = connection.as_mut().ok_or_else(|| at("no connection".into()))?;
            // the second of two connections with the same name ends the first
            let _second = if exchange.name == "hs-duplicate-first" && greeted {
                let mut second = TcpStream::connect(address(scene.reader.contact())).await.map_err(io)?;
                second.write_all(&steps[0].bytes).await.map_err(io)?;
                Some(second)
            } else {
                None
            };
            answered(stream, *carrier, &step.bytes, greeted).await.map_err(at)?;
            greeted = true;
        }
    }
    Ok(())
}

/// Which port a connection goes to.
fn target(scene: &Scene, exchange: &Exchange, step: &Step) -> SocketAddr {
    if step.meaning == "to the name server" {
        return scene.other_names.address();
    }
    let contact = match (&scene.rpc, &scene.writer) {
        (Some(rpc), _) => rpc.contact(),
        (None, Some(writer)) => writer.contact(),
        _ => scene.reader.contact(),
    };
    assert!(contact.port != 0, "{}", exchange.name);
    address(contact)
}

/// Checks that the reader got this data.
async fn arrived(reader: &mut InputPort, carrier: Carrier, expected: Vec<Said>) -> Outcome {
    for said in expected {
        let message = reader.recv().await.ok_or("the reader is closed")?;
        let got = match (&message.payload, carrier.is_text()) {
            (Payload::Binary(bytes), false) => bytes.to_vec(),
            (Payload::Text(text), true) => text.clone(),
            (other, _) => return Err(format!("data in the wrong form: {other:?}")),
        };
        if (&got, &message.envelope) != (&said.payload, &said.command.envelope) {
            return Err(format!("the reader got {got:02x?} with {:?}, not {said:?}", message.envelope));
        }
    }
    Ok(())
}

/// Reads as much as was captured and compares.
async fn answered(stream: &mut TcpStream, carrier: Carrier, expected: &[u8], greeted: bool) -> Outcome {
    let mut got = Vec::new();
    let lines = |bytes: &[u8]| bytes.iter().filter(|b| **b == b'\n').count();
    // 8 bytes that begin no carrier are answered by text
    let text = carrier.is_text() || expected.starts_with(b"* ");
    while if text { lines(&got) < lines(expected) } else { got.len() < expected.len() } {
        let byte = stream.read_u8().await.map_err(|e| format!("{e} after {:?}", String::from_utf8_lossy(&got)))?;
        got.push(byte);
    }
    if text {
        let (got, want) = (masked(&got), masked(expected));
        return if got == want { Ok(()) } else { Err(format!("answered {got:?}, not {want:?}")) };
    }
    if !greeted {
        // the listener's own port number
        let (got, want) = ((&got[..2], &got[6..]), (&expected[..2], &expected[6..]));
        return if got == want { Ok(()) } else { Err(format!("greeted {got:02x?}")) };
    }
    if got == expected { Ok(()) } else { Err(format!("answered {got:02x?}, not {expected:02x?}")) }
}

async fn datagrams(scene: &mut Scene, exchange: &Exchange) -> Outcome {
    let io = |e: std::io::Error| e.to_string();
    let to = address(scene.reader.contact());
    let mut stream = TcpStream::connect(to).await.map_err(io)?;
    let local = stream.local_addr().map_err(io)?;
    let mut steps = exchange.steps.iter();
    let first = steps.next().ok_or("no steps")?;
    stream.write_all(&first.bytes).await.map_err(io)?;
    let mut reply = [0; 8];
    stream.read_exact(&mut reply).await.map_err(io)?;
    let number = u16::from_le_bytes([reply[2], reply[3]]);
    if stream.read(&mut [0]).await.map_err(io)? != 0 {
        return Err("more than the reply".into());
    }
    drop(stream);
    let socket = UdpSocket::bind(local).await.map_err(io)?;
    for step in steps.skip(1) {
        if step.transport.starts_with("udp") {
            socket.send_to(&step.bytes, SocketAddr::new(to.ip(), number)).await.map_err(io)?;
            if step.from_client {
                arrived(&mut scene.reader, Carrier::Udp, data(Carrier::Udp, &step.bytes[8..])).await?;
            }
        } else if step.from_client {
            stream_out_of_band(to, step, &exchange.steps).await?;
        }
    }
    if !scene.reader.peers().is_empty() {
        tokio::task::yield_now().await;
    }
    Ok(())
}

async fn stream_out_of_band(to: SocketAddr, step: &Step, steps: &[Step]) -> Outcome {
    let io = |e: std::io::Error| e.to_string();
    let mut stream = TcpStream::connect(to).await.map_err(io)?;
    stream.write_all(&step.bytes).await.map_err(io)?;
    let mut got = Vec::new();
    stream.read_to_end(&mut got).await.map_err(io)?;
    let want = steps.iter().find(|it| !it.from_client && it.transport == "tcp" && it.bytes.starts_with(b"Welcome"));
    let want = &want.ok_or("no reply captured")?.bytes;
    if got == *want { Ok(()) } else { Err(format!("answered {:?}", String::from_utf8_lossy(&got))) }
}
