//! The machine: processors, timers, disk, viewer.

use super::Finding;
use crate::view::VIEWER_VERSION;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// Number of timers that are measured.
const TIMERS: u32 = 50;

pub(super) fn processors() -> Finding {
    match std::thread::available_parallelism().map_or(1, usize::from) {
        1 => Finding::warn(
            "one processor",
            "run planner and viewer on another machine: the safety chain needs a processor of its own",
        ),
        n => Finding::ok(format!("{n} processors")),
    }
}

/// Measures the delay of timers of one millisecond: the control loop depends on them.
#[expect(clippy::disallowed_methods, reason = "it is the machine's own clock that is looked at")]
pub(super) async fn timers() -> Finding {
    let mut late = Vec::new();
    for _ in 0..TIMERS {
        let begun = std::time::Instant::now();
        tokio::time::sleep(Duration::from_millis(1)).await;
        late.push(begun.elapsed().saturating_sub(Duration::from_millis(1)));
    }
    late.sort();
    let ms = |d: Option<&Duration>| d.map_or(0.0, |d| d.as_secs_f64() * 1e3);
    let median = ms(late.get(late.len() / 2));
    let worst = ms(late.last());
    let what = format!("timers are {median:.1} ms late, {worst:.1} ms at worst");
    if median > 5.0 || worst > 50.0 {
        return Finding::warn(
            what,
            "end other programs, or choose a longer controller.period_ms: the machine is too busy for 20 ms",
        );
    }
    Finding::ok(what)
}

/// Checks that runs can be written, and the free disk space.
pub(super) fn folder(runs: &Path) -> Vec<Finding> {
    let here = if runs.is_dir() { runs } else { Path::new(".") };
    let written = match tempfile::tempfile_in(here) {
        Ok(_) => Finding::ok("runs/ can be written"),
        Err(e) => Finding::bad(format!("runs/ can't be written: {e}"), "work in a writable folder, or give --out DIR"),
    };
    vec![written, room(here)]
}

fn room(folder: &Path) -> Finding {
    let out = Command::new("df").arg("-Pk").arg(folder).output();
    let text = out.map(|o| String::from_utf8_lossy(&o.stdout).into_owned()).unwrap_or_default();
    match free(&text) {
        None => Finding::warn("free disk space can't be determined", "make sure that there is room for recordings"),
        Some((gigabytes, percent)) => {
            let what = format!("{gigabytes:.1} GB of disk are free ({percent:.0} %)");
            match percent {
                p if p < 1.0 => Finding::bad(what, "free some: no run is started on a full disk"),
                p if p < 10.0 => Finding::warn(what, "free some, or run with --no-record"),
                _ => Finding::ok(what),
            }
        }
    }
}

/// Free gigabytes and percent in the output of `df -Pk`.
fn free(text: &str) -> Option<(f64, f64)> {
    let mut numbers = text.lines().nth(1)?.split_whitespace().skip(1);
    let (total, _, free): (f64, f64, f64) =
        (numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?);
    (total > 0.0).then(|| (free / 1e6, 100.0 * free / total))
}

pub(super) fn viewer() -> Finding {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found: Option<PathBuf> = std::env::split_paths(&path).map(|p| p.join("rerun")).find(|p| p.is_file());
    match found {
        Some(viewer) => {
            Finding::ok(format!("the viewer is {}; recordings are of version {VIEWER_VERSION}", viewer.display()))
        }
        None => {
            let remedy = format!("to look at recordings: pip install rerun-sdk=={VIEWER_VERSION}");
            Finding::warn("the viewer `rerun` is not on the PATH", remedy)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_room_is_read_from_df() {
        let text = "Filesystem 1024-blocks Used Available Capacity Mounted on\n/dev/sda1 1000000 900000 50000 95% /\n";
        assert_eq!(free(text), Some((0.05, 5.0)));
        assert_eq!(free("df: nothing there\n"), None);
        assert_eq!(free("a\n/dev/x 0 0 0 - /\n"), None);
    }
}
