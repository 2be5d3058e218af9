//! The account of one robot's motions, from the run's events: outcome, contacts, depth, duration of the retreat. No Python here.

use mobee_contract::{Cause, CommitId, Entry, Event, Outcome, Refusal, Sink, Time};
use mobee_model::{Contact, Scene};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Contacts of one motion that are listed.
const MAX_CONTACTS: usize = 64;
/// Motions whose accounts are stored.
const MAX_ACCOUNTS: usize = 256;
/// Time in which an event that has been emitted must arrive.
const ACCOUNT_TIMEOUT: Duration = Duration::from_secs(2);

/// Account of the last motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct MotionAccount {
    /// The transaction; none if it was refused.
    pub id: Option<CommitId>,
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
    /// The newest outcomes, and how many there were: committed, rolled back, faulted.
    accounts: VecDeque<MotionAccount>,
    outcomes: [u64; 3],
    /// Cause of the last closing of the filter, in words.
    stopped: Option<String>,
    /// Braking clearance of the controller, m, once it has been described.
    braking_clearance: Option<f64>,
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

    /// The account of the last motion that has ended.
    pub fn last(&self) -> Option<MotionAccount> {
        self.lock().accounts.back().cloned()
    }

    /// The account of a motion that has ended; `None` if it is not among the newest.
    pub fn account_of(&self, id: CommitId) -> Option<MotionAccount> {
        let of = |account: &MotionAccount| account.id == Some(id);
        let later = |account: &mut Account| account.accounts.back().is_none_or(|newest| newest.id < Some(id));
        let waited = self.account.1.wait_timeout_while(self.lock(), ACCOUNT_TIMEOUT, later);
        let (account, _) = waited.unwrap_or_else(PoisonError::into_inner);
        account.accounts.iter().rev().find(|account| of(account)).cloned()
    }

    /// Numbers of motions that were committed, rolled back and faulted.
    pub fn outcomes(&self) -> [u64; 3] {
        self.lock().outcomes
    }

    /// Cause of the last closing of the filter, in words.
    pub fn stopped(&self) -> Option<String> {
        self.lock().stopped.clone()
    }

    /// Braking clearance of the controller, m; zero if it does not look ahead.
    pub fn braking_clearance(&self) -> f64 {
        let waited = self.account.1.wait_timeout_while(self.lock(), ACCOUNT_TIMEOUT, |a| a.braking_clearance.is_none());
        let (account, _) = waited.unwrap_or_else(PoisonError::into_inner);
        account.braking_clearance.unwrap_or_default()
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
            Event::Controller { robot, clearance, .. } if *robot == self.robot => {
                account.braking_clearance = Some(clearance.unwrap_or_default());
                self.account.1.notify_all();
            }
            Event::Disabled { robot, cause, .. } if *robot == self.robot => {
                account.stopped = Some(self.cause(cause));
            }
            Event::Outcome { robot, id, outcome, cause, .. } if *robot == self.robot => {
                let mut last = std::mem::take(&mut account.open);
                last.id = Some(*id);
                let [committed, rolled_back, faulted] = &mut account.outcomes;
                *match outcome {
                    Outcome::Committed => committed,
                    Outcome::RolledBack => rolled_back,
                    Outcome::Faulted => faulted,
                } += 1;
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
                if account.accounts.len() >= MAX_ACCOUNTS {
                    account.accounts.pop_front();
                }
                account.accounts.push_back(last.clone());
                self.settle(&mut account, last);
            }
            _ => {}
        }
    }

    /// A cause with the first pair of shapes that came too near.
    fn cause(&self, cause: &Cause) -> String {
        let first = match cause {
            Cause::Contact(near) | Cause::Foreseen(near) => near.first().map(|contact| self.name(contact)),
            _ => None,
        };
        let pair = first.map_or(String::new(), |(a, b)| format!(" ({a}, {b})"));
        format!("{}{pair}", cause.word())
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
