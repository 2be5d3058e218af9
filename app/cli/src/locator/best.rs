//! `mobee locator best`: trains every kind on the collected views, evaluates it on held-out places, stores the best
//! one, and swaps it into a running sensor.

use super::collect::{Collection, ViewSelection, collected};
use crate::roadmap::may_write;
use crate::robot_import::Steps;
use miette::Report;
use mobee_compose::config::ConfigError;
use mobee_compose::maps::save_text;
use mobee_sensing::locators::beginning::{Beginning, Untaught};
use mobee_sensing::locators::file::{LocatorFile, LocatorKind};
use mobee_sensing::locators::folds::folds;
use mobee_sensing::locators::head::HeadKind;
use mobee_sensing::locators::score::{LocatorScore, PlaceAnswers};
use mobee_sensing::locators::view::KnownView;
use std::fmt::Write;
use std::path::PathBuf;

/// Minimum share of held-out views that the best kind must locate.
const MIN_LOCATED_SHARE: f64 = 0.9;

/// Arguments of `mobee locator best`.
#[derive(clap::Args, Clone, Debug)]
pub struct BestArgs {
    /// The folder of a run, ended or not, from which training data are collected.
    #[arg(value_name = "RUN", required_unless_present = "data", conflicts_with = "data")]
    run: Option<PathBuf>,
    /// Instead of a run, a table of views of known places, such as `mobee locator collect` writes.
    #[arg(long, value_name = "FILE.csv")]
    data: Option<PathBuf>,
    #[command(flatten)]
    selection: ViewSelection,
    /// The locator to write: the best kind, trained on all places.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The nominal head kinematics that training starts from: `v1` (iCubs of 2012) or `v2` (later ones, and the shipped
    /// model).
    #[arg(long, value_parser = super::train::head, default_value = "v2")]
    head: HeadKind,
    /// The seed of all randomness.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Replace the locator if it exists.
    #[arg(long)]
    force: bool,
    /// The folder of a running run whose sensor gets the best locator (`--sensor` if there are several); it may be RUN.
    #[arg(long, value_name = "RUN")]
    into: Option<PathBuf>,
    /// Seconds after the swap during which the old locator returns if the new one fails.
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0, value_parser = super::collect::positive, requires = "into")]
    probation: f64,
}

/// The result of a kind: its score at held-out places, or the reason why it could not be trained.
type KindResult = (LocatorKind, Result<LocatorScore, Untaught>);

/// Trains, compares, stores the best, and swaps it in if requested.
///
/// # Errors
/// If run or table can't be read, no kind can be trained, the locator can't be written, or the run retains its own.
pub fn command(args: &BestArgs) -> Result<String, Report> {
    may_write(&args.out, args.force)?;
    let bar = Steps::new();
    bar.step("reads views");
    let (name, (table, digest), mut report) = match (&args.run, &args.data) {
        (Some(run), _) => {
            let Collection { table: csv, text, .. } = collected(run, &args.selection)?;
            let name = run.display().to_string();
            let parsed_table = super::parsed_table(&name, &csv)?;
            let report = format!("{name}: {text}");
            (name, parsed_table, report)
        }
        (None, Some(data)) => (data.display().to_string(), super::table(data)?, String::new()),
        // the command line demands one of them
        (None, None) => {
            return Err(ConfigError::plain("there is nothing to learn from", "give a run, or --data").into());
        }
    };
    let from = Beginning { head: args.head, ..Beginning::recorded(args.seed) };
    let untaught = |e: &Untaught| {
        let help = "give more views of more places, spread over the workspace";
        ConfigError::plain(format!("{name}: {e}"), help)
    };
    let judged: Vec<KindResult> = LocatorKind::ALL
        .into_iter()
        .map(|kind| {
            bar.step(kind.name());
            (kind, held_out(kind, &table.known, &from))
        })
        .collect();
    let Some(best) = best(&judged) else {
        let why = judged.iter().find_map(|(_, score)| score.as_ref().err());
        let none = Untaught("no kind answers what it is asked".into());
        return Err(untaught(why.unwrap_or(&none)).into());
    };
    bar.step("learns the best from all places");
    let file = LocatorFile::train(best, &table.known, digest, &from, &mut |share| bar.show(share));
    save_text(&args.out, &file.map_err(|e| untaught(&e))?.text())?;
    let views = table.known.len();
    report += &text(&judged);
    let _ = writeln!(report, "{}: {}, from all {views} views", args.out.display(), best.name());
    if let Some(run) = &args.into {
        drop(bar);
        // print the result before waiting for the swap
        crate::terminal::out(&std::mem::take(&mut report));
        crate::ctl::put_locator(run, args.selection.sensor.as_deref(), (best, &args.out), args.probation)?;
    }
    Ok(report)
}

/// The score of a kind at held-out places: each fifth of them is located after training on the others.
fn held_out(kind: LocatorKind, known: &[KnownView], from: &Beginning) -> Result<LocatorScore, Untaught> {
    let mut answers = PlaceAnswers::default();
    for fold in folds(known, from.seed)? {
        let file = LocatorFile::train(kind, &fold.train, String::new(), from, &mut |_| ())?;
        answers.ask(&file.ready(), &fold.test);
    }
    Ok(answers.score())
}

/// The kind with the least mean error of single views, of those that locate nearly all.
fn best(judged: &[KindResult]) -> Option<LocatorKind> {
    let able = judged.iter().filter_map(|(kind, score)| Some((*kind, score.as_ref().ok()?.single)));
    let able = able.filter(|(_, e)| e.n > 0 && e.located as f64 >= MIN_LOCATED_SHARE * e.n as f64);
    able.min_by(|(_, a), (_, b)| a.mean_mm.total_cmp(&b.mean_mm)).map(|(kind, _)| kind)
}

fn text(judged: &[KindResult]) -> String {
    let mut text = String::from("errors at places held out, mm\n");
    let of = ["one view: median", "mean", "95 %", "all of a place: mean", "95 %"];
    let _ = write!(text, "{:12}{:>16}", "", "answered");
    for name in of {
        let _ = write!(text, "  {name}");
    }
    text.push_str("  in region of 95 %\n");
    for (kind, score) in judged {
        match score {
            Ok(LocatorScore { single: s, fused: f }) => {
                let answered = format!("{} of {}", s.located, s.n);
                let _ = write!(text, "{:12}{answered:>16}", kind.name());
                let values = [s.median_mm, s.mean_mm, s.p95_mm, f.mean_mm, f.p95_mm];
                for (name, mm) in of.iter().zip(values) {
                    let _ = write!(text, "  {mm:>0$.1}", name.len());
                }
                let _ = writeln!(text, "  {:>15.1} %", 100.0 * s.inside_95);
            }
            Err(why) => {
                let _ = writeln!(text, "{:12}learned nothing: {why}", kind.name());
            }
        }
    }
    text
}
