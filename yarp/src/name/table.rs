//! State and answers of a name server: pure, without socket and clock (spec sections 3.1 and 3.3).

mod answer;
mod numbers;
mod subscriptions;

pub use answer::NameReply;
pub use subscriptions::PendingConnection;

use super::text::{registration, sayable};
use crate::{Bottle, Contact, Dialect, Value};
use numbers::NumberPool;
use std::collections::BTreeMap;
use subscriptions::Subscriptions;

/// Greatest number of properties of one port, and greatest size of all its properties together, bytes.
const MOST_PROPERTIES: (usize, usize) = (32, 8192);
/// Greatest number of topics.
const MOST_TOPICS: usize = 256;

/// Counters since the start of the server.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NameCounts {
    /// Registrations made.
    pub registered: u64,
    /// Registrations that took a name from another address. YARP allows this silently: two programs may
    /// compete for one port in this way, or a restarted one may reclaim its name.
    pub replaced: u64,
    /// Requests refused because of a limit or an invalid word.
    pub refused: u64,
}

/// The answer to one request, and the persistent connections that are due.
#[derive(Debug)]
pub struct Handled {
    /// Answer to send.
    pub answer: NameReply,
    /// Connections whose ends are both registered, to be made if they are not there.
    pub links: Vec<PendingConnection>,
}

/// Ports of a network, their properties, and the persistent connections.
#[derive(Debug)]
pub struct NameTable {
    ports: BTreeMap<String, NameEntry>,
    numbers: NumberPool,
    subscriptions: Subscriptions,
    topics: Vec<String>,
    most: usize,
    counts: NameCounts,
}

#[derive(Debug)]
struct NameEntry {
    contact: Contact,
    properties: BTreeMap<String, Vec<String>>,
    /// True for entries that are listed but can't be changed: the server itself.
    fixed: bool,
}

impl NameTable {
    /// Creates a table that contains only the server (its name is the namespace), for at most `most` ports.
    /// Port numbers are assigned from the server's own plus 2.
    pub fn new(server: Contact, most: usize) -> NameTable {
        let mut table = NameTable {
            numbers: NumberPool::new(server.port),
            ports: BTreeMap::new(),
            subscriptions: Subscriptions::default(),
            topics: Vec::new(),
            most,
            counts: NameCounts::default(),
        };
        for contact in [server, Contact::new("fallback", "mcast", "224.2.1.1", 10000)] {
            table.ports.insert(contact.name.clone(), NameEntry { contact, properties: BTreeMap::new(), fixed: true });
        }
        table
    }

    /// Counters so far.
    pub fn counts(&self) -> NameCounts {
        self.counts
    }

    /// Port of this name.
    pub fn query(&self, name: &str) -> Option<&Contact> {
        self.ports.get(&bare(name)).map(|e| &e.contact)
    }

    /// All ports, in the order of their names.
    pub fn ports(&self) -> impl Iterator<Item = &Contact> {
        self.ports.values().map(|e| &e.contact)
    }

    /// Answers one request of a peer at this host (an address), given as words.
    pub fn answer(&mut self, words: &[String], peer: &str) -> Handled {
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let mut links = Vec::new();
        let answer = match words.as_slice() {
            ["bot", "query", rest @ ..] => NameReply::Bottle(answer::port(self.query(rest.first().unwrap_or(&"")))),
            ["bot", "list", rest @ ..] => NameReply::ports(self.list(rest.first().copied())),
            ["bot", "set", name, key, values @ ..] => {
                self.set(name, key, values);
                NameReply::Bottle(self.values(name, key))
            }
            ["bot", "get", name, key, ..] => NameReply::Bottle(self.values(name, key)),
            ["bot", "help", ..] => NameReply::Bottle(Bottle::of(answer::HELP.iter().skip(1).copied())),
            ["bot", rest @ ..] | rest => self.plain(rest, peer, &mut links),
        };
        Handled { answer, links }
    }

    /// Answers in the plain form.
    fn plain(&mut self, words: &[&str], peer: &str, links: &mut Vec<PendingConnection>) -> NameReply {
        match words {
            ["register", name, rest @ ..] => NameReply::registration(self.register(name, rest, peer).as_ref()),
            ["query", name, ..] => NameReply::registration(self.query(name)),
            ["unregister", name, ..] => {
                self.unregister(&bare(name));
                NameReply::end()
            }
            ["list", rest @ ..] => {
                NameReply::Lines(self.list(rest.first().copied()).into_iter().map(registration).collect())
            }
            ["set", name, key, values @ ..] => {
                self.set(name, key, values);
                self.property(name, key)
            }
            ["set" | "get", name] => self.property(name, ""),
            ["get", name, key, ..] => self.property(name, key),
            ["check", name, key, rest @ ..] => self.check(name, key, rest.first().unwrap_or(&"")),
            ["route", rest @ ..] => {
                let (a, b) = (rest.first().unwrap_or(&""), rest.get(1).unwrap_or(&""));
                NameReply::Lines(vec![format!("port {a} route {b} = tcp:/{b}")])
            }
            ["gc", ..] => NameReply::Lines(vec!["garbage collection done.".into()]),
            ["help", ..] => NameReply::Lines(answer::HELP.iter().map(|l| l.to_string()).collect()),
            ["announce", rest @ ..] => {
                let present = !matches!(rest.get(1), Some(&("0" | "-1")));
                if let (Some(name), true) = (rest.first(), present) {
                    *links = self.due(&bare(name));
                }
                NameReply::done(true)
            }
            ["subscribe", src, dest, rest @ ..] => {
                let added = self.subscriptions.add(src, dest, rest.first().copied().unwrap_or_default());
                let src = bare(src);
                *links = self.due(&src).into_iter().filter(|l| l.is(&src, &bare(dest))).collect();
                // a subscription that ends with its port does not wait for an unregistered one
                for end in [src, bare(dest)] {
                    if self.query(&end).is_none() {
                        self.subscriptions.gone(&end);
                    }
                }
                self.counts.refused += u64::from(!added);
                NameReply::done(added)
            }
            ["subscribe", rest @ ..] => NameReply::Bottle(self.subscriptions.listed(rest.first().copied())),
            ["unsubscribe", rest @ ..] => {
                let word = |i| bare(rest.get(i).copied().unwrap_or_default());
                self.subscriptions.remove(&word(0), &word(1));
                NameReply::done(true)
            }
            ["topic", name, ..] => {
                let known = self.topics.iter().any(|t| t == name);
                let room = self.topics.len() < MOST_TOPICS && sayable(name);
                if !known && room {
                    self.topics.push(name.to_string());
                }
                NameReply::done(known || room)
            }
            ["topic"] => NameReply::Bottle(Bottle::of(self.topics.iter().map(String::as_str))),
            ["untopic", rest @ ..] => {
                self.topics.retain(|t| Some(&t.as_str()) != rest.first());
                NameReply::done(true)
            }
            ["type", ..] => NameReply::done(false),
            _ => NameReply::end(),
        }
    }

    /// Registers a port; `None` if that is refused. The words are carrier, host and number, any of them
    /// `...`.
    fn register(&mut self, name: &str, words: &[&str], peer: &str) -> Option<Contact> {
        let choose = |i: usize| words.get(i).copied().filter(|w| *w != "...");
        let carrier = choose(0).unwrap_or("tcp");
        let host = choose(1).unwrap_or(peer);
        let given = match choose(2).and_then(|w| w.parse::<i64>().ok()).unwrap_or(0) {
            // ports with a type send -1 for a number that the server has to choose
            -1 => 0,
            number @ 0..=65535 => number as u16,
            _ => return self.refuse(),
        };
        let fixed = self.ports.get(name).is_some_and(|e| e.fixed);
        let words_ok = [name, carrier, host].into_iter().all(sayable) && carrier.len() <= 100 && host.len() <= 260;
        if fixed || !words_ok || (self.ports.len() >= self.most && !self.ports.contains_key(name)) {
            return self.refuse();
        }
        // Checked before anything changes: a refused registration leaves the former one in place.
        if given == 0 && !self.numbers.has_port(name) {
            return self.refuse();
        }
        let before = self.ports.get(name).map(|e| e.contact.clone());
        self.unregister(name);
        let name = match name {
            "..." => self.numbers.name(),
            n if n.starts_with('=') => format!("{}{n}", self.numbers.name()),
            n => n.to_string(),
        };
        let host = match (carrier, choose(1)) {
            ("mcast", None) => self.numbers.group(),
            _ => host.to_string(),
        };
        let Some(port) = (if given == 0 { self.numbers.port(&name) } else { Some(given) }) else {
            return self.refuse();
        };
        let contact = Contact::new(&name, carrier, &host, port);
        self.counts.registered += 1;
        self.counts.replaced += u64::from(before.is_some_and(|b| (b.host, b.port) != (host, port)));
        self.ports.insert(name, NameEntry { contact: contact.clone(), properties: BTreeMap::new(), fixed: false });
        Some(contact)
    }

    fn refuse(&mut self) -> Option<Contact> {
        self.counts.refused += 1;
        None
    }

    fn unregister(&mut self, name: &str) {
        if self.ports.get(name).is_some_and(|e| !e.fixed) {
            self.numbers.free(self.ports.remove(name).map(|e| e.contact));
            self.subscriptions.gone(name);
        }
    }

    /// Ports whose names begin with these whole components.
    fn list(&self, prefix: Option<&str>) -> Vec<&Contact> {
        let within = |name: &str, prefix: &str| {
            name.strip_prefix(prefix)
                .is_some_and(|rest| rest.is_empty() || rest.starts_with('/') || prefix.ends_with('/'))
        };
        self.ports().filter(|c| prefix.is_none_or(|p| within(&c.name, p))).collect()
    }

    /// Replaces a property; no-op for an unknown port, or beyond the limits.
    fn set(&mut self, name: &str, key: &str, values: &[&str]) {
        let Some(entry) = self.ports.get_mut(&bare(name)) else { return };
        let size = |k: &String, v: &Vec<String>| k.len() + v.iter().map(|v| v.len() + 1).sum::<usize>();
        let others: usize = entry.properties.iter().filter(|(k, _)| *k != key).map(|(k, v)| size(k, v)).sum();
        let mut values: Vec<String> = values.iter().map(|v| v.to_string()).collect();
        values.sort();
        let count = entry.properties.len() + usize::from(!entry.properties.contains_key(key));
        if count > MOST_PROPERTIES.0 || others + size(&key.to_string(), &values) > MOST_PROPERTIES.1 {
            self.counts.refused += 1;
        } else if values.is_empty() {
            entry.properties.remove(key);
        } else {
            entry.properties.insert(key.to_string(), values);
        }
    }

    fn get(&self, name: &str, key: &str) -> Option<&[String]> {
        let entry = self.ports.get(&bare(name))?;
        Some(entry.properties.get(key).map(Vec::as_slice).unwrap_or_default())
    }

    fn property(&self, name: &str, key: &str) -> NameReply {
        let Some(values) = self.get(name, key) else { return NameReply::end() };
        let values: String = values.iter().map(|v| format!(" {v}")).collect();
        NameReply::Lines(vec![format!("port {} property {key} ={values}", bare(name))])
    }

    fn values(&self, name: &str, key: &str) -> Bottle {
        let value = |text: &String| match Bottle::parse(text, Dialect::V3) {
            Ok(Bottle(mut values)) if values.len() == 1 => values.swap_remove(0),
            _ => Value::from(text.as_str()),
        };
        Bottle(self.get(name, key).unwrap_or_default().iter().map(value).collect())
    }

    fn check(&self, name: &str, key: &str, value: &str) -> NameReply {
        let Some(values) = self.get(name, key) else { return NameReply::end() };
        let present = values.iter().any(|v| v == value);
        NameReply::Lines(vec![format!("port {} property {key} value {value} present {present}", bare(name))])
    }

    /// Persistent connections of a port whose ends are both registered now.
    fn due(&self, name: &str) -> Vec<PendingConnection> {
        self.subscriptions.of(name).filter(|l| [&l.src, &l.dest].iter().all(|end| self.query(end).is_some())).collect()
    }
}

/// Name without carrier and network choice: `/x` of `tcp://x` and `/net=127/x`.
fn bare(name: &str) -> String {
    let name = if name.starts_with('/') { name.to_string() } else { Contact::parse(name).name };
    match name
        .strip_prefix("/net=")
        .or_else(|| name.strip_prefix("/NET="))
        .and_then(|rest| rest.find('/').map(|i| &rest[i..]))
    {
        Some(rest) => rest.to_string(),
        None => name,
    }
}

#[cfg(test)]
mod tests;
