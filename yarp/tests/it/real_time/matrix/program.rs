//! The real YARP's programs as child processes.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use tempfile::TempDir;
use tokio::sync::mpsc;

/// Where the real programs are, and the private network that they are run in.
pub struct Tools {
    home: PathBuf,
    dir: TempDir,
    number: u16,
}

impl Tools {
    /// The installed programs, if there are any.
    pub fn find() -> Option<Tools> {
        let default = || Some(PathBuf::from(std::env::var_os("HOME")?).join(".cache/mobee/yarp-3.5.0"));
        let home = std::env::var_os("MOBEE_YARP").map(PathBuf::from).or_else(default)?.join("build");
        home.join("bin/yarpserver").is_file().then(|| Tools { home, dir: TempDir::new().unwrap(), number: 0 })
    }

    /// The same programs in another network, whose name server is at this number.
    pub fn network(&self, number: u16) -> Tools {
        let dir = TempDir::new().unwrap();
        std::fs::write(dir.path().join("yarp.conf"), format!("127.0.0.1 {number} yarp\n")).unwrap();
        Tools { home: self.home.clone(), dir, number }
    }

    /// With the key that all programs of the network have to know.
    pub fn with_key(self, key: &str) -> Tools {
        std::fs::write(self.dir.path().join("auth.conf"), format!("[AUTH]\nkey {key}\n")).unwrap();
        self
    }

    pub fn number(&self) -> u16 {
        self.number
    }

    pub fn address(&self) -> SocketAddr {
        SocketAddr::from((Ipv4Addr::LOCALHOST, self.number))
    }

    /// Starts a program; it is killed when dropped.
    pub fn start(&self, program: &str, args: &[&str]) -> Program {
        let mut child = Command::new(self.home.join("bin").join(program))
            .args(args)
            .env("YARP_CONFIG_HOME", self.dir.path())
            .env("YARP_DATA_DIRS", self.home.join("share/yarp"))
            .env_remove("YARP_NAMESPACE")
            .env_remove("YARP_PORT_PREFIX")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (send, lines) = mpsc::channel(4096);
        let input = child.stdin.take();
        forward(child.stdout.take().unwrap(), send.clone());
        forward(child.stderr.take().unwrap(), send);
        Program { child, input, lines, said: Vec::new() }
    }

    /// Runs `yarp ARGS...` to its end; what it said, and whether it was successful.
    pub async fn yarp(&self, args: &[&str]) -> Result<(bool, String), String> {
        let mut program = self.start("yarp", args);
        program.close_input();
        super::within(&format!("yarp {}", args.join(" ")), program.line(|_| false)).await?;
        let ok = program.child.wait().is_ok_and(|status| status.success());
        Ok((ok, program.said()))
    }

    /// The same, where anything but success is an error.
    pub async fn succeed(&self, args: &[&str]) -> Result<String, String> {
        match self.yarp(args).await? {
            (true, said) => Ok(said),
            (false, said) => Err(format!("yarp {}: {said}", args.join(" "))),
        }
    }
}

/// A running program.
pub struct Program {
    child: Child,
    input: Option<ChildStdin>,
    lines: mpsc::Receiver<String>,
    said: Vec<String>,
}

impl Program {
    /// Waits for a line; `None` when the program ended before.
    pub async fn line(&mut self, wanted: impl Fn(&str) -> bool) -> Option<String> {
        while let Some(line) = self.lines.recv().await {
            self.said.push(line.clone());
            if wanted(&line) {
                return Some(line);
            }
        }
        None
    }

    /// Types a line.
    pub fn type_line(&mut self, line: &str) -> Result<(), String> {
        let input = self.input.as_mut().ok_or("its input is closed")?;
        input.write_all(format!("{line}\n").as_bytes()).and_then(|()| input.flush()).map_err(|e| e.to_string())
    }

    pub fn close_input(&mut self) {
        self.input = None;
    }

    /// Everything that it said so far.
    pub fn said(&mut self) -> String {
        while let Ok(line) = self.lines.try_recv() {
            self.said.push(line);
        }
        self.said.join("\n")
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn forward(from: impl Read + Send + 'static, to: mpsc::Sender<String>) {
    std::thread::spawn(move || {
        for line in BufReader::new(from).lines().map_while(Result::ok) {
            if to.blocking_send(line).is_err() {
                return;
            }
        }
    });
}
