//! `mobee roadmap` as a user meets it: a map from nothing, interrupted or not; what blocks it; a plan; and files that are
//! none, refused with place and remedy.

use super::common::{answer, complaint, text};
use mobee::compose::maps::read_settings;
use mobee_model::load_robot;
use mobee_planning::map_file::{MapFile, TriedMotion};
use mobee_planning::roadmap::Roadmap;
use std::path::{Path, PathBuf};

const ROBOT: &str = "configs/robots/icub.xml";
const WORLD: &str = "configs/worlds/table.xml";
const SETTINGS: &str = "configs/roadmaps/table.toml";

fn build(out: &Path, more: &[&str]) -> String {
    let args = ["roadmap", "build", SETTINGS, "--set", "vertices=100", "--out", text(out)];
    answer(&[&args[..], more].concat())
}

#[test]
fn every_file_of_settings_is_one_for_its_robot() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/roadmaps");
    let files: Vec<PathBuf> =
        std::fs::read_dir(folder).expect("the folder").map(|e| e.expect("an entry").path()).collect();
    assert!(!files.is_empty());
    for file in files {
        let (settings, _) = read_settings(&file, &[]).unwrap_or_else(|e| panic!("{}: {e:?}", file.display()));
        let robot = load_robot(&settings.robot).expect("its robot").value;
        settings.plan(&robot).unwrap_or_else(|e| panic!("{}: {e:?}", file.display()));
    }
}

#[test]
fn a_map_is_built_interrupted_resumed_validated_planned_on_merged_and_shown() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (whole, cut) = (at("whole.json"), at("cut.json"));
    let told = build(&whole, &[]);
    assert!(told.contains("100 vertices") && told.contains("spacing: median"), "{told}");
    let map = MapFile::parse(&std::fs::read_to_string(&whole).expect("the map")).expect("a map");
    assert!(map.vertices.len() == 100 && map.edges.len() >= 100 * 8, "{} edges", map.edges.len());

    // stopped, torn in the middle of a line, and resumed, it is the same
    assert!(build(&cut, &["--stop-after", "70"]).contains("the same command goes on") && !cut.exists());
    let part = at("cut.json.part");
    let torn = std::fs::read(&part).expect("what was found");
    std::fs::write(&part, &torn[..torn.len() - 3]).expect("written");
    build(&cut, &[]);
    assert!(!part.exists());
    assert_eq!(std::fs::read(&cut).expect("a map"), std::fs::read(&whole).expect("a map"));

    let place = ["--robot", ROBOT, "--world", WORLD];
    let told = answer(&[&["roadmap", "validate", text(&whole)][..], &place].concat());
    assert!(told.contains("directed edges") && told.contains(" free"), "{told}");
    let told = answer(&["roadmap", "info", text(&whole)]);
    assert!(told.contains("certified in world") && told.contains("at 12.0 mm"), "{told}");
    let told = answer(&["roadmap", "path", text(&whole), "0", "99", "--robot", ROBOT]);
    assert!(told.starts_with("0  hand at ") && told.contains("\n99  hand at "), "{told}");

    // the one that was validated and the one that was not, in either order
    let (ab, other_way) = (at("ab.json"), at("other_way.json"));
    answer(&["roadmap", "merge", text(&whole), text(&cut), "--out", text(&ab)]);
    answer(&["roadmap", "merge", text(&cut), text(&whole), "--out", text(&other_way)]);
    assert_eq!(std::fs::read(&ab).expect("a map"), std::fs::read(&other_way).expect("a map"));
    let merged = MapFile::parse(&std::fs::read_to_string(&ab).expect("the map")).expect("a map");
    assert!(merged.vertices.len() == 100 && merged.certified.is_some());

    let picture = at("map.rrd");
    answer(&[&["roadmap", "view", text(&whole), "--out", text(&picture)][..], &place].concat());
    assert!(picture.metadata().expect("a recording").len() > 20_000);

    // an agent takes it by its name, drives on it, and leaves a map of its own that can be merged with it
    let behavior = at("tour.toml");
    let root = env!("CARGO_MANIFEST_DIR");
    let tour = format!(
        "[world]\nfile = \"{root}/{WORLD}\"\n[[robot]]\nname = \"icub\"\nmodel = \"{root}/{ROBOT}\"\n\
         controller = {{ period_ms = 20, history = 6000 }}\ndriver = {{ kind = \"sim\", profile = \"ideal\" }}\n\
         agent = {{ kind = \"roadmap\", map = \"whole.json\", goals = [\"5\", \"0\"], speed = 0.3, \
         poses = [{{ name = \"home\", q_deg = {{ r_elbow = 60 }} }}], edges = [[\"home\", \"0\"]] }}\n"
    );
    std::fs::write(&behavior, tour).expect("written");
    let run = at("run");
    answer(&["run", text(&behavior), "--for", "60", "--no-record", "--json", "--out", text(&run)]);
    let learned = run.join("roadmap-icub.json");
    let map = MapFile::parse(&std::fs::read_to_string(&learned).expect("the map")).expect("a map");
    assert!(map.tried.iter().any(|t| t.reached && t.run.as_deref() == Some("run")), "{:?}", map.tried);
    answer(&["roadmap", "merge", text(&whole), text(&learned), "--out", text(&at("both.json"))]);

    // nothing is written over unawares
    assert!(complaint(&["roadmap", "build", SETTINGS, "--out", text(&whole)]).contains("exists already"));
}

#[test]
fn parts_that_no_way_joins_are_joined_and_what_was_known_stays() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let (torn, better, pruned) = (at("torn.json"), at("better.json"), at("pruned.json"));
    build(&torn, &[]);
    let read = |path: &Path| MapFile::parse(&std::fs::read_to_string(path).expect("the map")).expect("a map");
    let mut map = read(&torn);
    map.edges.retain(|e| (e.from < 50) == (e.to < 50));
    map.vertices[3].name = Some("start".into());
    map.tried.push(TriedMotion { run: Some("an earlier one".into()), from: 3, to: 4, reached: true, cause: None });
    std::fs::write(&torn, map.text()).expect("written");
    let robot = load_robot(Path::new(ROBOT)).expect("the robot").value;
    let islands = |file: &MapFile| Roadmap::of_file(file, &robot).expect("of the robot").islands().len();
    assert!(islands(&map) > 1);

    let improve = ["roadmap", "improve", text(&torn), "--robot", ROBOT, "--world", WORLD, "--out"];
    let told = answer(&[&improve[..], &[text(&better)]].concat());
    assert!(told.starts_with("parts of the map: "), "{told}");
    let joined = read(&better);
    assert!(islands(&joined) < islands(&map), "{told}");
    assert_eq!((&joined.tried, &joined.hand, &joined.motors), (&map.tried, &map.hand, &map.motors));
    assert_eq!(joined.vertices[..100], map.vertices[..]);
    assert!(joined.certified.is_some() && joined.edges.iter().all(|e| e.verdict.is_some()));
    assert_eq!(read(&torn), map, "another file was asked for");

    let told = answer(&[&improve[..], &[text(&pruned), "--grow", "5", "--prune"]].concat());
    assert!(told.contains("poses added where the map was thin: 5"), "{told}");
    let kept = read(&pruned);
    assert!(islands(&kept) == 1 && kept.vertices.iter().any(|v| v.name.as_deref() == Some("start")), "{told}");
    assert_eq!(kept.tried.len(), 1);

    assert!(complaint(&[&improve[..], &[text(&better)]].concat()).contains("exists already"));
    let katana = ["roadmap", "improve", text(&torn), "--robot", "configs/robots/katana.xml"];
    assert!(complaint(&katana).contains("the map is one of the robot icub, not of katana"));
}

#[test]
fn a_build_goes_on_only_with_the_settings_that_it_began_with() {
    let dir = tempfile::tempdir().expect("a folder");
    let out = dir.path().join("map.json");
    let part = dir.path().join("map.json.part");
    build(&out, &["--stop-after", "55"]);
    let other = ["roadmap", "build", SETTINGS, "--set", "vertices=100", "--set", "seed=2", "--out", text(&out)];
    assert!(complaint(&other).contains("other settings"));
    // a pose that is none, in the third line
    let lines = std::fs::read_to_string(&part).expect("what was found");
    let mut lines: Vec<String> = lines.lines().map(str::to_owned).collect();
    lines[2] = lines[2].replace("\"q\":[", "\"q\":[9.9,");
    std::fs::write(&part, lines.join("\n") + "\n").expect("written");
    let same = ["roadmap", "build", SETTINGS, "--set", "vertices=100", "--out", text(&out)];
    let told = complaint(&same);
    assert!(told.contains(".part:3: this pose is not acceptable"), "{told}");
    assert!(!out.exists(), "nothing is half built");
}

#[test]
fn what_is_no_map_of_this_robot_is_refused_with_its_place() {
    let dir = tempfile::tempdir().expect("a folder");
    let map = dir.path().join("map.json");
    build(&map, &[]);
    let good = std::fs::read_to_string(&map).expect("the map");
    let katana = ["roadmap", "path", text(&map), "0", "1", "--robot", "configs/robots/katana.xml"];
    let told = complaint(&katana);
    assert!(told.contains("the map is one of the robot icub, not of katana") && told.contains("map.json:4:"), "{told}");

    let bad = dir.path().join("bad.json");
    let refused = |text_of: String, words: &str| {
        std::fs::write(&bad, text_of).expect("written");
        let told = complaint(&["roadmap", "info", text(&bad)]);
        assert!(told.contains(words), "{words}: {told}");
    };
    refused(good[..good.len() * 2 / 3].to_owned(), "the file ends in the middle");
    refused(good.replacen("\"version\": 2", "\"version\": 9", 1), "reads versions up to 2");
    refused(good.replacen("\"from\":0,\"to\":", "\"from\":0,\"to\":99", 1), "there is no vertex 99");
    refused(good.replacen("\"id\":1,\"q_rad\":[", "\"id\":1,\"q_rad\":[NaN,", 1), "this is no JSON");
    refused(String::new(), "the file ends in the middle");
    assert!(complaint(&["roadmap", "info", "configs"]).contains("folder"));
    assert!(complaint(&["roadmap", "path", text(&map), "0", "4000", "--robot", ROBOT]).contains("no vertex"));

    let wrong = ["roadmap", "build", SETTINGS, "--out", text(&bad), "--force", "--set", "spacing_mm=-3"];
    assert!(complaint(&wrong).contains("-3 is out of bounds"));
    let wrong = ["roadmap", "build", "configs/behaviors/explore.toml", "--out", text(&bad), "--force"];
    assert!(complaint(&wrong).contains("`table` is missing"));
}

/// What is replaced with `--force` is a file, and never a device, a pipe or a folder.
#[test]
fn only_regular_files_are_replaced() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let map = at("map.json");
    build(&map, &[]);
    let pipe = at("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo").success());
    for other in [pipe.as_path(), dir.path()] {
        let told = complaint(&["roadmap", "merge", text(&map), "--out", text(other), "--force"]);
        assert!(told.contains("not a file"), "{told}");
        assert!(!other.symlink_metadata().expect("still there").is_file());
    }
    answer(&["roadmap", "merge", text(&map), "--out", text(&map), "--force"]);
}
