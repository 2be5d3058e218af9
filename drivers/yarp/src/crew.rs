//! Group of tasks that must not end early: every task that can stop the robot is watched.

use std::future::Future;
use tokio::task::{Id, JoinSet};

/// Tasks of one thread. Dropping the group ends them.
#[derive(Debug, Default)]
pub struct Crew {
    tasks: JoinSet<()>,
    names: Vec<(Id, String)>,
}

impl Crew {
    /// Spawns a task.
    pub fn add(&mut self, name: String, task: impl Future<Output = ()> + Send + 'static) {
        #[cfg(test)]
        let task = poison::may_befall(name.clone(), task);
        let id = self.tasks.spawn(task).id();
        self.names.push((id, name));
    }

    /// Waits for the first task that ends, and returns its name and the reason. Never ready while all of them
    /// run.
    pub async fn lost(&mut self) -> String {
        match self.tasks.join_next_with_id().await {
            None => std::future::pending().await,
            Some(Ok((id, ()))) => format!("{} ended", self.name(id)),
            // no task is ever canceled
            Some(Err(error)) => format!("{} panicked", self.name(error.id())),
        }
    }

    /// Waits until all have ended.
    pub async fn ended(&mut self) {
        while self.tasks.join_next().await.is_some() {}
    }

    fn name(&self, id: Id) -> &str {
        self.names.iter().find(|(of, _)| *of == id).map_or("a task", |(_, name)| name)
    }
}

/// Panics on demand, so that tests can see what the death of each task does.
#[cfg(test)]
pub mod poison {
    use std::future::Future;
    use std::sync::Mutex;
    use tokio::sync::watch;

    static VICTIM: Mutex<Option<watch::Sender<String>>> = Mutex::new(None);

    fn victim() -> watch::Receiver<String> {
        VICTIM.lock().unwrap().get_or_insert_with(|| watch::Sender::new(String::new())).subscribe()
    }

    /// Panics the tasks whose name begins with `name`.
    pub fn kill(name: &str) {
        drop(victim());
        let victim = VICTIM.lock().unwrap();
        victim.as_ref().unwrap().send_replace(name.to_owned());
    }

    pub async fn may_befall(name: String, task: impl Future<Output = ()>) {
        let mut victim = victim();
        let befallen = async {
            loop {
                victim.changed().await.unwrap();
                let who = victim.borrow_and_update().clone();
                if name.starts_with(&who) {
                    return;
                }
            }
        };
        tokio::select! {
            () = befallen => panic!("poisoned: {name}"),
            () = task => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::instant;
    use std::time::Duration;

    #[tokio::test(start_paused = true)]
    async fn a_crew_has_ended_when_all_have() {
        let begun = instant();
        let mut crew = Crew::default();
        for secs in [1, 3, 2] {
            crew.add(format!("{secs} s"), tokio::time::sleep(Duration::from_secs(secs)));
        }
        assert_eq!((crew.lost().await, begun.elapsed().as_secs()), ("1 s ended".into(), 1));
        crew.ended().await;
        assert_eq!(begun.elapsed().as_secs(), 3);
    }

    #[tokio::test(start_paused = true)]
    async fn a_crew_reports_which_task_was_lost_and_why() {
        let mut crew = Crew::default();
        crew.add("hand".into(), std::future::pending());
        crew.add("brake".into(), async { std::panic::resume_unwind(Box::new("planted")) });
        assert_eq!(crew.lost().await, "brake panicked");
        crew.add("reader".into(), std::future::ready(()));
        assert_eq!(crew.lost().await, "reader ended");
    }
}
