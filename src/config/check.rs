//! What the types of a configuration can't say, before any file that it names is read.

use super::{Clock, Complaints, Config, Source, When, did_you_mean, suggestion};

/// The checks of one configuration, and what they have found.
struct Checks<'a> {
    source: &'a Source,
    wrong: Complaints,
}

impl Checks<'_> {
    fn say(&mut self, path: &str, message: impl Into<String>, help: impl Into<String>) {
        self.wrong.push(self.source.error(path, message, help));
    }

    /// Not-a-number is out of every range.
    fn range(&mut self, path: &str, x: f64, low: f64, high: f64, unit: &str) {
        if !(x >= low && x <= high) {
            self.say(path, format!("{x} {unit} is out of range"), format!("give {low} to {high} {unit}"));
        }
    }
}

impl Config {
    /// Everything that is wrong with numbers, names and combinations.
    pub(super) fn check(&self, source: &Source) -> Complaints {
        let mut c = Checks { source, wrong: Complaints::default() };
        self.check_run(&mut c);
        self.check_robots(&mut c);
        self.check_script(&mut c);
        c.wrong
    }

    fn check_run(&self, c: &mut Checks<'_>) {
        let yarp_robot = self.robot.iter().position(|r| r.driver["kind"] == "yarp");
        let real_only = yarp_robot.map(|i| format!("robot[{i}].driver")).or(self.yarp.as_ref().map(|_| "yarp".into()));
        if let Some(at) = real_only.filter(|_| self.clock == Clock::Virtual) {
            let what = "YARP runs by the wall clock, and this behavior's clock is virtual";
            c.say(&at, what, "set clock = \"real\"");
        }
        if self.name.contains(['/', '\\']) || self.name.starts_with('.') {
            c.say("name", "the name can't be part of a folder's name", "use letters, digits, - and _");
        }
        if self.robot.is_empty() {
            c.say("robot", "there is no robot", "add a [[robot]] table with name, model and controller");
        }
        if let Some(secs) = self.for_s {
            c.range("for_s", secs, 0.001, 1e7, "s");
        }
        c.range("record.poses_hz", self.record.poses_hz, 0.1, 1000.0, "Hz");
    }

    fn check_robots(&self, c: &mut Checks<'_>) {
        for (i, r) in self.robot.iter().enumerate() {
            let at = |key: &str| format!("robot[{i}].{key}");
            if self.robot.iter().take(i).any(|other| other.name == r.name) {
                let what = format!("there are two robots `{}`", r.name);
                c.say(&at("name"), what, "name one of them differently");
            }
            if r.name.is_empty() || !r.name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-') {
                c.say(&at("name"), "not a robot's name", "use letters, digits, - and _");
            }
            c.range(&at("controller.period_ms"), r.controller.period_ms, 1.0, 1000.0, "ms");
            c.range(&at("controller.history"), r.controller.history as f64, 10.0, 1e7, "poses");
            c.range(&at("controller.margin_mm"), r.controller.margin_mm, 0.0, 500.0, "mm");
            c.range(&at("controller.tolerance_deg"), r.controller.tolerance_deg, 1e-3, 10.0, "deg");
            if let Err(e) = r.controller.drive() {
                let path = format!("{}.{}", at("controller"), e.path);
                let help = did_you_mean(&e.what).unwrap_or(e.help);
                c.say(path.trim_end_matches('.'), e.what, help);
            }
            for (k, x) in r.base.position_m.iter().enumerate() {
                c.range(&at(&format!("base.position_m[{k}]")), *x, -100.0, 100.0, "m");
            }
            c.range(&at("base.yaw_deg"), r.base.yaw_deg, -360.0, 360.0, "deg");
        }
    }

    fn check_script(&self, c: &mut Checks<'_>) {
        let names: Vec<&str> = self.robot.iter().map(|r| r.name.as_str()).collect();
        for (i, s) in self.script.iter().enumerate() {
            match &s.when {
                When::AtS(t) => c.range(&format!("script[{i}].when.at_s"), *t, 0.0, 1e7, "s"),
                When::AfterOutcomes { robot, .. } if !names.contains(&robot.as_str()) => {
                    let at = format!("script[{i}].when.after_outcomes.robot");
                    c.say(&at, format!("there is no robot `{robot}`"), suggestion(robot, "robot", &names));
                }
                When::AfterOutcomes { .. } => {}
            }
            if s.edit.class.is_none() && s.edit.position_m.is_none() && !s.edit.remove {
                c.say(&format!("script[{i}].edit"), "nothing happens here", "give class, position_m or remove");
            }
        }
    }
}
