//! Settings of MoBeE's YARP ports: table `[yarp]` of a configuration.

use mobee_contract::{KindError, suggestion};
use mobee_filter::force_field::ForceFieldSettings;
use mobee_model::Robot;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Settings of MoBeE's own YARP ports. All have defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct YarpSettings {
    /// Prefix of the names of MoBeE's ports.
    pub prefix: String,
    /// Address of the name server, such as `127.0.0.1:10000`. Default: from YARP's own files and environment, or
    /// `127.0.0.1:10000` if they give none.
    pub name_server: Option<SocketAddr>,
    /// True to start a name server in this process, at that address, if none answers there.
    #[schemars(extend("expert" = true))]
    pub start_name_server: bool,
    /// True if ports may be reached from other computers. YARP has neither passwords nor encryption: anyone
    /// who can reach a port can move the robot.
    pub allow_open_network: bool,
    /// True if an open network may do without the key of `auth.conf`, with which programs authenticate each
    /// connection: then anyone who can reach the ports can move the robot.
    #[schemars(extend("expert" = true))]
    pub without_auth: bool,
    /// YARP dialect: `3` or `4`. The two can't be distinguished on the wire.
    pub dialect: u8,
    /// True to open the port filter: a board for each part, through which any YARP program moves the robot
    /// safely.
    pub filter: bool,
    /// Share of each motor's maximum speed that programs may use through the filter. Slower than requested is
    /// safe; too fast to stop within the margin is not. Position-direct setpoints are followed as they
    /// arrive.
    pub speed: f64,
    /// Time between two messages of the state ports, ms.
    #[schemars(extend("expert" = true))]
    pub period_ms: f64,
    /// Robots whose boards have other names, or only some of the parts; keyed by the robot's name in the run.
    pub robots: BTreeMap<String, RobotPorts>,
    /// True to open the world RPC, `/MoBeE/world`.
    pub world: bool,
    /// Folder for the world RPC's `save` and `load`. Without it both are refused.
    #[schemars(extend("format" = "folder"))]
    #[schemars(extend("expert" = true))]
    pub save_folder: Option<PathBuf>,
    /// True to open the ports of the parts (`/MoBeE/right_arm/rpc` and so on) and of the robots.
    pub parts: bool,
    /// Force-field controllers, by the name of the part. A part without one serves no `cmd:i`.
    #[schemars(extend("expert" = true))]
    pub force_field: BTreeMap<String, ForceFieldSettings>,
}

/// Names of one robot's filtered boards.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RobotPorts {
    /// Prefix of the part's name: `/icub` serves the boards under the robot's own names (the real boards must
    /// then have others). Default: `prefix` and the robot's name, `/MoBeE/icub`.
    pub prefix: Option<String>,
    /// Parts to serve; default: all.
    pub parts: Option<Vec<String>>,
}

impl Default for YarpSettings {
    fn default() -> YarpSettings {
        YarpSettings {
            prefix: "/MoBeE".into(),
            name_server: None,
            start_name_server: true,
            allow_open_network: false,
            without_auth: false,
            dialect: 3,
            filter: true,
            speed: 0.1,
            period_ms: 10.0,
            robots: BTreeMap::new(),
            world: true,
            save_folder: None,
            parts: true,
            force_field: BTreeMap::new(),
        }
    }
}

impl YarpSettings {
    /// Checks every setting.
    ///
    /// # Errors
    /// The first invalid setting, with the valid values.
    pub fn validate(&self) -> Result<(), KindError> {
        let check = |good: bool, path: &str, what: String, help: &str| {
            if good { Ok(()) } else { Err(KindError::new(path, what, help)) }
        };
        let far = self.name_server.filter(|a| !a.ip().is_loopback() && !self.allow_open_network);
        let own = |(robot, ports): (&String, &RobotPorts)| {
            Some(check_name(&format!("robots.{robot}.prefix"), ports.prefix.as_ref()?))
        };
        let fields = self.force_field.iter().map(|(part, f)| f.validate(&format!("force_field.{part}")));
        let all = [
            check_name("prefix", &self.prefix),
            check(
                matches!(self.dialect, 3 | 4),
                "dialect",
                format!("there is no YARP dialect {}", self.dialect),
                "write 3, or 4 if all your YARP programs are of version 4",
            ),
            // written so that NaN fails
            check(
                self.period_ms >= 1.0 && self.period_ms <= 1000.0,
                "period_ms",
                format!("{} is no usable time between two messages", self.period_ms),
                "give a number from 1 to 1000",
            ),
            check(
                self.speed > 0.0 && self.speed <= 1.0,
                "speed",
                format!("{} is not a share of the maximum speed", self.speed),
                "give a number above 0 and up to 1",
            ),
            check(
                far.is_none(),
                "name_server",
                far.map_or(String::new(), |a| format!("{a} is on another computer, and only this one may be used")),
                "set allow_open_network = true if that network is yours alone",
            ),
            check(
                self.filter || self.world || self.parts,
                "",
                "this table opens no port at all".into(),
                "leave `filter`, `world` or `parts` true, or remove the table",
            ),
            check(
                self.parts || self.force_field.is_empty(),
                "force_field",
                "with parts = false no port serves these controllers".into(),
                "set parts = true, or remove the table",
            ),
        ];
        KindError::gather(all.into_iter().chain(self.robots.iter().filter_map(own)).chain(fields))?;
        Ok(())
    }

    /// Checks the robots, parts and joints that are named in the settings against the existing ones.
    ///
    /// # Errors
    /// Every unknown name, every list whose length is not the number of joints, and every port that two
    /// robots would open.
    pub fn check_robots(&self, robots: &[Arc<Robot>]) -> Result<(), KindError> {
        let names: Vec<&str> = robots.iter().map(|r| r.name.as_str()).collect();
        let parts_of = |r: &Robot| r.parts.iter().map(|p| p.name.clone()).collect::<Vec<_>>();
        let unknown = |path: String, what: &str, name: &str, known: &[&str]| {
            Err(KindError::new(path, format!("there is no {what} `{name}`"), suggestion(name, what, known)))
        };
        let mut all = Vec::new();
        for (name, ports) in &self.robots {
            let Some(robot) = robots.iter().find(|r| r.name == *name) else {
                all.push(unknown(format!("robots.{name}"), "robot", name, &names));
                continue;
            };
            let known = parts_of(robot);
            let known: Vec<&str> = known.iter().map(String::as_str).collect();
            for (i, part) in ports.parts.iter().flatten().enumerate().filter(|(_, p)| !known.contains(&p.as_str())) {
                all.push(unknown(format!("robots.{name}.parts[{i}]"), "part", part, &known));
            }
        }
        let known: Vec<String> = robots.iter().flat_map(|r| parts_of(r)).collect();
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        for (name, field) in &self.force_field {
            let part = robots.iter().flat_map(|r| &r.parts).find(|p| p.name == *name);
            all.push(match part {
                None => unknown(format!("force_field.{name}"), "part", name, &known),
                Some(part) => field.check_joints(part.motors.len()).map_err(|what| {
                    KindError::new(format!("force_field.{name}"), what, "give one number per joint of the part")
                }),
            });
        }
        for (i, a) in robots.iter().enumerate().filter(|_| self.filter) {
            let twin = robots.iter().take(i).find(|b| self.robot_prefix(&a.name) == self.robot_prefix(&b.name));
            if let Some(b) = twin {
                let what = format!("{} and {} would open ports of the same names", b.name, a.name);
                let path = format!("robots.{}.prefix", a.name);
                all.push(Err(KindError::new(path, what, "give each robot a prefix of its own")));
            }
        }
        KindError::gather(all)?;
        Ok(())
    }

    /// True if anyone who reaches the ports could use them although the settings do not state that this is
    /// intended.
    pub fn is_unguarded(&self) -> bool {
        self.allow_open_network && !self.without_auth && self.network().is_ok_and(|n| n.auth().is_none())
    }

    /// Network of these settings and of YARP's own configuration.
    ///
    /// # Errors
    /// A message with the remedy.
    pub fn network(&self) -> Result<mobee_yarp::Network, String> {
        super::network::find(self)
    }

    /// Time between two messages of the state ports.
    pub(crate) fn period(&self) -> Duration {
        Duration::try_from_secs_f64(self.period_ms * 1e-3).unwrap_or(Duration::from_millis(10))
    }

    /// Prefix of the names of a robot's filtered boards.
    pub fn robot_prefix(&self, robot: &str) -> String {
        let own = self.robots.get(robot).and_then(|r| r.prefix.clone());
        own.unwrap_or_else(|| format!("{}/{robot}", self.prefix))
    }

    /// Names of all ports that are opened for these robots.
    pub fn port_names(&self, robots: &[Arc<Robot>]) -> Vec<String> {
        let mut names = Vec::new();
        let mut taken = BTreeSet::new();
        for robot in robots {
            let name = &robot.name;
            let own = format!("{}/{}", self.prefix, robot.name);
            for part in robot.parts.iter().filter(|part| self.serves(name, &part.name)) {
                let board = format!("{}/{}", self.robot_prefix(name), part.name);
                names.extend(["rpc:i", "command:i", "state:o", "stateExt:o"].map(|port| format!("{board}/{port}")));
            }
            if !self.parts {
                continue;
            }
            names.extend(["rpc", "collisions:o", "observation:o"].map(|port| format!("{own}/{port}")));
            for part in &robot.parts {
                let first = taken.insert(part.name.clone());
                let prefix = self.part_prefix(robot, &part.name, first, robots.iter().map(|r| r.name.as_str()));
                names.extend(["rpc", "state:o"].map(|port| format!("{prefix}/{port}")));
                names.extend(self.steers(&part.name, first).then(|| format!("{prefix}/cmd:i")));
            }
        }
        names.extend(self.world.then(|| format!("{}/world", self.prefix)));
        names
    }

    /// Prefix of the names of a part's own ports. `first` is true if no earlier robot has a part of this
    /// name.
    pub(crate) fn part_prefix<'a>(
        &self,
        robot: &Robot,
        part: &str,
        first: bool,
        mut robots: impl Iterator<Item = &'a str>,
    ) -> String {
        // the robot's own ports have its name, and the filtered board is at ROBOT/PART
        let is_free = first && robots.all(|name| name != part);
        if is_free { format!("{}/{part}", self.prefix) } else { format!("{}/{}/parts/{part}", self.prefix, robot.name) }
    }

    /// True if a part has a force-field controller.
    pub(crate) fn steers(&self, part: &str, first: bool) -> bool {
        first && self.force_field.contains_key(part)
    }

    /// True if a part of a robot has a filtered board.
    pub(crate) fn serves(&self, robot: &str, part: &str) -> bool {
        let chosen = self.robots.get(robot).and_then(|r| r.parts.as_ref());
        self.filter && chosen.is_none_or(|parts| parts.iter().any(|p| p == part))
    }
}

fn check_name(path: &str, name: &str) -> Result<(), KindError> {
    let fine = |c: char| c.is_ascii_graphic() && !matches!(c, '"' | '(' | ')' | '\\');
    if name.len() <= 200 && name.len() > 1 && name.starts_with('/') && !name.ends_with('/') && name.chars().all(fine) {
        return Ok(());
    }
    Err(KindError::new(path, format!("\"{name}\" can't begin a port's name"), "write something like /MoBeE"))
}
