//! Recorded tables: comma-separated text, one view of a known position in each row.
//!
//! Columns, in any order: the detections of the left and the right eye (centers `lcx`, `lcy`,
//! `rcx`, `rcy`, pixels; boxes `lx`, `ly`, `lw`, `lh`, `rx`, `ry`, `rw`, `rh`, all or none), the
//! joints (`neck_pitch` to `eyes_vergence`, `torso_yaw`, `torso_roll`, `torso_pitch`, degrees), and
//! the position (`x_mm`, `y_mm`, `z_mm`).

use super::view::{Glimpse, KnownView, StereoView};
use nalgebra::Vector3;
use thiserror::Error;

/// Names of the joints' columns, in the order of [`super::head::JOINTS`].
const ENCODERS: [&str; 9] = [
    "torso_pitch",
    "torso_roll",
    "torso_yaw",
    "neck_pitch",
    "neck_roll",
    "neck_yaw",
    "eyes_tilt",
    "eyes_version",
    "eyes_vergence",
];
const CENTERS: [&str; 4] = ["lcx", "lcy", "rcx", "rcy"];
const BOXES: [&str; 8] = ["lx", "ly", "lw", "lh", "rx", "ry", "rw", "rh"];
const PLACE: [&str; 3] = ["x_mm", "y_mm", "z_mm"];
/// Width and height of the images of recorded tables, pixels; a box within a pixel of the border is
/// clipped.
const IMAGE_SIZE_PX: [f64; 2] = [640.0, 480.0];
/// Minimum number of rows of a table.
const MIN_ROWS: usize = 1;
/// Maximum absolute number in a table: more is neither a pixel, a degree nor a millimeter.
const MAX_NUMBER: f64 = 1e6;

/// An error in a table: place, problem and remedy.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("line {line}: {what}")]
pub struct RowFault {
    /// Line, from 1.
    pub line: usize,
    /// Problem, with the column.
    pub what: String,
    /// Remedy.
    pub help: String,
}

/// A complete table.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewTable {
    /// Its rows.
    pub known: Vec<KnownView>,
    /// The rows contain bounding boxes.
    pub has_boxes: bool,
}

fn fault(line: usize, what: impl Into<String>, help: impl Into<String>) -> RowFault {
    RowFault { line, what: what.into(), help: help.into() }
}

/// Reads a table.
///
/// # Errors
/// Missing, unknown or duplicate columns, rows of another length, fields that are not finite
/// numbers, boxes of negative size, and tables without rows. Nothing is returned in these cases.
pub fn parse(text: &str) -> Result<ViewTable, RowFault> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = text.lines().enumerate().map(|(i, l)| (i + 1, l.trim_end_matches('\r')));
    let header = lines.next().map(|(_, l)| l).unwrap_or_default();
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let (columns, has_boxes) = columns(&names)?;
    let mut known = Vec::new();
    for (line, row) in lines.filter(|(_, l)| !l.trim().is_empty()) {
        let fields: Vec<&str> = row.split(',').map(str::trim).collect();
        if fields.len() != names.len() {
            let what = format!("{} fields, and the header names {} columns", fields.len(), names.len());
            return Err(fault(line, what, "give each row one field for each column, or remove the row"));
        }
        let number = |column: usize| -> Result<f64, RowFault> {
            let name = names[column];
            let field = fields[column];
            let value = field.parse::<f64>().ok().filter(|v| v.abs() <= MAX_NUMBER);
            value.ok_or_else(|| {
                let found = if field.is_empty() { "nothing".into() } else { format!("{field:?}") };
                fault(
                    line,
                    format!("column {} (`{name}`) has {found} where a finite number belongs", column + 1),
                    "correct the field, or remove the row",
                )
            })
        };
        known.push(view(&columns, has_boxes, line, &number)?);
    }
    if known.len() < MIN_ROWS {
        return Err(fault(1, "there are no rows after the header", "give a table with at least one row"));
    }
    Ok(ViewTable { known, has_boxes })
}

/// Formats views with boxes as a table that [`parse`] reads; views without a box for both eyes are
/// omitted.
pub fn table(known: &[KnownView]) -> String {
    let names: Vec<&str> = CENTERS.iter().chain(&ENCODERS).chain(&PLACE).chain(&BOXES).copied().collect();
    let mut text = names.join(",") + "\n";
    for KnownView { view, place } in known {
        let [left, right] = &view.eyes;
        let (Some(l), Some(r)) = (left.bounds, right.bounds) else { continue };
        let centers = left.center.into_iter().chain(right.center);
        let encoders = view.encoders.iter().map(|q| q.to_degrees());
        let numbers = centers.chain(encoders).chain(place.iter().map(|m| m * 1e3)).chain(l).chain(r);
        let fields: Vec<String> = numbers.map(|n| format!("{n:.4}")).collect();
        text += &(fields.join(",") + "\n");
    }
    text
}

/// Returns the index of each column, in the order centers, joints, position, boxes.
fn columns(names: &[&str]) -> Result<(Vec<usize>, bool), RowFault> {
    let at = |name: &str| names.iter().position(|n| *n == name);
    let help = "give a table as recorded: lcx,lcy,rcx,rcy, the nine joints in degrees, x_mm,y_mm,z_mm, and lx,ly,lw,lh,rx,ry,rw,rh if \
                there are boxes";
    if let Some(twice) = names.iter().enumerate().find(|(i, n)| names.iter().take(*i).any(|m| m == *n)) {
        return Err(fault(1, format!("column {} (`{}`) is there twice", twice.0 + 1, twice.1), help));
    }
    if at("cell_x").is_some() && at("x_mm").is_none() {
        return Err(fault(
            1,
            "the places are cells of a table (`cell_x`), not positions",
            "give positions in `x_mm`, `y_mm`, `z_mm`: cells contain neither their size nor the position of the table",
        ));
    }
    let wanted = || CENTERS.iter().chain(&ENCODERS).chain(&PLACE);
    let known = |n: &&&str| wanted().chain(&BOXES).any(|w| w == *n);
    if let Some(strange) = names.iter().find(|n| !known(n)) {
        return Err(fault(1, format!("the column `{strange}` is not known"), help));
    }
    let missing: Vec<&str> = wanted().copied().filter(|w| at(w).is_none()).collect();
    if !missing.is_empty() {
        return Err(fault(1, format!("columns are missing: {}", missing.join(", ")), help));
    }
    let boxes: Vec<usize> = BOXES.iter().filter_map(|b| at(b)).collect();
    if !boxes.is_empty() && boxes.len() != BOXES.len() {
        return Err(fault(1, "some of the columns of the boxes are missing", help));
    }
    let has_boxes = !boxes.is_empty();
    Ok((wanted().filter_map(|w| at(w)).chain(boxes).collect(), has_boxes))
}

fn view(
    columns: &[usize],
    has_boxes: bool,
    line: usize,
    number: &dyn Fn(usize) -> Result<f64, RowFault>,
) -> Result<KnownView, RowFault> {
    let numbers = columns.iter().map(|c| number(*c)).collect::<Result<Vec<f64>, RowFault>>()?;
    let part = |from: usize, n: usize| numbers.iter().skip(from).take(n).copied();
    let glimpse = |e: usize| -> Result<Glimpse, RowFault> {
        let mut center = [0.0; 2];
        center.iter_mut().zip(part(2 * e, 2)).for_each(|(c, n)| *c = n);
        if !has_boxes {
            return Ok(Glimpse { center, bounds: None, is_clipped: false });
        }
        let mut bounds = [0.0; 4];
        bounds.iter_mut().zip(part(16 + 4 * e, 4)).for_each(|(b, n)| *b = n);
        let [x, y, w, h] = bounds;
        if w < 0.0 || h < 0.0 {
            let eye = ["left", "right"][e];
            return Err(fault(line, format!("the box of the {eye} eye has no size"), "correct it, or remove the row"));
        }
        let is_clipped = x <= 1.0 || y <= 1.0 || x + w >= IMAGE_SIZE_PX[0] - 2.0 || y + h >= IMAGE_SIZE_PX[1] - 2.0;
        Ok(Glimpse { center, bounds: Some(bounds), is_clipped })
    };
    let mut encoders = [0.0; 9];
    encoders.iter_mut().zip(part(4, 9)).for_each(|(e, degrees)| *e = degrees.to_radians());
    let place = Vector3::from_iterator(part(13, 3).map(|mm| mm / 1000.0));
    Ok(KnownView { view: StereoView { eyes: [glimpse(0)?, glimpse(1)?], encoders, is_timed: false }, place })
}
