//! External checker or planner in its own process, and the description of a scene that it needs; for benchmarks against
//! peers.

use mobee_model::{JointMotion, Scene, Shape};
use nalgebra::Isometry3;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// A folder for data between benchmark and peer; removed on drop.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new() -> Folder {
        let folder = std::env::temp_dir().join(format!("mobee-peer-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        Folder(folder)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    pub fn write(&self, name: &str, bytes: Vec<u8>) {
        std::fs::write(self.0.join(name), bytes).expect("it is written");
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).ok();
    }
}

/// An external program that replies line by line.
pub struct Peer {
    child: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    /// Words of its first line, which starts with `ready`.
    pub ready: Vec<String>,
}

impl Peer {
    /// Starts the program with the folder as its last argument, and waits until it is ready.
    pub fn start(words: &[String], folder: &Folder) -> Peer {
        let (program, rest) = words.split_first().expect("a peer's command");
        let mut command = Command::new(program);
        command.args(rest).arg(folder.path()).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("the peer starts");
        let to = child.stdin.take().expect("its input");
        let from = child.stdout.take().expect("its output");
        let mut peer = Peer { child, to, from: BufReader::new(from), ready: Vec::new() };
        peer.ready = peer.line();
        peer
    }

    fn line(&mut self) -> Vec<String> {
        let mut line = String::new();
        self.from.read_line(&mut line).expect("its reply");
        line.split_whitespace().map(str::to_owned).collect()
    }

    /// Requests one more round, and returns the numbers of the peer's reply.
    pub fn ask(&mut self) -> Vec<f64> {
        writeln!(self.to).expect("the peer reads");
        self.line().iter().map(|n| n.parse().expect("a number")).collect()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

/// Joints, shapes and pairs of a scene of one robot, in the format of `coal_scene.py`.
pub fn described(scene: &Scene) -> Value {
    let pose = |p: &Isometry3<f64>| {
        let (t, r) = (p.translation.vector, p.rotation.coords);
        json!([t.x, t.y, t.z, r.x, r.y, r.z, r.w])
    };
    let skeleton = &scene.skeletons()[0];
    let mut frames = vec![json!({ "parent": null, "at": pose(&skeleton.base) })];
    frames.extend(skeleton.joints.iter().map(|j| {
        let motion = if matches!(j.motion, JointMotion::Turn) { "turn" } else { "slide" };
        json!({
            "parent": j.parent, "at": pose(&j.at), "axis": j.axis.as_slice(), "motion": motion,
            "motor": j.motor, "gain": j.gain, "start": j.min - j.limits.0 * j.gain,
        })
    }));
    frames.push(json!({ "parent": null, "at": pose(&Isometry3::identity()) }));
    let shapes = scene.colliders().map(|c| {
        let (kind, sizes) = match c.shape {
            Shape::Sphere { radius } => ("sphere", vec![radius]),
            Shape::Capsule { radius, height } => ("capsule", vec![radius, height]),
            Shape::Cylinder { radius, height } => ("cylinder", vec![radius, height]),
            Shape::Box { size } => ("box", size.iter().copied().collect()),
        };
        json!({ "kind": kind, "sizes": sizes, "frame": c.frame, "pose": pose(&c.pose) })
    });
    json!({ "frames": frames, "shapes": shapes.collect::<Vec<_>>(), "pairs": scene.pairs() })
}
