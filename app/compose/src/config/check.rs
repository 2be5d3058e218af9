//! Checks of a configuration beyond its types, before any file that it names is read.

use super::{ClockMode, Complaints, Config, Source, StepTrigger, did_you_mean, suggestion};
use mobee_bridge_yarp::YarpSettings;

/// Maximum coordinate in the world, meters: a greater one was meant in millimeters.
const MAX_COORDINATE_M: f64 = 50.0;
/// Maximum length of a behavior's name, bytes: the name and the run's time are a folder's name.
const MAX_NAME_BYTES: usize = 100;

/// The checks of one configuration, and the complaints so far.
pub(super) struct Checks<'a> {
    source: &'a Source,
    wrong: Complaints,
}

impl Checks<'_> {
    pub(super) fn complain(&mut self, path: &str, message: impl Into<String>, help: impl Into<String>) {
        if self.wrong.is_full() {
            return;
        }
        self.wrong.push(self.source.error(path, message, help));
    }

    /// Checks a range; NaN is out of every range.
    pub(super) fn range(&mut self, path: &str, x: f64, low: f64, high: f64, unit: &str) {
        self.range_or(path, x, (low, high), unit, None);
    }

    /// Checks a range of a value that may have been meant in another unit: `other` is that unit's name and its factor
    /// to ours.
    pub(super) fn range_or(
        &mut self,
        path: &str,
        x: f64,
        (low, high): (f64, f64),
        unit: &str,
        other: Option<(&str, f64)>,
    ) {
        if !(x >= low && x <= high) {
            let meant = other.filter(|(_, factor)| (low..=high).contains(&(x * factor)));
            let hint = meant.map_or(String::new(), |(name, factor)| {
                format!("; if {name} are meant, write {}", (x * factor * 1e6).round() / 1e6)
            });
            self.complain(path, format!("{x} {unit} is out of range"), format!("give {low} to {high} {unit}{hint}"));
        }
    }

    /// Checks a name: names become parts of other names, paths and ports.
    pub(super) fn name(&mut self, path: &str, name: &str, of: &str) {
        if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-') {
            self.complain(path, format!("not a {of}'s name"), "use letters, digits, - and _");
        }
    }

    pub(super) fn position(&mut self, path: &str, p: &[f64; 3]) {
        let near = |p: &[f64; 3]| p.iter().all(|x| x.abs() <= MAX_COORDINATE_M);
        if !near(p) {
            let meters = p.map(|x| (x * 1e3).round() / 1e6);
            let hint =
                if near(&meters) { format!("; if millimeters are meant, write {meters:?}") } else { String::new() };
            let help = format!("give meters, up to {MAX_COORDINATE_M} from the origin{hint}");
            self.complain(path, format!("{p:?} m is far away from everything"), help);
        }
    }
}

impl Config {
    /// Checks all numbers, names and combinations.
    pub(super) fn check(&self, source: &Source) -> Complaints {
        let mut c = Checks { source, wrong: Complaints::default() };
        self.check_run(&mut c);
        if let Some(torture) = &self.torture {
            c.range("torture.faulted_percent", torture.faulted_percent, 0.0, 100.0, "percent");
        }
        self.check_robots(&mut c);
        self.check_sensors(&mut c);
        self.check_script(&mut c);
        c.wrong
    }

    fn check_run(&self, c: &mut Checks<'_>) {
        if self.name.contains(['/', '\\']) || self.name.starts_with('.') {
            c.complain("name", "the name can't be part of a folder's name", "use letters, digits, - and _");
        } else if self.name.len() > MAX_NAME_BYTES {
            let what = format!("the name has {} bytes, too many for a folder's name", self.name.len());
            c.complain("name", what, format!("{MAX_NAME_BYTES} are enough"));
        }
        if self.robot.is_empty() {
            c.complain("robot", "there is no robot", "add a [[robot]] table with name, model and controller");
        }
        if let Some(secs) = self.for_s {
            c.range("for_s", secs, 0.001, 1e7, "s");
        }
        c.range("record.poses_hz", self.record.poses_hz, 0.1, 1000.0, "Hz");
        if self.record.live.is_some() && self.clock == ClockMode::Virtual {
            let what = "a viewer can't follow a run in virtual time, which waits for nobody";
            c.complain(
                "record.live",
                what,
                "set clock = \"real\", or take this away and open the recording with `mobee view`",
            );
        }
    }

    fn check_robots(&self, c: &mut Checks<'_>) {
        for (i, r) in self.robot.iter().enumerate() {
            let at = |key: &str| format!("robot[{i}].{key}");
            if self.robot.iter().take(i).any(|other| other.name == r.name) {
                let what = format!("there are two robots `{}`", r.name);
                c.complain(&at("name"), what, "name one of them differently");
            }
            c.name(&at("name"), &r.name, "robot");
            let k = &r.controller;
            c.range_or(&at("controller.period_ms"), k.period_ms, (1.0, 1000.0), "ms", Some(("seconds", 1e3)));
            c.range(&at("controller.history"), r.controller.history as f64, 10.0, 1e7, "poses");
            // a margin of zero is allowed for simulations; one of micrometers is a mistake
            let least = if k.margin_mm == 0.0 { 0.0 } else { 0.5 };
            c.range_or(&at("controller.margin_mm"), k.margin_mm, (least, 500.0), "mm", Some(("meters", 1e3)));
            // zero: the paper's Algorithm 6
            if let Some(mm) = k.reserve_mm.filter(|mm| *mm != 0.0) {
                // beyond the margin, the margin stops a slow robot
                c.range_or(&at("controller.reserve_mm"), mm, (0.5, k.margin_mm.max(0.5)), "mm", Some(("meters", 1e3)));
            }
            if let Some(deg) = k.stall_deg {
                // below the tolerance, a motor that rests beside its target would count as held
                c.range(&at("controller.stall_deg"), deg, k.tolerance_deg.clamp(0.05, 45.0), 45.0, "deg");
            }
            if let Some(nm) = k.contact_nm {
                c.range(&at("controller.contact_nm"), nm, 0.0, 1e5, "N m");
            }
            c.range(&at("controller.tolerance_deg"), k.tolerance_deg, 1e-3, 10.0, "deg");
            c.range(&at("controller.undo_s"), k.undo_s, 0.0, 3600.0, "s");
            if let Some(ms) = k.stale_ms {
                c.range(&at("controller.stale_ms"), ms, 2.0 * k.period_ms, 10_000.0, "ms");
            }
            c.position(&at("base.position_m"), &r.base.position_m);
            if let Err(e) = k.drive() {
                for e in e.under(&at("controller")).all() {
                    let help = did_you_mean(&e.what).unwrap_or(e.help);
                    c.complain(e.path.trim_end_matches('.'), e.what, help);
                }
            }
            if let Some(rest) = &r.rest {
                rest.check(&at("rest"), c);
            }
            c.range(&at("base.yaw_deg"), r.base.yaw_deg, -360.0, 360.0, "deg");
        }
    }

    fn check_script(&self, c: &mut Checks<'_>) {
        let names: Vec<&str> = self.robot.iter().map(|r| r.name.as_str()).collect();
        for (i, s) in self.script.iter().enumerate() {
            match &s.when {
                StepTrigger::AtS(t) => {
                    let at = format!("script[{i}].when.at_s");
                    c.range(&at, *t, 0.0, 1e7, "s");
                    // with --for, a user shortens one run on purpose
                    let end = self.for_s.filter(|end| t >= end && c.source.in_file("for_s"));
                    if let Some(end) = end {
                        let what = format!("this never happens: the run ends at {end} s");
                        c.complain(&at, what, "choose an earlier time, or a longer `for_s`");
                    }
                }
                StepTrigger::AfterOutcomes { robot, .. } if !names.contains(&robot.as_str()) => {
                    let at = format!("script[{i}].when.after_outcomes.robot");
                    c.complain(&at, format!("there is no robot `{robot}`"), suggestion(robot, "robot", &names));
                }
                StepTrigger::AfterOutcomes { robot, .. } => {
                    let planless = self.robot.iter().any(|r| r.name == *robot && r.agent.is_none());
                    let ports = |y: &YarpSettings| y.filter || y.parts;
                    if planless && self.bridge.is_empty() && !self.yarp.as_ref().is_some_and(ports) {
                        let at = format!("script[{i}].when.after_outcomes.robot");
                        let what = format!("this never happens: nobody moves {robot}");
                        c.complain(&at, what, "give the robot an agent, or use at_s");
                    }
                }
            }
            if let Some(p) = &s.edit.position_m {
                c.position(&format!("script[{i}].edit.position_m"), p);
            }
            if s.edit.remove && (s.edit.class.is_some() || s.edit.position_m.is_some()) {
                let what = "a removed object has no class or position";
                c.complain(&format!("script[{i}].edit"), what, "remove either `remove` or the others");
            }
            if s.edit.class.is_none() && s.edit.position_m.is_none() && !s.edit.remove {
                c.complain(
                    &format!("script[{i}].edit"),
                    "this step changes nothing",
                    "give class, position_m or remove",
                );
            }
        }
    }
}
