//! The dialog of a calibration: prompts, the live table of ranges, a question before servos are written, and the file at the end.

use super::CalibrateArgs;
use crate::arms::KnownArm;
use crate::signals::Interrupt;
use crate::terminal::{out, shell_word};
use indicatif::{ProgressBar, ProgressStyle};
use miette::Report;
use mobee_compose::config::ConfigError;
use mobee_compose::maps::stage;
use mobee_contract::KindError;
use mobee_feetech::ArmCalibrator;
use mobee_feetech::calibration::{ArmCalibration, SweptMotor, SweptRange};
use std::fmt::Write;
use std::io::IsTerminal;
use std::process::ExitCode;
use std::time::Duration;
use tokio::sync::mpsc;

/// Time between two readings.
const READING_PERIOD: Duration = Duration::from_millis(20);
/// Counts per turn, as LeRobot counts degrees.
const TURN_COUNTS: f64 = 4095.0;
/// Share of the model's range that a joint must be moved through.
const LEAST_SHARE: f64 = 0.5;
/// The answer that permits to write servos.
const CONSENT: &str = "yes";

/// Runs the dialog on the terminal.
///
/// # Errors
/// As for [`super::command`].
pub(super) fn run(args: &CalibrateArgs, arm: &KnownArm) -> Result<ExitCode, Report> {
    if args.write_offsets && !args.yes && !std::io::stdin().is_terminal() {
        let help = "answer on a terminal, or give --yes";
        return Err(ConfigError::plain(
            "--write-offsets needs an answer, and the standard input is not a terminal",
            help,
        )
        .into());
    }
    let folder = args.out.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        return Err(ConfigError::plain(format!("there is no folder {}", folder.display()), "make it first").into());
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|e| Report::msg(format!("no asynchronous runtime: {e}")))?;
    runtime.block_on(async {
        let mut dialog = Dialog { lines: lines(), interrupt: Interrupt::new() };
        dialog.calibrate(args, arm).await
    })?;
    Ok(ExitCode::SUCCESS)
}

/// The lines of the standard input. The thread ends with the program.
fn lines() -> mpsc::Receiver<String> {
    let (sender, receiver) = mpsc::channel(4);
    std::thread::spawn(move || {
        let all = std::io::stdin().lines().map_while(Result::ok);
        all.map(|line| sender.blocking_send(line)).take_while(Result::is_ok).for_each(drop);
    });
    receiver
}

/// The motors of an arm, and how far each must be moved.
fn motors(arm: &KnownArm) -> Result<Vec<SweptMotor>, Report> {
    let robot = arm.robot()?;
    let each = robot.motors.iter().zip(1..).map(|(motor, id)| {
        let counts = LEAST_SHARE * (motor.max - motor.min).to_degrees() * TURN_COUNTS / 360.0;
        let least_range = (!arm.endless.contains(&motor.name.as_str())).then_some(counts.ceil() as i32);
        SweptMotor { name: motor.name.clone(), id, homing_offset: 0, least_range }
    });
    Ok(each.collect())
}

/// The person at the terminal.
struct Dialog {
    lines: mpsc::Receiver<String>,
    interrupt: Interrupt,
}

impl Dialog {
    async fn calibrate(&mut self, args: &CalibrateArgs, arm: &KnownArm) -> Result<(), Report> {
        let refused = |e: KindError| Report::from(complaint(e));
        let mut calibrator = ArmCalibrator::open(&args.port, args.baud, motors(arm)?).map_err(refused)?;
        if args.write_offsets {
            out("Move every joint to the middle of its range, then press Enter.\n");
            self.line().await?;
            calibrator.center().map_err(refused)?;
        }
        let all_but = match arm.endless {
            [] => String::new(),
            endless => format!(", but not {}", endless.join(", ")),
        };
        out(&format!("Move each joint slowly to both of its ends{all_but}; Enter ends, Ctrl-C aborts.\n"));
        self.sweep(&mut calibrator).await?;
        let (calibration, remarks) = calibrator.finish().map_err(refused)?;
        // complete beside its place before a servo is written
        let staged = stage(&args.out, &calibration.to_json()).map_err(|e| unwritten(args, &e))?;
        remarks.iter().for_each(|remark| out(&format!("{remark}\n")));
        if args.write_offsets {
            out(&format!("The servos will store:\n{}", indented(&calibrator, &calibration)));
            if !args.yes {
                out(&format!("This replaces what they store now. Write it? Answer `{CONSENT}`.\n"));
                if self.line().await?.trim() != CONSENT {
                    return Err(ConfigError::plain("the servos may not be written", "nothing was written").into());
                }
            }
            calibrator.store(&calibration).map_err(refused)?;
        }
        let placed = if args.force { staged.persist(&args.out) } else { staged.persist_noclobber(&args.out) };
        placed.map_err(|e| unwritten(args, &e.error))?;
        let file = shell_word(&args.out);
        let port = shell_word(std::path::Path::new(&args.port));
        out(&format!("{file}\nnow: mobee new NAME --arm {} --port {port} --calibration {file}\n", arm.name));
        Ok(())
    }

    /// Records until Enter.
    async fn sweep(&mut self, calibrator: &mut ArmCalibrator) -> Result<(), Report> {
        // hidden where standard error is not a terminal
        let table = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("{msg}") {
            table.set_style(style);
        }
        let mut clock = tokio::time::interval(READING_PERIOD);
        let end = loop {
            tokio::select! {
                line = next_line(&mut self.lines, &mut self.interrupt) => break line.map(drop),
                _ = clock.tick() => match calibrator.record() {
                    Ok(_) => table.set_message(ranges_text(calibrator).trim_end().to_owned()),
                    Err(e) => break Err(complaint(e).into()),
                },
            }
        };
        table.finish_and_clear();
        out(&ranges_text(calibrator));
        end
    }

    async fn line(&mut self) -> Result<String, Report> {
        next_line(&mut self.lines, &mut self.interrupt).await
    }
}

/// The next line of the person.
///
/// # Errors
/// After Ctrl-C, or at the end of the standard input.
async fn next_line(lines: &mut mpsc::Receiver<String>, interrupt: &mut Interrupt) -> Result<String, Report> {
    let unfinished = |what: &str| ConfigError::plain(what, "nothing was written; calibrate again").into();
    tokio::select! {
        () = interrupt.wait() => Err(unfinished("the calibration was interrupted")),
        line = lines.recv() => line.ok_or_else(|| unfinished("the standard input has ended")),
    }
}

fn complaint(e: KindError) -> ConfigError {
    let more: String = e.more.iter().map(|e| format!("; {}", e.what)).collect();
    ConfigError::plain(e.what + &more, format!("{}; no file was written", e.help))
}

fn unwritten(args: &CalibrateArgs, e: &std::io::Error) -> ConfigError {
    let mut help = "check the folder's space and permissions".to_owned();
    if args.write_offsets {
        help += "; if the servos have been written, `mobee calibrate` without --write-offsets makes the file";
    }
    ConfigError::plain(format!("can't write {}: {e}", args.out.display()), help)
}

fn indented(calibrator: &ArmCalibrator, calibration: &ArmCalibration) -> String {
    calibrator.changes(calibration).iter().map(|line| format!("  {line}\n")).collect()
}

/// The ranges so far, as a table.
fn ranges_text(calibrator: &ArmCalibrator) -> String {
    let mut text = format!("  {:14} {:>5} {:>5} {:>5}   deg\n", "joint", "min", "now", "max");
    for (motor, range) in calibrator.ranges() {
        let _ = writeln!(text, "  {:14} {}", motor.name, range_text(motor, range));
    }
    text
}

fn range_text(motor: &SweptMotor, range: &SweptRange) -> String {
    let Some([min, now, max]) = range.counts else { return "no reading".into() };
    let deg = |counts: i32| f64::from(counts) * 360.0 / TURN_COUNTS;
    let state = match motor.least_range {
        None => "turns without end: leave it".to_owned(),
        Some(_) if range.wrapped => "JUMPED: its range contains the end of the encoder's turn".to_owned(),
        Some(least) if max - min < least => format!("{:.0} of {:.0} or more", deg(max - min), deg(least)),
        Some(_) => format!("{:.0}", deg(max - min)),
    };
    format!("{min:>5} {now:>5} {max:>5}   {state}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_the_models_range_is_wanted_except_of_an_endless_joint() {
        let motors = motors(crate::arms::known("so101").expect("known")).expect("a model");
        let least: Vec<Option<i32>> = motors.iter().map(|m| m.least_range).collect();
        assert_eq!(least, [Some(1252), Some(1138), Some(1102), Some(1081), None, Some(626)]);
        assert_eq!(motors.iter().map(|m| m.id).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6]);
    }

    #[test]
    fn the_table_shows_what_is_missing() {
        let motor = SweptMotor { name: "pan".into(), id: 1, homing_offset: 0, least_range: Some(1251) };
        let text = |counts, wrapped| range_text(&motor, &SweptRange { counts: Some(counts), wrapped });
        assert_eq!(text([1000, 1500, 2000], false), " 1000  1500  2000   88 of 110 or more");
        assert!(text([1000, 1500, 3000], false).ends_with("   176"));
        assert!(text([0, 4000, 4095], true).contains("JUMPED"));
    }
}
