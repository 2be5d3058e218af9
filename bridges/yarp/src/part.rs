//! YARP encoding of a part's RPC, with the original's words and replies.
//!
//! ```text
//! list          the part's markers                     stpd [limit]  1 if nothing is commanded to go faster (deg/s), else 0
//! get MARKER    position and normal, world frame       tolo x y z    a point in the frame of the part's root
//! getn          the number of joints                   togl x y z    and back
//! clrt MARKER   accepted for compatibility: there is no trail to clear
//! ```

use super::words::{self, line, string};
use mobee_filter::part_rpc::{self, PartRefusal, PartReply, PartRequest, PartView};
use mobee_yarp::{Bottle, Value};

/// Answers a request; errors are reported in the reply.
pub(crate) fn answer(request: &Bottle, view: &PartView) -> Bottle {
    match parse(request).and_then(|asked| part_rpc::answer(&asked, view)) {
        Ok(answer) => reply(&answer),
        Err(PartRefusal::Unknown) => Bottle(vec![string("Unknown RPC command: "), string(request.to_string())]),
        Err(PartRefusal::Malformed | PartRefusal::NoMarker | PartRefusal::NoRoot) => {
            line("Handler encountered a problem :-(")
        }
    }
}

fn parse(request: &Bottle) -> Result<PartRequest, PartRefusal> {
    let rest = request.0.get(1..).unwrap_or_default();
    let name = || words::name(rest.first()).ok_or(PartRefusal::Malformed);
    let point = || words::exactly(rest).ok_or(PartRefusal::Malformed);
    match words::name(request.0.first()).as_deref() {
        Some("list") => Ok(PartRequest::Markers),
        Some("get") => name().map(PartRequest::Marker),
        Some("getn") => Ok(PartRequest::Joints),
        Some("stpd") => Ok(PartRequest::IsStill(words::number(rest.first()).unwrap_or_default())),
        Some("tolo") => point().map(PartRequest::ToLocal),
        Some("togl") => point().map(PartRequest::ToGlobal),
        Some("clrt") => name().map(PartRequest::ClearTrail),
        _ => Err(PartRefusal::Unknown),
    }
}

fn reply(reply: &PartReply) -> Bottle {
    match reply {
        PartReply::Markers(names) => Bottle(names.iter().map(string).collect()),
        PartReply::Marker { position, normal } => floats(position.iter().chain(normal)),
        PartReply::Joints(count) => Bottle(vec![Value::Int32(i32::try_from(*count).unwrap_or(i32::MAX))]),
        PartReply::IsStill(still) => Bottle(vec![Value::Int32(i32::from(*still))]),
        PartReply::Point(at) => floats(at),
        PartReply::Cleared => Bottle(vec![]),
    }
}

/// Bottle of numbers.
pub(crate) fn floats<'a>(values: impl IntoIterator<Item = &'a f64>) -> Bottle {
    Bottle(values.into_iter().map(|x| Value::Float64(*x)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::{Robot, load_robot};
    use nalgebra::Isometry3;
    use proptest::prelude::*;

    fn icub() -> Robot {
        load_robot(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/icub.xml")).unwrap().value
    }

    fn reply_to(robot: &Robot, part: usize, text: &str) -> Bottle {
        let q = robot.home();
        let base = Isometry3::translation(0.0, 0.0, 1.0);
        let view = PartView { robot, part, base, q: &q, commanded: &[0.5, -2.0] };
        answer(&Bottle::parse(text, Default::default()).unwrap(), &view)
    }

    #[test]
    fn markers_are_listed_and_found() {
        let robot = icub();
        let marker = robot.markers.first().unwrap();
        assert!(reply_to(&robot, marker.part, "list").to_string().contains(&marker.name));
        let at = robot.markers_at(&robot.home())[0].clone();
        let numbers = reply_to(&robot, marker.part, &format!("get {}", marker.name)).numbers().unwrap();
        assert_eq!(numbers.len(), 6);
        assert!((numbers[2] - at.position().z - 1.0).abs() < 1e-12, "in the world's frame");
        let other = (marker.part + 1) % robot.parts.len();
        let trouble = line("Handler encountered a problem :-(");
        assert_eq!(reply_to(&robot, other, &format!("get {}", marker.name)), trouble);
        assert_eq!(reply_to(&robot, marker.part, &format!("clrt {}", marker.name)), Bottle::new());
    }

    #[test]
    fn joints_standstill_and_frames_are_reported() {
        let robot = icub();
        let part = robot.parts.iter().position(|p| p.name == "right_arm").unwrap();
        assert_eq!(reply_to(&robot, part, "getn").to_string(), robot.parts[part].motors.len().to_string());
        assert_eq!(reply_to(&robot, part, "stpd").to_string(), "0");
        assert_eq!(reply_to(&robot, part, "stpd 2.0").to_string(), "1");
        let local = reply_to(&robot, part, "tolo 0.1 0.2 0.3");
        let back = reply_to(&robot, part, &format!("togl {local}")).numbers().unwrap();
        assert!(back.iter().zip([0.1, 0.2, 0.3]).all(|(a, b)| (a - b).abs() < 1e-9));
        assert_eq!(reply_to(&robot, part, "jump high").to_string(), "\"Unknown RPC command: \" \"jump high\"");
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        /// Every text gets a reply.
        #[test]
        fn no_request_harms(part in 0..9_usize, text in "(list|get|getn|stpd|tolo|togl|clrt|[a-z]{1,5})( (-?[0-9]{1,3}|nan|[a-z]+|\\(1 2\\)))*") {
            let robot = icub();
            reply_to(&robot, part, &text);
        }
    }
}
