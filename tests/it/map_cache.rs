//! A map that a behavior names by its settings is one and the same, whether this run builds it or finds it in the cache; and what is in the
//! cache is used only if it is what these settings describe.

use super::common::{events, mobee_in, said, text, thin_map};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

/// A folder with a small table map of each arm, and a behavior that drives on the right one.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let settings = |side: &str| {
        let motors: Vec<String> =
            ["shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_prosup", "wrist_pitch", "wrist_yaw"]
                .iter()
                .map(|motor| format!("\"{side}_{motor}\""))
                .collect();
        format!(
            "seed = 1\nrobot = \"{0}/robots/icub.xml\"\nworld = \"{0}/worlds/table.xml\"\nmotors = [\"torso\", {1}]\n\
             hand = \"{side}_hand_dh_frame\"\ntable = {{ height_m = -0.15, x_m = [-0.80, 0.50], y_m = [-0.70, 0.90] }}\n\
             offset_mm = 80\nspacing_mm = 10\nvertices = 30\nneighbors = 6\nclearance_mm = 12\n",
            configs.display(),
            motors.join(", ")
        )
    };
    let behavior = format!(
        "world.file = \"{0}/worlds/table.xml\"\n[[robot]]\nname = \"icub\"\nmodel = \"{0}/robots/icub.xml\"\n\
         controller = {{ period_ms = 20, history = 6000 }}\ndriver = {{ kind = \"sim\", profile = \"ideal\" }}\n\
         agent = {{ kind = \"roadmap\", map = \"right.toml\", goals = [\"5\", \"0\"], speed = 0.3, \
         poses = [{{ name = \"home\", q_deg = {{ r_elbow = 60 }} }}], edges = [[\"home\", \"0\"]] }}\n",
        configs.display()
    );
    for (name, text) in [("right.toml", settings("r")), ("left.toml", settings("l")), ("tour.toml", behavior)] {
        fs::write(dir.path().join(name), text).expect("a file");
    }
    dir
}

fn run(dir: &Path, out: &str) -> (Output, String) {
    let done = mobee_in(dir)
        .env("XDG_CACHE_HOME", dir.join("cache"))
        .args(["run", "tour.toml", "--for", "20", "--no-record", "--out", out])
        .output()
        .expect("mobee starts");
    assert!(done.status.success(), "{}", said(&done));
    let summary = fs::read_to_string(dir.join(out).join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
    (done, summary["journal_hash"].as_str().expect("a hash").to_owned())
}

fn cached(dir: &Path) -> PathBuf {
    let maps: Vec<PathBuf> =
        dir.join("cache/mobee/maps").read_dir().expect("a cache").map(|e| e.expect("an entry").path()).collect();
    assert_eq!(maps.len(), 1);
    maps[0].clone()
}

/// The shipped behavior on a thin map; it plans by distances, and so by the last digit of each pose.
#[test]
fn the_run_that_builds_its_map_is_the_run_that_finds_it() {
    let dir = tempfile::tempdir().expect("a folder");
    let map = format!("robot.icub.agent.map={:?}", thin_map(dir.path()));
    let reach = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/reach.toml");
    let mobee = |args: &[&str]| {
        let done = mobee_in(dir.path()).env("XDG_CACHE_HOME", dir.path().join("cache")).args(args).output();
        let done = done.expect("mobee starts");
        assert!(done.status.success(), "{}", said(&done));
        done
    };
    let journal = |out: &str| {
        let done = mobee(&["run", text(&reach), "--for", "12", "--no-record", "--set", &map, "--out", out]);
        assert!(!said(&done).contains("in the cache is not used"), "{}", said(&done));
        events(&dir.path().join(out))
    };
    assert!(journal("first") == journal("second"), "equal, event by event");
    mobee(&["replay", "first"]);
}

#[test]
fn a_map_in_the_cache_that_is_not_what_was_built_is_built_again() {
    let dir = folder();
    let (_, hash) = run(dir.path(), "first");
    let kept = cached(dir.path());
    let whole = fs::read_to_string(&kept).expect("a map");
    let other = dir.path().join("left.json");
    let build = ["roadmap", "build", "left.toml", "--out", text(&other)];
    let built = mobee_in(dir.path()).args(build).output().expect("mobee starts");
    assert!(built.status.success(), "{}", said(&built));
    let without_edges: Vec<&str> =
        whole.lines().filter(|l| !l.contains("\"from\": 1,") && !l.contains("\"from\":1,")).collect();
    let damages = [
        ("another arm's map", fs::read_to_string(&other).expect("a map")),
        ("without the first line, as older programs wrote it", whole.split_once('\n').expect("two lines").1.to_owned()),
        ("another digit", whole.replacen("\"at_m\"", "\"at_m\" ", 1)),
        ("another version's", whole.replacen("\"inputs\":\"", "\"inputs\":\"0", 1)),
        ("cut in half", whole[..whole.len() / 2].to_owned()),
        ("empty", String::new()),
        ("edges missing", without_edges.join("\n")),
    ];
    for (i, (what, text)) in damages.iter().enumerate() {
        assert_ne!(*text, whole, "{what}");
        fs::write(&kept, text).expect("written");
        let (out, again) = run(dir.path(), &format!("run-{i}"));
        assert_eq!(hash, again, "{what}");
        assert!(said(&out).contains("built again") && said(&out).contains(text_of(&kept)), "{what}: {}", said(&out));
        assert_eq!(fs::read_to_string(&kept).expect("a map"), whole, "{what}: it is put right");
    }
}

fn text_of(path: &Path) -> &str {
    path.file_name().and_then(|name| name.to_str()).expect("a name")
}
