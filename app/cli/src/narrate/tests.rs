use super::*;
use mobee_contract::{CommitId, Hold};
use mobee_model::{Object, ObjectClass, Primitive, Shape, parse_robot};
use nalgebra::Isometry3;

const ARM: &str = r#"<ZeroPositionKinematicTree robotName="arm"><bodypart name="arm"><link z="0.2" radius="0.03">
  <motor name="pan"><joint z="1"><link x="0.3" radius="0.03">
  <motor name="elbow"><joint z="1"><link x="0.3" radius="0.03"/></joint></motor></link></joint></motor>
</link></bodypart></ZeroPositionKinematicTree>"#;

/// A narrator of an arm beside a ball, that has been told of the arm.
fn narrator() -> Narrator {
    let robot = parse_robot("arm.xml", ARM).unwrap().value;
    let shapes = vec![Primitive { shape: Shape::Sphere { radius: 0.05 }, pose: Isometry3::identity() }];
    let class = ObjectClass::Obstacle;
    let pose = Isometry3::translation(9.0, 0.0, 0.0);
    let ball = Object { name: "ball".into(), class, persistent: false, pose, shapes, color: None };
    let scene = Scene::new(vec![(robot.into(), Isometry3::identity())], vec![ball]).unwrap();
    let mut narrator = Narrator::new(&scene);
    let robot = Event::Robot {
        robot: "arm".into(),
        motors: vec!["pan".into(), "elbow".into()],
        sliding: Vec::new(),
        min: vec![-3.0; 2],
        max: vec![3.0; 2],
        max_speed: vec![1.0; 2],
        period: 0.02,
        fresh: 0.1,
        margin: 0.01,
        tolerance: 0.002,
        rest_speed: 0.01,
        resolution: 0.0,
        hold_error: 0.0,
        deflection: 0.0,
        constraints: Vec::new(),
    };
    assert_eq!(narrator.line(&robot), None);
    narrator
}

/// The forearm and the ball.
fn met(distance: f64) -> Contact {
    let pair = (ShapeId::Robot { robot: 0, node: 4, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
    Contact { pair, distance, points: Default::default() }
}

fn commit(motors: &[usize]) -> Event {
    let motors = motors.iter().map(|m| (*m, 0.5)).collect();
    let robot = "arm".into();
    let agent = "arm/agent".into();
    let target = vec![1.0, 0.0].into();
    Event::Commit { robot, id: CommitId(12), agent, target, escape: false, motors, stream: false }
}

fn outcome(outcome: Outcome, cause: Cause) -> Event {
    let at = |q: f64| -> Pose { vec![q, 0.0].into() };
    Event::Outcome {
        robot: "arm".into(),
        id: CommitId(12),
        outcome,
        q: at(0.001),
        safe: Some(at(0.0)),
        cause: Some(cause),
    }
}

fn state(status: Status) -> Event {
    Event::State { robot: "arm".into(), status }
}

#[test]
fn a_rollback_is_one_line_that_says_which_motors_what_met_and_where_it_rests() {
    let mut narrator = narrator();
    let began = narrator.line(&commit(&[0])).unwrap();
    assert_eq!((began.weight, began.text.as_str()), (Weight::Detail, "arm: motion 12 of arm/agent begins: pan"));
    let line = narrator.line(&outcome(Outcome::RolledBack, Cause::Contact(vec![met(0.0091), met(0.0095)]))).unwrap();
    assert_eq!((line.weight, line.kind), (Weight::News, "rolled back"));
    let expected = "arm: motion 12 was rolled back: arm arm: behind elbow came within 9.1 mm of ball (moved by pan), \
                    and 1 more pairs; rests where it began (0.1 deg from there)";
    assert_eq!(line.text, expected);
    narrator.line(&commit(&[0, 1]));
    let line = narrator.line(&outcome(Outcome::RolledBack, Cause::Contact(vec![met(-0.004)]))).unwrap();
    assert!(
        line.text.contains("came 4.0 mm deep into ball (moved by pan, elbow); rests where it began"),
        "{}",
        line.text
    );
    let line = narrator.line(&outcome(Outcome::RolledBack, Cause::Foreseen(vec![met(0.003)]))).unwrap();
    assert!(line.text.contains("would have come within 3.0 mm of ball"), "{}", line.text);
}

#[test]
fn what_was_asked_for_is_no_fault() {
    let mut narrator = narrator();
    narrator.line(&commit(&[0]));
    let text = |narrator: &mut Narrator| narrator.line(&outcome(Outcome::Faulted, Cause::Asked)).unwrap();
    let stopped = text(&mut narrator);
    assert_eq!((stopped.weight, stopped.text.as_str()), (Weight::Detail, "arm: motion 12 stopped on request"));
    narrator.line(&Event::Halted { robot: "arm".into() });
    assert_eq!(text(&mut narrator).text, "arm: motion 12 stopped: halted");
    narrator.line(&Event::Released { robot: "arm".into() });
    narrator.line(&state(Status::Holding(Hold::ShuttingDown)));
    assert_eq!(text(&mut narrator).text, "arm: motion 12 aborted: run ended");
}

#[test]
fn a_hold_says_what_touches() {
    let mut narrator = narrator();
    let names = ("arm:arm/4#0".to_owned(), "ball#0".to_owned());
    let began = Event::ContactBegan { robot: "arm".into(), contact: met(0.004), names, during: Status::Rest };
    assert_eq!(narrator.line(&began).unwrap().text, "arm: arm arm: behind elbow is 4.0 mm from ball");
    let holds = narrator.line(&state(Status::Holding(Hold::InContact))).unwrap();
    let expected = "arm: holds: arm arm: behind elbow is 4.0 mm from ball; clear it away, or an escape leads out";
    assert_eq!((holds.weight, holds.text.as_str()), (Weight::News, expected));
    assert_eq!(narrator.line(&state(Status::Rest)).unwrap().text, "arm: accepts motions again");
}

#[test]
fn a_refused_swap_names_its_remedy() {
    let why = "the state can't be taken over: it is of kind \"explorer\"".to_owned();
    let step = SwapStep::Refused { why };
    let line = narrator().line(&Event::Swap { robot: "arm".into(), part: SwapPart::Agent, step }).unwrap();
    assert_eq!(line.weight, Weight::Warning);
    assert!(
        line.text.ends_with("`mobee ctl swap agent FILE --fresh` starts it without the old one's state"),
        "{}",
        line.text
    );
}
