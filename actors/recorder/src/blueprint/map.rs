//! The layout of a map: a large view of robot and map, with a legend of the colors beside it.

use super::{Print, publish};
use crate::front::Front;
use crate::stream::Written;
use rerun::RecordingStream;
use rerun::blueprint::components::{ContainerKind, PanelState, PlayState};

/// Writes the layout, which plays from the beginning.
pub(crate) fn send_map(rec: &RecordingStream, front: &Front) -> Written {
    publish(rec, |print| print.whole_map(front))
}

impl Print<'_> {
    fn whole_map(&mut self, front: &Front) -> Written {
        let scene = self.space("Map", "/world", front)?;
        let edges = self.view("TextDocument", "Edges", "/edges")?;
        let about = self.view("TextDocument", "Legend", "/about")?;
        let words = self.container(ContainerKind::Vertical, "Words", &[edges, about], &[2.0, 1.0])?;
        self.container(ContainerKind::Horizontal, "Map and words", &[scene, words], &[5.0, 2.0])?;
        self.frame(PanelState::Collapsed, PlayState::Playing)
    }
}
