//! The captured encodings of real YARPs (spec section 20), each in both directions: bytes to content and content to bytes,
//! text to bytes and bytes to text. What they mean stands in the files, so `YARP_VECTORS` may name a folder of others.

use std::collections::BTreeMap;
use std::path::PathBuf;

use mobee_yarp::payload::{pair, vector};
use mobee_yarp::{Bottle, Dialect, Image, JointData, JointField, PixelCode, Stamp, Vocab};
use serde_json::Value as Json;

/// What the names of encodings begin with; anything else that has bytes is taken for a bottle.
const KINDS: [&str; 8] = ["bottle-", "parse-", "vector-", "vectorof-", "image-", "stamp", "command-", "jointdata-"];

#[test]
fn every_captured_encoding_passes_in_both_directions() {
    let (mut passed, mut exchanges) = (BTreeMap::new(), 0);
    for (name, json) in vectors() {
        let kind = KINDS.into_iter().find(|kind| name.starts_with(kind)).unwrap_or("others");
        if json["hex"].is_null() && kind != "command-" {
            exchanges += usize::from(json["steps"].is_array());
            continue; // replayed by other tests
        }
        let v4 = json["dialect"].as_str().map_or(name.ends_with("-v4"), |dialect| dialect.starts_with('4'));
        let case = Case { name: &name, json: &json, dialect: if v4 { Dialect::V4 } else { Dialect::V3 } };
        match kind {
            "parse-" => case.parse(),
            "vector-" => case.vector(),
            "vectorof-" => case.integers(),
            "image-" => case.image(),
            "stamp" => case.stamp(),
            "jointdata-" => case.joints(),
            "command-" => case.command(),
            _ => drop(case.is_bottle()),
        }
        *passed.entry(kind).or_insert(0) += 1;
    }
    println!("{} captured encodings passed in both directions: {passed:?}", passed.values().sum::<i32>());
    assert!(exchanges > 0 || !passed.is_empty(), "no file there has an encoding or an exchange");
    assert!(passed.len() >= KINDS.len() || foreign().is_some(), "no vectors of some kind: {passed:?}");
}

/// The folder of the user's own vectors.
fn foreign() -> Option<PathBuf> {
    std::env::var_os("YARP_VECTORS").map(PathBuf::from)
}

fn vectors() -> BTreeMap<String, Json> {
    let own = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data/yarp-vectors");
    let folder = foreign().unwrap_or_else(own);
    let files = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("YARP_VECTORS: {}: {e}", folder.display()));
    files
        .map(|file| file.unwrap().path())
        .filter(|path| path.extension().is_some_and(|it| it == "json"))
        .map(|path| {
            let name = path.file_stem().unwrap().to_str().unwrap().to_string();
            let json = serde_json::from_slice(&std::fs::read(&path).unwrap());
            (name, json.unwrap_or_else(|e| panic!("{}: {e}", path.display())))
        })
        .collect()
}

struct Case<'a> {
    name: &'a str,
    json: &'a Json,
    dialect: Dialect,
}

impl Case<'_> {
    fn hex(&self) -> Vec<u8> {
        unhex(self.json["hex"].as_str().unwrap_or_else(|| panic!("{}: no bytes", self.name)))
    }

    /// A text of the file: a character is a byte.
    fn text(&self, key: &str) -> Vec<u8> {
        let text = self.json[key].as_str().unwrap_or_else(|| panic!("{}: no `{key}`", self.name));
        text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect()
    }

    /// What the bytes are as a bottle: that gives these bytes again, and is printed and read as the file's text.
    fn decoded(&self) -> Bottle {
        let (name, bytes) = (self.name, self.hex());
        let decoded = Bottle::decode(&bytes, self.dialect).unwrap_or_else(|e| panic!("{name}: {e}"));
        let prefix = Bottle::decode_prefix(&[bytes.as_slice(), b"more"].concat(), self.dialect).unwrap();
        assert_eq!(prefix.map(|(_, length)| length), Some(bytes.len()), "{name}: length");
        for end in 0..bytes.len() {
            assert_eq!(Bottle::decode_prefix(&bytes[..end], self.dialect), Ok(None), "{name}: {end} bytes");
            assert!(Bottle::decode(&bytes[..end], self.dialect).is_err(), "{name}: {end} bytes");
        }
        if self.json["text"].is_string() {
            let show = |text: &[u8]| text.escape_ascii().to_string();
            let text = self.text("text");
            assert_eq!(show(&decoded.to_text()), show(&text), "{name}: printed");
            assert_eq!(show(&self.written().to_text()), show(&text), "{name}: read and printed");
        }
        decoded
    }

    /// The bytes are those of a bottle.
    fn is_bottle(&self) -> Bottle {
        let decoded = self.decoded();
        assert_eq!(decoded.encode(self.dialect), self.hex(), "{}: encoded", self.name);
        decoded
    }

    /// The file's text as a bottle.
    fn written(&self) -> Bottle {
        Bottle::parse(self.text("text"), self.dialect).unwrap_or_else(|e| panic!("{}: {e}", self.name))
    }

    fn parse(&self) {
        let read = Bottle::parse(self.text("input_text"), self.dialect).unwrap();
        // by their writing, since nan differs from itself
        assert_eq!(format!("{:?}", self.is_bottle()), format!("{read:?}"), "{}: read", self.name);
    }

    fn vector(&self) {
        let expected = vector::from_bottle(&self.written()).unwrap();
        assert_eq!(vector::decode(&self.hex(), self.dialect).unwrap(), expected, "{}", self.name);
        assert_eq!(vector::encode(&expected, self.dialect), self.hex(), "{}", self.name);
        self.decoded();
    }

    fn integers(&self) {
        let expected: Vec<i32> = self.written().iter().map(|n| n.as_i64().unwrap().try_into().unwrap()).collect();
        assert_eq!(vector::decode_i32(&self.hex(), self.dialect).unwrap(), expected, "{}", self.name);
        assert_eq!(vector::encode_i32(&expected), self.hex(), "{}", self.name);
        self.is_bottle();
    }

    fn image(&self) {
        let image = Image::decode(&self.hex(), self.dialect).unwrap();
        assert_eq!(image.encode(), self.hex(), "{}", self.name);
        assert_eq!(Image::from_bottle(self.written()).unwrap(), image, "{}: from text", self.name);
        assert_eq!(image.to_bottle(), self.is_bottle(), "{}: as a bottle", self.name);
        if self.name.starts_with("image-rgb-3x2") {
            // r = 10 x + y, g = 100 + x, b = 200 + y
            let pixels = (0..2).flat_map(|y| (0..3).flat_map(move |x| [10 * x + y, 100 + x, 200 + y]));
            let made = Image::new(PixelCode::RGB, 3, 2, &pixels.collect::<Vec<u8>>()).unwrap();
            assert_eq!(Image { top: image.top, ..made }, image);
        }
    }

    fn stamp(&self) {
        let stamp = Stamp::decode(&self.hex(), self.dialect).unwrap();
        assert_eq!(stamp.encode(self.dialect), self.hex(), "{}", self.name);
        assert_eq!(stamp.envelope().into_bytes(), self.text("text"), "{}", self.name);
        assert_eq!(Stamp::from_bottle(&self.written()).unwrap(), stamp, "{}: from text", self.name);
        assert_eq!(stamp.to_bottle(), self.is_bottle(), "{}: as a bottle", self.name);
    }

    fn joints(&self) {
        let data = JointData::decode(&self.hex(), self.dialect).unwrap();
        assert_eq!(data.encode(self.dialect), self.hex(), "{}", self.name);
        assert_eq!(JointData::from_bottle(&self.written()).unwrap(), data, "{}: from text", self.name);
        assert_eq!(data.to_bottle(self.dialect).unwrap(), self.is_bottle(), "{}: as a bottle", self.name);
        if self.name.starts_with("jointdata-2") {
            assert_eq!(data, self.two_joints());
        }
    }

    /// Field n of joint j is n + j/2, the temperature 30 + 1.5 j.
    fn two_joints(&self) -> JointData {
        let field = |n: i32, valid| JointField { values: vec![f64::from(n), f64::from(n) + 0.5], valid };
        let modes = |a, b| JointField::known([a, b].map(|letters| Vocab::new(letters).0 as i32).to_vec());
        JointData {
            position: field(1, true),
            velocity: field(2, true),
            acceleration: field(3, true),
            motor_position: field(4, false),
            motor_velocity: field(5, false),
            motor_acceleration: field(6, false),
            torque: field(7, true),
            pwm: field(8, true),
            current: field(9, true),
            control_modes: modes("pos", "vel"),
            interaction_modes: modes("stif", "comp"),
            temperature: match self.dialect {
                Dialect::V3 => JointField::default(),
                Dialect::V4 => JointField::known(vec![30.0, 31.5]),
            },
        }
    }

    fn command(&self) {
        match &*self.name.replace("-v4", "") {
            "command-text" => return self.command_text(),
            "command-malformed" => return self.command_malformed(),
            _ => {}
        }
        // `streaming command HEAD (BODY)`
        let content = self.json["content"].as_str().and_then(|content| content.strip_prefix("streaming command "));
        let (head, body) =
            content.and_then(|it| it.rsplit_once('(')).unwrap_or_else(|| panic!("{}: no content", self.name));
        let read = |text: &str| Bottle::parse(text, self.dialect).unwrap();
        let head = read(head.trim_end_matches([' ', ',']));
        let body = vector::from_bottle(&read(body.trim_end_matches(')'))).unwrap();
        let (name, dialect, bytes) = (self.name, self.dialect, self.hex());
        assert_eq!(pair::decode(&bytes, dialect).unwrap(), (head.clone(), body.clone()), "{name}");
        assert_eq!(pair::encode(&head, &body, dialect), bytes, "{name}");
        assert_eq!(pair::to_bottle(&head, &body), self.decoded(), "{name}: as a bottle");
    }

    /// What the client says after its greeting.
    fn said(&self) -> Vec<u8> {
        let steps = self.json["steps"].as_array().unwrap().iter();
        let said = steps.filter(|step| step["dir"] == "client->server").nth(1);
        unhex(said.and_then(|step| step["hex"].as_str()).unwrap())
    }

    fn command_text(&self) {
        let said = String::from_utf8(self.said()).unwrap();
        let line = said.strip_prefix("D\r\n").and_then(|it| it.strip_suffix("\r\n")).unwrap();
        let (head, body) = pair::from_bottle(&Bottle::parse(line, self.dialect).unwrap()).unwrap();
        assert_eq!((&head, &body), (&Bottle::of([Vocab::new("vmos")]), &vec![0.0; 7]));
        assert_eq!(pair::to_bottle(&head, &body).to_string(), line);
    }

    fn command_malformed(&self) {
        // index, lengths of two blocks and one reply, command of 8 bytes, then the payload
        let said = self.said();
        let payload = &said[8 + 10 + 12 + 8..];
        let flat = Bottle::decode(payload, self.dialect).unwrap();
        assert_eq!(flat, Bottle::new().with(Vocab::new("vmos")).with(Bottle::of([0.0; 7])));
        assert_eq!(flat.encode(self.dialect), payload);
        assert!(pair::decode(payload, self.dialect).is_err());
    }
}

fn unhex(hex: &str) -> Vec<u8> {
    let byte = |at: usize| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
    (0..hex.len()).step_by(2).map(byte).collect()
}
