#[allow(dead_code, reason = "the tests of the world's requests use the rest")]
#[path = "../../../filter/src/world_rpc/tests/bench.rs"]
mod bench;
use super::*;
use bench::{Bench, any_request};
use mobee_filter::world_rpc::{Answered, Changed, Errand};
use mobee_model::{Object, parse_world};
use mobee_yarp::Text;
use proptest::prelude::*;

/// The core with the YARP protocol.
struct Typist(Bench);

/// Result of a request.
struct Seen {
    reply: Bottle,
    errand: Option<Errand>,
}

impl Typist {
    fn new() -> Typist {
        Typist(Bench::new())
    }

    fn ask(&mut self, request: &Bottle) -> Seen {
        let said = match self.0.ask(&parse(request)) {
            Ok(Answered::Errand(errand)) => return Seen { reply: Bottle::new(), errand: Some(errand) },
            Ok(Answered::Reply(reply) | Answered::Changed(Changed { reply, .. })) => Ok(reply),
            Err(why) => Err(why),
        };
        Seen { reply: reply(&said), errand: None }
    }

    /// Sends a line of blank-separated words and numbers, and formats the reply in the same way.
    fn line(&mut self, text: &str) -> String {
        shown(&self.ask(&typed(text)).reply)
    }
}

fn typed(text: &str) -> Bottle {
    let value = |word: &str| match (word.parse::<i32>(), word.parse::<f64>()) {
        (Ok(i), _) => Value::Int32(i),
        (_, Ok(x)) => Value::Float64(x),
        _ => match word.strip_prefix('[') {
            Some(vocab) => Value::Vocab(Vocab::new(vocab.trim_end_matches(']'))),
            None => Value::String(Text(word.as_bytes().to_vec())),
        },
    };
    Bottle(text.split_whitespace().map(value).collect())
}

fn shown(bottle: &Bottle) -> String {
    let show = |value: &Value| match value {
        Value::Float64(x) => format!("{}", (x * 1e6).round() / 1e6 + 0.0),
        Value::String(Text(bytes)) => String::from_utf8(bytes.clone()).unwrap(),
        other => format!("{other:?}"),
    };
    bottle.0.iter().map(show).collect::<Vec<_>>().join(" | ")
}

#[test]
fn objects_are_made_named_and_listed_as_in_the_original() {
    let mut b = Typist::new();
    assert_eq!(b.line("ls"), "table");
    assert_eq!(b.line("mk sph 0.1 1 2 3"), "sph1");
    assert_eq!(b.line("[mk] [ssph] 0.1 1 2 3"), "ssph1");
    assert_eq!(b.line("mk cyl 0.1 0.2 1 2 3"), "cyl1");
    assert_eq!(b.line("mk sbox 0.1 0.2 0.3 1 2 3"), "sbox1");
    assert_eq!(b.line("mk sph 0.1 1 2 3"), "sph2");
    assert_eq!(b.line("mk sph 0 1 2 3"), "Sphere radius must be greater than 0.");
    assert_eq!(b.line("mk cyl 1 -1 1 2 3"), "Cylinder height must be greater than 0.");
    assert_eq!(b.line("mk box 1 1 0 1 2 3"), "Box must have depth > 0.");
    assert_eq!(b.line("mk sph 0.1 1 2 3"), "sph3", "a failure takes no number");
    assert_eq!(b.line("mk cone 1 1"), "MK ERROR: Unknown geometry... use '(s)sph', '(s)cyl', or '(s)box'");
    assert_eq!(b.line("ls"), "table | sph1 | ssph1 | cyl1 | sbox1 | sph2 | sph3");
    assert_eq!(b.line("clr"), "Removed all world objects");
    assert_eq!(b.line("ls"), "table", "what is persistent stays");
    assert_eq!(b.line("mk sph 0.1 1 2 3"), "sph1", "counters begin again");
}

const UNKNOWN_CLASS: &str =
    "Object sph1 found. | Unknown definition, use 'obs', 'tgt' or 'gho' (or 'obstacle', 'target', 'ghost').";

#[test]
fn objects_are_moved_turned_read_and_removed() {
    let mut b = Typist::new();
    b.line("mk sph 0.1 1 2 3");
    assert_eq!(b.line("set sph 1 4 5 6"), "Object sph1 found. | Set Cartesian position of object.");
    assert_eq!(b.line("rot sph1 0 0 90"), "Object sph1 found. | Set rotation (about x,y,z in degrees).");
    let pose = "0 | 1 | 0 | 0 | -1 | 0 | 0 | 0 | 0 | 0 | 1 | 0 | 4 | 5 | 6 | 1";
    assert_eq!(b.line("get sph1"), format!("Object sph1 found. | {pose}"));
    assert_eq!(b.line("rot [sph] 1 1 0 0 0 1 0 0 0 1"), "Object sph1 found. | Set full rotation matrix.");
    assert!(b.line("get sph1").starts_with("Object sph1 found. | 1 | 0 | 0 | 0 | 0 | 1"));
    assert_eq!(b.line("set cyl 7 1 2 3"), "Object cyl7 not found.");
    assert_eq!(b.line("def sph1 tgt"), "Object sph1 found. | Changed object type to 'target'.");
    assert_eq!(b.0.scene.object("sph1").unwrap().1.class, ObjectClass::Target);
    assert_eq!(b.line("def sph1 xyz"), UNKNOWN_CLASS);
    for (word, class) in
        [("ghost", ObjectClass::Ghost), ("obstacle", ObjectClass::Obstacle), ("target", ObjectClass::Target)]
    {
        assert_eq!(
            b.line(&format!("def sph1 {word}")),
            format!("Object sph1 found. | Changed object type to '{word}'.")
        );
        assert_eq!(b.0.scene.object("sph1").unwrap().1.class, class);
    }
    assert_eq!(b.line("rm sph1"), "Object sph1 found. | Removed object");
    assert_eq!(b.line("rm sph1"), "Object sph1 not found.");
    assert_eq!(b.line("rm table"), "Object table found. | Object is persistent and stays.");
    assert_eq!(b.line("flip"), "Unknown RPC command");
    assert_eq!(b.line("srun 0.5"), "ok");
    assert_eq!(b.line("sync"), "ok");
    assert!(b.line("srun").starts_with("Please provide the refresh period"));
    assert!(b.line("help").contains("grab OBJ robot marker"));
}

#[test]
fn the_simulators_frame_is_turned_into_ours() {
    let mut b = Typist::new();
    b.line("mk cyl 0.1 0.2 1 2 3");
    assert_eq!(b.line("sim cyl 1 0.1 0.9 0.3 0 0 0"), "Object cyl1 found.");
    let (_, object) = b.0.scene.object("cyl1").unwrap();
    assert!((object.pose.translation.vector - nalgebra::Vector3::new(-0.326, -0.1, 0.3024)).norm() < 1e-12);
    assert!((object.pose.rotation.angle() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    let wrong = "Object cyl1 found. | parseSimRTBottle: invalid number of arguments supplied";
    assert_eq!(b.line("sim cyl 1 0.1 0.9"), wrong);
}

#[test]
fn what_is_grabbed_follows_its_marker_until_released() {
    let mut b = Typist::new();
    let marker = b.0.scene.robots()[0]
        .marker("RightHand")
        .map_or_else(|| b.0.scene.robots()[0].markers.last().unwrap().name.clone(), |m| m.name.clone());
    let robot = b.0.scene.robots()[0].name.clone();
    b.line("mk sph 0.02 0.1 0.2 0.3");
    b.line("def sph1 tgt");
    assert_eq!(b.line("grab sph1 nobody x"), "Object sph1 found. | Robot not found.");
    let grabbed = b.line(&format!("grab sph1 {robot} {marker}"));
    assert_eq!(grabbed, "Object sph1 found. | Robot found. | Marker found, grabbing object.");
    assert!(b.0.follow().is_empty(), "a robot at rest makes no edits");
    let place = |b: &Typist| {
        let at = b.0.scene.robots()[0].markers.iter().position(|m| m.name == marker).unwrap();
        let frame = b.0.scene.robots()[0].markers_at(&b.0.poses[0])[at].frame;
        frame.inverse() * b.0.scene.object("sph1").unwrap().1.pose
    };
    let before = place(&b);
    b.0.poses[0] = b.0.poses[0].iter().zip(&b.0.scene.robots()[0].motors).map(|(q, m)| (q + 0.3).min(m.max)).collect();
    assert_eq!(b.0.follow().len(), 1);
    assert!((place(&b).translation.vector - before.translation.vector).norm() < 1e-9);
    b.line("set sph1 0 0 1");
    assert!(b.0.follow().is_empty(), "put elsewhere, it is held from there");
    let released = b.line(&format!("grab sph1 {robot} none"));
    assert_eq!(released, "Object sph1 found. | Robot found. | Marker not found, releasing object.");
    b.0.poses[0] = b.0.scene.home()[0].clone();
    assert!(b.0.follow().is_empty());
}

#[test]
fn every_change_can_be_taken_back() {
    let mut b = Typist::new();
    assert_eq!(b.line("undo"), "Nothing to undo.");
    let state = |b: &Typist| {
        let mut all: Vec<_> = b.0.scene.objects().map(|(_, o)| Object::clone(o)).collect();
        all.sort_by(|a, b| a.name.cmp(&b.name));
        all
    };
    let mut states = vec![state(&b)];
    for text in [
        "mk sph 0.1 1 2 3",
        "set sph1 3 2 1",
        "mk box 1 1 1 0 0 0",
        "def box 1 gho",
        "rot table 1 2 3",
        "rm sph1",
        "clr",
    ] {
        b.line(text);
        states.push(state(&b));
    }
    while let Some(last) = states.pop() {
        assert_eq!(state(&b), last);
        if !states.is_empty() {
            assert!(b.line("undo").starts_with("Undone: "));
        }
    }
    assert_eq!(b.line("undo"), "Nothing to undo.");
}

#[test]
fn a_saved_world_loads_again_and_names_lead_nowhere_else() {
    let mut b = Typist::new();
    b.line("mk sph 0.1 1 2 3");
    let Some(Errand::Save { file, text }) = b.ask(&typed("save my-world")).errand else { panic!("no file") };
    assert_eq!(file, "my-world.xml");
    b.line("clr");
    b.line("mk box 1 1 1 9 9 9");
    b.line("set table 5 5 5");
    let Some(Errand::Load { file }) = b.ask(&typed("load my-world.xml")).errand else { panic!("no file") };
    let objects = parse_world(&file, &text).unwrap().value;
    assert_eq!(shown(&reply(&b.0.loaded(&file, objects))), "Loaded 2 objects from my-world.xml.");
    assert_eq!(b.line("ls"), "table | sph1");
    assert_eq!(b.0.scene.object("table").unwrap().1.pose, nalgebra::Isometry3::identity());
    assert_eq!(b.line("mk sph 0.1 1 2 3"), "sph2", "a name in use is passed over");
    for name in ["../x", "/etc/passwd", "a/b", "..", ".hidden", "", "a\\b", "x\0y"] {
        for command in ["save", "load"] {
            let mut request = typed(command);
            request.0.push(string(name));
            let answered = b.ask(&request);
            assert_eq!(answered.errand, None, "{command} {name:?}");
            assert!(shown(&answered.reply).starts_with("Give the bare name"));
        }
    }
}

#[test]
fn bottles_of_wrong_shape_get_a_sentence() {
    let mut b = Typist::new();
    b.line("mk sph 0.1 1 2 3");
    let before = b.0.scene.epoch();
    // requests that end too early, contain lists instead of words, or invalid numbers: these crashed the
    // original
    let list = |text: &str| Value::List(typed(text));
    let requests = [
        Bottle(vec![]),
        Bottle(vec![list("mk sph")]),
        Bottle(vec![string("get")]),
        Bottle(vec![string("set"), list("sph 1")]),
        Bottle(vec![string("set"), string("sph1")]),
        Bottle(vec![string("set"), string("sph1"), list("1 2 3")]),
        Bottle(vec![string("rot"), string("sph1"), Value::Float64(f64::NAN), Value::Int8(1), Value::Int8(1)]),
        Bottle(vec![string("mk"), string("sph"), Value::Float64(f64::INFINITY), Value::Int8(1)]),
        Bottle(vec![string("mk"), string("sph"), Value::Float64(0.1)]),
        Bottle(vec![string("grab"), string("sph1")]),
        Bottle(vec![string("def"), string("sph1"), Value::Blob(vec![0; 9])]),
        Bottle(vec![Value::Dict(Bottle(vec![]))]),
        typed("rot sph1 1 1 1 1 1 1 1 1 1"),
        typed("set sph1 1 2 nan"),
        typed("set sph1 1 2 3 4"),
    ];
    for request in requests {
        let reply = b.ask(&request).reply;
        assert!(!reply.0.is_empty(), "{request:?}");
        assert_eq!(b.0.scene.epoch(), before, "{request:?}");
    }
}

fn any_value() -> impl Strategy<Value = Value> {
    let words = prop::sample::select(vec![
        "mk", "set", "get", "rot", "def", "rm", "ls", "clr", "grab", "sim", "srun", "undo", "save", "load", "sph",
        "sbox", "cyl", "sph1", "table", "obs", "gho", "icub", "icubSim", "",
    ]);
    let leaf = prop_oneof![
        4 => words.clone().prop_map(string),
        2 => words.prop_map(|w| Value::Vocab(Vocab::new(w))),
        4 => (-3..4_i32).prop_map(Value::Int32),
        4 => (-2.0..2.0_f64).prop_map(Value::Float64),
        1 => any::<f64>().prop_map(Value::Float64),
        1 => any::<i64>().prop_map(Value::Int64),
        1 => prop::collection::vec(any::<u8>(), 0..8).prop_map(|b| Value::String(Text(b))),
        1 => prop::collection::vec(any::<u8>(), 0..8).prop_map(Value::Blob),
    ];
    leaf.prop_recursive(3, 12, 4, |inner| prop::collection::vec(inner, 0..4).prop_map(|v| Value::List(Bottle(v))))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// For all requests in any order: no panic, only edits that the scene accepts, and always a reply or an
    /// errand.
    #[test]
    fn no_request_harms(requests in prop::collection::vec(prop::collection::vec(any_value(), 0..8), 1..20)) {
        let mut b = Typist::new();
        for request in requests {
            let listing = words::name(request.first()).as_deref() == Some("ls");
            let answered = b.ask(&Bottle(request));
            prop_assert!(listing || answered.errand.is_some() || !answered.reply.0.is_empty());
            b.0.follow();
        }
    }

    /// A request written as a client writes it is parsed to the same request.
    #[test]
    fn what_is_written_is_read_again(request in any_request()) {
        prop_assert_eq!(parse(&written(&request)), request);
    }
}

/// Message of a client for a request.
fn written(request: &WorldRequest) -> Bottle {
    let words = |words: &[&str]| words.iter().map(string).collect::<Vec<_>>();
    let floats = |numbers: &[f64]| numbers.iter().map(|x| Value::Float64(*x)).collect::<Vec<_>>();
    Bottle(match request {
        WorldRequest::Help => words(&["help"]),
        WorldRequest::List => words(&["ls"]),
        WorldRequest::Clear => words(&["clr"]),
        WorldRequest::Synchronize => words(&["sync"]),
        WorldRequest::Undo => words(&["undo"]),
        WorldRequest::Save(file) => words(&["save", file]),
        WorldRequest::Load(file) => words(&["load", file]),
        WorldRequest::Malformed { .. } => words(&["flip"]),
        WorldRequest::Make { geometry, fixed, at } => {
            let (name, sizes) = match geometry {
                Geometry::Sphere { radius } => ("sph", vec![*radius]),
                Geometry::Cylinder { radius, height } => ("cyl", vec![*radius, *height]),
                Geometry::Box { size } => ("box", size.to_vec()),
            };
            let name = if *fixed { format!("s{name}") } else { name.to_owned() };
            [words(&["mk", &name]), floats(&sizes), floats(at)].concat()
        }
        WorldRequest::Object { name, ask } => {
            let (verb, rest) = match ask {
                ObjectRequest::Get => ("get", vec![]),
                ObjectRequest::Put(at) => ("set", floats(at)),
                ObjectRequest::Turn(angles) => ("rot", floats(angles)),
                ObjectRequest::TurnTo(rows) => ("rot", floats(rows)),
                ObjectRequest::FromSimulator(numbers) => ("sim", floats(numbers)),
                ObjectRequest::Class(ObjectClass::Obstacle) => ("def", words(&["obs"])),
                ObjectRequest::Class(ObjectClass::Target) => ("def", words(&["tgt"])),
                ObjectRequest::Class(ObjectClass::Ghost) => ("def", words(&["gho"])),
                ObjectRequest::Remove => ("rm", vec![]),
                ObjectRequest::Grab { robot, marker } => ("grab", words(&[robot, marker])),
            };
            [words(&[verb, name]), rest].concat()
        }
    })
}
