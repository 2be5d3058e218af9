//! The captured encodings of real YARPs (spec section 20), each in both directions: bytes to content and content to bytes,
//! text to bytes and bytes to text.

use std::collections::BTreeMap;
use std::path::PathBuf;

use mobee_yarp::payload::{pair, vector};
use mobee_yarp::{Bottle, Dialect, Field, Image, JointData, PixelCode, Stamp, Text, Value, Vocab};
use serde_json::Value as Json;

const PREFIXES: [&str; 8] = ["bottle-", "parse-", "vector-", "vectorof-", "image-", "stamp", "command-", "jointdata-"];

#[test]
fn every_captured_encoding_passes_in_both_directions() {
    let mut passed = BTreeMap::new();
    for (name, json) in vectors() {
        let Some(prefix) = PREFIXES.into_iter().find(|prefix| name.starts_with(prefix)) else { continue };
        let dialect = if name.ends_with("-v4") { Dialect::V4 } else { Dialect::V3 };
        let case = Case { bare: name.trim_end_matches("-v4"), name: &name, json: &json, dialect };
        match prefix {
            "parse-" => case.parse(),
            "bottle-" => case.bottle(),
            "vector-" | "vectorof-" => case.vector(),
            "image-" => case.image(),
            "stamp" => case.stamp(),
            "jointdata-" => case.joints(),
            _ => case.command(),
        }
        *passed.entry(prefix).or_insert(0) += 1;
    }
    println!("{} captured encodings passed in both directions: {passed:?}", passed.values().sum::<i32>());
    assert_eq!(passed.len(), PREFIXES.len(), "no vectors of some kind");
}

fn vectors() -> BTreeMap<String, Json> {
    let folder = std::env::var_os("YARP_VECTORS")
        .map(PathBuf::from)
        .unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/yarp-vectors"));
    let files = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("YARP_VECTORS: {}: {e}", folder.display()));
    files
        .map(|file| file.unwrap().path())
        .filter(|path| path.extension().is_some_and(|it| it == "json"))
        .map(|path| {
            let name = path.file_stem().unwrap().to_str().unwrap().to_string();
            (name, serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap())
        })
        .collect()
}

struct Case<'a> {
    name: &'a str,
    /// The name without the dialect.
    bare: &'a str,
    json: &'a Json,
    dialect: Dialect,
}

impl Case<'_> {
    fn hex(&self) -> Vec<u8> {
        unhex(self.json["hex"].as_str().unwrap_or_else(|| panic!("{}: no bytes", self.name)))
    }

    /// A text of the file: a character is a byte.
    fn text(&self, key: &str) -> Option<Vec<u8>> {
        Some(self.json[key].as_str()?.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect())
    }

    /// The bytes mean this bottle, the bottle gives these bytes, and so with the text.
    fn is_bottle(&self, expected: &Bottle) {
        let (name, bytes) = (self.name, self.hex());
        let decoded = Bottle::decode(&bytes, self.dialect).unwrap_or_else(|e| panic!("{name}: {e}"));
        // by their writing, since nan differs from itself
        assert_eq!(format!("{decoded:?}"), format!("{expected:?}"), "{name}: decoded");
        assert_eq!(expected.encode(self.dialect), bytes, "{name}: encoded");
        let prefix = Bottle::decode_prefix(&[bytes.as_slice(), b"more"].concat(), self.dialect).unwrap();
        assert_eq!(prefix.map(|(_, length)| length), Some(bytes.len()), "{name}: length");
        for end in 0..bytes.len() {
            assert_eq!(Bottle::decode_prefix(&bytes[..end], self.dialect), Ok(None), "{name}: {end} bytes");
            assert!(Bottle::decode(&bytes[..end], self.dialect).is_err(), "{name}: {end} bytes");
        }
        if let Some(text) = self.text("text") {
            let show = |text: &[u8]| text.escape_ascii().to_string();
            assert_eq!(show(&expected.to_text()), show(&text), "{name}: printed");
            let again = Bottle::parse(&text, self.dialect).unwrap();
            assert_eq!(show(&again.to_text()), show(&text), "{name}: read and printed");
        }
    }

    fn parse(&self) {
        let input = self.text("input_text").unwrap();
        self.is_bottle(&Bottle::parse(input, self.dialect).unwrap());
    }

    fn bottle(&self) {
        let v = Vocab::new;
        let expected = match self.bare {
            "bottle-blob" => Bottle::new().with(vec![0u8, 1, 2, 254, 255]),
            "bottle-dict" => Bottle(vec![Value::Dict(Bottle::of([Bottle::new().with("k").with(5)]))]),
            "bottle-empty" => Bottle::new(),
            "bottle-float-text" => Bottle::of([0.0, 100000.0, 1e100, 123_456_789.123_456_79]),
            "bottle-float32" => Bottle::of([1.5f32]),
            "bottle-float64" => Bottle::of([-0.1]),
            "bottle-homog-float64" => Bottle::of([1.0, 2.5, -3e10]),
            "bottle-homog-int32" => Bottle::of([1, 2, 3]),
            "bottle-homog-string" => Bottle::of(["ab", "c"]),
            "bottle-homog-vocab" => Bottle::of([v("get"), v("axes")]),
            "bottle-inf-nan" => Bottle::of([f64::INFINITY, f64::NEG_INFINITY, f64::NAN]),
            "bottle-int8" => Bottle::of([-5i8]),
            "bottle-int16" => Bottle::of([-300i16]),
            "bottle-int32" => Bottle::of([42]),
            "bottle-int64" => Bottle::of([1234567890123456789i64]),
            "bottle-list-of-lists" => Bottle::of([Bottle::of([1]), Bottle::of([2])]),
            "bottle-mixed" => Bottle::new().with(1).with("two").with(3.0),
            "bottle-nested-homog" => Bottle::new().with(v("set")).with(v("poss")).with(Bottle::of([1.0, 2.0])),
            "bottle-nested-mixed" => {
                Bottle::of([Bottle::new().with(1).with("x").with(Bottle::of([7, 8])), Bottle::new()])
            }
            "bottle-string-empty" => Bottle::of([""]),
            "bottle-string-escapes" => Bottle::of(["q\"b\\n\nr\rz\0t\ttab\0"]),
            "bottle-string-utf8" => Bottle::of([Text::from("café")]),
            "bottle-string" => Bottle::of(["hello world"]),
            "bottle-vocab-list" => Bottle::of([v("list")]),
            "bottle-vocab-set" => Bottle::of([v("set")]),
            "bottle-vocab-true" => Bottle::of([true]),
            "bottle-vocab-zero" => Bottle::of([false]),
            "bottle-vocab64" => Bottle(vec![Value::Vocab64(u64::from_le_bytes(*b"velocity"))]),
            other => panic!("{other} is not covered: add its content here"),
        };
        self.is_bottle(&expected);
    }

    fn vector(&self) {
        let bytes = self.hex();
        if self.bare == "vectorof-int-2" {
            assert_eq!(vector::decode_i32(&bytes, self.dialect), Ok(vec![7, -1]), "{}", self.name);
            assert_eq!(vector::encode_i32(&[7, -1]), bytes, "{}", self.name);
            return self.is_bottle(&Bottle::of([7, -1]));
        }
        let expected: &[f64] = match self.bare {
            "vector-0" => &[],
            "vector-3" => &[1.0, -2.25, 0.001],
            other => panic!("{other} is not covered: add its content here"),
        };
        assert_eq!(vector::decode(&bytes, self.dialect).unwrap(), expected, "{}", self.name);
        assert_eq!(vector::encode(expected, self.dialect), bytes, "{}", self.name);
        self.text_is(&Bottle::decode(&bytes, self.dialect).unwrap());
        let text = Bottle::parse(self.text("text").unwrap(), self.dialect).unwrap();
        assert_eq!(vector::from_bottle(&text).unwrap(), expected, "{}: from text", self.name);
    }

    fn image(&self) {
        // the flag of the top is 1 where it comes from 3.12 and 0 from 4.0
        let top = if self.dialect == Dialect::V3 { 1 } else { 0 };
        let of = |pixel, width, height, quantum, pixels: &[u8]| {
            let image = Image::new(pixel, width, height, pixels).unwrap();
            if quantum == 8 { image } else { Image { quantum, rows: pixels.to_vec(), ..image } }
        };
        let image = match self.bare {
            "image-empty" => Image::EMPTY,
            "image-float-2x1" => of(PixelCode::FLOAT, 2, 1, 8, &[1.5f32.to_le_bytes(), (-2f32).to_le_bytes()].concat()),
            "image-mono-3x2-q1" => of(PixelCode::MONO, 3, 2, 1, &[0, 1, 2, 16, 17, 18]),
            "image-rgb-3x2" => {
                let pixels = (0..2).flat_map(|y| (0..3).flat_map(move |x| [10 * x + y, 100 + x, 200 + y]));
                of(PixelCode::RGB, 3, 2, 8, &pixels.collect::<Vec<u8>>())
            }
            other => panic!("{other} is not covered: add its content here"),
        };
        let (image, bytes) = (Image { top, ..image }, self.hex());
        assert_eq!(Image::decode(&bytes, self.dialect).unwrap(), image, "{}", self.name);
        assert_eq!(image.encode(), bytes, "{}", self.name);
        self.is_bottle(&image.to_bottle());
        let text = Bottle::parse(self.text("text").unwrap(), self.dialect).unwrap();
        assert_eq!(Image::from_bottle(text).unwrap(), image, "{}: from text", self.name);
    }

    fn stamp(&self) {
        let (stamp, bytes) = (Stamp { count: 12, time: 1700000000.25 }, self.hex());
        assert_eq!(Stamp::decode(&bytes, self.dialect).unwrap(), stamp, "{}", self.name);
        assert_eq!(stamp.encode(self.dialect), bytes, "{}", self.name);
        assert_eq!(Some(stamp.envelope().into_bytes()), self.text("text"), "{}", self.name);
        self.is_bottle(&stamp.to_bottle());
    }

    fn joints(&self) {
        // field n of joint j is n + j/2, the temperature 30 + 1.5 j
        let field = |n: i32, valid| Field { values: vec![f64::from(n), f64::from(n) + 0.5], valid };
        let modes = |a, b| Field::known([a, b].map(|letters| Vocab::new(letters).0 as i32).to_vec());
        let data = JointData {
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
                Dialect::V3 => Field::default(),
                Dialect::V4 => Field::known(vec![30.0, 31.5]),
            },
        };
        assert_eq!(self.bare, "jointdata-2", "another one: add its content here");
        let bytes = self.hex();
        assert_eq!(JointData::decode(&bytes, self.dialect).unwrap(), data, "{}", self.name);
        assert_eq!(data.encode(self.dialect), bytes, "{}", self.name);
        self.is_bottle(&data.to_bottle(self.dialect).unwrap());
        let text = Bottle::parse(self.text("text").unwrap(), self.dialect).unwrap();
        assert_eq!(JointData::from_bottle(&text).unwrap(), data, "{}: from text", self.name);
    }

    fn command(&self) {
        let v = Vocab::new;
        let (head, body): (Bottle, &[f64]) = match self.bare {
            "command-dpo" => (Bottle::new().with(v("dpo")).with(3), &[12.5]),
            "command-dpog" => (Bottle::new().with(v("dpog")).with(2).with(Bottle::of([0, 4])), &[1.0, 2.0]),
            "command-vmos" => (Bottle::of([v("vmos")]), &[5.0, -5.0]),
            "command-text" => return self.command_text(),
            "command-malformed" => return self.command_malformed(),
            other => panic!("{other} is not covered: add its content here"),
        };
        let bytes = self.hex();
        let (name, dialect) = (self.name, self.dialect);
        assert_eq!(pair::decode(&bytes, dialect).unwrap(), (head.clone(), body.to_vec()), "{name}");
        assert_eq!(pair::encode(&head, body, dialect), bytes, "{name}");
        self.is_bottle(&pair::to_bottle(&head, body));
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

    fn text_is(&self, bottle: &Bottle) {
        assert_eq!(Some(bottle.to_text()), self.text("text"), "{}: printed", self.name);
    }
}

fn unhex(hex: &str) -> Vec<u8> {
    let byte = |at: usize| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
    (0..hex.len()).step_by(2).map(byte).collect()
}
