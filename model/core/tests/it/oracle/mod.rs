//! Reads the reference results of the original program.

use mobee_model::Robot;
use std::path::{Path, PathBuf};

/// The shared reference folder, if it is here.
pub fn shared() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let folder = std::env::var_os("MOBEE_SHARED").map_or(beside, PathBuf::from);
    if folder.join("reference/mobee-oracle").is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no shared reference data at {}", folder.display());
    None
}

/// A folder of reference data that ships with the project.
pub fn own_data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data").join(name)
}

/// The rows of a table without its heading.
pub fn table(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    text.lines().skip(1).map(|line| line.split(',').map(str::to_string).collect()).collect()
}

/// The poses of a table with columns `part.motor`, in degrees, as the robot's pose vectors.
pub fn poses(robot: &Robot, path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut lines = text.lines();
    let motors: Vec<Option<usize>> = lines
        .next()
        .expect("a heading")
        .split(',')
        .map(|column| robot.motor_index(column.split_once('.')?.1))
        .collect();
    assert_eq!(motors.iter().flatten().count(), robot.motors.len());
    lines
        .map(|line| {
            let mut q = robot.home();
            for (value, motor) in line.split(',').zip(&motors) {
                if let Some(m) = motor {
                    q[*m] = value.parse::<f64>().expect("a number").to_radians();
                }
            }
            q
        })
        .collect()
}
