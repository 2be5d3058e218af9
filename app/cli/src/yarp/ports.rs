//! The commands that open ports or communicate with one: `read`, `write`, `rpc`.

use super::input::Lines;
use super::{Failure, because, info};
use crate::signals::Interrupt;
use mobee_model::printable;
use mobee_yarp::{Bottle, CallError, Carrier, Contact, Delivery, InputPort, Message, Network, Queue, RpcClient};
use mobee_yarp::{OutputPort, Value, Vocab, remote};
use std::io::{IsTerminal, Write};
use std::time::Duration;

/// Number of attempts to send a request whose connection breaks, as in the original.
const ATTEMPTS: u32 = 3;
/// Maximum number of messages that wait to be printed.
pub(super) const WAITING: usize = 1000;

/// The name of a port; an unused one for `...`.
fn name(text: &str) -> String {
    if text == "..." { format!("/tmp/port/mobee/{}", std::process::id()) } else { text.into() }
}

/// The carrier in a target, else that of the option.
pub(super) fn carrier_of(target: &str, option: Carrier) -> Result<Carrier, Failure> {
    match Contact::parse(target).carrier {
        none if none.is_empty() => Ok(option),
        said => said.parse().map_err(because),
    }
}

/// Writes a line to standard output at once; `false` when the reader has closed it.
pub(super) fn printed(line: &[u8]) -> bool {
    let mut out = std::io::stdout().lock();
    // programs get the raw bytes; on a terminal control characters must have no effect
    let readable = out.is_terminal().then(|| printable(&String::from_utf8_lossy(line)).into_owned());
    let line = readable.as_ref().map_or(line, |text| text.as_bytes());
    out.write_all(line).and_then(|()| out.write_all(b"\n")).and_then(|()| out.flush()).is_ok()
}

/// `read`: prints messages, until Ctrl-C or the writer's end of file.
pub(super) async fn read(network: &Network, port: &str, words: &[String], carrier: Carrier) -> Result<(), Failure> {
    let mut sources = Vec::new();
    let mut envelope = false;
    let mut trim = usize::MAX;
    let mut words = words.iter().peekable();
    while let Some(word) = words.next() {
        match word.as_str() {
            "envelope" => envelope = true,
            "trim" => trim = words.next_if(|w| w.parse::<usize>().is_ok()).map_or(80, |w| w.parse().unwrap_or(80)),
            source => sources.push(source),
        }
    }
    let mut interrupt = Interrupt::new();
    let name = name(port);
    if remote::exists(network, &name).await.map_err(because)? {
        return Err(because(format!("port {name} is open already: choose another name, or end its program")));
    }
    let mut reader = InputPort::open(network, &name, Queue::Bounded(WAITING)).await.map_err(because)?;
    info(format_args!("Port {} active at {}", reader.name(), reader.contact()));
    for source in sources {
        let carrier = carrier_of(source, carrier)?;
        if let Err(e) = reader.connect_from(source, carrier).await {
            info(format_args!("{e}"));
        }
    }
    loop {
        let message = tokio::select! {
            message = reader.recv() => message,
            () = interrupt.wait() => None,
        };
        if !message.is_some_and(|m| show(network, &m, envelope, trim)) {
            break;
        }
    }
    reader.close().await;
    Ok(())
}

/// Prints a message; `false` after the last one.
fn show(network: &Network, message: &Message, envelope: bool, trim: usize) -> bool {
    let bottle = match message.payload.bottle(network.dialect()) {
        Ok(bottle) => bottle,
        Err(e) => {
            info(format_args!("a message from {} was dropped: {e}", message.from));
            return true;
        }
    };
    // the original's convention for lines of text: 0 and the line, at the end 1
    let text = match bottle.0.as_slice() {
        [Value::Int32(1), Value::String(_)] => return false,
        [Value::Int32(_), Value::String(line)] => line.0.clone(),
        _ => bottle.to_text(),
    };
    let text = text.get(..trim.min(text.len())).unwrap_or(&text);
    let stamp = message.envelope.as_ref().filter(|_| envelope);
    let stamp = stamp.map(|stamp| format!("{} ", Bottle::parse(stamp, network.dialect()).unwrap_or_default()));
    printed(&[stamp.unwrap_or_default().as_bytes(), text].concat())
}

/// `write`: sends each line as a bottle, or `verbatim`.
pub(super) async fn write(
    network: &Network,
    port: &str,
    words: &[String],
    carrier: Carrier,
    wait_connect: bool,
) -> Result<(), Failure> {
    let verbatim = words.iter().any(|w| w == "verbatim");
    let mut interrupt = Interrupt::new();
    let writer = OutputPort::open(network, &name(port), Delivery::Strict(WAITING)).await.map_err(because)?;
    info(format_args!("Port {} active at {}", writer.name(), writer.contact()));
    let work = async {
        for target in words.iter().filter(|w| *w != "verbatim") {
            writer.connect(target, carrier_of(target, carrier)?).await.map_err(because)?;
        }
        let mut lines = Lines::new();
        while let Some(line) = lines.next().await {
            let bottle = if verbatim { wrapped(0, line) } else { parse(network, line)? };
            while wait_connect && writer.peers().is_empty() {
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
            writer.write(bottle, None);
            writer.drained().await;
        }
        if verbatim {
            writer.write(wrapped(1, b"<EOF>".to_vec()), None);
        }
        Ok(())
    };
    let ended = tokio::select! {
        ended = work => ended,
        () = interrupt.wait() => Ok(()),
    };
    writer.close().await;
    ended
}

fn wrapped(code: i32, line: Vec<u8>) -> Bottle {
    Bottle(vec![Value::Int32(code), Value::String(mobee_yarp::Text(line))])
}

fn parse(network: &Network, line: Vec<u8>) -> Result<Bottle, Failure> {
    Bottle::parse(line, network.dialect()).map_err(because)
}

/// `rpc`: sends each line, prints each reply.
pub(super) async fn rpc(
    network: &Network,
    port: &str,
    own: &str,
    carrier: Carrier,
    admin: bool,
) -> Result<(), Failure> {
    let carrier = carrier_of(port, carrier)?;
    let mut client = RpcClient::connect(network, own, port, carrier).await.map_err(because)?;
    let mut interrupt = Interrupt::new();
    let work = async {
        let mut lines = Lines::new();
        while let Some(line) = lines.next().await {
            let request = parse(network, line)?;
            let mut attempt = 1;
            let reply = loop {
                let reply = if admin { client.admin(&request).await } else { client.call(&request).await };
                match reply {
                    Err(CallError::Broken { .. }) if attempt < ATTEMPTS => {
                        attempt += 1;
                        info("Target disappeared, reconnecting...");
                        client = RpcClient::connect(network, own, port, carrier).await.map_err(because)?;
                    }
                    reply => break reply.map_err(because)?,
                }
            };
            if !respond(&reply) {
                break;
            }
        }
        client.close().await;
        Ok(())
    };
    tokio::select! {
        ended = work => ended,
        () = interrupt.wait() => Ok(()),
    }
}

/// Prints a reply; one that begins with `[many]` as a line per element.
fn respond(reply: &Bottle) -> bool {
    match reply.0.as_slice() {
        [Value::Vocab(many), rest @ ..] if *many == Vocab::new("many") => {
            let inner = match rest {
                [Value::List(list)] => &list.0,
                rest => rest,
            };
            printed(b"Responses:")
                && inner.iter().all(|value| {
                    let text = match value {
                        Value::String(text) => text.0.clone(),
                        value => value.to_text(),
                    };
                    printed(&[b"  ".as_slice(), &text].concat())
                })
        }
        _ => printed(&[b"Response: ".as_slice(), &reply.to_text()].concat()),
    }
}
