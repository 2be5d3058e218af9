//! The first lines that a run prints: its folder, its ports, and the commands to watch and to stop it.

use super::{CtlAt, Folder};
use crate::terminal;
use mobee_compose::Composition;
use mobee_runtime::clock::ClockKind;

/// The lines, in order.
pub(super) fn lines(composition: &Composition, folder: &Folder, ctl: CtlAt) -> Vec<String> {
    let name = &composition.config.name;
    let path = folder.path().display();
    let until = match composition.config.for_s {
        Some(secs) => format!("for {secs} s"),
        None => "until its agents are done or it is stopped".to_owned(),
    };
    if composition.config.clock_kind() == ClockKind::Virtual {
        return vec![format!("{name}: running in virtual time {until}, into {path}; Ctrl-C ends it in order")];
    }
    let mut lines = vec![format!("{name}: running {until}, into {path}")];
    let names = composition.bridge_names();
    for (bridge, name) in composition.bridges.iter().zip(&names) {
        let served = bridge.serves(composition.scene.robots());
        let served = if served.is_empty() { "programs outside".to_owned() } else { served.join(" ") };
        lines.push(format!("  serves  {name}: {served}"));
    }
    let run = match (ctl, folder.path().parent().is_some_and(|parent| parent.ends_with("runs"))) {
        (CtlAt::Off, _) => {
            lines.push("  stop    Ctrl-C".into());
            return lines;
        }
        (_, true) => String::new(),
        (_, false) => format!(" --run {}", terminal::shell_word(folder.path())),
    };
    lines.push(format!("  watch   mobee ctl{run} status, mobee ctl{run} log -f"));
    lines.push(format!(
        "  stop    Ctrl-C or mobee ctl{run} stop; mobee ctl{run} halt stops the robots and keeps the run"
    ));
    lines
}
