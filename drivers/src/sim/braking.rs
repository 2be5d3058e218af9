//! How far a robot still travels after a contact has begun: reaction and braking path.

use mobee_contract::Board;
use mobee_model::Robot;
use std::time::Duration;

/// Reaction and braking path of a robot, meters, at a share of its greatest speeds.
///
/// What passes between a contact and the rest: a reading may have been taken just before (`period`), the controller answers at
/// the end of its own period, the stop command takes its latency, and then every motor brakes:
///
/// `angle = v (period + control + latency) + v^2 / (2 a)`, with the greatest acceleration `a`,
///
/// and no point of a shape moves farther than the angle times the motor's [`Robot::reach`].
#[derive(Clone, Debug, PartialEq)]
pub struct StoppingPath {
    /// The worst motor moving alone, an index into `Robot::motors`, and its path. **This figure is what the margin is compared with**: where it
    /// exceeds the margin, one motor alone can run from the margin into hard contact. What several do together is rarely worse, since a robot seldom
    /// stretches out all its joints at once and moves them all the same way at full allowed speed.
    pub single: (usize, f64),
    /// The motors between the base and the shape that moves fastest if all of them move at once, nearest the base first.
    pub chain: Vec<usize>,
    /// The path of that shape if the motors' motions add up as random ones do (root of the sum of squares).
    pub chain_typical: f64,
    /// The path of that shape if all add up: no shape ever goes farther.
    pub chain_bound: f64,
}

impl StoppingPath {
    /// A warning with its remedies, if this margin (m) is smaller than what one motor alone needs.
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

/// Reaction and braking path of a robot on this board. `control` is the time from a reading to the stop command, `speed_share` the share of the
/// greatest speed that agents use (what is not a number within 0 to 1 counts as 1).
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

/// For every node that bears a solid shape, the motors above it.
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
