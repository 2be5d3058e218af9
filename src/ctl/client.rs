//! What `mobee ctl` says to a run, and how it shows the answers.

use super::{CtlArgs, CtlCommand, SwapArgs, find};
use crate::config::ConfigError;
use miette::Report;
use mobee_yarp::{Bottle, Dialect, RpcClient, Text, Value};
use std::process::ExitCode;
use std::time::Duration;

/// How often `top` is drawn, and a swap looked after.
const PERIOD: Duration = Duration::from_millis(500);

/// An answer: whether it was done, and the lines.
struct Answer {
    done: bool,
    lines: Vec<String>,
}

pub(super) async fn run(args: CtlArgs) -> Result<ExitCode, Report> {
    let mut client = find::connect(&args).await?;
    let words = |words: &[&str], robot: Option<String>| {
        words.iter().map(|w| (*w).to_owned()).chain(robot).collect::<Vec<String>>()
    };
    let request = match args.command {
        CtlCommand::Status => words(&["status"], None),
        CtlCommand::Top => return top(&mut client).await,
        CtlCommand::Swap(swap) => return self::swap(&mut client, swap).await,
        CtlCommand::Pause { robot } => words(&["pause"], robot),
        CtlCommand::Resume { robot } => words(&["resume"], robot),
        CtlCommand::Recover { robot } => words(&["recover"], robot),
        CtlCommand::Stop { now } => words(&["stop"], now.then(|| "now".into())),
        CtlCommand::Record { what } => words(&["record"], Some(what)),
        CtlCommand::World { words } => {
            let mut request = Bottle(vec![string("world")]);
            let text = words.join(" ");
            request.0.extend(Bottle::parse(&text, Dialect::V3).map_err(|e| Report::msg(e.to_string()))?.0);
            return finish(ask(&mut client, &request).await?);
        }
    };
    finish(ask(&mut client, &bottle(&request)).await?)
}

fn string(text: &str) -> Value {
    Value::String(Text(text.as_bytes().to_vec()))
}

fn bottle(words: &[String]) -> Bottle {
    Bottle(words.iter().map(|w| string(w)).collect())
}

async fn ask(client: &mut RpcClient, request: &Bottle) -> Result<Answer, ConfigError> {
    let reply = client
        .call(request)
        .await
        .map_err(|e| ConfigError::plain(e.to_string(), "see whether the run still goes on, and ask again"))?;
    let mut lines = reply.0.iter().map(|value| match value {
        Value::String(Text(bytes)) => String::from_utf8_lossy(bytes).into_owned(),
        other => Bottle(vec![other.clone()]).to_string(),
    });
    let done = lines.next().as_deref() == Some("ok");
    Ok(Answer { done, lines: lines.collect() })
}

fn finish(answer: Answer) -> Result<ExitCode, Report> {
    let text = answer.lines.join("\n");
    if answer.done {
        println!("{text}");
        return Ok(ExitCode::SUCCESS);
    }
    eprintln!("{text}");
    Ok(ExitCode::from(2))
}

async fn top(client: &mut RpcClient) -> Result<ExitCode, Report> {
    loop {
        let answer = ask(client, &bottle(&["status".into()])).await?;
        // clear, and begin at the top left
        println!("\x1b[2J\x1b[H{}", answer.lines.join("\n"));
        tokio::select! {
            _ = tokio::signal::ctrl_c() => return Ok(ExitCode::SUCCESS),
            () = tokio::time::sleep(PERIOD) => {}
        }
    }
}

async fn swap(client: &mut RpcClient, args: SwapArgs) -> Result<ExitCode, Report> {
    let file = args.file.canonicalize().map_err(|e| {
        ConfigError::plain(format!("{}: {e}", args.file.display()), "give a configuration file that can be read")
    })?;
    let robot = args.robot.unwrap_or_default();
    let numbers = [args.shadow, args.probation, args.budget].map(|n| n.to_string());
    let mut request = vec!["swap".to_owned(), robot.clone(), args.part.clone(), file.display().to_string()];
    request.extend(numbers);
    request.extend(args.fresh.then(|| "fresh".to_owned()));
    let offered = ask(client, &bottle(&request)).await?;
    if !offered.done || args.no_wait {
        return finish(offered);
    }
    println!("{}", offered.lines.join("\n"));
    let mut said = String::new();
    loop {
        let answer = ask(client, &bottle(&["swapped".to_owned(), robot.clone(), args.part.clone()])).await?;
        if !answer.done {
            return finish(answer);
        }
        let [step, text] = answer.lines.as_slice() else { return finish(answer) };
        if *text != said {
            println!("{text}");
            said.clone_from(text);
        }
        match step.as_str() {
            "settled" => return Ok(ExitCode::SUCCESS),
            "refused" | "reverted" => return Ok(ExitCode::FAILURE),
            _ => tokio::time::sleep(PERIOD).await,
        }
    }
}
