//! I27: contacts have a hysteresis. A contact begins below the margin (during the retreat 1 mm below it), and
//! begins again only after it has ended.
//!
//! After a restart, as of a reflex that died, or after a change of the margin or the world, present contacts may
//! be reported again.

use super::{FoundViolations, Invariant};
use crate::journal::JournalLine;
use mobee_contract::Event;
use mobee_model::Contact;
use std::collections::BTreeMap;

/// Tolerance for rounding, meters.
const ROUNDING: f64 = 1e-9;

#[derive(Default)]
pub(super) struct ContactsHold {
    robots: BTreeMap<String, HeldContacts>,
}

#[derive(Default)]
struct HeldContacts {
    margin: f64,
    present: Vec<(Contact, (String, String))>,
}

impl Invariant for ContactsHold {
    fn on(&mut self, line: &JournalLine, found: &mut FoundViolations<'_>) {
        match &line.event {
            Event::Robot { robot, margin, .. } => {
                self.robots.insert(robot.clone(), HeldContacts { margin: *margin, present: Vec::new() });
            }
            Event::Died { .. } | Event::Restarted { .. } | Event::Resumed { .. } | Event::World { .. } => {
                self.robots.values_mut().for_each(|r| r.present.clear());
            }
            Event::ContactBegan { robot, contact, names, .. } => {
                let Some(state) = self.robots.get_mut(robot) else { return };
                let mm = contact.distance * 1e3;
                let margin = state.margin * 1e3;
                if contact.distance > state.margin + ROUNDING {
                    found
                        .report(format!("{robot}: a contact began at {mm:.2} mm, beyond the margin of {margin:.2} mm"));
                }
                if state.present.iter().any(|(known, _)| known.pair == contact.pair) {
                    found.report(format!("{robot}: the contact of {} and {} began a second time", names.0, names.1));
                } else {
                    state.present.push((*contact, names.clone()));
                }
            }
            Event::ContactEnded { robot, names, .. } => {
                if let Some(state) = self.robots.get_mut(robot) {
                    state.present.retain(|(_, known)| known != names);
                }
            }
            _ => {}
        }
    }
}
