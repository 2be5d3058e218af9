//! What the tests share: the program and what it says, the real YARP's place, a private network, and a running `mobee`.

pub mod pictures;

use serde_json::Value;
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

/// What `mobee check` says of a journal in which nothing was broken.
pub const HOLD: &str = "invariants I1-I11, I14, I17-I23, I25-I29, I31, I34 and I35 hold";

/// A private YARP network: a folder with its `yarp.conf`, and a port number for its name server.
pub struct Network {
    dir: tempfile::TempDir,
    pub port: u16,
}

/// A network of its own for each test. Its numbers lie below those that systems give to connections by themselves: a name
/// server hands out the numbers above its own unseen, and a real program does not open where a connection has one.
pub fn network() -> Network {
    let dir = tempfile::tempdir().expect("a folder");
    let first = 11_000 + (std::process::id() % 80) as u16 * 200;
    let free = |n: &u16| (0..100).all(|i| TcpListener::bind((Ipv4Addr::LOCALHOST, n + i)).is_ok());
    let port = (first..30_000).step_by(100).find(free).expect("100 free port numbers");
    std::fs::write(dir.path().join("yarp.conf"), format!("127.0.0.1 {port} yarp\n")).expect("yarp.conf");
    Network { dir, port }
}

impl Network {
    /// The folder, for runs and files of the test.
    pub fn path(&self) -> &Path {
        self.dir.path()
    }

    /// A command within this network.
    pub fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        command.env("YARP_CONFIG_HOME", self.path()).env_remove("YARP_NAMESPACE").env_remove("YARP_PORT_PREFIX");
        command
    }
}

/// The real YARP, where `tests/yarp/install.sh` puts it.
pub struct RealYarp {
    home: PathBuf,
}

impl RealYarp {
    /// `None`, said plainly, where it is not installed.
    pub fn find() -> Option<RealYarp> {
        let home = std::env::var_os("MOBEE_YARP").map(PathBuf::from).or_else(|| {
            let home = std::env::var_os("HOME")?;
            Some(Path::new(&home).join(".cache/mobee/yarp-3.5.0"))
        })?;
        if home.join("build/bin/yarpserver").is_file() {
            return Some(RealYarp { home });
        }
        eprintln!("SKIPPED: the real YARP is not installed; tests/yarp/install.sh installs it");
        None
    }

    /// One of its own programs (`yarp`, `yarpserver`, `yarpdev`).
    pub fn tool(&self, name: &str, network: &Network) -> Command {
        let mut command = network.command(self.home.join("build/bin").join(name));
        command.env("YARP_DATA_DIRS", self.home.join("build/share/yarp"));
        command
    }

    /// Runs one of the C++ programs of `tests/yarp` to its end, at most three minutes, and returns what it said.
    pub fn program(&self, name: &str, network: &Network, args: &[&str]) -> String {
        let mut command = network.command("timeout");
        command.env("YARP_DATA_DIRS", self.home.join("build/share/yarp"));
        command.arg("180").arg(self.home.join("programs").join(name)).args(args);
        let out = command.output().expect("the program starts");
        eprint!("{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8_lossy(&out.stdout).into_owned()
    }
}

/// A program in another process; killed when dropped.
pub struct Process(pub Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The real YARP's name server where it is installed; elsewhere `mobee sim` starts one.
pub fn real_name_server(network: &Network) -> Option<Process> {
    let mut server = RealYarp::find()?.tool("yarpserver", network);
    server.args(["--socket", &network.port.to_string(), "--read"]);
    Some(Process(server.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("yarpserver starts")))
}

/// A `mobee run` in another process.
pub struct Run {
    child: Child,
    out: PathBuf,
    network: PathBuf,
}

fn mobee() -> &'static str {
    env!("CARGO_BIN_EXE_mobee")
}

/// The program, started in this folder, its words without colors.
pub fn mobee_in(folder: &Path) -> Command {
    let mut command = Command::new(mobee());
    command.current_dir(folder).env("NO_COLOR", "1");
    command
}

/// The program in the folder of the project, where the shipped configurations are.
pub fn mobee_here() -> Command {
    mobee_in(Path::new(env!("CARGO_MANIFEST_DIR")))
}

/// What the program says in the project's folder if all goes well.
pub fn answer(args: &[&str]) -> String {
    let out = mobee_here().args(args).output().expect("mobee starts");
    assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8_lossy(&out.stdout).into_owned()
}

/// What it complains of, with exit code 2; line breaks and frames are taken out.
pub fn complaint(args: &[&str]) -> String {
    let out = mobee_here().args(args).output().expect("mobee starts");
    let told = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(2), "{args:?}: {told}");
    assert!(told.contains("help: "), "{told}");
    told.split_whitespace().filter(|w| *w != "│").collect::<Vec<_>>().join(" ")
}

/// A robot file with two motors, for behaviors that are written in a test.
pub const EDGE: &str = r#"<ZeroPositionKinematicTree version="1.0" robotName="edge">
  <bodypart name="base">
    <link z="0.2" radius="0.03">
      <motor name="M_first" minPos="-30" maxPos="60" home="0">
        <joint z="1" minPos="-30" maxPos="60"><link x="0.3" radius="0.02">
          <motor name="M_second" minPos="-30" maxPos="30"><joint z="1"><link x="0.2" radius="0.02"/></joint></motor>
        </link></joint>
      </motor>
    </link>
  </bodypart>
</ZeroPositionKinematicTree>"#;

/// All that a program said, on both of its outputs.
pub fn said(out: &Output) -> String {
    String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr)
}

/// A path as an argument.
pub fn text(path: &Path) -> &str {
    path.to_str().expect("a readable path")
}

/// The settings of the map of reach.toml with poses three centimeters apart, written into a folder.
pub fn thin_map(folder: &Path) -> PathBuf {
    thinned("reach.toml", folder)
}

/// The settings of a map that ships with poses three centimeters apart, written into a folder.
pub fn thinned(file: &str, folder: &Path) -> PathBuf {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let text = std::fs::read_to_string(configs.join("roadmaps").join(file)).expect("settings");
    let text =
        text.replace("\"../", &format!("\"{}/", configs.display())).replace("spacing_mm = 10", "spacing_mm = 30");
    let map = folder.join(format!("thin-{file}"));
    std::fs::write(&map, text).expect("written");
    map
}

/// The events of a journal, as far as its lines are whole.
pub fn events(run: &Path) -> Vec<Value> {
    let journal = std::fs::read_to_string(run.join("journal.jsonl")).unwrap_or_default();
    let line = |l: &str| serde_json::from_str::<Value>(l).ok().map(|v| v["event"].clone());
    journal.lines().filter_map(line).filter(|e| !e.is_null()).collect()
}

impl Run {
    /// Starts it, patient with old readings.
    pub fn start(network: &Network, config: &str) -> Run {
        Run::of(network, config, "icub")
    }

    /// Starts it with another robot than the iCub.
    pub fn of(network: &Network, config: &str, robot: &str) -> Run {
        Run::with(network, config, robot, &[])
    }

    /// Starts it with settings of its own.
    pub fn with(network: &Network, config: &str, robot: &str, set: &[&str]) -> Run {
        // The machine may take all processors away for half a second: what is not about stale readings shall not see them.
        let patient = format!("robot.{robot}.controller.stale_ms=3000");
        let out = network.path().join("run");
        let child = network
            .command(mobee())
            .args(["run", config, "--json", "--set", &patient])
            .args(set.iter().flat_map(|s| ["--set", s]))
            .arg("--out")
            .arg(&out)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .stdout(Stdio::null())
            .stderr(Stdio::inherit())
            .spawn()
            .expect("mobee starts");
        Run { child, out, network: network.path().to_owned() }
    }

    /// Waits until a port answers: `mobee yarp exists` tries for this long by itself.
    pub fn wait_for_port(&mut self, port: &str) {
        let waited = Command::new(mobee())
            .args(["yarp", "exists", "--wait", "60", port])
            .env("YARP_CONFIG_HOME", &self.network)
            .status()
            .expect("mobee starts");
        assert!(waited.success(), "no port {port}; the run says {:?}", self.child.try_wait());
    }

    /// Ends it in order, and returns what `mobee check` says of it.
    pub fn end(&mut self) -> String {
        let kill = Command::new("kill").args(["-INT", &self.child.id().to_string()]).status().expect("kill");
        assert!(kill.success());
        self.wait()
    }

    /// Waits for its own end, and returns what `mobee check` says of it.
    pub fn wait(&mut self) -> String {
        let status = self.child.wait().expect("an end");
        assert!(status.success(), "the run ended with {status}");
        let checked = Command::new(mobee()).arg("check").arg(&self.out).output().expect("mobee starts");
        String::from_utf8_lossy(&checked.stdout).into_owned()
    }

    /// Open file descriptors and resident memory in kB.
    pub fn used(&self) -> (usize, usize) {
        let of = |what: &str| PathBuf::from(format!("/proc/{}/{what}", self.child.id()));
        let files = std::fs::read_dir(of("fd")).map_or(0, Iterator::count);
        let status = std::fs::read_to_string(of("status")).unwrap_or_default();
        let resident = status.lines().find_map(|l| l.strip_prefix("VmRSS:")?.split_whitespace().next()?.parse().ok());
        (files, resident.unwrap_or(0))
    }

    /// The summary that it left.
    pub fn summary(&self) -> Value {
        let text = std::fs::read_to_string(self.out.join("summary.json")).expect("a summary");
        serde_json::from_str(&text).expect("JSON")
    }
}

/// A `mobee sim` in another process; ends when dropped.
pub struct Sim(Child);

/// Serves the simulated robot of a configuration under this prefix.
pub fn sim(network: &Network, config: &str, prefix: &str, set: &[String]) -> Sim {
    let mut command = network.command(mobee());
    command.args(["sim", config, "--prefix", prefix]).current_dir(env!("CARGO_MANIFEST_DIR"));
    command.args(set.iter().flat_map(|s| ["--set", s])).stdout(Stdio::null());
    let sim = Sim(command.spawn().expect("mobee starts"));
    let port = format!("{prefix}/torso/rpc:i");
    let waited = network.command(mobee()).args(["yarp", "exists", "--wait", "60", &port]).status();
    assert!(waited.expect("mobee starts").success(), "no port {port}");
    sim
}

impl Drop for Sim {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
