//! Configurations of a robot, read back from a recording.

use crate::body::entity;
use crate::stream::TIMELINE;
use mobee_contract::Time;
use rerun::external::arrow::array::{Array as _, Float64Array, StringArray};
use rerun::external::re_log_encoding::DecoderApp;
use rerun::log::{Chunk, LogMsg};
use rerun::{StoreKind, TimelineName};
use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::Path;

/// Recorded positions of a robot's motors: within 0.05 degrees and, at rest, one second; see the plots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecordedPoses {
    /// Per part the names of its motors, and their positions over time, degrees.
    parts: BTreeMap<String, PosePlot>,
}

#[derive(Clone, Debug, Default, PartialEq)]
struct PosePlot {
    motors: Vec<String>,
    rows: BTreeMap<i64, Vec<f64>>,
}

impl RecordedPoses {
    /// Reads the data of a robot from a recording.
    ///
    /// # Errors
    /// As a message, if there is no such file, it is not a recording, or it has no data of the robot.
    pub fn read(path: &Path, robot: &str) -> Result<RecordedPoses, String> {
        let bad = |why: &dyn std::fmt::Display| format!("{} can't be read as a recording: {why}", path.display());
        let file = BufReader::new(mobee_model::file::open(path).map_err(|e| bad(&e))?);
        let below = format!("/joints/{}/", entity(robot));
        let mut poses = RecordedPoses::default();
        for message in DecoderApp::decode_eager(file).map_err(|e| bad(&e))?.map_while(Result::ok) {
            let LogMsg::ArrowMsg(store, rows) = message else { continue };
            if store.kind() != StoreKind::Recording {
                continue;
            }
            let Ok(chunk) = Chunk::from_arrow_msg(&rows) else { continue };
            if let Some(part) = chunk.entity_path().to_string().strip_prefix(&below) {
                poses.parts.entry(part.to_owned()).or_default().add(&chunk);
            }
        }
        poses.parts.retain(|_, plot| !plot.rows.is_empty());
        if poses.parts.is_empty() {
            return Err(format!("{}: there are no poses of a robot {robot} in it", path.display()));
        }
        Ok(poses)
    }

    /// Returns a table of comma-separated values: `t_s`, then `PART.MOTOR`, degrees; parts without a value at a
    /// time are interpolated.
    pub fn table(&self) -> String {
        use std::fmt::Write as _;
        let mut text = String::from("t_s");
        for (part, plot) in &self.parts {
            for motor in &plot.motors {
                let _ = write!(text, ",{part}.{motor}");
            }
        }
        text.push('\n');
        let times: std::collections::BTreeSet<i64> = self.parts.values().flat_map(|p| p.rows.keys().copied()).collect();
        for at in times {
            let _ = write!(text, "{}", Time(u64::try_from(at).unwrap_or(0)).secs());
            for value in self.parts.values().flat_map(|plot| plot.at(at)) {
                let _ = write!(text, ",{value:.4}");
            }
            text.push('\n');
        }
        text
    }
}

impl PosePlot {
    fn add(&mut self, chunk: &Chunk) {
        let times = chunk.timelines().get(&TimelineName::from_static_str(TIMELINE));
        for column in chunk.components().values() {
            let list = &column.list_array;
            if let Some(names) = list.values().as_any().downcast_ref::<StringArray>() {
                self.motors = names.iter().flatten().map(str::to_owned).collect();
            }
            let Some(times) = times else { continue };
            for (row, at) in times.times_raw().iter().enumerate().filter(|(row, _)| list.is_valid(*row)) {
                let values = list.value(row);
                if let Some(values) = values.as_any().downcast_ref::<Float64Array>() {
                    self.rows.insert(*at, values.values().to_vec());
                }
            }
        }
    }

    /// Positions at a time, interpolated linearly between two rows.
    fn at(&self, at: i64) -> Vec<f64> {
        let before = self.rows.range(..=at).next_back();
        let after = self.rows.range(at..).next();
        match (before, after) {
            (Some((t0, a)), Some((t1, b))) if t1 > t0 => {
                let share = (at - t0) as f64 / (t1 - t0) as f64;
                a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect()
            }
            (Some((_, q)), _) | (None, Some((_, q))) => q.clone(),
            (None, None) => Vec::new(),
        }
    }
}
