//! The layout a recording opens with.
//!
//! Rerun's own builder can't set a view's eye, background or time range, so the archetypes of a blueprint are
//! logged here directly, into a separate stream that is sent before the data.

mod map;
mod model;

use crate::front::Front;
use crate::stream::{TIMELINE, Written, in_words};
pub(crate) use map::send_map;
pub(crate) use model::send_model;
use rerun::blueprint::components::{ContainerKind, LoopMode, PanelState, PlayState};
use rerun::external::re_log_types::BlueprintActivationCommand;
use rerun::external::re_sdk_types::blueprint::archetypes as look;
use rerun::external::re_sdk_types::blueprint::components::{BackgroundKind, LinkAxis, TextLogColumn, VisibleTimeRange};
use rerun::external::re_sdk_types::blueprint::datatypes::{self as shapes, TextLogColumnKind};
use rerun::external::re_sdk_types::datatypes::{Range2D, TimeInt, TimeRange, TimeRangeBoundary, Uuid};
use rerun::{AsComponents, RecordingStream, RecordingStreamBuilder, StoreId, components};
use std::collections::BTreeMap;

/// Length of the visible part of a trail, s.
const TRAIL_SECS: i64 = 30;

/// Content of one recorder's page.
pub(crate) struct Page {
    /// Prefix of all its entities: empty, or `NAME/`.
    pub(crate) root: String,
    /// Robots on the page.
    pub(crate) robots: Vec<Shown>,
    /// Entities of its cameras.
    pub(crate) eyes: Vec<String>,
    /// Viewpoint of the scene.
    pub(crate) front: Front,
}

/// Properties of a robot that the layout depends on.
pub(crate) struct Shown {
    /// Name of the robot as a part of entity paths.
    pub(crate) name: String,
    /// Its parts with motors, as parts of entity paths, and whether each has moved.
    pub(crate) parts: Vec<(String, bool)>,
    /// Entities of its trails.
    pub(crate) trails: Vec<String>,
    /// Bounds of its flat roadmap: left, top, right, bottom.
    pub(crate) bounds: Option<[f32; 4]>,
}

/// Writes the layout of a run's recording, all pages side by side.
pub(crate) fn send(rec: &RecordingStream, pages: &[Page]) -> Written {
    publish(rec, |print| print.write(pages))
}

/// Writes a layout and makes it the active one.
fn publish(rec: &RecordingStream, write: impl FnOnce(&mut Print<'_>) -> Written) -> Written {
    let info = rec.store_info().ok_or("the recording is switched off (environment variable RERUN)")?;
    let application = info.application_id().clone();
    let (layout, storage) =
        RecordingStreamBuilder::new(application).blueprint().memory().map_err(|e| in_words("its layout", &e))?;
    layout.set_time_sequence("blueprint", 0);
    let mut print = Print { rec: &layout, counts: BTreeMap::new(), last: [0; 2] };
    write(&mut print)?;
    let messages = storage.take();
    let id: StoreId = messages.first().map(|m| m.store_id().clone()).ok_or("the layout is empty")?;
    let command = BlueprintActivationCommand { blueprint_id: id, make_active: true, make_default: true };
    rec.send_blueprint(messages, command);
    Ok(())
}

/// A layout that is being written.
struct Print<'a> {
    rec: &'a RecordingStream,
    /// Number of boxes of each class.
    counts: BTreeMap<u8, u8>,
    /// The newest box: its class, and its number in that class.
    last: [u8; 2],
}

/// Path of a finished box in the blueprint.
type BoxPath = String;

/// Name of a view, with the robot's name if there are several robots.
fn named(what: &str, robot: &Shown, robots: &[Shown]) -> String {
    if robots.len() > 1 { format!("{}: {what}", robot.name) } else { what.to_owned() }
}

/// Index of the plot that opens first, counted over all robots: the first of a part that has moved.
pub(crate) fn open_plot(robots: &[Shown]) -> usize {
    robots.iter().flat_map(|robot| &robot.parts).position(|(_, moves)| *moves).unwrap_or(0)
}

/// A time at an offset from the cursor, s.
fn around(secs: i64) -> TimeRangeBoundary {
    TimeRangeBoundary::CursorRelative(TimeInt(secs * 1_000_000_000))
}

/// Id of the box of a class with this number.
fn uuid([class, number]: [u8; 2]) -> Uuid {
    Uuid { bytes: [0x6d, 0x6f, 0x62, 0x65, 0, 0, 0x40, 0, 0x80, 0, 0, 0, 0, 0, class, number] }
}

/// Classes of boxes, each with its own ids. The viewer stores the state of a view by its id when the layout is
/// sent again, and can't draw a view with the state of another class.
const CLASSES: [&str; 11] = [
    "3D",
    "2D",
    "Graph",
    "TextLog",
    "TextDocument",
    "TimeSeries",
    "StateTimeline",
    "Horizontal",
    "Vertical",
    "Tabs",
    "Grid",
];

/// Number of a class in ids.
fn class_number(class: &str) -> u8 {
    CLASSES.iter().zip(1..).find_map(|(known, number)| (*known == class).then_some(number)).unwrap_or(0)
}

impl Print<'_> {
    fn write(&mut self, pages: &[Page]) -> Written {
        let mut places = Vec::new();
        for page in pages {
            places.push(self.page(page)?);
        }
        if places.len() > 1 {
            self.container(ContainerKind::Horizontal, "Runs", &places, &vec![1.0; places.len()])?;
        }
        self.frame(PanelState::Collapsed, PlayState::Following)
    }

    /// Writes the viewport and the panels around it. It must come last, because the last box contains all others.
    fn frame(&mut self, time_line: PanelState, play: PlayState) -> Written {
        let viewport = look::ViewportBlueprint::new()
            .with_root_container(rerun::blueprint::components::RootContainer(uuid(self.last)))
            .with_auto_layout(false)
            .with_auto_views(false);
        self.log("viewport", &viewport)?;
        let collapsed = look::PanelBlueprint::new().with_state(PanelState::Collapsed);
        self.log("blueprint_panel", &collapsed)?;
        self.log("selection_panel", &collapsed)?;
        let looped = if play == PlayState::Playing { LoopMode::All } else { LoopMode::Off };
        let time = look::TimePanelBlueprint::new()
            .with_state(time_line)
            .with_timeline(TIMELINE)
            .with_loop_mode(looped)
            .with_play_state(play);
        self.log("time_panel", &time)
    }

    /// Writes the page of one recorder.
    fn page(&mut self, page: &Page) -> Result<BoxPath, String> {
        let Page { root, robots, eyes, front } = page;
        let scene = self.scene(page, front)?;
        // Before the maps: they are added later and shift the numbers of the boxes that follow.
        let eyes = self.eyes(root, eyes)?;
        // No empty view for agents without a map; the layout is sent again when the first vertex arrives.
        let mut maps = Vec::new();
        for robot in robots.iter().filter(|robot| robot.bounds.is_some()) {
            maps.push(self.map(root, robot, robots)?);
        }
        for robot in robots.iter().filter(|robot| robot.bounds.is_some()) {
            maps.push(self.view(
                "Graph",
                &named("Roadmap as graph", robot, robots),
                &format!("/{root}graph/{}", robot.name),
            )?);
        }
        let maps = if maps.is_empty() { None } else { Some(self.tabs("Roadmap", &maps)?) };
        let log = self.log_view(root, robots.len() > 1)?;
        let progress = self.progress(root)?;
        let about = self.view("TextDocument", "Legend", &format!("/{root}about"))?;
        let texts = self.tabs("Words", &[log, progress, about])?;
        let lanes = self.lanes("States", &format!("/{root}state"))?;
        let mut plots = Vec::new();
        for robot in robots {
            for (part, _) in &robot.parts {
                plots.push(self.plot(root, robot, part, robots)?);
            }
        }
        let plots = self.tabs_open_at("Joints", &plots, open_plot(robots))?;
        let right: Vec<BoxPath> = eyes.into_iter().chain(maps).chain([texts]).collect();
        let shares: &[f32] = match right.len() {
            3 => &[2.0, 2.0, 2.0],
            2 => &[3.0, 2.0],
            _ => &[1.0],
        };
        let right = self.container(ContainerKind::Vertical, "Eyes, map and words", &right, shares)?;
        let top = self.container(ContainerKind::Horizontal, "Scene and map", &[scene, right], &[3.0, 2.0])?;
        let bottom = self.container(ContainerKind::Horizontal, "Over time", &[lanes, plots], &[3.0, 2.0])?;
        let name = if root.is_empty() { "Run" } else { root.trim_end_matches('/') };
        self.container(ContainerKind::Vertical, name, &[top, bottom], &[3.0, 1.0])
    }

    /// Writes the camera images, side by side.
    fn eyes(&mut self, root: &str, eyes: &[String]) -> Result<Option<BoxPath>, String> {
        let mut views = Vec::new();
        for eye in eyes {
            let name = eye.split_once("eyes/").map_or(eye.as_str(), |(_, name)| name);
            views.push(self.view("2D", name, &format!("/{root}{eye}"))?);
        }
        if views.is_empty() {
            return Ok(None);
        }
        self.container(ContainerKind::Horizontal, "Eyes", &views, &vec![1.0; views.len()]).map(Some)
    }

    /// Writes the view of the world from the robot's front, with trails of the last seconds only.
    fn scene(&mut self, page: &Page, front: &Front) -> Result<BoxPath, String> {
        let Page { root, robots, .. } = page;
        let name = if root.is_empty() { "Robot and world" } else { root.trim_end_matches('/') };
        let scene = self.space(name, &format!("/{root}world"), front)?;
        let range = VisibleTimeRange(rerun::external::re_sdk_types::datatypes::VisibleTimeRange {
            timeline: TIMELINE.into(),
            range: TimeRange { start: around(-TRAIL_SECS), end: around(0) },
        });
        for trail in robots.iter().flat_map(|r| &r.trails) {
            let path = format!("{scene}/ViewContents/overrides/{root}{trail}/visualizers");
            self.log(&path, &look::VisibleTimeRanges::new([range.clone()]))?;
        }
        Ok(scene)
    }

    /// Writes a 3D view from the front.
    fn space(&mut self, name: &str, origin: &str, front: &Front) -> Result<BoxPath, String> {
        let scene = self.view("3D", name, origin)?;
        let eye = look::EyeControls3D::new()
            .with_position(front.eye)
            .with_look_target(front.target)
            .with_eye_up([0.0, 0.0, 1.0]);
        self.log(&format!("{scene}/EyeControls3D"), &eye)?;
        let background = look::Background::new(BackgroundKind::SolidColor).with_color(0x171C26FFu32);
        self.log(&format!("{scene}/Background"), &background)?;
        let grid = look::LineGrid3D::new()
            .with_visible(true)
            .with_spacing(0.2)
            .with_plane(components::Plane3D::new([0.0, 0.0, 1.0], front.floor))
            .with_color(0xFFFFFF0Cu32);
        self.log(&format!("{scene}/LineGrid3D"), &grid)?;
        Ok(scene)
    }

    fn map(&mut self, root: &str, robot: &Shown, robots: &[Shown]) -> Result<BoxPath, String> {
        let view = self.view("2D", &named("Roadmap", robot, robots), &format!("/{root}roadmap/{}", robot.name))?;
        let background = look::Background::new(BackgroundKind::SolidColor).with_color(0x0E1218FFu32);
        self.log(&format!("{view}/Background"), &background)?;
        if let Some([left, top, right, bottom]) = robot.bounds {
            let range =
                Range2D { x_range: [left.into(), right.into()].into(), y_range: [top.into(), bottom.into()].into() };
            self.log(&format!("{view}/VisualBounds2D"), &look::VisualBounds2D::new(range))?;
        }
        Ok(view)
    }

    /// Writes the event log; its column of sources is shown only if there are several robots.
    fn log_view(&mut self, root: &str, sources: bool) -> Result<BoxPath, String> {
        let view = self.view("TextLog", "Log", &format!("/{root}log"))?;
        let column = |kind, visible: bool| TextLogColumn(shapes::TextLogColumn { kind, visible: visible.into() });
        let columns = look::TextLogColumns::new().with_text_log_columns([
            column(TextLogColumnKind::EntityPath, sources),
            column(TextLogColumnKind::LogLevel, true),
            column(TextLogColumnKind::Body, true),
        ]);
        self.log(&format!("{view}/TextLogColumns"), &columns)?;
        Ok(view)
    }

    fn progress(&mut self, root: &str) -> Result<BoxPath, String> {
        let view = self.view("TimeSeries", "Progress", &format!("/{root}progress"))?;
        self.window(&view, TimeRangeBoundary::Infinite, TimeRangeBoundary::Infinite)?;
        Ok(view)
    }

    fn plot(&mut self, root: &str, robot: &Shown, part: &str, robots: &[Shown]) -> Result<BoxPath, String> {
        let view =
            self.view("TimeSeries", &named(part, robot, robots), &format!("/{root}joints/{}/{part}", robot.name))?;
        self.window(&view, around(-60), around(5))?;
        Ok(view)
    }

    /// Writes state lanes over all times. The view fits its range to the data when it is first drawn, which may
    /// be a part of a file that is still loading, or the first instant of a live run. Only the shared time axis
    /// follows later, so no range is set: all.
    fn lanes(&mut self, name: &str, origin: &str) -> Result<BoxPath, String> {
        let view = self.view("StateTimeline", name, origin)?;
        let axis = look::TimeAxis::new().with_link(LinkAxis::LinkToGlobal);
        self.log(&format!("{view}/TimeAxis"), &axis)?;
        Ok(view)
    }

    /// Sets the time range of a view.
    fn window(&self, view: &str, start: TimeRangeBoundary, end: TimeRangeBoundary) -> Written {
        let axis = look::TimeAxis::new().with_view_range(TimeRange { start, end });
        self.log(&format!("{view}/TimeAxis"), &axis)
    }

    fn view(&mut self, class: &str, name: &str, origin: &str) -> Result<BoxPath, String> {
        let path = self.id("view", class);
        let contents = look::ViewContents::new(["$origin/**"]);
        self.log(&format!("{path}/ViewContents"), &contents)?;
        let view = look::ViewBlueprint::new(class).with_display_name(name).with_space_origin(origin);
        self.log(&path, &view)?;
        Ok(path)
    }

    fn tabs(&mut self, name: &str, contents: &[BoxPath]) -> Result<BoxPath, String> {
        self.tabs_open_at(name, contents, 0)
    }

    fn tabs_open_at(&mut self, name: &str, contents: &[BoxPath], open: usize) -> Result<BoxPath, String> {
        let path = self.container(ContainerKind::Tabs, name, contents, &[])?;
        if let Some(active) = contents.get(open) {
            self.log(&path, &look::ContainerBlueprint::update_fields().with_active_tab(active.as_str()))?;
        }
        Ok(path)
    }

    fn container(
        &mut self,
        kind: ContainerKind,
        name: &str,
        contents: &[BoxPath],
        shares: &[f32],
    ) -> Result<BoxPath, String> {
        let path = self.id("container", &format!("{kind:?}"));
        let mut container = look::ContainerBlueprint::new(kind)
            .with_display_name(name)
            .with_contents(contents.iter().map(String::as_str));
        match kind {
            ContainerKind::Horizontal => container = container.with_col_shares(shares.iter().copied()),
            ContainerKind::Vertical => container = container.with_row_shares(shares.iter().copied()),
            ContainerKind::Tabs | ContainerKind::Grid => {}
        }
        self.log(&path, &container)?;
        Ok(path)
    }

    /// Creates the path of a new box. Ids are counted by class, not random: two recordings of one run open with
    /// equal layouts.
    fn id(&mut self, what: &str, class: &str) -> BoxPath {
        let class = class_number(class);
        let number = self.counts.entry(class).or_default();
        *number = number.saturating_add(1);
        self.last = [class, *number];
        format!("{what}/6d6f6265-0000-4000-8000-00000000{class:02x}{number:02x}")
    }

    fn log(&self, path: &str, what: &dyn AsComponents) -> Written {
        self.rec.log(path, what).map_err(|e| in_words("its layout", &e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The layout is sent again with more boxes, as when the first vertex of a map arrives.
    #[test]
    fn an_id_is_of_one_class_whatever_a_layout_has() {
        let mut classes: BTreeMap<BoxPath, &str> = BTreeMap::new();
        for layout in [&["3D", "TextLog", "TimeSeries"][..], &["3D", "2D", "2D", "TextLog", "Tabs", "StateTimeline"]] {
            let rec = RecordingStream::disabled();
            let mut print = Print { rec: &rec, counts: BTreeMap::new(), last: [0; 2] };
            for class in layout {
                assert_ne!(class_number(class), 0, "{class}");
                let before = classes.insert(print.id("view", class), class);
                assert!(before.is_none_or(|before| before == *class), "{before:?} and {class}");
            }
        }
    }
}
