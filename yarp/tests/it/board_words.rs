//! Every recorded request to a board is understood, written again as it was, and answered as the board answered it.

use mobee_yarp::board::{Ask, JointKind, Joints, Set, Shadow, ShadowAxis, Streamed, mode, reply};
use mobee_yarp::{Bottle, Dialect, Stamp, Value, Vocab};
use std::path::PathBuf;

fn folder() -> PathBuf {
    std::env::var_os("YARP_VECTORS")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data/yarp-vectors"), PathBuf::from)
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect()
}

/// A recorded request, as the payload of its message, and the reply without the ack.
struct Exchange {
    file: String,
    request: Vec<u8>,
    reply: Vec<u8>,
}

impl Exchange {
    fn asked(&self) -> Bottle {
        Bottle::decode(&self.request, Dialect::V3).unwrap_or_else(|e| panic!("{}: {e}", self.file))
    }
    fn said(&self) -> Bottle {
        Bottle::decode(&self.reply, Dialect::V3).unwrap_or_else(|e| panic!("{}: {e}", self.file))
    }
    /// The stamp of the reply, which is the machine's and not the protocol's.
    fn stamp(&self) -> Stamp {
        let said = self.said().0;
        let at = said.iter().position(|v| *v == Value::Vocab(Vocab::new("tsta")));
        match at.map(|i| (&said[i + 1], &said[i + 2])) {
            Some((Value::Int32(count), Value::Float64(time))) => Stamp { count: *count as u32, time: *time },
            _ => Stamp { count: 0, time: 0.0 },
        }
    }
}

fn exchanges() -> Vec<Exchange> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder()).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    let mut all = Vec::new();
    for path in files {
        let file = path.file_stem().unwrap().to_string_lossy().into_owned();
        let of_boards = ["cb-", "cb2-", "icubsim-right-arm"].iter().any(|p| file.starts_with(p));
        if !of_boards || file == "cb-stream-commands" {
            continue;
        }
        let vector: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let hex = |s: &serde_json::Value| bytes(s["hex"].as_str().unwrap());
        for pair in vector["steps"].as_array().unwrap().chunks(2) {
            let (message, answer) = (hex(&pair[0]), hex(&pair[1]));
            // the index (8 + 2 + 8 bytes, a length per block, one zero) and the command of 8 bytes
            let head = 8 + 10 + 4 * usize::from(message[8]) + 4 + 8;
            let ack = answer.len() - 8;
            assert_eq!(&answer[ack..], b"YA\0\0\0\0RP");
            all.push(Exchange { file: file.clone(), request: message[head..].into(), reply: answer[..ack].into() });
        }
    }
    assert!(all.len() >= 100 || std::env::var_os("YARP_VECTORS").is_some(), "{} exchanges", all.len());
    all
}

/// Codes that a board for arms leaves to others: amplifiers, torques, currents, PWM, PIDs, faults, calibration, variables.
const LEFT_OUT: [&str; 13] = [
    "cb2-cald",
    "cb2-get-acu",
    "cb2-get-asta",
    "cb2-get-icur-ref",
    "cb2-get-ijfl-jhfl",
    "cb2-get-ipwm-pwm",
    "cb2-get-pid-pids-pos",
    "cb2-get-pwm",
    "cb2-get-torq-rng",
    "cb2-get-torq-trq",
    "cb2-get-torq-trqs",
    "cb2-set-adi",
    "cb2-set-torq-ref",
];

/// The same with strings of up to four letters as vocabs, whole numbers of values as floats: the canonical spelling.
fn canonical(bottle: &Bottle) -> Bottle {
    let word = |v: &Value| v.as_vocab().map_or_else(|| v.clone(), Value::Vocab);
    let mut words: Vec<Value> = bottle.0.iter().map(word).collect();
    let moves = words.get(1) == Some(&Value::Vocab(Vocab::new("pos")));
    if let (true, Some(Value::Int32(v))) = (moves, words.get(3).cloned()) {
        words[3] = Value::Float64(f64::from(v));
    }
    Bottle(words)
}

#[test]
fn every_recorded_request_is_understood_and_written_again_byte_for_byte() {
    let (mut known, mut left, mut unknown) = (0, 0, 0);
    for e in exchanges() {
        let asked = e.asked();
        assert_eq!(asked.encode(Dialect::V3), e.request, "{}", e.file);
        match Ask::parse(&asked) {
            Some(ask) => {
                known += 1;
                assert_eq!(ask.bottle(), canonical(&asked), "{}", e.file);
                if canonical(&asked) == asked {
                    assert_eq!(ask.bottle().encode(Dialect::V3), e.request, "{}", e.file);
                }
                assert_eq!(Ask::parse(&ask.bottle()), Some(ask), "{}", e.file);
            }
            None if LEFT_OUT.contains(&e.file.as_str()) => left += 1,
            None => {
                unknown += 1;
                let said = e.said();
                assert_eq!(reply::unknown(&asked), said, "{} is not understood but was answered", e.file);
            }
        }
    }
    assert_eq!(left, LEFT_OUT.len());
    assert!(known >= 80, "{known} understood, {unknown} rightly not");
}

/// What the reply says, put into the shadow.
fn learn(shadow: &mut Shadow, asked: &Bottle, said: &Bottle) {
    use mobee_yarp::board::{Get, Quantity};
    let axes = shadow.axes.len();
    let numbers = |v: &Value| -> Vec<f64> {
        v.as_list().map_or_else(|| vec![v.as_f64().unwrap()], |l| l.0.iter().map(|v| v.as_f64().unwrap()).collect())
    };
    let vocabs = |v: &Value| -> Vec<Vocab> {
        v.as_list().map_or_else(|| vec![v.as_vocab().unwrap()], |l| l.0.iter().map(|v| v.as_vocab().unwrap()).collect())
    };
    let Some(Ask::Get(get)) = Ask::parse(asked) else { return };
    if said == &reply::fail() || said == &reply::nak() {
        return;
    }
    let value = said.0.get(2);
    match get {
        Get::Name(j) => {
            let Some(Value::String(text)) = value else { panic!("a name is a string") };
            shadow.axes[j].name = String::from_utf8(text.0.clone()).unwrap();
        }
        Get::Kind(j) => shadow.axes[j].kind = JointKind::from_code(value.unwrap().as_i64().unwrap() as i32),
        Get::Limits(j) => {
            (shadow.axes[j].min, shadow.axes[j].max) = (value.unwrap().as_f64().unwrap(), said.0[3].as_f64().unwrap());
        }
        Get::SpeedLimits(j) => shadow.axes[j].max_speed = said.0[3].as_f64().unwrap(),
        Get::Done(joints) => {
            for j in joints.on(axes).unwrap() {
                shadow.axes[j].done = value.unwrap().as_i64() == Some(1);
            }
        }
        Get::Values(reading, joints) => {
            for (j, v) in joints.on(axes).unwrap().into_iter().zip(numbers(value.unwrap())) {
                let a = &mut shadow.axes[j];
                *match reading {
                    Quantity::Encoder => &mut a.q,
                    Quantity::EncoderSpeed => &mut a.speed,
                    Quantity::EncoderAcceleration => &mut a.acc,
                    Quantity::Target => &mut a.target,
                    Quantity::ReferenceSpeed => &mut a.ref_speed,
                    Quantity::ReferenceAcceleration => &mut a.ref_acc,
                    Quantity::Velocity => &mut a.vel_ref,
                    Quantity::Direct => &mut a.direct_ref,
                } = v;
            }
        }
        Get::Modes(joints) => {
            for (j, v) in joints.on(axes).unwrap().into_iter().zip(vocabs(value.unwrap())) {
                shadow.axes[j].mode = v;
            }
        }
        Get::Interactions(joints) => {
            for (j, v) in joints.on(axes).unwrap().into_iter().zip(vocabs(&said.0[0])) {
                shadow.axes[j].interaction = v;
            }
        }
        Get::Version | Get::Axes | Get::Motors | Get::MotorEncoders => {}
    }
}

#[test]
fn a_shadow_answers_every_question_as_the_board_did() {
    let mut answered = 0;
    for e in exchanges() {
        let axes = if e.file.starts_with("icubsim") { 16 } else { 7 };
        let mut shadow = Shadow { axes: vec![ShadowAxis::at_rest("", 0.0, 1.0, 1.0, 0.5); axes] };
        let asked = e.asked();
        learn(&mut shadow, &asked, &e.said());
        match shadow.answer(&asked, e.stamp()) {
            Some(answer) => {
                answered += 1;
                assert_eq!(answer.encode(Dialect::V3), e.reply, "{}: {asked:?}", e.file);
            }
            None => {
                let set = matches!(Ask::parse(&asked), Some(Ask::Set(_)));
                let failed = reply::unknown(&asked) == e.said();
                assert!(set || failed || LEFT_OUT.contains(&e.file.as_str()), "{} is not answered", e.file);
            }
        }
    }
    assert!(answered >= 45, "{answered} answered");
}

#[test]
fn orders_fit_the_board_exactly_when_the_board_took_them() {
    for e in exchanges() {
        let axes = if e.file.starts_with("icubsim") { 16 } else { 7 };
        if let Some(ask @ Ask::Set(_)) = Ask::parse(&e.asked()) {
            assert_eq!(ask.fits(axes), reply::is_ok(&e.said()), "{}", e.file);
        }
    }
}

fn words(text: &[&str]) -> Vec<Value> {
    text.iter().map(|w| Value::Vocab(Vocab::new(w))).collect()
}

#[test]
fn malformed_requests_are_not_understood() {
    let list = |n: &[i32]| Value::List(Bottle(n.iter().map(|i| Value::Int32(*i)).collect()));
    let tries: Vec<(&[&str], Vec<Value>)> = vec![
        (&["set", "pos"], vec![]),
        (&["set", "pos"], vec![Value::Int32(0)]),
        (&["set", "pos"], vec![Value::Int32(-1), Value::Float64(1.0)]),
        (&["set", "posg"], vec![Value::Int32(3), list(&[1, 4]), list(&[5, 6])]),
        (&["set", "posg"], vec![Value::Int32(2), list(&[1, 4]), list(&[5])]),
        (&["set", "posg"], vec![Value::Int32(2), list(&[1, -4]), list(&[5, 6])]),
        (&["set", "poss"], vec![Value::Float64(1.0)]),
        (&["set", "vmo"], vec![Value::Int32(0), Value::Float64(1.0)]),
        (&["set", "dpos"], vec![list(&[1, 2, 3])]),
        (&["get", "enc"], vec![]),
        (&["get", "encg"], vec![Value::Int32(1), list(&[0])]),
        (&["get", "icmd"], vec![]),
        (&["get", "icmd", "cmog"], vec![Value::Int32(2)]),
        (&["set", "icmd", "cmod"], vec![Value::Int32(0)]),
        (&["set", "llim"], vec![Value::Int32(0), Value::Float64(1.0)]),
    ];
    for (head, tail) in tries {
        let request = Bottle(words(head).into_iter().chain(tail).collect());
        assert_eq!(Ask::parse(&request), None, "{request:?}");
    }
    let twice = Set::Stop(Joints::Group(vec![1, 1]));
    assert!(!Ask::Set(twice).fits(3), "a joint named twice");
    let strings = Bottle(["get", "encs"].map(|w| Value::String(mobee_yarp::Text(w.into()))).to_vec());
    assert!(Ask::parse(&strings).is_some());
}

#[test]
fn streamed_commands_are_read_strictly_and_written_as_the_real_client_does() {
    let vector = std::fs::read(folder().join("cb-stream-commands.json")).unwrap();
    let vector: serde_json::Value = serde_json::from_slice(&vector).unwrap();
    let mut seen = 0;
    for step in vector["steps"].as_array().unwrap() {
        let message = bytes(step["hex"].as_str().unwrap_or(""));
        if !step["meaning"].as_str().is_some_and(|m| m.starts_with("D ")) {
            continue;
        }
        let head = 8 + 10 + 4 * usize::from(message[8]) + 4 + 8;
        let pair = Bottle::decode(&message[head..], Dialect::V3).unwrap();
        let [Value::List(head), Value::List(body)] = pair.0.as_slice() else { panic!("a pair") };
        let body: Vec<f64> = body.0.iter().map(|v| v.as_f64().unwrap()).collect();
        let torque = head.0[0] == Value::Vocab(Vocab::new("dtq"));
        match Streamed::parse(head, &body, 7) {
            Some(streamed) => {
                seen += 1;
                assert_eq!(streamed.pair(), (head.clone(), body.clone()));
            }
            None => assert!(torque, "{head:?}"),
        }
        assert_eq!(Streamed::parse(head, &[], 7), None);
        assert_eq!(Streamed::parse(head, &[f64::NAN; 7], 7), None);
        assert_eq!(Streamed::parse(head, &[0.5; 8], 7), None);
    }
    assert_eq!(seen, 6);
    assert_eq!(mode::SETTABLE.len(), 9);
}
