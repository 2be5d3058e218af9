//! The import of a URDF: performed once per input, and link orientations equal those of the file.

use mobee_import::{ImportError, ImportOptions, Imported};

use mobee_model::parse_robot;
use std::path::{Path, PathBuf};

const ARM: &str = r#"<robot name="arm">
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="upper"><collision><origin xyz="0.2 0 0"/><geometry><box size="0.3 0.05 0.05"/></geometry></collision></link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.2" rpy="0 0 1.5707963267948966"/>
    <axis xyz="0 1 0"/><limit lower="0.1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/><origin xyz="0.35 0 0" rpy="3.141592653589793 0 0"/></joint>
</robot>"#;

fn options(identity: &str) -> ImportOptions {
    ImportOptions { poses: 200, identity: identity.to_owned(), ..ImportOptions::default() }
}

fn imported(urdf: &Path) -> (Imported, Vec<&'static str>) {
    let mut steps = Vec::new();
    let mut progress = |step, share: f64| {
        assert!((0.0..=1.0).contains(&share), "{step}: {share}");
        if steps.last() != Some(&step) {
            steps.push(step);
        }
    };
    let imported = options("a").import(urdf, &mut progress).unwrap();
    (imported, steps)
}

fn arm() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let urdf = dir.path().join("arm.urdf");
    std::fs::write(&urdf, ARM).unwrap();
    (dir, urdf)
}

#[test]
fn a_robot_file_names_what_it_was_made_from() {
    let (dir, urdf) = arm();
    let (imported, steps) = imported(&urdf);
    assert_eq!(steps.len(), 5, "{steps:?}");
    let xml = dir.path().join("arm.xml");
    assert!(!options("a").made(&xml, &urdf).unwrap(), "there is no file yet");
    let text = imported.file_text(&urdf, &xml).unwrap();
    std::fs::write(&xml, &text).unwrap();
    assert_eq!(parse_robot("arm.xml", &text).unwrap().value.motors, imported.robot.motors);
    assert_eq!(options("a").inputs(&urdf).unwrap(), imported.inputs);
    assert!(options("a").made(&xml, &urdf).unwrap());
    assert!(!options("b").made(&xml, &urdf).unwrap(), "other options");
    std::fs::write(&urdf, ARM.replace("0.3 0.05", "0.31 0.05")).unwrap();
    assert!(!options("a").made(&xml, &urdf).unwrap(), "another shape");
}

#[test]
fn links_are_turned_as_the_file_has_them() {
    let (_dir, urdf) = arm();
    let rotations = options("a").link_rotations(&urdf).unwrap();
    let x = |link: &str| rotations[link] * nalgebra::Vector3::x();
    let z = |link: &str| rotations[link] * nalgebra::Vector3::z();
    assert!((x("upper") - nalgebra::Vector3::y()).norm() < 1e-12, "{}", x("upper"));
    assert!((z("tool") + nalgebra::Vector3::z()).norm() < 1e-12, "{}", z("tool"));
    assert_eq!(rotations.len(), 3);
}

#[test]
fn a_missing_file_is_named_with_a_remedy() {
    let missing = Path::new("nowhere/arm.urdf");
    let error = options("a").import(missing, &mut |_, _| ()).err().unwrap();
    let ImportError::File(error) = error else { panic!("{error}") };
    assert!(error.file() == "nowhere/arm.urdf" && error.remedy().contains("path"), "{error:?}");
}

/// A gripper whose fingers are 4 mm apart at zero and 0.4 mm apart in the SRDF's pose `closed`.
const GRIPPER: &str = r#"<robot name="gripper">
  <link name="left"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <link name="arm"><collision><origin xyz="0 0 0.3"/><geometry><sphere radius="0.01"/></geometry></collision></link>
  <link name="right"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="left"/><child link="arm"/><axis xyz="1 0 0"/><origin xyz="0.024 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="grip" type="prismatic"><parent link="arm"/><child link="right"/><axis xyz="1 0 0"/>
    <limit lower="-0.005" upper="0.2" effort="1" velocity="1"/></joint>
</robot>"#;

#[test]
fn pairs_that_are_near_in_a_named_pose_get_a_clearance_of_their_own() {
    let dir = tempfile::tempdir().unwrap();
    let (urdf, srdf) = (dir.path().join("gripper.urdf"), dir.path().join("gripper.srdf"));
    std::fs::write(&urdf, GRIPPER).unwrap();
    let import = |grip: &str| {
        let state =
            format!("<group_state name=\"closed\" group=\"g\"><joint name=\"grip\" value=\"{grip}\"/></group_state>");
        let group = "<group name=\"g\"><joint name=\"turn\"/><joint name=\"grip\"/></group>";
        std::fs::write(&srdf, format!("<robot name=\"gripper\">{group}{state}</robot>")).unwrap();
        let options = ImportOptions { poses: 0, srdf: Some(srdf.clone()), ..options("a") };
        options.import(&urdf, &mut |_, _| ()).unwrap()
    };
    let near = |grip: &str| import(grip).robot.near;
    assert!(near("0.1").is_empty(), "{:?}", near("0.1"));
    for (grip, mm) in [("0", 3.0), ("-0.0026", 0.0), ("-0.001", 1.0)] {
        let near = near(grip);
        assert!(near.len() == 1 && near[0].clearance * 1e3 == mm, "{grip}: {near:?}");
        assert!(near[0].reason.contains("`closed`"), "{near:?}");
    }
    let told = import("0").decided.join("\n");
    assert!(told.contains("left and right (3 mm: 4.0 mm apart in the SRDF's pose `closed`)"), "{told}");
}
