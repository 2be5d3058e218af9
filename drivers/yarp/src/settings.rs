//! Settings of a robot behind YARP.

use mobee_contract::KindError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Settings of a robot behind YARP: its control boards, and the connections to them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct YarpDriverSettings {
    /// The control boards, one per part of the robot model. Motors of parts without a board rest at home and accept no commands.
    pub parts: Vec<PartSettings>,
    /// Address of the name server, `HOST:PORT`. Default: from YARP's own files and environment, or `127.0.0.1:10000` if they
    /// give none.
    #[serde(default)]
    pub server: Option<String>,
    /// Prefix of our own port names; default: `/MoBeE/ROBOT/driver`.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub name: Option<String>,
    /// Address of this machine on which our ports listen; default: 127.0.0.1, for this machine only. YARP has
    /// no encryption: anyone who can reach these ports can send wrong states.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub listen: Option<String>,
    /// Carrier of states and streamed commands: `fast_tcp`, `tcp` or `udp`.
    #[serde(default = "carrier")]
    #[schemars(extend("expert" = true))]
    pub carrier: String,
    /// Dialect of the robot's network: `3.x` (all iCub software so far) or `4.x`.
    #[serde(default = "dialect")]
    pub dialect: String,
    /// Time between two states of a board, ms.
    #[serde(default = "period_ms")]
    #[schemars(extend("expert" = true))]
    pub period_ms: f64,
    /// Upper bound of the time from a command to its effect, including the network, ms.
    #[serde(default = "latency_ms")]
    #[schemars(extend("expert" = true))]
    pub latency_ms: f64,
    /// A board whose state is older than this is stale, ms.
    #[serde(default = "stale_ms")]
    #[schemars(extend("expert" = true))]
    pub stale_ms: f64,
    /// Time limit of an answer, ms.
    #[serde(default = "timeout_ms")]
    #[schemars(extend("expert" = true))]
    pub timeout_ms: f64,
    /// Time limit for reaching all boards at the start, s.
    #[serde(default = "connect_s")]
    #[schemars(extend("expert" = true))]
    pub connect_s: f64,
    /// Maximum speed of every motor, deg/s, unless the board allows less.
    #[serde(default = "max_speed")]
    pub max_speed_deg_per_s: f64,
    /// Maximum acceleration of every motor, also in braking, deg/s^2.
    #[serde(default = "max_acceleration")]
    pub max_acceleration_deg_per_s2: f64,
    /// Greatest distance at which a joint may rest from its commanded position under weight that nothing
    /// compensates, deg: the greatest load over the stiffness of its servo. Prismatic joints are assumed to
    /// have none. 0: the boards bring joints to their targets, as an integral term does.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub hold_error_deg: f64,
    /// Greatest distance by which a push moves a joint from its commanded position, deg: the greatest torque over
    /// the stiffness of its servo. Joints that no command names but a contact has bent then join the retreat.
    /// Prismatic joints are assumed not to give way. 0: the joints do not give way, or it is unknown.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub deflection_deg: f64,
    /// Resolution of the encoders, deg or mm: one count, or four standard deviations of their noise. Default:
    /// estimated from the states at the connection, which can't detect a coarse encoder that rests on one
    /// count (a turn of 4,096 counts: 0.088).
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub resolution_deg: Option<f64>,
    /// True if the boards accept position-direct setpoints. The retreat streams them; otherwise it uses a
    /// reduced set of waypoints.
    #[serde(default = "yes")]
    #[schemars(extend("expert" = true))]
    pub position_direct: bool,
    /// Method of moves: `position` sends the boards targets and reference speeds; `set-points` streams a
    /// trajectory of our own, for boards that do not honor reference speeds, such as iCub_SIM's.
    #[serde(default)]
    pub moves: Moves,
}

/// Method of moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Moves {
    /// The boards' own moves, at reference speeds.
    #[default]
    Position,
    /// Position-direct setpoints of a trajectory of our own.
    SetPoints,
}

/// One control board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PartSettings {
    /// Name of the part in the robot model, such as `torso`.
    pub part: String,
    /// Prefix of the board's port names, such as `/icub/torso`.
    pub port: String,
}

fn carrier() -> String {
    "fast_tcp".into()
}
fn dialect() -> String {
    "3.x".into()
}
fn period_ms() -> f64 {
    20.0
}
fn latency_ms() -> f64 {
    60.0
}
fn stale_ms() -> f64 {
    200.0
}
fn timeout_ms() -> f64 {
    500.0
}
fn connect_s() -> f64 {
    5.0
}
fn max_speed() -> f64 {
    50.0
}
fn max_acceleration() -> f64 {
    200.0
}
fn yes() -> bool {
    true
}

impl YarpDriverSettings {
    /// Settings of these boards, with default values.
    pub fn of<'a>(parts: impl IntoIterator<Item = (&'a str, &'a str)>) -> YarpDriverSettings {
        let part = |(part, port): (&str, &str)| PartSettings { part: part.into(), port: port.into() };
        YarpDriverSettings {
            parts: parts.into_iter().map(part).collect(),
            server: None,
            name: None,
            listen: None,
            carrier: carrier(),
            dialect: dialect(),
            period_ms: period_ms(),
            latency_ms: latency_ms(),
            stale_ms: stale_ms(),
            timeout_ms: timeout_ms(),
            connect_s: connect_s(),
            max_speed_deg_per_s: max_speed(),
            max_acceleration_deg_per_s2: max_acceleration(),
            hold_error_deg: 0.0,
            deflection_deg: 0.0,
            resolution_deg: None,
            position_direct: true,
            moves: Moves::Position,
        }
    }

    /// Checks every setting that can be checked without a robot.
    ///
    /// # Errors
    /// The first invalid setting, with the valid range.
    pub fn validate(&self) -> Result<(), KindError> {
        let ranges = [
            ("period_ms", self.period_ms, 1.0, 1000.0),
            ("latency_ms", self.latency_ms, 0.0, 10_000.0),
            ("stale_ms", self.stale_ms, 2.0 * self.period_ms, 10_000.0),
            ("timeout_ms", self.timeout_ms, 10.0, 60_000.0),
            ("connect_s", self.connect_s, 0.0, 600.0),
            ("max_speed_deg_per_s", self.max_speed_deg_per_s, 0.1, 10_000.0),
            ("max_acceleration_deg_per_s2", self.max_acceleration_deg_per_s2, 0.1, 1e6),
            ("hold_error_deg", self.hold_error_deg, 0.0, 30.0),
            ("deflection_deg", self.deflection_deg, 0.0, 90.0),
            ("resolution_deg", self.resolution_deg.unwrap_or_default(), 0.0, 10.0),
        ];
        let number = |(name, value, least, most): (&str, f64, f64, f64)| {
            // written so that NaN fails
            if value >= least && value <= most {
                return Ok(());
            }
            let what = format!("{value} is not a usable value here");
            Err(KindError::new(name, what, format!("give a number from {least} to {most}")))
        };
        let ports = self.parts.iter().enumerate().map(|(i, p)| rooted(&format!("parts[{i}].port"), &p.port));
        let words = [self.board(), self.name.as_ref().map_or(Ok(()), |name| rooted("name", name)), self.words()];
        KindError::gather(ranges.into_iter().map(number).chain(ports).chain(words))?;
        Ok(())
    }

    fn board(&self) -> Result<(), KindError> {
        let help = "name at least one board: parts = [{ part = \"torso\", port = \"/icub/torso\" }]";
        if self.parts.is_empty() { Err(KindError::new("parts", "the robot has no board", help)) } else { Ok(()) }
    }

    fn words(&self) -> Result<(), KindError> {
        if self.moves == Moves::SetPoints && !self.position_direct {
            let what = "moves can't be made of set-points without `position_direct`";
            return Err(KindError::new("moves", what, "set position_direct = true, or moves = \"position\""));
        }
        if let Some(listen) = &self.listen
            && listen.parse::<std::net::IpAddr>().is_err()
        {
            let help = "give this machine's address in the robot's network, such as 10.0.0.12, or 0.0.0.0 for all";
            return Err(KindError::new("listen", format!("`{listen}` is not an address"), help));
        }
        if !["fast_tcp", "tcp", "udp"].contains(&self.carrier.as_str()) {
            let what = format!("a robot's states can't be carried by `{}`", self.carrier);
            return Err(KindError::new("carrier", what, "choose fast_tcp, tcp or udp"));
        }
        if self.dialect == "4.x" {
            let what = "the control boards of YARP 4 answer other questions, which are not built in yet";
            return Err(KindError::new("dialect", what, "run the robot's boards under YARP 3, or bridge them"));
        }
        if self.dialect != "3.x" {
            return Err(KindError::new("dialect", format!("there is no dialect `{}`", self.dialect), "choose 3.x"));
        }
        Ok(())
    }

    /// Time between two states.
    pub fn period(&self) -> Duration {
        millis(self.period_ms)
    }

    /// Time from a command to its effect.
    pub fn latency(&self) -> Duration {
        millis(self.latency_ms)
    }

    /// Age at which a state is stale.
    pub fn stale(&self) -> Duration {
        millis(self.stale_ms)
    }

    /// Time limit of an answer.
    pub fn timeout(&self) -> Duration {
        millis(self.timeout_ms)
    }

    /// Time limit for reaching all boards at the start.
    pub fn patience(&self) -> Duration {
        millis(1e3 * self.connect_s)
    }
}

fn millis(ms: f64) -> Duration {
    Duration::try_from_secs_f64(1e-3 * ms).unwrap_or_default()
}

fn rooted(path: &str, name: &str) -> Result<(), KindError> {
    if name.starts_with('/') && name.len() > 1 && !name.ends_with('/') && !name.contains(char::is_whitespace) {
        return Ok(());
    }
    let help = "port names begin with a slash, end without one and contain no blanks: /icub/torso";
    Err(KindError::new(path, format!("`{name}` is not a valid port name"), help))
}
