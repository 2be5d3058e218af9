//! Profiles of real arms: servos, weight, encoders and boards; and user-defined values.

use mobee_contract::KindError;
use mobee_model::{JointMotion, Robot};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Servo of one joint, per radian of encoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// Stiffness, N m/rad.
    pub stiffness: f64,
    /// Damping, N m s/rad.
    pub damping: f64,
    /// Greatest torque, N m.
    pub torque: f64,
    /// Inertia, kg m^2, including the arm's share.
    pub inertia: f64,
    /// Share of the inertia that is the rotor's, kg m^2.
    pub rotor: f64,
    /// Dry friction, N m.
    pub friction: f64,
    /// Share of the commanded speed that is fed forward, 0 to 1. Without it, the servo lags by damping /
    /// stiffness seconds.
    pub lead: f64,
    /// Value of one radian of encoder in the joint's own unit: 1 for revolute, in meters for prismatic
    /// joints.
    pub unit: f64,
    /// Mechanical end stops, rad of encoder.
    pub stops: (f64, f64),
}

/// Factor on the inertia of a joint when other joints move with it.
const COUPLED: f64 = 2.0;

impl Servo {
    /// Distance by which it overshoots its commanded path if that brakes at `acceleration`, rad/s^2; rad.
    pub fn overshoot(&self, acceleration: f64) -> f64 {
        COUPLED * self.inertia * acceleration / self.stiffness.max(1e-6)
    }
}

/// Model of an arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ArmProfile {
    /// Kinematic joints: always at the commanded position, without weight, lag or force.
    Ideal,
    /// Generic arm: weight compensated, servos of 5 to 6 Hz that lag a little, a 16-bit encoder.
    Arm,
    /// Arms of an iCub: stiff position loops of a board that compensates the weight by its integral term.
    Icub,
    /// Franka Panda: weight compensated, servo gains and torques of its MuJoCo Menagerie model.
    Panda,
    /// Universal Robots UR5: weight compensated, gains and torques of the UR5e of the MuJoCo Menagerie.
    Ur5,
    /// SO-101, six STS3215 hobby servos: 4,096 counts per turn, no weight compensation.
    So101,
}

/// Commanded position of a board after a stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum StopRule {
    /// The board brakes along its commanded path and holds its end.
    #[default]
    Commanded,
    /// The board holds the position that its encoder reads.
    Measured,
}

/// Condition on which a board reports a move as done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum DoneRule {
    /// The commanded trajectory has ended.
    #[default]
    Trajectory,
    /// The joint is also within half a degree of its target.
    Arrived,
}

/// Kind of torque that a board reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EffortReport {
    /// The external torque, by torque sensors and a model of the arm.
    External,
    /// The servo's load: its own torque.
    Load,
}

/// Servos, weight and board of a simulated arm. Values that are not given are the profile's. Lists start at
/// the base; the last number applies to all joints that follow.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ServoSettings {
    /// Stiffness of the position servo, N m/rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stiffness_nm_per_rad: Option<Vec<f64>>,
    /// Damping, N m s/rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damping_nms_per_rad: Option<Vec<f64>>,
    /// Greatest torque, N m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque_nm: Option<Vec<f64>>,
    /// Inertia moved by a joint, kg m^2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inertia_kgm2: Option<Vec<f64>>,
    /// Dry friction, N m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction_nm: Option<Vec<f64>>,
    /// Share of the commanded speed that the servo feeds forward, 0 to 1; without it, the servo lags by
    /// damping / stiffness seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lead: Option<f64>,
    /// Mass of all moving links, kg, distributed over their shapes by volume.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<f64>,
    /// Share of the weight that the arm's own controller compensates, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compensated: Option<f64>,
    /// Stiffness of contacts, N/m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact_n_per_m: Option<f64>,
    /// Commanded position after a stop: `commanded` or `measured`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop: Option<StopRule>,
    /// Condition on which a move is reported as done: `trajectory` or `arrived`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub done: Option<DoneRule>,
    /// True if the board applies reference accelerations; otherwise it accepts them but keeps its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub honors_acceleration: Option<bool>,
}

/// Numbers of a profile.
#[derive(Clone, Copy, Debug)]
pub struct ArmNumbers {
    stiffness: &'static [f64],
    damping: &'static [f64],
    torque: &'static [f64],
    inertia: &'static [f64],
    friction: &'static [f64],
    rotor: f64,
    lead: f64,
    mass: f64,
    compensated: f64,
    /// Greatest accelerations, deg/s^2; empty if they are not known.
    acceleration: &'static [f64],
    /// Encoder resolution, deg.
    pub resolution_deg: f64,
    /// Encoder noise, deg.
    pub noise_deg: f64,
    stop: StopRule,
    /// Kind of torque that it reports.
    pub reports: EffortReport,
}

/// Prismatic joints (fingers) of every profile: N/m, N s/m, N, kg.
const SLIDE: [f64; 4] = [2_000.0, 60.0, 40.0, 0.1];
/// Greatest sag of an arm under its own weight, rad; more indicates an overload.
const MOST_SAG: f64 = 6.0 * std::f64::consts::PI / 180.0;
/// Share of a joint's greatest torque above which a reported torque indicates a contact, by kind of report:
/// load includes the weight.
const CONTACT_EFFORT: (f64, f64) = (0.1, 0.6);
/// Stiffness of a contact between links of metal or hard plastic, N/m.
const CONTACT: f64 = 30_000.0;

/// Plausible arm, not a real one: critically damped servos of 35 rad/s, between an iCub's and a UR5's; inertia and
/// torque of an arm of 8 kg.
const ARM: ArmNumbers = ArmNumbers {
    stiffness: &[1200.0, 1200.0, 750.0, 370.0, 120.0],
    damping: &[70.0, 70.0, 43.0, 21.0, 7.0],
    torque: &[80.0, 80.0, 60.0, 30.0, 12.0],
    inertia: &[1.0, 1.0, 0.6, 0.3, 0.1],
    friction: &[0.8, 0.8, 0.6, 0.3, 0.1],
    rotor: 0.05,
    lead: 0.9,
    mass: 8.0,
    compensated: 1.0,
    acceleration: &[],
    resolution_deg: 360.0 / 65_536.0,
    noise_deg: 0.001,
    stop: StopRule::Commanded,
    reports: EffortReport::External,
};

/// Torques: iCub arm data sheet (shoulder 40, elbow 20, wrist 0.65 N m); stiffness and inertia estimated.
const ICUB: ArmNumbers = ArmNumbers {
    stiffness: &[800.0, 800.0, 500.0, 300.0, 60.0],
    damping: &[40.0, 40.0, 25.0, 15.0, 3.0],
    torque: &[40.0, 40.0, 40.0, 20.0, 8.0],
    inertia: &[0.6, 0.6, 0.3, 0.15, 0.02],
    friction: &[1.0, 1.0, 0.6, 0.4, 0.05],
    rotor: 0.05,
    lead: 1.0,
    mass: 8.0,
    compensated: 1.0,
    acceleration: &[],
    resolution_deg: 0.01,
    noise_deg: 0.005,
    stop: StopRule::Commanded,
    reports: EffortReport::External,
};

/// MuJoCo Menagerie, franka_emika_panda: gains, force ranges, armature 0.1; link inertia estimated. Accelerations:
/// the limits of the Franka Control Interface.
const PANDA: ArmNumbers = ArmNumbers {
    stiffness: &[4500.0, 4500.0, 3500.0, 3500.0, 2000.0],
    damping: &[450.0, 450.0, 350.0, 350.0, 200.0],
    torque: &[87.0, 87.0, 87.0, 87.0, 12.0],
    inertia: &[1.2, 1.2, 0.8, 0.6, 0.2],
    friction: &[0.5, 0.5, 0.5, 0.5, 0.2],
    rotor: 0.1,
    lead: 1.0,
    mass: 16.0,
    compensated: 1.0,
    acceleration: &[859.0, 429.0, 572.0, 716.0, 859.0, 1145.0],
    resolution_deg: 0.0005,
    noise_deg: 0.0005,
    stop: StopRule::Commanded,
    reports: EffortReport::External,
};

/// MuJoCo Menagerie, universal_robots_ur5e: gains and force ranges of its size3 and size1 joints;
/// link inertia estimated.
const UR5: ArmNumbers = ArmNumbers {
    stiffness: &[2000.0, 2000.0, 2000.0, 500.0],
    damping: &[400.0, 400.0, 400.0, 100.0],
    torque: &[150.0, 150.0, 150.0, 28.0],
    inertia: &[2.0, 2.0, 1.0, 0.2],
    friction: &[2.0, 2.0, 2.0, 0.5],
    rotor: 0.1,
    lead: 1.0,
    mass: 18.0,
    compensated: 1.0,
    acceleration: &[],
    resolution_deg: 0.001,
    noise_deg: 0.001,
    stop: StopRule::Commanded,
    reports: EffortReport::External,
};

/// STS3215: 4,096 counts, stall torque 2.9 N m at 12 V; gain and armature of the SO-101's MuJoCo model.
const SO101: ArmNumbers = ArmNumbers {
    stiffness: &[17.8],
    damping: &[1.1],
    torque: &[2.9],
    inertia: &[0.05, 0.05, 0.04, 0.03],
    friction: &[0.05],
    rotor: 0.028,
    lead: 0.0,
    mass: 0.5,
    compensated: 0.0,
    acceleration: &[],
    resolution_deg: 360.0 / 4096.0,
    noise_deg: 0.0,
    stop: StopRule::Measured,
    reports: EffortReport::Load,
};

impl ArmProfile {
    /// Profile of the robot with one of these names, of which the first has priority; [`ArmProfile::Arm`] if none
    /// belongs to a robot with a profile of its own.
    pub fn of_robot<'a>(names: impl IntoIterator<Item = &'a str>) -> ArmProfile {
        let of = |name: &str| {
            let name = name.to_lowercase();
            let plain: String = name.chars().filter(char::is_ascii_alphanumeric).collect();
            let has = |words: &[&str]| {
                let mut tokens = name.split(|c: char| !c.is_ascii_alphanumeric());
                tokens.any(|token| words.contains(&token))
            };
            if plain.contains("icub") {
                Some(ArmProfile::Icub)
            } else if plain.contains("panda") || has(&["fr3"]) {
                Some(ArmProfile::Panda)
            } else if plain.contains("so100") || plain.contains("so101") || plain.contains("soarm10") {
                Some(ArmProfile::So101)
            } else if has(&["ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e", "ur20", "ur30"]) {
                Some(ArmProfile::Ur5)
            } else {
                None
            }
        };
        names.into_iter().find_map(of).unwrap_or(ArmProfile::Arm)
    }

    /// Its numbers; `None` for kinematic joints.
    pub fn numbers(self) -> Option<ArmNumbers> {
        match self {
            ArmProfile::Ideal => None,
            ArmProfile::Arm => Some(ARM),
            ArmProfile::Icub => Some(ICUB),
            ArmProfile::Panda => Some(PANDA),
            ArmProfile::Ur5 => Some(UR5),
            ArmProfile::So101 => Some(SO101),
        }
    }
}

impl ArmNumbers {
    /// Greatest acceleration of a joint, by its number from the base, deg/s^2; `None` if it is not known.
    pub fn acceleration_deg(&self, joint: usize) -> Option<f64> {
        self.acceleration.get(joint).or(self.acceleration.last()).copied()
    }
}

/// Behavior of the board that moves such an arm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardRules {
    /// Commanded position after a stop.
    pub stop: StopRule,
    /// Condition on which it reports a move as done.
    pub done: DoneRule,
    /// True if it accepts reference accelerations but ignores them.
    pub ignores_acceleration: bool,
}

impl ServoSettings {
    /// Rules of the board under these settings.
    pub fn rules(&self, numbers: &ArmNumbers) -> BoardRules {
        BoardRules {
            stop: self.stop.unwrap_or(numbers.stop),
            done: self.done.unwrap_or_default(),
            ignores_acceleration: !self.honors_acceleration.unwrap_or(true),
        }
    }

    /// Servos of a robot's motors.
    pub fn servos(&self, numbers: &ArmNumbers, robot: &Robot) -> Vec<Servo> {
        let [stiffness, damping, torque, inertia, friction] = [
            (&self.stiffness_nm_per_rad, numbers.stiffness),
            (&self.damping_nms_per_rad, numbers.damping),
            (&self.torque_nm, numbers.torque),
            (&self.inertia_kgm2, numbers.inertia),
            (&self.friction_nm, numbers.friction),
        ]
        .map(|(own, given)| own.as_deref().filter(|own| !own.is_empty()).unwrap_or(given));
        let nth = |list: &[f64], i: usize| list.get(i).or(list.last()).copied().unwrap_or_default();
        let first = |part: usize| robot.parts.get(part).map_or(0, |p| p.motors.start);
        let servo = |(m, motor): (usize, &mobee_model::Motor)| {
            let i = m.saturating_sub(first(motor.part));
            let lead = self.lead.unwrap_or(numbers.lead);
            match motor.motion {
                JointMotion::Turn => Servo {
                    stiffness: nth(stiffness, i),
                    damping: nth(damping, i),
                    torque: nth(torque, i),
                    inertia: nth(inertia, i),
                    friction: nth(friction, i),
                    rotor: numbers.rotor,
                    lead,
                    unit: 1.0,
                    stops: (motor.min, motor.max),
                },
                JointMotion::Slide => {
                    // meters per radian of encoder
                    let unit = 1.0 / JointMotion::Slide.encoder(1.0);
                    let [stiffness, damping, force, mass] = SLIDE;
                    Servo {
                        stiffness: stiffness * unit * unit,
                        damping: damping * unit * unit,
                        torque: force * unit,
                        inertia: mass * unit * unit,
                        friction: 0.0,
                        rotor: mass * unit * unit,
                        lead,
                        unit,
                        stops: (motor.min, motor.max),
                    }
                }
            }
        };
        robot.motors.iter().enumerate().map(servo).collect()
    }

    /// Greatest displacement of a joint from its commanded position by weight, rad; zero if the arm's own
    /// controller compensates the weight.
    pub fn hold_error(&self, numbers: &ArmNumbers) -> f64 {
        let [_, felt, _] = self.body(numbers);
        if felt > 0.0 { MOST_SAG } else { 0.0 }
    }

    /// Displacement of a joint by a push at which the servo reaches its torque limit, rad, and the reported
    /// torque above which something pushes the joint, N m (N for prismatic joints).
    pub fn contact(&self, numbers: &ArmNumbers, servo: &Servo) -> (f64, f64) {
        let share = match numbers.reports {
            EffortReport::External => CONTACT_EFFORT.0,
            EffortReport::Load => CONTACT_EFFORT.1,
        };
        (servo.torque / servo.stiffness.max(1e-6), share * servo.torque / servo.unit)
    }

    /// Mass, kg, share of the weight that is not compensated, and stiffness of contacts, N/m.
    pub fn body(&self, numbers: &ArmNumbers) -> [f64; 3] {
        let compensated = self.compensated.unwrap_or(numbers.compensated);
        [self.mass_kg.unwrap_or(numbers.mass), 1.0 - compensated, self.contact_n_per_m.unwrap_or(CONTACT)]
    }

    /// Lists of numbers per joint, each with its name and valid range.
    fn lists(&self) -> [(&'static str, Option<&[f64]>, f64, f64); 5] {
        [
            ("stiffness_nm_per_rad", self.stiffness_nm_per_rad.as_deref(), 0.1, 1e6),
            ("damping_nms_per_rad", self.damping_nms_per_rad.as_deref(), 0.0, 1e6),
            ("torque_nm", self.torque_nm.as_deref(), 0.001, 1e6),
            ("inertia_kgm2", self.inertia_kgm2.as_deref(), 1e-4, 1e4),
            ("friction_nm", self.friction_nm.as_deref(), 0.0, 1e4),
        ]
    }

    /// True if it gives a number under this key.
    pub fn has(&self, key: &str) -> bool {
        serde_json::to_value(self).is_ok_and(|all| all.get(key).is_some())
    }

    /// Names of the lists without a number.
    pub fn empty_lists(&self) -> impl Iterator<Item = String> {
        let empty = self.lists().into_iter().filter(|(_, list, ..)| list.is_some_and(<[f64]>::is_empty));
        empty.map(|(name, ..)| format!("servo.{name}"))
    }

    /// Checks that every number has a joint.
    ///
    /// # Errors
    /// A list that is longer than the robot's longest part.
    pub fn fits(&self, robot: &Robot) -> Result<(), KindError> {
        let joints = robot.parts.iter().map(|part| part.motors.len()).max().unwrap_or(0);
        let long = |(name, list, ..): (&str, Option<&[f64]>, f64, f64)| match list.map_or(0, <[f64]>::len) {
            given if given > joints => Err(KindError::new(
                format!("servo.{name}"),
                format!("{given} numbers for {joints} joints: those from number {} on have no joint", joints + 1),
                format!("give {joints} numbers at most, from the base on; the last counts for all joints that follow"),
            )),
            _ => Ok(()),
        };
        KindError::gather(self.lists().map(long)).map(|_| ())
    }

    /// All numbers with their names and valid ranges.
    pub fn ranges(&self) -> Vec<(String, f64, f64, f64)> {
        let of_list = |(name, list, least, most): (&'static str, Option<&[f64]>, f64, f64)| {
            let list = list.unwrap_or_default().to_vec().into_iter().enumerate();
            list.map(move |(i, x)| (format!("servo.{name}[{i}]"), x, least, most))
        };
        let single = [
            ("lead", self.lead, 0.0, 1.0),
            ("mass_kg", self.mass_kg, 0.0, 1e4),
            ("compensated", self.compensated, 0.0, 1.0),
            ("contact_n_per_m", self.contact_n_per_m, 100.0, 1e7),
        ];
        let single = single.into_iter().filter_map(|(name, x, a, b)| Some((format!("servo.{name}"), x?, a, b)));
        self.lists().into_iter().flat_map(of_list).chain(single).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::ArmProfile;

    #[test]
    fn known_arms_are_found_by_name() {
        let known = [
            ("panda", ArmProfile::Panda),
            ("franka-fr3", ArmProfile::Panda),
            ("ur5e_robot", ArmProfile::Ur5),
            ("UR10", ArmProfile::Ur5),
            ("so101_new_calib", ArmProfile::So101),
            ("SO_ARM100", ArmProfile::So101),
            ("iCubGenova01", ArmProfile::Icub),
            ("z1", ArmProfile::Arm),
            ("contour5", ArmProfile::Arm),
        ];
        for (name, expected) in known {
            assert_eq!(ArmProfile::of_robot(["robot", name]), expected, "{name}");
        }
    }
}
