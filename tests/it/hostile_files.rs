//! Files that nobody should have written: endless, enormous, deep, or no files at all. Each is answered as any other mistake is,
//! within bounds of memory and processor time that a good file needs a small part of, and without a word that would act
//! on a terminal.

use super::common::mobee_in;
use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

/// Address space of the program, kB: several times what it takes to say its version.
const MEMORY_KB: u64 = 400_000;
/// Seconds of a processor, generously; most need a hundredth of one.
const PROCESSOR_S: u64 = 5;

const KATANA: &str = include_str!("../../configs/robots/katana.xml");
const ROBOT: &str = r#"<ZeroPositionKinematicTree version="1.0" robotName="edge"><bodypart name="base">
<motor name="turn"><joint z="1"><link x="0.3" radius="0.02">HERE</link></joint></motor></bodypart></ZeroPositionKinematicTree>"#;
const BEHAVIOR: &str = r#"world.file = "world.xml"
[[robot]]
name = "edge"
model = "robot.xml"
controller = { period_ms = 20, history = 500 }
"#;
const WORLD: &str = r#"<WorldList><object name="post" px="3"><sphere radius="0.1"/></object></WorldList>"#;

/// A folder with a behavior and what it names, all of it good.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    put(&dir, "behavior.toml", BEHAVIOR);
    put(&dir, "world.xml", WORLD);
    put(&dir, "robot.xml", ROBOT.replace("HERE", ""));
    dir
}

fn put(dir: &tempfile::TempDir, name: &str, text: impl AsRef<[u8]>) {
    std::fs::write(dir.path().join(name), text).expect("a file");
}

/// Runs the program within the bounds.
fn bounded(dir: &Path, args: &[&str]) -> Output {
    let program = mobee_in(dir);
    let mut shell = Command::new("sh");
    let script = format!("ulimit -v {MEMORY_KB} && ulimit -t {PROCESSOR_S} && exec \"$0\" \"$@\"");
    shell.args(["-c", &script]).arg(program.get_program()).args(args).current_dir(dir).env("NO_COLOR", "1");
    shell.stdin(std::process::Stdio::null()).output().expect("the shell starts")
}

fn answered(what: &str, dir: &tempfile::TempDir, args: &[&str], codes: &[i32]) -> String {
    let out = bounded(dir.path(), args);
    let said = super::common::said(&out);
    let start: String = said.chars().take(600).collect();
    let code = out.status.code();
    assert!(code.is_some_and(|c| codes.contains(&c)), "{what}: {:?}, not {codes:?}: {start}", out.status);
    assert!(!said.contains("panicked"), "{what}: {start}");
    assert!(said.len() < 60_000, "{what}: {} bytes are said: {start}", said.len());
    assert!(!said.contains(|c: char| c != '\n' && mobee_model::is_hidden(c)), "{what}: a hidden character: {start:?}");
    if code == Some(2) {
        assert!(said.contains("help"), "{what}: a remedy: {start}");
    }
    said
}

/// A file in the place of a good one: what it is, its name, its text, what is asked, and the codes that may be answered.
type Text = (&'static str, &'static str, String, &'static [&'static str], &'static [i32]);

fn texts() -> Vec<Text> {
    let info: &[&str] = &["model", "info", "robot.xml"];
    let check: &[&str] = &["check", "behavior.toml"];
    let convert: &[&str] = &["model", "convert", "robot.urdf", "out.xml"];
    let robot = |inner: &str| ROBOT.replace("HERE", inner);
    let world = |inner: &str| format!("<WorldList>{inner}</WorldList>");
    let urdf = |inner: &str| format!("<robot name=\"r\">{inner}</robot>");
    let numbered = |n: usize, each: fn(usize) -> String| {
        (0..n).fold(String::new(), |mut s, i| {
            let _ = write!(s, "{}", each(i));
            s
        })
    };
    vec![
        (
            "nested elements",
            "robot.xml",
            robot(&("<link x='1'>".repeat(200_000) + &"</link>".repeat(200_000))),
            info,
            &[2],
        ),
        ("shapes in one node", "robot.xml", robot(&"<sphere radius=\"0.01\"/>".repeat(400_000)), info, &[2]),
        ("links side by side", "robot.xml", robot(&"<link x=\"0.01\" radius=\"0.01\"/>".repeat(4000)), info, &[2]),
        (
            "pairs of shapes",
            "robot.xml",
            robot(&"<link x=\"0.01\"><link x=\"0.01\" radius=\"0.01\"/></link>".repeat(900)),
            check,
            &[0, 2],
        ),
        (
            "a name of 12 MB",
            "robot.xml",
            KATANA.replace("robotName=\"katana\"", &format!("robotName=\"{}\"", "k".repeat(12 << 20))),
            info,
            &[2],
        ),
        (
            "a mistake behind 70,000 columns",
            "robot.xml",
            robot(&("<!-- ".to_owned() + &"x".repeat(70_000) + " --><link x='no'/>")),
            info,
            &[2],
        ),
        ("a model of 17 MiB", "robot.xml", KATANA.to_owned() + &" ".repeat(17 << 20), info, &[2]),
        (
            "a terminal's escape",
            "robot.xml",
            KATANA.replace("robotName=\"katana\"", "robotName=\"&#x1b;[31mred\""),
            info,
            &[2],
        ),
        (
            "an escape that is not even a reference",
            "robot.xml",
            KATANA.replace("robotName=\"katana\"", "robotName=\"\u{1b}[31mred\" no"),
            info,
            &[2],
        ),
        ("writing from right to left", "robot.xml", KATANA.replace("motor1_pan", "motor\u{202e}"), info, &[2]),
        ("a forged line", "robot.xml", KATANA.replace("motor1_pan", "motor&#10;all is well"), info, &[2]),
        ("a radius that vanishes", "robot.xml", robot("<sphere radius='1e-320'/>"), info, &[2]),
        ("a motor's index below 0", "robot.xml", KATANA.replace("idx=\"4\"", "idx=\"-3\""), info, &[2]),
        (
            "entities of entities",
            "robot.xml",
            "<!DOCTYPE l [<!ENTITY a \"aa\"><!ENTITY b \"&a;&a;\">]>".to_owned()
                + &KATANA.replace("\"katana\"", "\"&b;\""),
            info,
            &[2],
        ),
        (
            "200,000 objects",
            "world.xml",
            world(&"<object px=\"5\"><sphere radius=\"0.01\"/></object>".repeat(200_000)),
            check,
            &[2],
        ),
        (
            "the most objects",
            "world.xml",
            world(&numbered(10_000, |i| {
                format!("<object px=\"{}\" py=\"9\"><sphere radius=\"0.01\"/></object>", i + 5)
            })),
            check,
            &[0],
        ),
        (
            "shapes in one object",
            "world.xml",
            world(&format!("<object px=\"5\">{}</object>", "<sphere radius=\"0.01\"/>".repeat(300_000))),
            check,
            &[2],
        ),
        (
            "strange attributes",
            "world.xml",
            world(&numbered(150_000, |i| format!("<object px=\"5\" a{i}=\"\"/>"))),
            check,
            &[2],
        ),
        ("a text of 2 MiB", "behavior.toml", format!("{BEHAVIOR}name = \"{}\"", "x".repeat(2 << 20)), check, &[2]),
        (
            "a text of almost 1 MiB",
            "behavior.toml",
            format!("name = \"{}\"\n{BEHAVIOR}", "x".repeat(1_040_000)),
            check,
            &[2],
        ),
        ("170,000 unknown keys", "behavior.toml", numbered(100_000, |i| format!("k{i}=1\n")) + BEHAVIOR, check, &[2]),
        (
            "numbers that are none",
            "behavior.toml",
            format!("a = [{}]\n{BEHAVIOR}", "nan,".repeat(200_000)),
            check,
            &[2],
        ),
        ("many brackets", "behavior.toml", format!("a = {}", "[".repeat(500_000)), check, &[2]),
        ("many tables", "behavior.toml", "[a]\n".repeat(200_000), check, &[2]),
        (
            "many robots",
            "behavior.toml",
            "world.file = \"world.xml\"\n".to_owned()
                + &BEHAVIOR.replace("world.file = \"world.xml\"\n", "").repeat(5_000),
            check,
            &[2],
        ),
        (
            "a mistake behind 70,000 columns",
            "behavior.toml",
            format!("name = {{ a = \"{}\", b = }}\n", "x".repeat(70_000)),
            check,
            &[2],
        ),
        ("an escape in a name", "behavior.toml", BEHAVIOR.replace("\"edge\"", "\"\\u001b[31mred\""), check, &[2]),
        ("an escape in a key", "behavior.toml", format!("\"\\u001b[2J\" = 1\n{BEHAVIOR}"), check, &[2]),
        ("an escape in the text", "behavior.toml", format!("# \u{1b}[2J\n\u{1b}[31m = 1\n{BEHAVIOR}"), check, &[2]),
        ("a forged line in a name", "behavior.toml", BEHAVIOR.replace("\"edge\"", "\"a\\nready to run\""), check, &[2]),
        (
            "the file itself, many times",
            "behavior.toml",
            format!("include = [{}]\n", "\"other.toml\",".repeat(5000)),
            check,
            &[2],
        ),
        (
            "links in a row",
            "robot.urdf",
            urdf(
                &(numbered(20_000, |i| format!("<link name=\"l{i}\"/>"))
                    + &numbered(19_999, |i| {
                        format!(
                            "<joint name=\"j{i}\" type=\"fixed\"><parent link=\"l{i}\"/><child link=\"l{}\"/></joint>",
                            i + 1
                        )
                    })),
            ),
            convert,
            &[2],
        ),
        ("nested URDF", "robot.urdf", "<x>".repeat(300_000), convert, &[2]),
        (
            "collision shapes",
            "robot.urdf",
            urdf(&format!(
                "<link name=\"a\">{}</link>",
                "<collision><geometry><sphere radius=\"1\"/></geometry></collision>".repeat(50_000)
            )),
            convert,
            &[2],
        ),
        (
            "a mesh many times",
            "robot.urdf",
            urdf(&format!(
                "<link name=\"a\">{}</link>",
                "<collision><geometry><mesh filename=\"big.stl\"/></geometry></collision>".repeat(4_000)
            )),
            convert,
            &[2],
        ),
        ("an escape in a link", "robot.urdf", urdf("<link name=\"a&#x9b;31m\"/>"), convert, &[2]),
    ]
}

#[test]
fn a_text_of_any_kind_is_answered_within_bounds() {
    for (what, file, text, args, codes) in texts() {
        let dir = folder();
        put(&dir, "other.toml", "seed = 1\n");
        // no vertices, and a hole of 40 MB that takes no room on the disk
        std::fs::File::create(dir.path().join("big.stl")).and_then(|f| f.set_len(40 << 20)).expect("a file");
        put(&dir, file, text);
        answered(what, &dir, args, codes);
    }
}

#[test]
fn includes_are_counted_however_they_nest() {
    let dir = folder();
    for i in 0..8 {
        let inner = format!("include = [{}]\n", format!("\"d{}.toml\",", i + 1).repeat(12));
        put(&dir, &format!("d{i}.toml"), if i < 7 { inner } else { "seed = 1\n".into() });
    }
    let said = answered("12 to the 7th includes", &dir, &["check", "d0.toml"], &[2]);
    assert!(said.contains("more than 64 files"), "{said}");
}

/// What is no file: a pipe that nobody writes to, a device without an end, a folder, a circle of links.
#[cfg(unix)]
#[test]
fn what_is_no_file_is_said_to_be_none_at_once() {
    let dir = folder();
    let fifo = Command::new("mkfifo").arg("pipe").current_dir(dir.path()).status().expect("mkfifo");
    assert!(fifo.success());
    std::os::unix::fs::symlink("circle", dir.path().join("circle")).expect("a link");
    let urdf = |mesh: &str| {
        format!(
            "<robot name=\"r\"><link name=\"a\"><collision><geometry><mesh filename=\"{mesh}\"/></geometry></collision></link></robot>"
        )
    };
    for path in ["pipe", "/dev/zero", "/dev/urandom", "/dev/stdin", ".", "circle"] {
        let replay = BEHAVIOR.to_owned() + &format!("driver = {{ kind = \"replay\", file = \"{path}\" }}\n");
        put(&dir, "include.toml", format!("include = [\"{path}\"]\n"));
        put(&dir, "model.toml", BEHAVIOR.replace("robot.xml", path));
        put(&dir, "world.toml", BEHAVIOR.replace("world.xml", path));
        put(&dir, "replay.toml", replay);
        put(&dir, "mesh.urdf", urdf(path));
        for args in [
            &["check", path][..],
            &["config", "show", path],
            &["model", "info", path],
            &["model", "convert", path, "out.xml"],
            &["model", "convert", "mesh.urdf", "out.xml"],
            &["model", "eval", "--robot", "robot.xml", "--poses", path, "--out", "tables"],
            &["check", "include.toml"],
            &["check", "model.toml"],
            &["check", "world.toml"],
            &["check", "replay.toml"],
        ] {
            answered(&format!("{path} for {args:?}"), &dir, args, &[2]);
        }
    }
    std::fs::create_dir(dir.path().join("run")).expect("a folder");
    for file in ["config.json", "journal.jsonl"] {
        std::fs::rename(dir.path().join("pipe"), dir.path().join("run").join(file)).expect("moved");
        for args in [&["check", "run"][..], &["inspect", "run"], &["run", "--resume", "run"], &["replay", "run"]] {
            answered(&format!("a pipe as {file} for {args:?}"), &dir, args, &[2]);
        }
        std::fs::rename(dir.path().join("run").join(file), dir.path().join("pipe")).expect("moved back");
    }
}
