//! A timed path: joint values for a program that drives them.
//!
//! Between two vertices all of the map's motors move at constant speed and arrive together: the slowest one moves at
//! its share of its maximum speed. Accelerations are not considered.

use mobee_compose::config::ConfigError;
use mobee_model::{Motor, Robot};
use mobee_planning::roadmap::Roadmap;
use serde_json::json;
use std::fmt::Write;

/// Maximum number of rows: a typing error must not fill the disk.
const MAX_ROWS: f64 = 1e6;
/// Minimum time between two vertices, s.
const MIN_LEG_S: f64 = 1e-3;
/// Decimal places: 1e-7 degrees or seconds is below the resolution of maps and clocks.
const DECIMAL_PLACES: usize = 7;
/// The reciprocal of the last decimal place.
const PER_UNIT: f64 = 1e7;

/// Speeds of motors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Speeds {
    /// Share of each motor's maximum speed.
    pub share: f64,
    /// Maximum speed of motors whose robot file states none, deg/s (mm/s).
    pub unstated_deg_per_s: f64,
}

/// Joint values and times along a path.
pub(crate) struct Trajectory<'a> {
    robot: &'a Robot,
    motors: Vec<&'a Motor>,
    speeds: Speeds,
    points: Vec<Point>,
}

/// Joint values at one time.
#[derive(Clone, Debug, PartialEq)]
struct Point {
    t_s: f64,
    /// The vertex and its name; `None` between two vertices.
    vertex: Option<(u32, Option<String>)>,
    /// Positions of the map's motors, rad of encoder.
    q: Vec<f64>,
}

impl<'a> Trajectory<'a> {
    /// A trajectory over the vertices of a path, with a point for each.
    pub fn new(map: &Roadmap, path: &[u32], robot: &'a Robot, speeds: Speeds) -> Trajectory<'a> {
        let vertices = path.iter().filter_map(|id| Some((*id, map.vertex(*id)?)));
        let poses = vertices.map(|(id, vertex)| (Some((id, vertex.name.clone())), map.group(&vertex.q)));
        Self::over(poses, map.motors(), robot, speeds)
    }

    /// A trajectory over the configurations of a path of these motors, rad of encoder, with a point for each.
    pub fn through(poses: &[Vec<f64>], motors: &[usize], robot: &'a Robot, speeds: Speeds) -> Trajectory<'a> {
        Self::over(poses.iter().map(|q| (None, q.clone())), motors, robot, speeds)
    }

    fn over(
        poses: impl Iterator<Item = (Option<(u32, Option<String>)>, Vec<f64>)>,
        motors: &[usize],
        robot: &'a Robot,
        speeds: Speeds,
    ) -> Trajectory<'a> {
        let motors: Vec<&Motor> = motors.iter().filter_map(|m| robot.motors.get(*m)).collect();
        let fastest = |m: &Motor| m.max_speed.unwrap_or(speeds.unstated_deg_per_s.to_radians()) * speeds.share;
        let mut points: Vec<Point> = Vec::new();
        for (vertex, goal) in poses {
            let (t_s, q) = match points.last() {
                None => (0.0, goal),
                Some(last) => {
                    // continuous joints take the short way round, as they are driven
                    let q: Vec<f64> = motors
                        .iter()
                        .zip(last.q.iter().zip(&goal))
                        .map(|(m, (from, to))| m.nearest_equivalent(*from, *to))
                        .collect();
                    let longest = motors.iter().zip(last.q.iter().zip(&q));
                    let longest = longest.map(|(m, (from, to))| (to - from).abs() / fastest(m)).fold(0.0, f64::max);
                    (last.t_s + longest.max(MIN_LEG_S), q)
                }
            };
            points.push(Point { t_s, vertex, q });
        }
        Trajectory { robot, motors, speeds, points }
    }

    /// Duration, s.
    pub fn duration_s(&self) -> f64 {
        self.points.last().map_or(0.0, |p| p.t_s)
    }

    /// The same trajectory with a point every `every_s` seconds, and one at the end.
    ///
    /// # Errors
    /// If there are more than [`MAX_ROWS`].
    pub fn sampled(self, every_s: f64) -> Result<Trajectory<'a>, ConfigError> {
        let end = self.duration_s();
        let is_bounded = end / every_s <= MAX_ROWS;
        if !is_bounded {
            let what = format!("a row every {every_s} s are more than {MAX_ROWS:.0} rows for {end:.1} s");
            return Err(ConfigError::plain(what, "give a longer time to --every"));
        }
        let mut points = Vec::new();
        let mut legs = self.points.windows(2).peekable();
        for i in 0_u32.. {
            let t_s = f64::from(i) * every_s;
            // the rest to the end may be a rounding error
            if t_s > end - every_s * 1e-6 {
                break;
            }
            while legs.next_if(|leg| leg.get(1).is_some_and(|to| to.t_s <= t_s)).is_some() {}
            let Some([from, to]) = legs.peek() else { break };
            let share = (t_s - from.t_s) / (to.t_s - from.t_s);
            let q = from.q.iter().zip(&to.q).map(|(a, b)| a + share * (b - a)).collect();
            points.push(Point { t_s, vertex: from.vertex.clone().filter(|_| share == 0.0), q });
        }
        points.extend(self.points.last().cloned());
        Ok(Trajectory { points, ..self })
    }

    /// A table: times in seconds, and a column for each motor in the unit that the header names.
    pub fn csv(&self) -> String {
        let columns = self.motors.iter().map(|m| quoted(&format!("{}_{}", m.name, m.motion.unit())));
        let mut out = std::iter::once("t_s".to_owned()).chain(columns).collect::<Vec<_>>().join(",") + "\n";
        for point in &self.points {
            let _ = write!(out, "{:.DECIMAL_PLACES$}", rounded(point.t_s));
            for q in &point.q {
                let _ = write!(out, ",{:.DECIMAL_PLACES$}", rounded(q.to_degrees()));
            }
            out.push('\n');
        }
        out
    }

    /// The same as JSON, one point per line.
    pub fn json(&self) -> String {
        let point = |p: &Point| {
            let positions: Vec<f64> = p.q.iter().map(|q| rounded(q.to_degrees())).collect();
            let mut row = json!({ "t_s": rounded(p.t_s), "positions": positions });
            if let Some((id, name)) = &p.vertex {
                row["vertex"] = (*id).into();
                if let Some(name) = name {
                    row["name"] = name.as_str().into();
                }
            }
            row.to_string()
        };
        let names: Vec<&str> = self.motors.iter().map(|m| m.name.as_str()).collect();
        let units: Vec<&str> = self.motors.iter().map(|m| m.motion.unit()).collect();
        let points: Vec<String> = self.points.iter().map(point).collect();
        format!(
            "{{\n\"robot\": {},\n\"joint_names\": {},\n\"units\": {},\n\"speed\": {},\n\"points\": [\n{}\n]\n}}\n",
            json!(self.robot.name),
            json!(names),
            json!(units),
            json!(self.speeds.share),
            points.join(",\n")
        )
    }
}

/// Rounds to [`DECIMAL_PLACES`]; a rounded zero has no sign.
fn rounded(x: f64) -> f64 {
    (x * PER_UNIT).round() / PER_UNIT + 0.0
}

/// A field of a table, quoted if necessary.
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field.to_owned() }
}
