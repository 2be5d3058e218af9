//! Messages of a robot's collision and observation ports: its present contacts, in the original's form, and
//! its state.

use super::words::string;
use mobee_contract::Latest;
use mobee_filter::observation::{Collision, Touch, Touched};
use mobee_model::Robot;
use mobee_yarp::{Bottle, Value};

/// Contacts of a robot: `((i x y z) (j x y z))` with itself, `(i x y z "ROBOT")` (or `"OBSTACLE"`,
/// `"TARGET"`) with others; a single 0 if there are none. i is the number of the shape, x y z its point of
/// contact, world frame.
pub(crate) fn collisions(all: &[Collision]) -> Bottle {
    if all.is_empty() {
        return Bottle(vec![Value::Int32(0)]);
    }
    let list = |collision: &Collision| {
        let values = match collision {
            Collision::Own(a, b) => vec![Value::List(Bottle(touch(a))), Value::List(Bottle(touch(b)))],
            Collision::With(at, what) => {
                let mut list = touch(at);
                list.push(string(match what {
                    Touched::Robot => "ROBOT",
                    Touched::Obstacle => "OBSTACLE",
                    Touched::Target => "TARGET",
                }));
                list
            }
        };
        Value::List(Bottle(values))
    };
    Bottle(all.iter().map(list).collect())
}

fn touch(touch: &Touch) -> Vec<Value> {
    let mut list = vec![Value::Int32(i32::try_from(touch.shape).unwrap_or(i32::MAX))];
    list.extend(touch.at.coords.iter().map(|x| Value::Float64(*x)));
    list
}

/// State of a robot: `(time SECONDS) (state WORD) (contacts N) (part NAME (q ...)) ...` with positions in
/// degrees, or in millimeters for prismatic joints.
pub(crate) fn observation(robot: &Robot, latest: &Latest) -> Bottle {
    let entry = |key: &str, value: Value| Value::List(Bottle(vec![string(key), value]));
    let count = i32::try_from(latest.contacts.len()).unwrap_or(i32::MAX);
    let mut all = vec![
        entry("time", Value::Float64(latest.at.secs())),
        entry("state", string(latest.status.word())),
        entry("contacts", Value::Int32(count)),
    ];
    for part in &robot.parts {
        let q = latest.q.get(part.motors.clone()).unwrap_or_default();
        let q = Value::List(Bottle(q.iter().map(|q| Value::Float64(q.to_degrees())).collect()));
        all.push(Value::List(Bottle(vec![string("part"), string(&part.name), q])));
    }
    Bottle(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn contacts_are_reported_in_the_originals_form() {
        assert_eq!(collisions(&[]).to_string(), "0");
        let one = Touch { shape: 7, at: Point3::new(1.0, 2.0, 3.0) };
        let other = Touch { shape: 9, at: Point3::new(4.0, 5.0, 6.0) };
        let reported = collisions(&[Collision::With(one, Touched::Obstacle), Collision::Own(one, other)]);
        assert_eq!(reported.to_string(), "(7 1.0 2.0 3.0 OBSTACLE) ((7 1.0 2.0 3.0) (9 4.0 5.0 6.0))");
    }
}
