//! Requests of `mobee ctl` to a run, and the output of their replies.

use super::connection::{self, Client};
use super::wire::{Reply, Request, SentConfig};
use super::{CtlArgs, CtlCommand, SwapArgs, config_payload};
use miette::Report;
use mobee_compose::config::ConfigError;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Interval between two requests for the state of a swap.
const SWAP_POLL_INTERVAL: Duration = Duration::from_millis(500);
/// Interval between two requests for the log, or for the end of a motion.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Maximum time in which a run ends in order.
const END_TIMEOUT: Duration = Duration::from_secs(120);
/// Interval of updates by `top`.
const REDRAW_INTERVAL: Duration = Duration::from_secs(1);

pub(super) async fn run(args: CtlArgs) -> Result<ExitCode, Report> {
    let mut client = connection::connect(&args).await?;
    let words = |words: &[&str], robot: Option<String>| {
        words.iter().map(|w| (*w).to_owned()).chain(robot).collect::<Vec<String>>()
    };
    let request = match args.command {
        CtlCommand::Status => words(&["status"], None),
        CtlCommand::Top { times } => return top(&mut client, times).await,
        CtlCommand::Swap(swap) => return self::swap(&mut client, swap).await,
        CtlCommand::Pause(of) => words(&["pause"], of.name()),
        CtlCommand::Resume(of) => words(&["resume"], of.name()),
        CtlCommand::Recover(of) => words(&["recover"], of.name()),
        CtlCommand::Restart { name } => words(&["restart"], name),
        CtlCommand::Halt(of) => words(&["halt"], of.name()),
        CtlCommand::Release(of) => words(&["release"], of.name()),
        CtlCommand::Pose(of) => words(&["pose"], of.name()),
        CtlCommand::Go { motors, robot, speed } => {
            let robot = robot.unwrap_or_default();
            let speed = speed.to_string();
            return go(&mut client, words(&["go", &robot, &speed], None).into_iter().chain(motors).collect()).await;
        }
        CtlCommand::Home { of, speed } => {
            let robot = of.name().unwrap_or_default();
            let speed = speed.to_string();
            return go(&mut client, words(&["home", &robot, &speed], None)).await;
        }
        CtlCommand::Log { follow, lines } => return log(&mut client, lines, follow).await,
        CtlCommand::Stop { now } => return stop(&mut client, words(&["stop"], now.then(|| "now".into()))).await,
        CtlCommand::Record { what, address } => words(&["record", &what], address),
        CtlCommand::World { words } => std::iter::once("world".to_owned()).chain(words).collect(),
    };
    finish(&client.call(&plain_request(request)).await?)
}

/// A request without an attached configuration.
fn plain_request(words: Vec<String>) -> Request {
    Request { words, offer: None }
}

fn finish(answer: &Reply) -> Result<ExitCode, Report> {
    let text = answer.lines.join("\n");
    if answer.done && !answer.over {
        println!("{text}");
        return Ok(ExitCode::SUCCESS);
    }
    eprintln!("{text}");
    Ok(ExitCode::from(2))
}

/// Ends the run, and waits until its journal and folder are final.
async fn stop(client: &mut Client, words: Vec<String>) -> Result<ExitCode, Report> {
    let answer = client.call(&plain_request(words)).await?;
    if !answer.done {
        return finish(&answer);
    }
    println!("{}", answer.lines.join("\n"));
    if client.closed(END_TIMEOUT).await {
        println!("the run is over");
        return Ok(ExitCode::SUCCESS);
    }
    let what = format!("the run has not ended within {} s", END_TIMEOUT.as_secs());
    Err(ConfigError::plain(what, "look at it with `mobee ctl status`, or end it by `mobee ctl stop --now`").into())
}

/// Commits a motion and waits for its outcome; Ctrl-C brakes it.
async fn go(client: &mut Client, words: Vec<String>) -> Result<ExitCode, Report> {
    let answer = client.call(&plain_request(words)).await?;
    let [robot, id] = answer.lines.as_slice() else { return finish(&answer) };
    if !answer.done {
        return finish(&answer);
    }
    let mut brakes = false;
    loop {
        let ended = client.call(&plain_request(vec!["ended".to_owned(), robot.clone(), id.clone()])).await?;
        match ended.lines.as_slice() {
            [word, text] if ended.done => {
                println!("{text}");
                return Ok(if word == "committed" { ExitCode::SUCCESS } else { ExitCode::FAILURE });
            }
            [] if ended.done => {}
            _ => return finish(&ended),
        }
        tokio::select! {
            _ = tokio::signal::ctrl_c(), if !brakes => {
                brakes = true;
                client.call(&plain_request(vec!["brake".to_owned(), robot.clone()])).await?;
            }
            () = tokio::time::sleep(POLL_INTERVAL) => {}
        }
    }
}

/// Shows the newest events, and those that follow.
async fn log(client: &mut Client, lines: u32, follow: bool) -> Result<ExitCode, Report> {
    let mut request = vec!["log".to_owned(), "last".to_owned(), lines.to_string()];
    let mut shown = false;
    loop {
        let answer = match client.call(&plain_request(request)).await {
            Ok(answer) if answer.over && shown => return Ok(ended(&answer)),
            Ok(answer) if answer.done && !answer.over => answer,
            Ok(answer) => return finish(&answer),
            Err(_) if shown => {
                println!("the run has ended");
                return Ok(ExitCode::SUCCESS);
            }
            Err(e) => return Err(e.into()),
        };
        let Some((next, lines)) = answer.lines.split_first() else { return finish(&answer) };
        if !lines.is_empty() {
            println!("{}", lines.join("\n"));
        }
        shown = true;
        if !follow {
            return Ok(ExitCode::SUCCESS);
        }
        request = vec!["log".to_owned(), "from".to_owned(), next.clone()];
        tokio::select! {
            _ = tokio::signal::ctrl_c() => return Ok(ExitCode::SUCCESS),
            () = tokio::time::sleep(POLL_INTERVAL) => {}
        }
    }
}

/// Prints the end of a run that was being observed.
fn ended(answer: &Reply) -> ExitCode {
    println!("{}", answer.lines.join("\n"));
    ExitCode::SUCCESS
}

/// Prints the status repeatedly until Ctrl-C or the end of the run: in place on a terminal, in sequence elsewhere.
async fn top(client: &mut Client, times: Option<u64>) -> Result<ExitCode, Report> {
    let terminal = std::io::stdout().is_terminal();
    let mut drawn = 0;
    loop {
        let answer = match client.call(&plain_request(vec!["status".into()])).await {
            Ok(answer) if answer.over && drawn > 0 => return Ok(ended(&answer)),
            Ok(answer) if answer.done => answer,
            Ok(answer) => return finish(&answer),
            Err(_) if drawn > 0 => {
                println!("the run has ended");
                return Ok(ExitCode::SUCCESS);
            }
            Err(e) => return Err(e.into()),
        };
        let lines = mobee_model::printable(&answer.lines.join("\n")).into_owned();
        // overwrite from the top left: clearing first would flicker
        let lines = if terminal {
            format!("\x1b[H{}\x1b[K\n\x1b[J", lines.replace('\n', "\x1b[K\n"))
        } else {
            format!("{lines}\n\n")
        };
        let mut out = std::io::stdout().lock();
        if out.write_all(lines.as_bytes()).and_then(|()| out.flush()).is_err() {
            return Ok(ExitCode::SUCCESS);
        }
        drop(out);
        drawn += 1;
        if times.is_some_and(|times| drawn >= times) {
            return Ok(ExitCode::SUCCESS);
        }
        tokio::select! {
            _ = tokio::signal::ctrl_c() => return Ok(ExitCode::SUCCESS),
            () = tokio::time::sleep(REDRAW_INTERVAL) => {}
        }
    }
}

async fn swap(client: &mut Client, args: SwapArgs) -> Result<ExitCode, Report> {
    let offer = config_payload::read(&args.file)?;
    let mut names = [("bridge", args.bridge), ("sensor", args.sensor), ("robot", args.robot)];
    let own = match args.part.as_str() {
        "bridge" => "bridge",
        "detector" | "locator" => "sensor",
        _ => "robot",
    };
    let name = names.iter_mut().find(|(of, _)| *of == own).and_then(|(_, name)| name.take()).unwrap_or_default();
    if let Some((option, _)) = names.iter().find(|(_, name)| name.is_some()) {
        let what = format!("--{option} does not say whose {} is meant", args.part);
        let help = "name a bridge with --bridge, a detector's or locator's sensor with --sensor, and the robot of any other part with --robot";
        return Err(ConfigError::plain(what, help).into());
    }
    let numbers = [args.shadow, args.probation, args.budget].map(|n| n.to_string());
    let mut words = vec!["swap".to_owned(), name.clone(), args.part.clone()];
    words.extend(numbers);
    words.extend(args.fresh.then(|| "fresh".to_owned()));
    let offered = client.call(&Request { words, offer: Some(offer) }).await?;
    if !offered.done || args.no_wait {
        return finish(&offered);
    }
    println!("{}", offered.lines.join("\n"));
    let end = end(client, &name, &args.part).await?;
    if end.over && end.done {
        // the new agent has finished before the end of its probation
        return Ok(ended(&end));
    }
    match end.lines.first().map(String::as_str) {
        Some("settled") => Ok(ExitCode::SUCCESS),
        Some("refused" | "reverted") => Ok(ExitCode::FAILURE),
        _ => finish(&end),
    }
}

/// Waits for the end of a swap, and prints each step; returns the reply with the last step, or the first without one.
async fn end(client: &mut Client, name: &str, part: &str) -> Result<Reply, ConfigError> {
    let mut printed = String::new();
    loop {
        let answer = client.call(&plain_request(vec!["swapped".to_owned(), name.to_owned(), part.to_owned()])).await?;
        let [step, text] = answer.lines.as_slice() else { return Ok(answer) };
        if answer.over {
            return Ok(answer);
        }
        if *text != printed {
            println!("{text}");
            printed.clone_from(text);
        }
        if !answer.done || ["settled", "refused", "reverted"].contains(&step.as_str()) {
            return Ok(answer);
        }
        tokio::time::sleep(SWAP_POLL_INTERVAL).await;
    }
}

/// Offers a locator for this sensor to the run in this folder, and waits for the end of the swap.
///
/// # Errors
/// If the run can't be reached, refuses the locator or returns to the old one, with its reason.
pub(super) async fn put_locator(
    run: &Path,
    sensor: &str,
    offer: SentConfig,
    probation: f64,
) -> Result<(), ConfigError> {
    let mut client = connection::connect_in(run).await?;
    let [sensor, part] = [sensor, "locator"];
    let words = ["swap", sensor, part, "0", &probation.to_string(), "1"].map(str::to_owned).into();
    let offered = client.call(&Request { words, offer: Some(offer) }).await?;
    let end = if offered.done { end(&mut client, sensor, part).await? } else { offered };
    if end.done && end.lines.first().is_some_and(|step| step == "settled") {
        return Ok(());
    }
    let what = format!("the sensor {sensor} of {} keeps its locator: {}", run.display(), end.lines.join(", "));
    Err(ConfigError::plain(what, "mend that, and offer it again by `mobee ctl swap locator FILE.toml`"))
}
