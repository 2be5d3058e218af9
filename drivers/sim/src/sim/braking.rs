//! Reaction and braking path: distance that a robot still travels after a contact has begun.

use mobee_contract::Board;
use mobee_model::Robot;
use std::time::Duration;

/// Reaction and braking path of a robot, meters, at a share of its greatest speeds.
///
/// The delays between a contact and the stop: a reading may have been taken just before (`period`), the
/// controller answers at the end of its own period, the stop command takes its latency, and then every motor
/// brakes:
///
/// `angle = v (period + control + latency) + v^2 / (2 a)`, with the greatest acceleration `a`,
///
/// No point of a shape moves farther than the angle times the motor's [`Robot::reach`].
#[derive(Clone, Debug, PartialEq)]
pub struct StoppingPath {
    /// The worst motor moving alone, an index into `Robot::motors`, and its path, m. **The margin is compared
    /// with this figure**: if the path exceeds the margin, one motor alone can run from the margin into hard
    /// contact. Several motors together are rarely worse, since a robot seldom stretches out all its joints
    /// and moves them all the same way at full allowed speed.
    pub single: (usize, f64),
    /// Motors between the base and the shape that moves fastest if all of them move at once, nearest the base
    /// first.
    pub chain: Vec<usize>,
    /// Path of that shape, m, if the motors' contributions add up like random ones (root of the sum of
    /// squares).
    pub chain_typical: f64,
    /// Path of that shape, m, if all contributions add up: an upper bound for all shapes.
    pub chain_bound: f64,
}

impl StoppingPath {
    /// Warning with its remedies, if this margin (m) is smaller than the path of one motor alone.
    pub fn warning(&self, margin: f64, robot: &Robot) -> Option<String> {
        let (motor, path) = self.single;
        let name = robot.motors.get(motor).map_or("?", |m| m.name.as_str());
        let [margin_mm, path_mm, typical_mm] = [margin, path, self.chain_typical].map(|m| m * 1e3);
        (margin < path).then(|| {
            format!(
                "a margin of {margin_mm:.1} mm is smaller than the reaction and braking path: motor {name} alone can carry a shape {path_mm:.1} mm \
                 farther, its whole chain typically {typical_mm:.1} mm; move more slowly, widen the margin, shorten the control period, or look ahead (without `reserve_mm = 0`)"
            )
        })
    }
}

/// Computes the reaction and braking path of a robot on this board. `control` is the time from a reading to
/// the stop command, `speed_share` the share of the greatest speed that agents use (a value outside 0 to 1
/// counts as 1).
pub fn stopping_path(robot: &Robot, board: &Board, control: Duration, speed_share: f64) -> StoppingPath {
    let share = if (0.0..=1.0).contains(&speed_share) { speed_share } else { 1.0 };
    let reaction = (board.period + control + board.latency).as_secs_f64();
    let path = |(axis, reach): (&mobee_contract::Axis, f64)| {
        let v = share * axis.max_speed;
        reach * (v * reaction + v * v / (2.0 * axis.max_acceleration))
    };
    let paths: Vec<f64> = board.axes.iter().zip(robot.reach()).map(path).collect();
    let single = paths.iter().copied().enumerate().fold((0, 0.0), |worst, p| if p.1 > worst.1 { p } else { worst });
    let of = |chain: &[usize]| chain.iter().filter_map(|m| paths.get(*m).copied()).collect::<Vec<f64>>();
    let chain = chains(robot)
        .into_iter()
        .max_by(|a, b| of(a).iter().sum::<f64>().total_cmp(&of(b).iter().sum()))
        .unwrap_or_default();
    let parts = of(&chain);
    StoppingPath {
        single,
        chain,
        chain_typical: parts.iter().map(|p| p * p).sum::<f64>().sqrt(),
        chain_bound: parts.iter().sum(),
    }
}

/// For every node with a solid shape, the motors above it.
fn chains(robot: &Robot) -> Vec<Vec<usize>> {
    let mut above: Vec<Vec<usize>> = Vec::with_capacity(robot.nodes.len());
    let mut bearing = Vec::new();
    for node in &robot.nodes {
        let mut motors = node.parent.and_then(|p| above.get(p)).cloned().unwrap_or_default();
        if !node.solids.is_empty() {
            bearing.push(motors.clone());
        }
        if let mobee_model::NodeKind::Joint { motor, .. } = &node.kind
            && !motors.contains(motor)
        {
            motors.push(*motor);
        }
        above.push(motors);
    }
    bearing
}
