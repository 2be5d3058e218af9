//! A group of a robot's motors in settings: parts, motors, poses in degrees, with errors that name
//! the place and the remedy.

use mobee_contract::{Axis, KindError, Refusal, View, suggestion};
use mobee_model::{Robot, ShapeId};
use nalgebra::{Unit, Vector3};
use std::collections::BTreeMap;

/// Resolves part and motor names to motor indices, in the robot's order. A part stands for all of
/// its motors. A name of both a motor and a part denotes the motor, because the part can also be
/// given by its motors.
///
/// # Errors
/// Unknown names, a motor named twice, or an empty list.
pub fn motors(path: &str, names: &[String], robot: &Robot) -> Result<Vec<usize>, KindError> {
    let mut group: Vec<usize> = Vec::new();
    KindError::gather(names.iter().enumerate().map(|(i, name)| {
        let place = format!("{path}[{i}]");
        let is_motor = robot.motors.iter().any(|m| m.name == *name);
        let found: Vec<usize> = match robot.parts.iter().find(|p| !is_motor && p.name == *name) {
            Some(part) => part.motors.clone().collect(),
            None => vec![motor(&place, name, robot)?],
        };
        if found.iter().any(|m| group.contains(m)) {
            let help = "name each motor once; a part stands for all of its motors";
            return Err(KindError::new(place, format!("{name:?} names a motor a second time"), help));
        }
        group.extend(found);
        Ok(())
    }))?;
    if group.is_empty() {
        let parts: Vec<_> = robot.parts.iter().map(|p| p.name.as_str()).collect();
        let help = format!("name at least one part ({}) or motor", parts.join(", "));
        return Err(KindError::new(path, "no motor is named", help));
    }
    group.sort_unstable();
    Ok(group)
}

/// Returns the index of a motor.
///
/// # Errors
/// An unknown name, with the most similar known one.
pub fn motor(path: &str, name: &str, robot: &Robot) -> Result<usize, KindError> {
    robot.motors.iter().position(|m| m.name == name).ok_or_else(|| {
        let parts = robot.parts.iter().map(|p| p.name.as_str());
        let known: Vec<&str> = parts.chain(robot.motors.iter().map(|m| m.name.as_str())).collect();
        let help = suggestion(name, "motor", &known);
        KindError::new(path, format!("the robot {} has no motor {name:?}", robot.name), help)
    })
}

/// Returns the index of the marker of this name, if one is named.
///
/// # Errors
/// An unknown name, with the most similar known one.
pub fn marker(path: &str, name: Option<&str>, robot: &Robot) -> Result<Option<usize>, KindError> {
    let Some(name) = name else { return Ok(None) };
    let known: Vec<&str> = robot.markers.iter().map(|m| m.name.as_str()).collect();
    let index = known.iter().position(|m| *m == name);
    index.map(Some).ok_or_else(|| {
        let help = suggestion(name, "marker", &known);
        KindError::new(path, format!("the robot {} has no marker {name:?}", robot.name), help)
    })
}

/// Converts a table of motor positions in degrees (millimeters for prismatic joints) to (motor,
/// rad), in the robot's order.
///
/// # Errors
/// An unknown motor, a position that is not finite or outside the motor's limits, an empty table.
pub fn positions(path: &str, q_deg: &BTreeMap<String, f64>, robot: &Robot) -> Result<Vec<(usize, f64)>, KindError> {
    let mut all = KindError::gather(q_deg.iter().map(|(name, deg)| {
        let place = format!("{path}.{name}");
        let index = motor(&place, name, robot)?;
        Ok((index, within_limits(&place, index, *deg, robot)?))
    }))?;
    if all.is_empty() {
        return Err(KindError::new(path, "the pose names no motor", "give at least one motor's position in degrees"));
    }
    all.sort_by_key(|(m, _)| *m);
    Ok(all)
}

/// Converts a position in degrees (millimeters for prismatic joints) to rad within the limits of
/// its motor; excess up to 1e-6 rad counts as rounding.
///
/// # Errors
/// A position that is not finite, or outside the limits.
pub fn within_limits(path: &str, index: usize, deg: f64, robot: &Robot) -> Result<f64, KindError> {
    let q = deg.to_radians();
    match robot.motors.get(index) {
        Some(m) if q >= m.min - 1e-6 && q <= m.max + 1e-6 => Ok(q.clamp(m.min, m.max)),
        Some(m) => {
            let (min, max) = (m.min.to_degrees(), m.max.to_degrees());
            let unit = m.motion.unit();
            let help = format!("give {} from {min:.2} to {max:.2}", m.motion.unit_in_words());
            Err(KindError::new(path, format!("{deg} {unit} is outside the limits of {}", m.name), help))
        }
        None => Err(KindError::new(path, "there is no such motor", "name a motor of the robot")),
    }
}

/// Converts ranges in degrees (millimeters for prismatic joints) by motor to (motor, min, max) in
/// rad for each motor of a group, in its order. Motors without a range get their limits, continuous
/// joints one turn.
///
/// # Errors
/// An unknown motor or one outside the group, a reversed range, a position outside the motor's limits.
pub fn ranges(
    path: &str,
    range_deg: &BTreeMap<String, [f64; 2]>,
    motors: &[usize],
    robot: &Robot,
) -> Result<Vec<(usize, f64, f64)>, KindError> {
    let given = KindError::gather(range_deg.iter().map(|(name, [min, max])| {
        let path = format!("{path}.{name}");
        let motor = motor(&path, name, robot)?;
        if !motors.contains(&motor) {
            let help = "add the motor to `motors`, or remove its range";
            return Err(KindError::new(path, format!("{name} is not one of the moved motors"), help));
        }
        if min > max {
            let help = format!("write [{max}, {min}]");
            return Err(KindError::new(path, format!("the range is reversed: {min} is above {max}"), help));
        }
        let low = within_limits(&format!("{path}[0]"), motor, *min, robot)?;
        Ok((motor, (low, within_limits(&format!("{path}[1]"), motor, *max, robot)?)))
    }))?;
    let given: BTreeMap<usize, (f64, f64)> = given.into_iter().collect();
    let limits = |m: &usize| robot.motors.get(*m).map(mobee_model::Motor::range);
    let range = |m: &usize| given.get(m).copied().or_else(|| limits(m)).map(|(min, max)| (*m, min, max));
    Ok(motors.iter().filter_map(range).collect())
}

/// Clamps a range to the board's limits, rad: robots may have narrower limits than their model.
pub fn allowed((min, max): (f64, f64), axis: Option<&Axis>) -> (f64, f64) {
    axis.map_or((min, max), |axis| (min.clamp(axis.min, axis.max), max.clamp(axis.min, axis.max)))
}

/// Checks a share of the maximum speed.
///
/// # Errors
/// Anything but a number above 0 and up to 1.
pub fn speed(path: &str, share: f64) -> Result<f64, KindError> {
    if share > 0.0 && share <= 1.0 {
        return Ok(share);
    }
    let help = "give a share of each motor's maximum speed (not deg/s), above 0 and up to 1, such as 0.1";
    Err(KindError::new(path, format!("{share} is not a share of the maximum speed"), help))
}

/// Checks a time in seconds.
///
/// # Errors
/// Anything but 0 to a million seconds.
pub fn seconds(path: &str, s: f64) -> Result<std::time::Duration, KindError> {
    if (0.0..=1e6).contains(&s) {
        return Ok(std::time::Duration::from_secs_f64(s));
    }
    Err(KindError::new(path, format!("{s} is not a valid waiting time"), "give seconds, 0 or more"))
}

/// Checks the distance in degrees at which a pose counts as reached; returns rad.
///
/// # Errors
/// Anything but a number above 0 and up to 10.
pub fn tolerance(path: &str, deg: f64) -> Result<f64, KindError> {
    if deg > 0.0 && deg <= 10.0 {
        return Ok(deg.to_radians());
    }
    Err(KindError::new(
        path,
        format!("{deg} deg is not a valid tolerance"),
        "give degrees above 0 and up to 10, such as 0.5",
    ))
}

/// Normalizes a direction.
///
/// # Errors
/// Numbers that are not finite, or all zero.
pub fn direction(path: &str, v: [f64; 3]) -> Result<Unit<Vector3<f64>>, KindError> {
    let finite = v.iter().all(|x| x.is_finite());
    Unit::try_new(Vector3::from(v), 1e-6)
        .filter(|_| finite)
        .ok_or_else(|| KindError::new(path, "this direction has no length", "give a vector, such as [0, 0, -1]"))
}

/// Returns a whole configuration with these motors at `q`.
pub fn whole(motors: &[usize], pose: &[f64], q: &[f64]) -> Vec<f64> {
    let mut pose = pose.to_vec();
    for (motor, q) in motors.iter().zip(q) {
        if let Some(slot) = pose.get_mut(*motor) {
            *slot = *q;
        }
    }
    pose
}

/// Returns a robot's home configuration, rad.
pub fn home(robot: &Robot) -> Vec<f64> {
    robot.motors.iter().map(|m| m.home).collect()
}

/// Returns an example for the setting `motors`: the robot's first part with motors.
pub fn example_part(robot: &Robot) -> Option<&mobee_model::Part> {
    robot.parts.iter().find(|p| !p.motors.is_empty())
}

/// Returns an example of a pose in degrees: one motor of [`example_part`], moved by this share of
/// the distance from home to its farther limit, at most 20 degrees.
pub fn example_pose(robot: &Robot, share: f64) -> BTreeMap<String, f64> {
    let motors = example_part(robot).map(|p| p.motors.clone()).unwrap_or_default();
    let first = robot.motors.get(motors).and_then(<[_]>::first);
    let turned = |m: &mobee_model::Motor| {
        let way = if m.max - m.home > m.home - m.min { m.max - m.home } else { m.min - m.home };
        let deg = (m.home + way * share).to_degrees();
        let most = m.home.to_degrees() + 20f64.copysign(way);
        let deg = if way > 0.0 { deg.min(most) } else { deg.max(most) };
        (deg * 10.0).round() / 10.0
    };
    first.map(|m| (m.name.clone(), turned(m))).into_iter().collect()
}

/// Chooses the marker that represents the group's hand, an index into `Robot::markers`: the one
/// with most of the group's joints above it, and of those the one nearest the root, so that a palm
/// is preferred to a fingertip.
pub fn hand(robot: &Robot, group: &[usize]) -> Option<usize> {
    let rank = |node: usize| {
        let moved = movers(robot, node).filter(|motor| group.contains(motor)).count();
        (moved, above(robot, node).count())
    };
    let ranked = robot.markers.iter().enumerate().map(|(i, m)| (rank(m.node), i));
    ranked.min_by_key(|((moved, depth), i)| (std::cmp::Reverse(*moved), *depth, *i)).map(|(_, i)| i)
}

/// Returns the motors that move a node (an index into `Robot::nodes`), such as a marker's, nearest
/// first.
pub fn movers(robot: &Robot, node: usize) -> impl Iterator<Item = usize> {
    let motor = |node: &mobee_model::Node| match node.kind {
        mobee_model::NodeKind::Joint { motor, .. } => Some(motor),
        _ => None,
    };
    above(robot, node).filter_map(motor)
}

/// Returns a node and its ancestors.
fn above(robot: &Robot, node: usize) -> impl Iterator<Item = &mobee_model::Node> {
    let parent = |node: &&mobee_model::Node| robot.nodes.get(node.parent?);
    std::iter::successors(robot.nodes.get(node), parent).take(robot.nodes.len())
}

/// Returns the configurations of all robots with the agent's own robot at `q`.
pub fn with_pose(view: &View, q: &[f64]) -> Vec<mobee_contract::Pose> {
    let mut poses = view.poses.clone();
    if let Some(own) = poses.get_mut(view.robot) {
        *own = q.into();
    }
    poses
}

/// Returns the position of a marker of the agent's robot at a configuration, world frame, meters;
/// the position of the robot's base if there is no such marker.
pub fn marker_at(view: &View, marker: Option<usize>, q: &[f64]) -> [f64; 3] {
    let robot = view.scene.robots().get(view.robot);
    let node = marker.and_then(|m| robot?.markers.get(m)).map(|m| m.node);
    let frames = view.scene.node_transforms(&with_pose(view, q));
    let frame = node.and_then(|n| frames.get(view.robot)?.get(n).copied());
    let p = frame.unwrap_or_else(|| view.scene.base(view.robot)).translation.vector;
    [p.x, p.y, p.z]
}

/// Describes the obstacle of a failed motion: the nearest contact of the agent's robot in the view.
pub fn cause(view: &View) -> Option<String> {
    let own = view.contacts.iter().filter(|c| involves(view.robot, c));
    let nearest = own.min_by(|a, b| a.distance.total_cmp(&b.distance))?;
    let (a, b) = nearest.pair;
    let mm = nearest.distance * 1000.0;
    Some(format!("{} and {} at {mm:.1} mm", view.scene.shape_name(a), view.scene.shape_name(b)))
}

/// Returns whether a contact involves this robot.
pub fn involves(robot: usize, contact: &mobee_model::Contact) -> bool {
    let own = |id: ShapeId| matches!(id, ShapeId::Robot { robot: r, .. } if usize::from(r) == robot);
    own(contact.pair.0) || own(contact.pair.1)
}

/// Returns the contacts of the agent's robot at a configuration, with obstacles, other robots and
/// itself, closer than `within` meters.
pub fn contacts_at(view: &View, q: &[f64], within: f64) -> Vec<mobee_model::Contact> {
    let mut all = view.scene.contacts(&with_pose(view, q), within);
    all.retain(|c| involves(view.robot, c));
    all
}

/// Returns whether the agent's robot at a configuration keeps the view's clearance and satisfies
/// its constraints. Contacts of other robots are ignored.
pub fn free(view: &View, q: &[f64]) -> bool {
    view.scene.robot_free(view.robot, &with_pose(view, q), view.clearance)
}

/// Converts a settings error in an agent's state to a refusal.
pub fn state(error: KindError) -> Refusal {
    let place = if error.path.is_empty() { String::new() } else { format!("{}: ", error.path) };
    Refusal::State { what: format!("{place}{}", error.what) }
}
