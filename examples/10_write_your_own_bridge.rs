//! Write a bridge: whoever types moves the robot, and hears in sentences what becomes of it.
//!
//! A bridge lets programs outside take part. It sees robots only through their filtered interface, as every agent does: what it
//! commits is a transaction, which the reflex may take back, and what it may not do is refused, with a reason and a remedy.
//!
//! `echo "move 30 10" | cargo run --release --example 10_write_your_own_bridge`

use mobee::run::{Folder, in_order, run};
use mobee_contract::{
    Answer, Bridge, Commit, CommitId, Filtered, Kind, MotionEnd, Refusal, Registered, Running, Service, Target,
    settings,
};
use std::io::BufRead;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc;

const HELP: &str = "say `move DEG DEG ...` (the robot's first motors), `stop`, `pose` or `quit`";

/// Its settings, as they stand in a configuration file. The doc comments are what `mobee kinds` shows.
#[derive(Clone, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct LinesSettings {
    /// The share of each motor's greatest speed to move at.
    speed: f64,
}

impl Default for LinesSettings {
    fn default() -> LinesSettings {
        LinesSettings { speed: 0.1 }
    }
}

struct Lines(LinesSettings);

// Registering the kind makes `[[bridge]]` with `kind = "lines"` work in configuration files.
inventory::submit! {
    Registered(&Kind::<dyn Bridge> {
        name: "lines",
        doc: "Moves the first robot by what is typed.",
        schema: || schemars::schema_for!(LinesSettings),
        example: |_| Ok(serde_json::json!({})),
        build: |value, _folder| Ok(Arc::new(Lines(settings(value)?))),
    })
}

impl Bridge for Lines {
    fn speed(&self) -> Option<f64> {
        Some(self.0.speed)
    }
}

impl Service for Lines {
    fn name(&self) -> String {
        "lines".into()
    }

    /// One life: it ends when the run does, or when there is no more to read and the last motion has ended.
    fn serve(self: Arc<Self>, running: Arc<dyn Running>, mut until: Answer<()>) -> Answer<Result<(), String>> {
        Box::pin(async move {
            let robot = running.robots().first().cloned().ok_or("there is no robot to move")?;
            let (mut lines, mut typing, mut moving) = (typed(), true, None);
            while typing || moving.is_some() {
                tokio::select! {
                    () = &mut until => break,
                    line = lines.recv(), if typing => match line.as_deref().map(str::trim) {
                        None | Some("quit") => typing = false,
                        Some(line) => println!("{}", self.answer(&robot, line, &mut moving).await),
                    },
                    () = running.sleep_until(running.now() + Duration::from_millis(20)) => {}
                }
                if let Some(end) = moving.and_then(|id| robot.end_of(id)) {
                    moving = None;
                    println!("{}", if end == MotionEnd::Reached { "reached" } else { "failed" });
                }
            }
            Ok(())
        })
    }
}

impl Lines {
    async fn answer(&self, robot: &Arc<dyn Filtered>, line: &str, moving: &mut Option<CommitId>) -> String {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("move") => match words.map(str::parse).collect::<Result<Vec<f64>, _>>() {
                Ok(degrees) => match self.commit(robot, &degrees).await {
                    Ok(id) => {
                        *moving = Some(id);
                        "on its way".into()
                    }
                    Err(refusal) => format!("refused: {refusal}; {}", refusal.remedy()),
                },
                Err(e) => format!("{e}; {HELP}"),
            },
            Some("stop") => {
                robot.stop("lines".into());
                "stopping".into()
            }
            Some("pose") => format!("{:.1?}", robot.latest().q.iter().map(|q| q.to_degrees()).collect::<Vec<_>>()),
            _ => HELP.into(),
        }
    }

    /// Commits a motion, as soon as the filter is open: it opens a moment after the run begins.
    async fn commit(&self, robot: &Arc<dyn Filtered>, degrees: &[f64]) -> Result<CommitId, Refusal> {
        let q = degrees.iter().map(|d| d.to_radians()).collect();
        let target = Target { motors: (0..degrees.len()).collect(), q, speed: self.0.speed };
        let commit = Commit { agent: "lines".into(), target, speeds: None };
        for _ in 0..100 {
            match robot.commit(commit.clone()).await {
                Err(Refusal::NotReady { .. }) => tokio::time::sleep(Duration::from_millis(50)).await,
                verdict => return verdict,
            }
        }
        robot.commit(commit).await
    }
}

/// What is typed, line by line. Reading can't be interrupted, so that a thread does it which nobody waits for.
fn typed() -> mpsc::Receiver<String> {
    let (send, lines) = mpsc::channel(1);
    std::thread::spawn(move || {
        let lines = std::io::stdin().lock().lines();
        lines.map_while(Result::ok).all(|line| send.blocking_send(line).is_ok());
    });
    lines
}

const BEHAVIOR: &str = r#"
clock = "real"
record.enabled = false

[[bridge]]
kind = "lines"
speed = 0.2

[[robot]]
name = "katana"
model = "MODEL"
controller = { period_ms = 20, history = 6000 }
driver = { kind = "sim", profile = "ideal" }
"#;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("lines.toml");
    std::fs::write(
        &file,
        BEHAVIOR.replace("MODEL", concat!(env!("CARGO_MANIFEST_DIR"), "/configs/robots/katana.xml")),
    )?;
    let composition = mobee::compose::read(&file, &[])?;
    let (_controls, receiver) = mpsc::channel(1);
    let done = run(composition, &Folder::create("lines", Some(&folder.path().join("run")))?, receiver, |_| ())?;
    println!("{} motions, {} taken back", done.end.counts.commits, done.end.counts.rolled_back);
    assert!(in_order(&done.end), "the end of the input ends the run");
    Ok(())
}
