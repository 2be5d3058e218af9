//! Drawing state of one robot.

use crate::blueprint::Shown;
use crate::body::{Appearance, RobotEntities, entity};
use crate::draw::Drawing;
use crate::palette;
use crate::roadmap::{DrawnPose, DrawnRoadmap};
use crate::stream::{EntityStream, Written};
use crate::traces::Traces;
use mobee_contract::Pose;
use mobee_model::{Contact, Robot};
use nalgebra::Isometry3;
use rerun::{SeriesLines, StateChange, StateConfiguration};
use std::sync::Arc;

/// Drawing state of one robot.
pub(crate) struct DrawnRobot {
    pub(crate) name: String,
    pub(crate) robot: Arc<Robot>,
    pub(crate) body: RobotEntities,
    pub(crate) traces: Traces,
    pub(crate) roadmap: DrawnRoadmap,
    pub(crate) drawing: Drawing,
    pub(crate) contacts: Vec<Contact>,
    pub(crate) rollbacks: u32,
    /// Newest configuration.
    pub(crate) pose: Option<Pose>,
    /// Bounds of the view of its flat roadmap.
    bounds: Option<[f32; 4]>,
}

impl DrawnRobot {
    pub(crate) fn new(
        stream: &EntityStream,
        robot: &Arc<Robot>,
        base: &Isometry3<f64>,
        index: usize,
        named: Vec<DrawnPose>,
    ) -> Result<DrawnRobot, String> {
        let name = entity(&robot.name);
        lane(stream, &format!("state/{name}/filter"), &palette::FILTER)?;
        lane(stream, &format!("state/{name}/transaction"), &palette::TRANSACTION)?;
        let rollbacks = SeriesLines::new().with_names(["rollbacks"]).with_colors([palette::NEAR]).with_widths([2.0]);
        stream.log_static(&format!("progress/{name}/rollbacks"), &rollbacks)?;
        Ok(DrawnRobot {
            body: RobotEntities::new(stream, robot, base, index as u16, &Appearance::RUN)?,
            traces: Traces::new(stream, robot, base)?,
            roadmap: DrawnRoadmap { named, ..DrawnRoadmap::default() },
            drawing: Drawing::new(stream, &name)?,
            contacts: Vec::new(),
            rollbacks: 0,
            pose: None,
            bounds: None,
            robot: Arc::clone(robot),
            name,
        })
    }

    pub(crate) fn shown(&self) -> Shown {
        Shown { name: self.name.clone(), parts: self.traces.parts(), trails: self.traces.trails(), bounds: self.bounds }
    }

    /// Returns true if the roadmap no longer fits its view, and then enlarges the view with some room.
    pub(crate) fn outgrown(&mut self) -> bool {
        let Some([left, top, right, bottom]) = self.roadmap.bounds() else { return false };
        let fits = |[l, t, r, b]: [f32; 4]| l <= left && t <= top && r >= right && b >= bottom;
        if self.bounds.is_some_and(fits) {
            return false;
        }
        let room = if self.bounds.is_some() { 0.2 * (right - left).max(bottom - top) } else { 0.0 };
        self.bounds = Some([left - room, top - room, right + room, bottom + room]);
        true
    }
}

/// Writes the colors and labels of a state lane.
pub(crate) fn lane(stream: &EntityStream, path: &str, states: &[(&str, &str, palette::Rgba)]) -> Written {
    let look = StateConfiguration::new()
        .with_values(states.iter().map(|s| s.0))
        .with_labels(states.iter().map(|s| s.1))
        .with_colors(states.iter().map(|s| s.2));
    stream.log_static(path, &look)?;
    // An empty state starts the lane.
    stream.log(path, &StateChange::new().with_state([""]))
}
