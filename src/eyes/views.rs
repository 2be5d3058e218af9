//! What two eyes saw of an object, as a table that locators learn from.

use mobee_behaviors::locators::head::JOINTS;
use mobee_behaviors::locators::learned::glimpse;
use mobee_behaviors::locators::lens::Lens;
use mobee_contract::Region;
use mobee_drivers::eyes::{Owner, Shot};
use mobee_model::Robot;
use nalgebra::Point3;
use std::fmt::Write;

/// The first line: the columns of `mobee locator train`.
const HEAD: &str = "lx,ly,lw,lh,lcx,lcy,rx,ry,rw,rh,rcx,rcy,torso_pitch,torso_roll,torso_yaw,neck_pitch,neck_roll,neck_yaw,\
                    eyes_tilt,eyes_version,eyes_vergence,x_mm,y_mm,z_mm\n";

/// The table, and where the joints are in a pose.
pub(super) struct Views {
    joints: [usize; 9],
    /// The table so far.
    pub(super) table: String,
}

impl Views {
    /// For a robot with an iCub's head and two eyes, the left one first; `None` for others.
    pub(super) fn new(robot: &Robot, eyes: usize) -> Option<Views> {
        let mut joints = [0; 9];
        for (joint, name) in joints.iter_mut().zip(JOINTS) {
            *joint = robot.motor_index(name)?;
        }
        (eyes == 2).then(|| Views { joints, table: HEAD.into() })
    }

    /// A line for an object that both eyes see whole; another teaches where the picture's border is.
    pub(super) fn add(&mut self, q: &[f64], shots: &[Shot], object: u32, place: &Point3<f64>) {
        let seen = |(shot, lens): (&Shot, &Lens)| {
            let region = region(shot, object).filter(|r| !r.is_clipped)?;
            let seen = glimpse(&region, shot.frame.intrinsics, lens)?;
            let ([u, v], [x, y, w, h]) = (seen.center, seen.bounds?);
            Some(format!("{x:.3},{y:.3},{w:.3},{h:.3},{u:.3},{v:.3},"))
        };
        let [left, right] = shots else { return };
        let [first, second] = &Lens::icub();
        let (Some(left), Some(right)) = (seen((left, first)), seen((right, second))) else { return };
        self.table += &(left + &right);
        for q in self.joints.iter().filter_map(|m| q.get(*m)) {
            let _ = write!(self.table, "{:.4},", q.to_degrees());
        }
        let [x, y, z] = [place.x, place.y, place.z].map(|p| p * 1e3);
        let _ = writeln!(self.table, "{x:.3},{y:.3},{z:.3}");
    }
}

/// What a detector without fault would tell of an object.
fn region(shot: &Shot, object: u32) -> Option<Region> {
    let [width, height] = shot.frame.intrinsics.size;
    let (mut area, mut sum) = (0.0, [0.0; 2]);
    let mut bounds = [f64::INFINITY, f64::INFINITY, 0.0, 0.0];
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (f64::from(x), f64::from(y))));
    for ((x, y), _) in pixels.zip(&shot.owner).filter(|(_, owner)| **owner == Owner::Object(object)) {
        area += 1.0;
        sum = [sum[0] + x + 0.5, sum[1] + y + 0.5];
        let [left, top, right, bottom] = bounds;
        bounds = [left.min(x), top.min(y), right.max(x + 1.0), bottom.max(y + 1.0)];
    }
    let [left, top, right, bottom] = bounds;
    let is_clipped = left <= 0.0 || top <= 0.0 || right >= f64::from(width) || bottom >= f64::from(height);
    let center = sum.map(|s| s / area);
    (area > 0.0).then(|| Region { object: String::new(), center, bounds, area, is_clipped, confidence: 1.0 })
}
