//! `mobee model eval`: a robot model's results for a table of poses, as tables in the format of the original program's
//! reference results.
//!
//! Everything is read before anything is written, and every table gets its name only when all are complete.

use miette::{IntoDiagnostic, WrapErr};
use mobee_compose::config::ConfigError;
use mobee_model::file::{MIB, read_text};
use mobee_model::{ContactKind, Object, Robot, Scene, ShapeId, load_robot, load_world};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum size of a table of poses, bytes.
const MAX_TABLE_BYTES: u64 = 64 * MIB;
/// Tolerance of limits for rounded values, encoder units.
const ROUNDING_DEG: f64 = 1e-6;

/// Arguments of an evaluation.
#[derive(Clone, Copy, Debug)]
pub struct Evaluation<'a> {
    /// The robot, ZRP XML.
    pub robot: &'a Path,
    /// The world, if there is one.
    pub world: Option<&'a Path>,
    /// The table of poses: `pose_id`, optionally `kind`, and `part.motor` columns in encoder units.
    pub poses: &'a Path,
    /// The folder for the results; created if missing.
    pub out: &'a Path,
}

/// The result of an evaluation.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Evaluated {
    /// Number of poses.
    pub poses: usize,
    /// Number of colliding pairs in `self_pairs.csv`.
    pub self_pairs: usize,
    /// Number of colliding pairs in `world_pairs.csv`.
    pub world_pairs: usize,
    /// The tables.
    pub files: Vec<PathBuf>,
}

/// Evaluates a robot at every pose of a table and writes `markers.csv`, `transforms.csv`, `constraints.csv`, `self_pairs.csv`
/// and, with a world, `world_pairs.csv`.
///
/// If a file can't be read or understood (with place and remedy; nothing is written then), or the results can't be
/// written (no table is replaced then).
pub fn evaluate(what: Evaluation<'_>) -> miette::Result<Evaluated> {
    let robot = Arc::new(load_robot(what.robot)?.value);
    let objects: Vec<Object> = what.world.map(load_world).transpose()?.map(|w| w.value).unwrap_or_default();
    let poses = read_poses(&robot, what.poses)?;
    let scene = Scene::new(vec![(robot.clone(), Default::default())], objects)
        .into_diagnostic()
        .wrap_err("the robot and the world do not make a scene")?;
    std::fs::create_dir_all(what.out).into_diagnostic().wrap_err_with(|| {
        format!("cannot make the folder {}; give --out a folder you may write to", what.out.display())
    })?;
    let mut tables = Tables::new(what.out, what.world.is_some())?;
    for pose in &poses {
        tables.pose(&scene, &robot, pose)?;
    }
    tables.finish(poses.len())
}

/// A row of the table of poses.
#[derive(Clone, Debug, PartialEq)]
struct PoseRow {
    id: u64,
    /// Motor positions, rad of encoder.
    q: Vec<f64>,
}

fn read_poses(robot: &Robot, path: &Path) -> Result<Vec<PoseRow>, ConfigError> {
    let name = path.display().to_string();
    let unreadable = |e: std::io::Error| {
        let help = "give --poses a table of poses, and split a large one; its path is relative to the folder the program runs in";
        ConfigError::plain(format!("cannot read {name}: {e}"), help)
    };
    let text = read_text(path, MAX_TABLE_BYTES).map_err(unreadable)?;
    parse_poses(robot, &name, &text)
}

fn parse_poses(robot: &Robot, name: &str, text: &str) -> Result<Vec<PoseRow>, ConfigError> {
    let mut lines = fields(text);
    let heading = lines.next().unwrap_or_default();
    let complain =
        |at: &Field<'_>, message: String, help: String| ConfigError::at(name, text, at.span(), message, help);
    let columns = heading.iter().map(|c| column(robot, c, &complain)).collect::<Result<Vec<_>, _>>()?;
    for (i, c) in heading.iter().enumerate() {
        if columns[..i].contains(&columns[i]) {
            return Err(complain(c, format!("column `{}` is there twice", c.text), "remove one of them".into()));
        }
    }
    if !columns.contains(&Column::Id) {
        let help = "the first line must name the columns: pose_id, then part.motor in encoder units (degrees; millimeters where a motor slides)";
        return Err(ConfigError::at(
            name,
            text,
            0..text.find('\n').unwrap_or(text.len()),
            "there is no column `pose_id`",
            help,
        ));
    }
    let mut poses: Vec<PoseRow> = Vec::new();
    let mut seen = std::collections::BTreeSet::new();
    for row in lines {
        let last = row.last().cloned().unwrap_or_default();
        if row.len() != columns.len() {
            let message = format!("this row has {} values, the heading has {} columns", row.len(), columns.len());
            return Err(complain(&last, message, "give every row one value per column".into()));
        }
        let mut pose = PoseRow { id: 0, q: robot.home() };
        for (field, column) in row.iter().zip(&columns) {
            match *column {
                Column::Kind => {}
                Column::Id => {
                    pose.id = field.text.parse().map_err(|_| {
                        let message = format!("`{}` is not a pose number", field.text);
                        complain(field, message, "number the poses 0, 1, 2, ...".into())
                    })?;
                    if !seen.insert(pose.id) {
                        let message = format!("pose {} is there twice", pose.id);
                        return Err(complain(field, message, "give each pose its own number".into()));
                    }
                }
                Column::Motor(m) => {
                    let motor = &robot.motors[m];
                    let value: Option<f64> = field.text.parse().ok().filter(|v: &f64| v.is_finite());
                    let Some(degrees) = value else {
                        let message = format!("`{}` is not a number", field.text);
                        return Err(complain(
                            field,
                            message,
                            format!("give the encoder value of `{}` in {}", motor.name, motor.motion.unit()),
                        ));
                    };
                    let min = motor.min.to_degrees();
                    let max = motor.max.to_degrees();
                    if degrees < min - ROUNDING_DEG || degrees > max + ROUNDING_DEG {
                        let message = format!("{degrees} is outside the limits of motor `{}`", motor.name);
                        return Err(complain(
                            field,
                            message,
                            format!("give {} from {min} to {max}", motor.motion.unit_in_words()),
                        ));
                    }
                    pose.q[m] = degrees.to_radians();
                }
            }
        }
        poses.push(pose);
    }
    if poses.is_empty() {
        return Err(ConfigError::at(name, text, 0..0, "there is no pose", "add a row per pose below the heading"));
    }
    Ok(poses)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Column {
    Id,
    Kind,
    Motor(usize),
}

fn column(
    robot: &Robot,
    field: &Field<'_>,
    complain: &impl Fn(&Field<'_>, String, String) -> ConfigError,
) -> Result<Column, ConfigError> {
    match field.text {
        "pose_id" => return Ok(Column::Id),
        "kind" => return Ok(Column::Kind),
        _ => {}
    }
    let full =
        |m: &mobee_model::Motor| robot.parts.get(m.part).map(|p| format!("{}.{}", p.name, m.name)).unwrap_or_default();
    if let Some(m) = robot.motors.iter().position(|m| full(m) == field.text) {
        return Ok(Column::Motor(m));
    }
    let near =
        robot.motors.iter().find(|m| field.text.rsplit('.').next().is_some_and(|n| n.eq_ignore_ascii_case(&m.name)));
    let help = match near {
        Some(m) => format!("did you mean `{}`?", full(m)),
        None => format!("the motors are {}", robot.motors.iter().map(full).collect::<Vec<_>>().join(", ")),
    };
    Err(complain(field, format!("there is no motor `{}` in robot `{}`", field.text, robot.name), help))
}

/// A value of a table, and its position in the text.
#[derive(Clone, Copy, Debug, Default)]
struct Field<'a> {
    text: &'a str,
    at: usize,
}

impl Field<'_> {
    fn span(&self) -> std::ops::Range<usize> {
        self.at..self.at + self.text.len()
    }
}

/// The non-empty lines of a table, split at commas.
fn fields(text: &str) -> impl Iterator<Item = Vec<Field<'_>>> {
    let offset = |part: &str| part.as_ptr() as usize - text.as_ptr() as usize;
    text.trim_start_matches('\u{feff}').lines().filter(|line| !line.trim().is_empty()).map(move |line| {
        line.split(',')
            .map(|value| {
                let text = value.trim();
                Field { text, at: offset(text) }
            })
            .collect()
    })
}

/// The result tables, under temporary names until they are complete.
struct Tables {
    markers: Table,
    transforms: Table,
    constraints: Table,
    self_pairs: Table,
    world_pairs: Option<Table>,
    done: Evaluated,
    line: String,
}

impl Tables {
    fn new(out: &Path, world: bool) -> miette::Result<Self> {
        Ok(Tables {
            markers: Table::new(out, "markers.csv", "pose_id,marker,px,py,pz,nx,ny,nz")?,
            transforms: Table::new(out, "transforms.csv", "pose_id,node,r00,r01,r02,tx,r10,r11,r12,ty,r20,r21,r22,tz")?,
            constraints: Table::new(out, "constraints.csv", "pose_id,part,violated,clause,value,satisfied")?,
            self_pairs: Table::new(out, "self_pairs.csv", "pose_id,kind,node_a,prim_a,node_b,prim_b,depth_m")?,
            world_pairs: world
                .then(|| Table::new(out, "world_pairs.csv", "pose_id,kind,node,prim,object,object_prim,depth_m"))
                .transpose()?,
            done: Evaluated::default(),
            line: String::new(),
        })
    }

    fn pose(&mut self, scene: &Scene, robot: &Robot, pose: &PoseRow) -> miette::Result<()> {
        let id = pose.id;
        for (marker, at) in robot.markers.iter().zip(robot.markers_at(&pose.q)) {
            let p = at.position();
            let n = at.normal;
            let name = quoted(&marker.name);
            self.markers.row(format_args!("{id},{name},{},{},{},{},{},{}", p.x, p.y, p.z, n.x, n.y, n.z))?;
        }
        for (node, frame) in scene.node_transforms(&[&pose.q]).iter().flatten().enumerate() {
            let matrix = frame.to_homogeneous();
            self.line.clear();
            for row in matrix.row_iter().take(3) {
                row.iter().try_for_each(|x| write!(self.line, ",{x}")).into_diagnostic()?;
            }
            self.transforms.row(format_args!("{id},{node}{}", self.line))?;
        }
        for part in &robot.parts {
            let values: Vec<f64> = part.clauses.iter().map(|c| robot.clause_value(c, &pose.q)).collect();
            let violated = u8::from(values.iter().any(|v| !satisfied(*v)));
            let name = quoted(&part.name);
            for (clause, value) in values.iter().enumerate() {
                let holds = u8::from(satisfied(*value));
                self.constraints.row(format_args!("{id},{name},{violated},{clause},{value},{holds}"))?;
            }
        }
        for found in scene.report(&[&pose.q]) {
            let kind = match found.kind {
                ContactKind::Reflex => "reflex",
                ContactKind::VisualOnly => "visual_only",
                ContactKind::Field => "field",
            };
            let depth = -found.contact.distance;
            let (a, b) = found.contact.pair;
            let ShapeId::Robot { node, shape, .. } = a else { continue };
            match b {
                ShapeId::Robot { node: other, shape: its, .. } => {
                    self.done.self_pairs += 1;
                    self.self_pairs.row(format_args!("{id},{kind},{node},{shape},{other},{its},{depth}"))?;
                }
                ShapeId::Object { object, shape: its } => {
                    let name = scene.objects().find(|(o, _)| *o == object).map(|(_, o)| quoted(&o.name));
                    let name = name.unwrap_or_default();
                    self.done.world_pairs += 1;
                    if let Some(table) = &mut self.world_pairs {
                        table.row(format_args!("{id},{kind},{node},{shape},{name},{its},{depth}"))?;
                    }
                }
            }
        }
        Ok(())
    }

    fn finish(mut self, poses: usize) -> miette::Result<Evaluated> {
        let tables = [
            Some(self.markers),
            Some(self.transforms),
            Some(self.constraints),
            Some(self.self_pairs),
            self.world_pairs,
        ];
        let written = tables.into_iter().flatten().map(Table::flush).collect::<Result<Vec<_>, _>>()?;
        for (temporary, name) in written {
            std::fs::rename(&temporary, &name)
                .into_diagnostic()
                .wrap_err_with(|| format!("cannot write {}", name.display()))?;
            self.done.files.push(name);
        }
        self.done.poses = poses;
        Ok(self.done)
    }
}

fn satisfied(value: f64) -> bool {
    value > 0.0
}

/// A name, quoted if necessary.
fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.to_string() }
}

/// One table; its temporary file is removed if it is not finished.
struct Table {
    temporary: PathBuf,
    name: PathBuf,
    file: Option<BufWriter<File>>,
}

impl Table {
    fn new(out: &Path, name: &str, heading: &str) -> miette::Result<Self> {
        let temporary = out.join(format!(".{name}.part"));
        let file = File::create(&temporary)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot write into {}; give --out a folder you may write to", out.display()))?;
        let mut table = Table { temporary, name: out.join(name), file: Some(BufWriter::new(file)) };
        table.row(format_args!("{heading}"))?;
        Ok(table)
    }

    fn row(&mut self, row: std::fmt::Arguments<'_>) -> miette::Result<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        writeln!(file, "{row}").into_diagnostic().wrap_err_with(|| format!("cannot write {}", self.name.display()))
    }

    fn flush(mut self) -> miette::Result<(PathBuf, PathBuf)> {
        if let Some(mut file) = self.file.take() {
            file.flush().into_diagnostic().wrap_err_with(|| format!("cannot write {}", self.name.display()))?;
        }
        Ok((std::mem::take(&mut self.temporary), self.name.clone()))
    }
}

impl Drop for Table {
    fn drop(&mut self) {
        if self.temporary.as_os_str().is_empty() {
            return;
        }
        self.file = None;
        // A remaining temporary file can't be handled here.
        let _ = std::fs::remove_file(&self.temporary);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edge() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/edge")
    }

    fn out(name: &str) -> tempfile::TempDir {
        tempfile::Builder::new().prefix(name).tempdir().expect("a folder")
    }

    #[test]
    fn the_edge_robot_gives_the_reference_tables() {
        let edge = edge();
        let out = out("eval");
        let what = Evaluation {
            robot: &edge.join("edge_a.xml"),
            world: None,
            poses: &edge.join("poses.csv"),
            out: out.path(),
        };
        let done = evaluate(what).expect("an evaluation");
        assert_eq!(done.files.len(), 4);
        for name in ["markers.csv", "transforms.csv", "constraints.csv", "self_pairs.csv"] {
            let read = |folder: &Path| {
                let text = std::fs::read_to_string(folder.join(name)).expect("a table");
                let mut lines = text.lines().map(str::to_string).collect::<Vec<_>>();
                let heading = lines.remove(0);
                lines.sort();
                (heading, lines)
            };
            let ((heading, expected), (ours, got)) = (read(&edge), read(out.path()));
            assert_eq!(heading, ours, "{name}");
            assert_eq!(expected.len(), got.len(), "{name}");
            // Depth is not unique; all else must agree.
            let compared = heading.split(',').filter(|c| *c != "depth_m").count();
            for (e, g) in expected.iter().zip(&got) {
                for (e, g) in e.split(',').zip(g.split(',')).take(compared) {
                    match (e.parse::<f64>(), g.parse::<f64>()) {
                        (Ok(e), Ok(g)) => assert!((e - g).abs() < 1e-6, "{name}: {e} {g}"),
                        _ => assert_eq!(e, g, "{name}"),
                    }
                }
            }
        }
    }

    #[test]
    fn wrong_tables_are_refused_with_their_place_and_nothing_is_written() {
        let edge = edge();
        let robot = edge.join("edge_a.xml");
        for (text, place, says) in [
            ("", (1, 1), "pose_id"),
            ("pose_id,base.M_frist\n0,1\n", (1, 9), "no motor"),
            ("pose_id,base.M_first,base.M_first\n0,1,1\n", (1, 22), "twice"),
            ("pose_id,base.M_first\n0,ten\n", (2, 3), "not a number"),
            ("pose_id,base.M_first\n0,NaN\n", (2, 3), "not a number"),
            ("pose_id,base.M_first\n0,20\n1\n", (3, 1), "1 values"),
            ("pose_id,base.M_first\n0,20\n0,20\n", (3, 1), "twice"),
            ("pose_id,base.M_first\n0,1e9\n", (2, 3), "outside the limits"),
            ("pose_id,base.M_first\n", (1, 1), "no pose"),
        ] {
            let out = out("eval");
            let poses = out.path().join("poses.csv");
            std::fs::write(&poses, text).expect("a table");
            let folder = out.path().join("results");
            let what = Evaluation { robot: &robot, world: None, poses: &poses, out: &folder };
            let error = evaluate(what).expect_err(text);
            let error = error.downcast_ref::<ConfigError>().expect("a place");
            assert!(error.message().contains(says), "{text:?}: {}", error.message());
            assert_eq!(error.line_column(), Some(place), "{text:?}: {}", error.message());
            assert!(!error.help_text().is_empty());
            assert!(!folder.exists());
        }
    }
}
