//! A part's own RPC (`/MoBeE/<part>/rpc`): markers, frames and standstill, with the original's words and replies.
//!
//! ```text
//! list          the part's markers                     stpd [limit]  1 if nothing is commanded to go faster (deg/s), else 0
//! get MARKER    position and normal, world frame       tolo x y z    a point in the frame of the part's root
//! getn          the number of joints                   togl x y z    and back
//! clrt MARKER   taken for the original's sake: there is no trail to clear
//! ```

use crate::words::{self, line, string};
use mobee_model::Robot;
use mobee_yarp::{Bottle, Value};
use nalgebra::{Isometry3, Point3};

/// What is known of a part when it is asked.
pub struct PartView<'a> {
    /// Its robot.
    pub robot: &'a Robot,
    /// Its index among the robot's parts.
    pub part: usize,
    /// Where the robot stands: `world_from_robot`.
    pub base: Isometry3<f64>,
    /// The robot's whole pose, rad.
    pub q: &'a [f64],
    /// The velocities commanded to the part's joints, deg/s.
    pub commanded: &'a [f64],
}

/// Answers a request; whatever is wrong is said in the reply.
pub fn answer(request: &Bottle, view: &PartView) -> Bottle {
    let rest = request.0.get(1..).unwrap_or_default();
    let verb = words::name(request.0.first());
    let trouble = || line("Handler encountered a problem :-(");
    match verb.as_deref() {
        Some("list") => Bottle(markers(view).map(string).collect()),
        Some("get") => marker(rest, view).unwrap_or_else(trouble),
        Some("getn") => {
            let joints = view.robot.parts.get(view.part).map_or(0, |p| p.motors.len());
            Bottle(vec![Value::Int32(i32::try_from(joints).unwrap_or(i32::MAX))])
        }
        Some("stpd") => {
            let most = words::number(rest.first()).unwrap_or_default();
            let still = view.commanded.iter().all(|v| v.abs() <= most);
            Bottle(vec![Value::Int32(i32::from(still))])
        }
        Some("tolo") => point(rest, view, |root, p| root.inverse_transform_point(&p)).unwrap_or_else(trouble),
        Some("togl") => point(rest, view, |root, p| root.transform_point(&p)).unwrap_or_else(trouble),
        Some("clrt") => match words::name(rest.first()) {
            Some(name) if markers(view).any(|m| *m == name) => Bottle(vec![]),
            _ => trouble(),
        },
        _ => Bottle(vec![string("Unknown RPC command: "), string(request.to_string())]),
    }
}

/// The positions of a part's joints as shares of their ranges: what its `state:o` sends.
pub fn shares(view: &PartView) -> Bottle {
    let motors = view.robot.parts.get(view.part).map(|p| p.motors.clone()).unwrap_or_default();
    let share = |i: usize| {
        let (motor, q) = (view.robot.motors.get(i)?, view.q.get(i)?);
        let range = motor.max - motor.min;
        Some(Value::Float64(if range > 0.0 { (q - motor.min) / range } else { 0.0 }))
    };
    Bottle(motors.filter_map(share).collect())
}

fn markers<'a>(view: &'a PartView) -> impl Iterator<Item = &'a String> {
    view.robot.markers.iter().filter(|m| m.part == view.part).map(|m| &m.name)
}

fn frames(view: &PartView) -> Vec<Isometry3<f64>> {
    let mut frames = Vec::with_capacity(view.robot.nodes.len());
    view.robot.forward_from(&view.base, view.q, &mut frames);
    frames
}

fn floats(values: impl IntoIterator<Item = f64>) -> Bottle {
    Bottle(values.into_iter().map(Value::Float64).collect())
}

fn marker(rest: &[Value], view: &PartView) -> Option<Bottle> {
    let name = words::name(rest.first())?;
    let marker = view.robot.markers.iter().find(|m| m.part == view.part && m.name == name)?;
    let frame = *frames(view).get(marker.node)?;
    let normal = frame.rotation * *marker.normal;
    Some(floats(frame.translation.vector.iter().chain(normal.iter()).copied()))
}

fn point(
    rest: &[Value],
    view: &PartView,
    turn: impl FnOnce(&Isometry3<f64>, Point3<f64>) -> Point3<f64>,
) -> Option<Bottle> {
    let [x, y, z] = words::exactly(rest)?;
    let root = view.robot.parts.get(view.part)?.root_node?;
    let turned = turn(frames(view).get(root)?, Point3::new(x, y, z));
    Some(floats(turned.coords.iter().copied()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::load_robot;
    use proptest::prelude::*;

    fn icub() -> Robot {
        load_robot(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/icub.xml")).unwrap().value
    }

    fn ask(robot: &Robot, part: usize, text: &str) -> Bottle {
        let q = robot.home();
        let base = Isometry3::translation(0.0, 0.0, 1.0);
        let view = PartView { robot, part, base, q: &q, commanded: &[0.5, -2.0] };
        answer(&Bottle::parse(text, Default::default()).unwrap(), &view)
    }

    #[test]
    fn markers_are_listed_and_found() {
        let robot = icub();
        let marker = robot.markers.first().unwrap();
        assert!(ask(&robot, marker.part, "list").to_string().contains(&marker.name));
        let at = robot.markers_at(&robot.home())[0].clone();
        let numbers = ask(&robot, marker.part, &format!("get {}", marker.name)).numbers().unwrap();
        assert_eq!(numbers.len(), 6);
        assert!((numbers[2] - at.position().z - 1.0).abs() < 1e-12, "in the world's frame");
        let other = (marker.part + 1) % robot.parts.len();
        let trouble = line("Handler encountered a problem :-(");
        assert_eq!(ask(&robot, other, &format!("get {}", marker.name)), trouble);
        assert_eq!(ask(&robot, marker.part, &format!("clrt {}", marker.name)), Bottle::new());
    }

    #[test]
    fn joints_standstill_and_frames_are_told() {
        let robot = icub();
        let part = robot.parts.iter().position(|p| p.name == "right_arm").unwrap();
        assert_eq!(ask(&robot, part, "getn").to_string(), robot.parts[part].motors.len().to_string());
        assert_eq!(ask(&robot, part, "stpd").to_string(), "0");
        assert_eq!(ask(&robot, part, "stpd 2.0").to_string(), "1");
        let local = ask(&robot, part, "tolo 0.1 0.2 0.3");
        let back = ask(&robot, part, &format!("togl {local}")).numbers().unwrap();
        assert!(back.iter().zip([0.1, 0.2, 0.3]).all(|(a, b)| (a - b).abs() < 1e-9));
        assert_eq!(ask(&robot, part, "jump high").to_string(), "\"Unknown RPC command: \" \"jump high\"");
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        /// Any text is answered.
        #[test]
        fn no_request_harms(part in 0..9_usize, text in "(list|get|getn|stpd|tolo|togl|clrt|[a-z]{1,5})( (-?[0-9]{1,3}|nan|[a-z]+|\\(1 2\\)))*") {
            let robot = icub();
            ask(&robot, part, &text);
        }
    }
}
