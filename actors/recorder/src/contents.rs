//! Contents of a recording, without a viewer.

use crate::stream::TIMELINE;
use mobee_contract::Time;
use rerun::external::arrow::array::{Array as _, StringArray};
use rerun::external::re_log_encoding::DecoderApp;
use rerun::log::{Chunk, LogMsg};
use rerun::{StoreKind, TimelineName};
use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::Path;

/// Contents of a recording. If its run was killed, they end with the last complete message.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Contents {
    /// Rows by entity, such as `/joints/icub/left_arm`.
    pub rows: BTreeMap<String, u64>,
    /// Properties of the run: seed, clock, configuration, build.
    pub properties: BTreeMap<String, String>,
    /// Time of the newest row.
    pub until: Time,
}

impl Contents {
    /// Reads a recording.
    ///
    /// # Errors
    /// As a message, if there is no such file or it is not a recording.
    pub fn read(path: &Path) -> Result<Contents, String> {
        let bad = |why: &dyn std::fmt::Display| format!("{} can't be read as a recording: {why}", path.display());
        let file = BufReader::new(mobee_model::file::open(path).map_err(|e| bad(&e))?);
        let messages = DecoderApp::decode_eager(file).map_err(|e| bad(&e))?;
        let mut contents = Contents::default();
        // A file whose writer was killed ends in the middle of a message: the messages before are valid.
        for message in messages.map_while(Result::ok) {
            if let LogMsg::ArrowMsg(store, rows) = message
                && store.kind() == StoreKind::Recording
                && let Ok(chunk) = Chunk::from_arrow_msg(&rows)
            {
                contents.add(&chunk);
            }
        }
        if contents.rows.is_empty() {
            return Err(bad(&"it holds nothing"));
        }
        Ok(contents)
    }

    fn add(&mut self, chunk: &Chunk) {
        let path = chunk.entity_path().to_string();
        if let Some(name) = path.strip_prefix("/__properties") {
            let name = name.trim_start_matches('/');
            for column in chunk.components().values() {
                let value = column.list_array.values();
                if let Some(text) =
                    value.as_any().downcast_ref::<StringArray>().filter(|t| !t.is_empty() && !name.is_empty())
                {
                    self.properties.insert(name.to_owned(), text.value(0).to_owned());
                }
            }
            return;
        }
        *self.rows.entry(path).or_default() += chunk.num_rows() as u64;
        if let Some(times) = chunk.timelines().get(&TimelineName::from_static_str(TIMELINE)) {
            let last = times.time_range().max().as_i64();
            self.until = self.until.max(Time(u64::try_from(last).unwrap_or(0)));
        }
    }
}
