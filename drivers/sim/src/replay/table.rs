//! A table of configurations over time, as text.

use mobee_contract::Time;
use mobee_model::Robot;

/// Tolerance beyond a limit, degrees, for rounding; such a value is set to the limit.
const ROUNDING_DEG: f64 = 0.2;

/// Error in a table: its line, description and remedy.
pub type RowError = (usize, String, String);

/// Configurations over time; never empty, with increasing times.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseTable {
    times: Vec<f64>,
    /// Values row by row, one per column, rad.
    values: Vec<f64>,
    /// Motor of each column.
    columns: Vec<usize>,
    /// Home configuration of the robot, for motors without a column.
    home: Vec<f64>,
}

impl PoseTable {
    /// Reads comma-separated text with a heading: `t_s`, then `PART.MOTOR` columns in degrees.
    ///
    /// # Errors
    /// The first error, with its line.
    pub fn parse(text: &str, robot: &Robot) -> Result<PoseTable, RowError> {
        let mut lines = text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#'));
        let (_, heading) =
            lines.next().ok_or((1, "there is no heading".to_owned(), "begin with `t_s,PART.MOTOR,...`".to_owned()))?;
        let mut names = heading.split(',').map(str::trim);
        if names.next() != Some("t_s") {
            return Err((1, "the first column is not `t_s`".into(), "begin with the time, seconds of the run".into()));
        }
        let columns = names.map(|name| column(robot, name)).collect::<Result<Vec<usize>, RowError>>()?;
        let (mut times, mut values): (Vec<f64>, Vec<f64>) = Default::default();
        for (i, line) in lines {
            let number = |field: &str| {
                let value = field.trim().parse().ok().filter(|v: &f64| v.is_finite());
                value.ok_or((i + 1, format!("`{}` is not a number", field.trim()), "give finite numbers".to_owned()))
            };
            let mut fields = line.split(',');
            let at = number(fields.next().unwrap_or_default())?;
            if at < 0.0 || times.last().is_some_and(|before| at <= *before) {
                return Err((i + 1, format!("the time {at} does not rise"), "sort the rows by their times".into()));
            }
            let mut given = 0;
            for (field, motor) in fields.zip(&columns) {
                let deg = number(field)?;
                let Some(m) = robot.motors.get(*motor) else { continue };
                let (min, max) = (m.min.to_degrees(), m.max.to_degrees());
                if deg < min - ROUNDING_DEG || deg > max + ROUNDING_DEG {
                    let what = format!("{deg} is outside the limits of motor `{}`", m.name);
                    return Err((i + 1, what, format!("give {} from {min} to {max}", m.motion.unit_in_words())));
                }
                values.push(deg.to_radians().clamp(m.min, m.max));
                given += 1;
            }
            if given != columns.len() || line.split(',').count() != columns.len() + 1 {
                let what =
                    format!("this row has {} values, the heading {}", line.split(',').count(), columns.len() + 1);
                return Err((i + 1, what, "give every row one value per column".into()));
            }
            times.push(at);
        }
        if times.is_empty() {
            return Err((2, "there is no pose".into(), "add a row per pose below the heading".into()));
        }
        Ok(PoseTable { times, values, columns, home: robot.home().to_vec() })
    }

    /// Configuration at a time, rad: interpolated between rows, constant before the first and after the last
    /// one.
    pub fn at(&self, at: Time) -> Vec<f64> {
        let t = at.secs();
        let after = self.times.partition_point(|row| *row <= t);
        let before = after.checked_sub(1).and_then(|i| self.row(i));
        match (before, self.row(after)) {
            (Some((t0, a)), Some((t1, b))) => {
                let share = (t - t0) / (t1 - t0);
                self.pose(a.iter().zip(b).map(|(a, b)| a + share * (b - a)))
            }
            (Some((_, q)), None) | (None, Some((_, q))) => self.pose(q.iter().copied()),
            (None, None) => Vec::new(),
        }
    }

    /// Time and values of a row.
    fn row(&self, i: usize) -> Option<(f64, &[f64])> {
        let n = self.columns.len();
        Some((*self.times.get(i)?, self.values.get(i * n..(i + 1) * n)?))
    }

    /// Configuration of the robot for a row's values.
    fn pose(&self, values: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut q = self.home.clone();
        for (motor, value) in self.columns.iter().zip(values) {
            if let Some(slot) = q.get_mut(*motor) {
                *slot = value;
            }
        }
        q
    }
}

fn column(robot: &Robot, name: &str) -> Result<usize, RowError> {
    let full =
        |m: &mobee_model::Motor| robot.parts.get(m.part).map(|p| format!("{}.{}", p.name, m.name)).unwrap_or_default();
    robot.motors.iter().position(|m| full(m) == name).ok_or_else(|| {
        let motors: Vec<String> = robot.motors.iter().map(full).collect();
        (1, format!("there is no motor `{name}`"), format!("the motors are: {}", motors.join(", ")))
    })
}
