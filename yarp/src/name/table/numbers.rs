//! Assignment of port numbers, names and multicast groups (spec section 3.3).

use crate::Contact;
use std::collections::{BTreeMap, BTreeSet};

/// Range of numbers above the server's own.
const LAST: u16 = 9999;

/// One counter each, and the released values.
#[derive(Debug)]
pub(super) struct NumberPool {
    next: u16,
    last: u16,
    /// Last owner of each number, and whether it is in use.
    given: BTreeMap<u16, (String, bool)>,
    preferred: BTreeMap<String, u16>,
    next_name: u64,
    free_names: BTreeSet<String>,
    next_group: u16,
    free_groups: BTreeSet<String>,
}

impl NumberPool {
    pub(super) fn new(server: u16) -> NumberPool {
        NumberPool {
            next: server.saturating_add(2),
            last: server.saturating_add(LAST),
            given: BTreeMap::new(),
            preferred: BTreeMap::new(),
            next_name: 1,
            free_names: BTreeSet::new(),
            next_group: 2,
            free_groups: BTreeSet::new(),
        }
    }

    /// True if numbers are left that were never assigned.
    fn has_next(&self) -> bool {
        self.next <= self.last && self.next < u16::MAX
    }

    /// True if [`Numbers::port`] has a number for a name once the name's present one is released.
    pub(super) fn has_port(&self, name: &str) -> bool {
        self.has_next() || self.given.values().any(|(owner, used)| !used || owner == name)
    }

    /// Port number for a name: its former one if that is free, else the next, or finally any free one.
    pub(super) fn port(&mut self, name: &str) -> Option<u16> {
        let free = |number: &u16| self.given.get(number).is_some_and(|(_, used)| !used);
        let number = match self.preferred.get(name).copied().filter(free) {
            Some(number) => number,
            None if self.has_next() => {
                self.next += 1;
                self.next - 1
            }
            None => self.given.iter().find(|(_, (_, used))| !used).map(|(number, _)| *number)?,
        };
        if let Some((before, _)) = self.given.insert(number, (name.into(), true)) {
            self.preferred.remove(&before);
        }
        self.preferred.insert(name.into(), number);
        Some(number)
    }

    /// Unused port name.
    pub(super) fn name(&mut self) -> String {
        self.free_names.pop_first().unwrap_or_else(|| {
            self.next_name += 1;
            format!("/tmp/port/{}", self.next_name - 1)
        })
    }

    /// Unused multicast address.
    pub(super) fn group(&mut self) -> String {
        self.free_groups.pop_first().unwrap_or_else(|| {
            let n = self.next_group;
            self.next_group = self.next_group.wrapping_add(1) % (254 * 255);
            format!("224.1.{}.{}", n / 255 + 1, n % 255 + 1)
        })
    }

    /// Releases the values of a port.
    pub(super) fn free(&mut self, contact: Option<Contact>) {
        let Some(Contact { name, carrier, host, port }) = contact else { return };
        if let Some((owner, used)) = self.given.get_mut(&port)
            && *owner == name
        {
            *used = false;
        }
        if name.strip_prefix("/tmp/port/").is_some_and(|n| n.parse::<u64>().is_ok_and(|n| n < self.next_name)) {
            self.free_names.insert(name);
        }
        if carrier == "mcast" && host.starts_with("224.1.") {
            self.free_groups.insert(host);
        }
    }
}
