//! The layout of a robot model: a large view of the robot, texts beside it, and motion and contacts over time
//! below.

use super::{Print, publish};
use crate::front::Front;
use crate::stream::Written;
use rerun::RecordingStream;
use rerun::blueprint::components::{ContainerKind, PanelState, PlayState};

/// Writes the layout, which plays from the beginning in a loop.
pub(crate) fn send_model(rec: &RecordingStream, front: &Front) -> Written {
    publish(rec, |print| print.model(front))
}

impl Print<'_> {
    fn model(&mut self, front: &Front) -> Written {
        let scene = self.space("Robot", "/world", front)?;
        let now = self.view("TextDocument", "Motor", "/now")?;
        let near = self.view("TextDocument", "What comes near", "/near")?;
        let left_out = self.view("TextDocument", "Pairs left out", "/left_out")?;
        let about = self.view("TextDocument", "Legend", "/about")?;
        let words = self.tabs("Words", &[near, left_out, about])?;
        let right = self.container(ContainerKind::Vertical, "Motor and words", &[now, words], &[2.0, 3.0])?;
        let top = self.container(ContainerKind::Horizontal, "Robot and words", &[scene, right], &[5.0, 3.0])?;
        let lanes = self.lanes("Which motor, and how near", "/state")?;
        let plot = self.view("TimeSeries", "Where it is", "/position")?;
        let bottom = self.container(ContainerKind::Horizontal, "Over time", &[lanes, plot], &[5.0, 3.0])?;
        self.container(ContainerKind::Vertical, "Model", &[top, bottom], &[4.0, 1.0])?;
        self.frame(PanelState::Collapsed, PlayState::Playing)
    }
}
