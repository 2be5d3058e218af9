//! Our clients and outputs: they get the server's bytes as captured and must say the client's, messages compared as
//! wholes since block boundaries carry no meaning (spec section 5.1).

use super::script::{Exchange, Outcome, Said, Step, hello, messages};
use crate::common::names;
use mobee_yarp::wire::Verb;
use mobee_yarp::{
    Bottle, CallError, Carrier, Contact, Delivery, Dialect, OutputPort, Payload, PortOptions, RpcClient, Sender,
};
use mobee_yarp::{NameServer, Network, remote};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream, UdpSocket};

pub async fn replay(exchange: &Exchange) -> Outcome {
    let (names, network) = names().await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    let target = Contact::new("/reader", "tcp", "127.0.0.1", port);
    network.register("/reader", "127.0.0.1", port).await.unwrap();
    let name = exchange.name.as_str();
    let (server, client): (Outcome, Outcome) = if name == "connect-admin" {
        network.register("/writer", "127.0.0.1", port).await.unwrap();
        tokio::join!(scripted(listener, exchange), third_program(&network))
    } else if name == "udp-session" {
        tokio::join!(scripted_datagrams(listener, exchange), output(&network, exchange))
    } else if name.starts_with("connect-") || name.starts_with("stream-") {
        tokio::join!(scripted(listener, exchange), output(&network, exchange))
    } else if name == "hs-duplicate-first" {
        tokio::join!(scripted(listener, exchange), replaced(&network, &target))
    } else {
        tokio::join!(scripted(listener, exchange), requests(&network, exchange, &target))
    };
    let closed: NameServer = names;
    closed.close().await;
    server.and(client)
}

/// Plays the server: compares what comes, answers what was captured.
async fn scripted(listener: TcpListener, exchange: &Exchange) -> Outcome {
    let mut connection: Option<(TcpStream, Carrier, Vec<u8>)> = None;
    for (i, step) in exchange.steps.iter().enumerate() {
        let at = |why: String| format!("step {i}: {why}");
        let io = |e: std::io::Error| at(e.to_string());
        if step.from_client && !step.event.is_empty() {
            continue;
        }
        if let Some((carrier, _)) = hello(&step.bytes).filter(|_| step.from_client) {
            let (mut stream, _) = listener.accept().await.map_err(io)?;
            let mut got = vec![0; step.bytes.len()];
            stream.read_exact(&mut got).await.map_err(io)?;
            if got != step.bytes {
                return Err(at(format!("said {:?}", String::from_utf8_lossy(&got))));
            }
            connection = Some((stream, carrier, Vec::new()));
            continue;
        }
        let (stream, carrier, rest) = connection.as_mut().ok_or_else(|| at("no connection".into()))?;
        if !step.event.is_empty() {
            connection = None;
        } else if step.from_client {
            let (want, _) = messages(*carrier, &step.bytes, usize::MAX).map_err(at)?;
            heard(stream, *carrier, rest, &want).await.map_err(at)?;
        } else {
            stream.write_all(&step.bytes).await.map_err(io)?;
        }
    }
    // what our client still says is its quit, which the capture need not have
    if let Some((mut stream, carrier, mut rest)) = connection {
        let mut buffer = [0; 256];
        while let Ok(n @ 1..) = stream.read(&mut buffer).await {
            rest.extend_from_slice(&buffer[..n]);
            let (said, _) = messages(carrier, &rest, usize::MAX)?;
            match said.as_slice() {
                [] => {}
                [quit] if quit.command.verb == Verb::Quit => {
                    stream.write_all(carrier.ack()).await.map_err(|e| e.to_string())?;
                    break;
                }
                other => return Err(format!("more than captured: {other:?}")),
            }
        }
    }
    Ok(())
}

/// Reads until these messages are there.
async fn heard(stream: &mut TcpStream, carrier: Carrier, rest: &mut Vec<u8>, want: &[Said]) -> Outcome {
    let mut buffer = [0; 4096];
    loop {
        let (got, left) = messages(carrier, rest, want.len())?;
        if got.len() >= want.len() {
            rest.drain(..rest.len() - left);
            return if got == want { Ok(()) } else { Err(format!("said {got:?}, not {want:?}")) };
        }
        match stream.read(&mut buffer).await.map_err(|e| e.to_string())? {
            0 => return Err(format!("closed after {got:?} instead of {want:?}")),
            n => rest.extend_from_slice(&buffer[..n]),
        }
    }
}

/// What comes between two steps of the client: the reply without its acknowledgement.
fn reply(exchange: &Exchange, step: usize, carrier: Carrier) -> Vec<u8> {
    let answers = exchange.steps[step + 1..].iter().take_while(|it| !it.from_client);
    let bytes: Vec<u8> = answers.flat_map(|it| it.bytes.clone()).collect();
    bytes.strip_suffix(carrier.ack()).unwrap_or(&bytes).to_vec()
}

/// Says by an RPC client what the captured client said.
async fn requests(network: &Network, exchange: &Exchange, target: &Contact) -> Outcome {
    let mut client: Option<(RpcClient, Carrier)> = None;
    for (i, step) in exchange.steps.iter().enumerate().filter(|(_, step)| step.from_client && step.event.is_empty()) {
        if let Some((carrier, name)) = hello(&step.bytes) {
            let options = PortOptions::default();
            let new = RpcClient::connect_to(network, &name, target.clone(), carrier, options).await;
            if let Some((old, _)) = client.take() {
                drop(old);
            }
            client = Some((new.map_err(|e| e.to_string())?, carrier));
            continue;
        }
        let Some((it, carrier)) = client.as_mut() else { return Err("no handshake".into()) };
        let carrier = *carrier;
        let want = reply(exchange, i, carrier);
        for said in messages(carrier, &step.bytes, usize::MAX)?.0 {
            let bottle = || {
                let payload =
                    if carrier.is_text() { Payload::Text(said.payload.clone()) } else { said.payload.clone().into() };
                payload.bottle(Dialect::V3).map_err(|e| e.to_string())
            };
            match &said.command.verb {
                Verb::Data(true) if carrier.is_text() => {
                    let got = it.call(&bottle()?).await.map_err(|e| e.to_string())?;
                    let want = Bottle::parse(&want, Dialect::V3).map_err(|e| e.to_string())?;
                    same(&got, &want)?;
                }
                Verb::Data(true) => match it.call_raw(&said.payload).await {
                    Ok(got) => same(&got, &want)?,
                    Err(CallError::NoReply(_)) if want.is_empty() => {}
                    Err(error) => return Err(error.to_string()),
                },
                Verb::Data(false) => it.tell(said.payload.clone()).await.map_err(|e| e.to_string())?,
                Verb::Admin => {
                    let got = it.admin(&bottle()?).await.map_err(|e| e.to_string())?;
                    let want = if carrier.is_text() { Payload::Text(want.clone()) } else { want.clone().into() };
                    same(&got, &want.bottle(Dialect::V3).map_err(|e| e.to_string())?)?;
                }
                Verb::Describe => {
                    let got = it.describe().await.map_err(|e| e.to_string())?;
                    same(&got.replace('\n', "\r\n"), &String::from_utf8_lossy(&want).into_owned())?;
                }
                Verb::Quit => {
                    if let Some((it, _)) = client.take() {
                        it.close().await;
                    }
                    return Ok(());
                }
                other => return Err(format!("no client of ours says {other:?}")),
            }
        }
    }
    if let Some((it, _)) = client {
        it.close().await;
    }
    Ok(())
}

fn same<T: PartialEq + std::fmt::Debug>(got: &T, want: &T) -> Outcome {
    if got == want { Ok(()) } else { Err(format!("read {got:?}, not {want:?}")) }
}

/// Says by a writer what the captured output port said.
async fn output(network: &Network, exchange: &Exchange) -> Outcome {
    let first = exchange.steps.first().ok_or("no steps")?;
    let (carrier, name) = hello(&first.bytes).ok_or("no handshake")?;
    let writer = OutputPort::open(network, &name, Delivery::Strict(10)).await.map_err(|e| e.to_string())?;
    writer.connect("/reader", carrier).await.map_err(|e| e.to_string())?;
    let mut quits = carrier == Carrier::Udp;
    for Step { bytes, transport, .. } in exchange.steps.iter().skip(1).filter(|step| step.from_client) {
        let bytes = match transport.as_str() {
            "" => bytes.as_slice(),
            transport if transport.starts_with("udp") => &bytes[8..],
            _ => continue,
        };
        for said in messages(carrier, bytes, usize::MAX)?.0 {
            match said.command.verb {
                Verb::Data(false) if carrier.is_text() => {
                    writer.write(Payload::Text(said.payload), said.command.envelope);
                }
                Verb::Data(false) => writer.write(said.payload, said.command.envelope),
                Verb::Quit => quits = true,
                other => return Err(format!("{other:?}")),
            }
        }
    }
    writer.drained().await;
    if quits && !writer.disconnect("/reader").await && carrier.acknowledges() {
        return Err("the output was gone".into());
    }
    writer.close().await;
    Ok(())
}

/// Checks, connects, checks as a third program.
async fn third_program(network: &Network) -> Outcome {
    let error = |e: remote::RemoteError| e.to_string();
    same(&remote::connection(network, "/writer", "/reader").await.map_err(error)?, &None)?;
    remote::connect(network, "/writer", "/reader", None).await.map_err(error)?;
    let found = remote::connection(network, "/writer", "/reader").await.map_err(error)?;
    same(&found.map(|it| it.carrier), &Some("tcp".into()))
}

/// A sender whose place another one of the same name takes.
async fn replaced(network: &Network, target: &Contact) -> Outcome {
    let to = target.to_string();
    let mut sender = Sender::connect(network, "/dup", &to, Carrier::Tcp).await.map_err(|e| e.to_string())?;
    // The unrequested acknowledgement may be taken for that of the first message; the end can't be overlooked.
    for _ in 0..2 {
        if sender.send(Bottle::default(), None).await.is_err() {
            return Ok(());
        }
    }
    Err("the end was overlooked".into())
}

async fn scripted_datagrams(listener: TcpListener, exchange: &Exchange) -> Outcome {
    let io = |e: std::io::Error| e.to_string();
    let socket = UdpSocket::bind("127.0.0.1:0").await.map_err(io)?;
    let number = socket.local_addr().map_err(io)?.port();
    let (mut stream, peer) = listener.accept().await.map_err(io)?;
    let mut got = vec![0; exchange.steps[0].bytes.len()];
    stream.read_exact(&mut got).await.map_err(io)?;
    same(&got, &exchange.steps[0].bytes)?;
    let [low, high] = number.to_le_bytes();
    stream.write_all(&[b'Y', b'A', low, high, 0, 0, b'R', b'P']).await.map_err(io)?;
    drop(stream);
    for step in exchange.steps.iter().filter(|it| it.from_client).skip(1) {
        if step.transport.starts_with("udp") {
            let mut buffer = vec![0; 1 << 16];
            let (length, from) = socket.recv_from(&mut buffer).await.map_err(io)?;
            same(&from, &peer)?;
            same(&buffer[..length].to_vec(), &step.bytes)?;
        } else {
            let (mut stream, _) = listener.accept().await.map_err(io)?;
            let mut got = vec![0; step.bytes.len()];
            stream.read_exact(&mut got).await.map_err(io)?;
            same(&got, &step.bytes)?;
        }
    }
    Ok(())
}
