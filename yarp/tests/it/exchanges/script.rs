//! Captured exchanges, and what their bytes mean.

use mobee_yarp::Carrier;
use mobee_yarp::wire::{TextCommand, Verb, frame, handshake, line};
use std::path::PathBuf;

pub type Outcome = Result<(), String>;

/// One captured exchange.
pub struct Exchange {
    pub name: String,
    pub steps: Vec<Step>,
}

/// One step: bytes, or an event.
#[derive(Clone, Debug)]
pub struct Step {
    pub from_client: bool,
    pub bytes: Vec<u8>,
    pub event: String,
    pub transport: String,
    pub meaning: String,
}

pub fn load() -> Vec<Exchange> {
    let folder = std::env::var_os("YARP_VECTORS")
        .map(PathBuf::from)
        .unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data/yarp-vectors"));
    let mut out = Vec::new();
    for file in std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
        let path = file.unwrap().path();
        if path.extension().is_none_or(|it| it != "json") {
            continue;
        }
        let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let Some(steps) = json["steps"].as_array() else { continue };
        let text = |step: &serde_json::Value, key: &str| step[key].as_str().unwrap_or_default().to_owned();
        let steps = steps.iter().map(|step| Step {
            from_client: text(step, "dir").starts_with("client"),
            bytes: unhex(&text(step, "hex")),
            event: text(step, "event"),
            transport: text(step, "transport"),
            meaning: text(step, "meaning"),
        });
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        out.push(Exchange { name, steps: steps.collect() });
    }
    out.sort_by(|a, b| a.name.cmp(&b.name));
    out
}

fn unhex(text: &str) -> Vec<u8> {
    text.as_bytes().chunks(2).map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap()).collect()
}

/// The carrier and name with which these bytes begin a connection.
pub fn hello(bytes: &[u8]) -> Option<(Carrier, String)> {
    if bytes.starts_with(&frame::numbered(10)) {
        return None;
    }
    let (hello, used) = handshake::parse(bytes).ok()??;
    (used == bytes.len()).then_some((hello.carrier, hello.name))
}

/// A message, whatever its blocks were.
#[derive(Clone, Debug, PartialEq)]
pub struct Said {
    pub command: TextCommand,
    pub payload: Vec<u8>,
}

/// The first `most` messages in these bytes, and how many bytes are left over.
pub fn messages(carrier: Carrier, mut bytes: &[u8], most: usize) -> Result<(Vec<Said>, usize), String> {
    let mut out = Vec::new();
    while out.len() < most {
        if carrier.is_text() {
            let Some(found) = line::Scanner::default().parse(bytes, 1 << 20).map_err(|e| e.to_string())? else { break };
            out.push(Said { command: found.command, payload: found.payload });
            bytes = &bytes[found.end..];
        } else {
            let Some(found) = frame::parse(bytes, 1 << 20).map_err(|e| e.to_string())? else { break };
            out.push(Said { command: found.command, payload: bytes[found.payload..found.end].to_vec() });
            bytes = &bytes[found.end..];
        }
    }
    Ok((out, bytes.len()))
}

/// The data messages of a step.
pub fn data(carrier: Carrier, bytes: &[u8]) -> Vec<Said> {
    let messages = messages(carrier, bytes, usize::MAX).map_or_else(|_| Vec::new(), |(messages, _)| messages);
    messages.into_iter().filter(|said| matches!(said.command.verb, Verb::Data(_))).collect()
}

/// Text without what differs from machine to machine: port numbers, processes (spec section 20).
pub fn masked(text: &[u8]) -> String {
    let mut text = String::from_utf8_lossy(text).into_owned();
    for key in ["(tid ", "(pid ", "(arguments ", "(name ", "(hostname ", "127.0.0.1:"] {
        let mut from = 0;
        while let Some(at) = text[from..].find(key) {
            let start = from + at + key.len();
            let end = start + text[start..].find([')', '/']).unwrap_or(0);
            text.replace_range(start..end, "_");
            from = start;
        }
        // what was quoted may have held a slash
        if let Some(at) = text.find(key)
            && key.starts_with('(')
        {
            let start = at + key.len();
            let end = start + text[start..].find(')').unwrap_or(0);
            text.replace_range(start..end, "_");
        }
    }
    text
}
