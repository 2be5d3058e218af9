//! Persistent connections: stored here, made by the server whenever both ends are registered (spec section
//! 3.3).

use super::bare;
use crate::Bottle;
use crate::name::text::sayable;
use std::collections::BTreeMap;

/// Largest number of stored connections.
const MAX_CONNECTIONS: usize = 4096;

/// A connection to be made, with its ends as the subscriber wrote them (they may have carriers).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PendingConnection {
    /// Sending port.
    pub src: String,
    /// Receiving port.
    pub dest: String,
}

impl PendingConnection {
    /// True if it connects these ports.
    pub(super) fn is(&self, src: &str, dest: &str) -> bool {
        bare(&self.src) == src && bare(&self.dest) == dest
    }
}

#[derive(Debug, Default)]
pub(super) struct Subscriptions(BTreeMap<(String, String), (PendingConnection, String)>);

impl Subscriptions {
    /// Stores a connection, and replaces an earlier one between the same ports. The mode is empty, `from` or
    /// `to`: the connection is then removed with that end.
    pub(super) fn add(&mut self, src: &str, dest: &str, mode: &str) -> bool {
        let key = (bare(src), bare(dest));
        if !(sayable(src) && sayable(dest))
            || mode.len() > 10
            || (self.0.len() >= MAX_CONNECTIONS && !self.0.contains_key(&key))
        {
            return false;
        }
        self.0.insert(key, (PendingConnection { src: src.into(), dest: dest.into() }, mode.into()));
        true
    }

    pub(super) fn remove(&mut self, src: &str, dest: &str) {
        self.0.remove(&(src.to_string(), dest.to_string()));
    }

    /// Removes the connections that end with this port.
    pub(super) fn gone(&mut self, name: &str) {
        self.0.retain(|(src, dest), (_, mode)| !((mode == "from" && src == name) || (mode == "to" && dest == name)));
    }

    /// Connections of a port.
    pub(super) fn of(&self, name: &str) -> impl Iterator<Item = PendingConnection> {
        self.0.iter().filter(move |((src, dest), _)| src == name || dest == name).map(|(_, (link, _))| link.clone())
    }

    /// Bottle of all connections, or of those of one port.
    pub(super) fn listed(&self, name: Option<&str>) -> Bottle {
        let wanted = self.0.iter().filter(|((src, dest), _)| name.is_none_or(|n| n == src || n == dest));
        wanted.fold(Bottle::of(["subscriptions"]), |all, (_, (link, mode))| {
            let mut one = Bottle::of(["subscription"]);
            one.push(Bottle::of(["src", &link.src])).push(Bottle::of(["dest", &link.dest]));
            if !mode.is_empty() {
                one.push(Bottle::of(["mode", mode]));
            }
            all.with(one)
        })
    }
}
