//! `mobee ctl restart`: starts a sensor or a bridge again.

use super::handler::{RequestHandler, SYSTEM_TIMEOUT};
use mobee_runtime::system::Control;
use std::collections::BTreeSet;
use tokio::sync::oneshot;

impl RequestHandler {
    /// Starts the sensor or bridge of this name again, or the only one.
    pub(super) async fn restart(&self, names: &[&str]) -> Result<Vec<String>, String> {
        let sensors = self.beside.cameras.iter().filter_map(|camera| Some(camera.split_once('/')?.0));
        let all: BTreeSet<&str> = sensors.chain(self.beside.bridges.iter().map(String::as_str)).collect();
        let there = || all.iter().copied().collect::<Vec<_>>().join(", ");
        let name = match (names, all.len()) {
            (_, 0) => return Err("there is no sensor and no bridge in this run".into()),
            // the sensor of a camera is restarted as a whole
            ([name], _) => name.split_once('/').map_or(*name, |(sensor, _)| sensor),
            ([], 1) => all.first().copied().unwrap_or_default(),
            ([], _) => return Err(format!("name the sensor or bridge; there are: {}", there())),
            _ => return Err(format!("name one sensor or bridge; there are: {}", there())),
        };
        if !all.contains(name) {
            return Err(format!("there is no sensor or bridge `{name}` in this run; there are: {}", there()));
        }
        let (reply, done) = oneshot::channel();
        self.send(Control::Restart { name: name.to_owned(), reply }).await?;
        let done =
            tokio::time::timeout(SYSTEM_TIMEOUT, done).await.map_err(|_| "the run does not answer".to_owned())?;
        done.map_err(|_| "the run is ending".to_owned())??;
        Ok(vec![format!("{name} has been started again")])
    }
}
