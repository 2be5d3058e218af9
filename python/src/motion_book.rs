//! The account of one robot's motions, from the run's events: outcome, contacts, depth, duration of the retreat. No Python here.

use mobee_contract::{Cause, Entry, Event, Outcome, Refusal, Sink, Time};
use mobee_model::{Contact, Scene};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Contacts of one motion that are listed.
const MAX_CONTACTS: usize = 64;

/// Account of the last motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct MotionAccount {
    pub outcome: Option<&'static str>,
    /// Kind of the cause, in a word or two.
    pub cause: Option<&'static str>,
    /// Names of the pairs that came too near.
    pub contacts: Vec<(String, String)>,
    /// Greatest penetration, m.
    pub depth: f64,
    /// Duration of the retreat, s.
    pub retreat_s: f64,
    /// Code and words of the refusal.
    pub refusal: Option<(&'static str, String)>,
}

#[derive(Default)]
struct Account {
    open: MotionAccount,
    retreat_began: Option<Time>,
    last: MotionAccount,
    /// Outcomes and refusals so far.
    settled: u64,
}

/// Shared by the sink in the run and by its reader.
#[derive(Clone)]
pub(crate) struct MotionBook {
    robot: String,
    /// For the names of shapes.
    scene: Arc<Scene>,
    account: Arc<(Mutex<Account>, Condvar)>,
}

impl MotionBook {
    pub fn new(robot: &str, scene: Arc<Scene>) -> Self {
        Self { robot: robot.to_owned(), scene, account: Arc::default() }
    }

    fn lock(&self) -> MutexGuard<'_, Account> {
        self.account.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Number of outcomes and refusals so far.
    pub fn settled(&self) -> u64 {
        self.lock().settled
    }

    /// The account of the motion that was settled after `before`; `None` if none comes in time.
    pub fn after(&self, before: u64, patience: Duration) -> Option<MotionAccount> {
        let waited = self.account.1.wait_timeout_while(self.lock(), patience, |account| account.settled <= before);
        let (account, timeout) = waited.unwrap_or_else(PoisonError::into_inner);
        (!timeout.timed_out()).then(|| account.last.clone())
    }

    fn name(&self, contact: &Contact) -> (String, String) {
        (self.scene.shape_name(contact.pair.0), self.scene.shape_name(contact.pair.1))
    }

    fn event(&self, at: Time, event: &Event) {
        let mut account = self.lock();
        match event {
            Event::Commit { robot, .. } if *robot == self.robot => account.open = MotionAccount::default(),
            Event::ContactBegan { robot, names, contact, .. } | Event::HardContact { robot, names, contact }
                if *robot == self.robot =>
            {
                list(&mut account.open.contacts, names.clone());
                account.open.depth = account.open.depth.max(-contact.distance);
            }
            Event::ContactEnded { robot, depth: Some(depth), .. } if *robot == self.robot => {
                account.open.depth = account.open.depth.max(*depth);
            }
            Event::RetreatBegan { robot, .. } if *robot == self.robot => account.retreat_began = Some(at),
            Event::Refused { robot, refusal, .. } if *robot == self.robot => {
                let last =
                    MotionAccount { refusal: Some((refusal.code(), words(refusal))), ..MotionAccount::default() };
                self.settle(&mut account, last);
            }
            Event::Outcome { robot, outcome, cause, .. } if *robot == self.robot => {
                let mut last = std::mem::take(&mut account.open);
                last.outcome = Some(match outcome {
                    Outcome::Committed => "committed",
                    Outcome::RolledBack => "rolled_back",
                    Outcome::Faulted => "faulted",
                });
                last.cause = cause.as_ref().map(Cause::word);
                if let Some(Cause::Contact(near) | Cause::Foreseen(near)) = cause {
                    near.iter().for_each(|contact| list(&mut last.contacts, self.name(contact)));
                }
                last.retreat_s = account.retreat_began.take().map_or(0.0, |began| at.since(began).as_secs_f64());
                self.settle(&mut account, last);
            }
            _ => {}
        }
    }

    fn settle(&self, account: &mut Account, last: MotionAccount) {
        account.last = last;
        account.settled += 1;
        self.account.1.notify_all();
    }
}

fn list(all: &mut Vec<(String, String)>, names: (String, String)) {
    if all.len() < MAX_CONTACTS && !all.contains(&names) {
        all.push(names);
    }
}

fn words(refusal: &Refusal) -> String {
    format!("{refusal}; {}", refusal.remedy())
}

impl Sink for MotionBook {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        if let Entry::Event(event) = entry {
            self.event(at, event);
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}
