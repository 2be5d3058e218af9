//! The user's YARP configuration: `yarp.conf`, namespaces, `auth.conf` and environment variables (spec section 2).

use crate::Network;
use crate::auth::Key;
use std::io;
use std::net::IpAddr;
use std::path::{Path, PathBuf};

/// Port number of name servers, unless `YARP_PORT_RANGE` or a file gives another.
pub const DEFAULT_PORT: u16 = 10000;
/// Greatest size of a configuration file, bytes; longer ones are refused.
const MAX_FILE_BYTES: u64 = 64 * 1024;

/// Error in the user's YARP configuration, with the place and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum NetworkConfigError {
    /// There is no address file.
    #[error(
        "{} does not exist, so the YARP name server is unknown: start one with `mobee yarp server --write`, \
         or write its address there as `127.0.0.1 10000 yarp`, or give it with --server HOST:PORT", .0.display()
    )]
    Missing(PathBuf),
    /// A file can't be read.
    #[error("{} can't be read: {why}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        why: String,
    },
    /// A file contains an error.
    #[error("{}, line {line}: {what}", path.display())]
    Wrong {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Description of the error, with the expected content.
        what: String,
    },
    /// An environment variable has an invalid value.
    #[error("environment variable {name}=\"{value}\": {what}")]
    Variable {
        /// Name of the variable.
        name: &'static str,
        /// Its value.
        value: String,
        /// Description of the error, with the expected content.
        what: String,
    },
    /// The environment gives neither a configuration folder nor a home.
    #[error("no folder for yarp.conf: set YARP_CONFIG_HOME or HOME")]
    NoHome,
}

/// Source of the environment: the process's, or that of a test.
pub struct Env<'a>(Box<Variables<'a>>);

/// Lookup of a variable's value.
type Variables<'a> = dyn Fn(&str) -> Option<String> + 'a;

impl<'a> Env<'a> {
    /// The process's environment variables.
    pub fn real() -> Env<'static> {
        Env(Box::new(|name| std::env::var(name).ok()))
    }

    /// Variables given by a function.
    pub fn new(variables: impl Fn(&str) -> Option<String> + 'a) -> Env<'a> {
        Env(Box::new(variables))
    }

    fn get(&self, name: &str) -> Option<String> {
        (self.0)(name).filter(|v| !v.is_empty())
    }

    fn number(&self, name: &'static str) -> Result<Option<u16>, NetworkConfigError> {
        let parse = |value: String| match value.trim().parse() {
            Ok(n) if n > 0 => Ok(n),
            _ => Err(NetworkConfigError::Variable {
                name,
                value,
                what: "a port number from 1 to 65535 was expected".into(),
            }),
        };
        self.get(name).map(parse).transpose()
    }

    /// The folder of `yarp.conf`: `$YARP_CONFIG_HOME`, else `$XDG_CONFIG_HOME/yarp`, else `~/.config/yarp`.
    ///
    /// # Errors
    /// None of the three is set.
    pub fn config_home(&self) -> Result<PathBuf, NetworkConfigError> {
        let own = self.get("YARP_CONFIG_HOME").map(PathBuf::from);
        let xdg = || self.get("XDG_CONFIG_HOME").map(|p| Path::new(&p).join("yarp"));
        let home = || self.get("HOME").map(|p| Path::new(&p).join(".config/yarp"));
        own.or_else(xdg).or_else(home).ok_or(NetworkConfigError::NoHome)
    }

    /// The namespace: `YARP_NAMESPACE`, else `yarp_namespace.conf`, else `/root`.
    ///
    /// # Errors
    /// The file exists but can't be read.
    pub fn namespace(&self) -> Result<String, NetworkConfigError> {
        let text = match self.get("YARP_NAMESPACE") {
            Some(text) => Some(text),
            None => read(&self.config_home()?.join("yarp_namespace.conf"))?,
        };
        let first = text.as_deref().and_then(|t| t.split(blank).find(|w| !w.is_empty()));
        Ok(first.unwrap_or("/root").to_string())
    }

    /// File that contains the name server's address in this namespace.
    ///
    /// # Errors
    /// As [`Env::config_home`].
    pub fn address_file(&self, namespace: &str) -> Result<PathBuf, NetworkConfigError> {
        let safe: String = namespace.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let file = if namespace == "/root" { "yarp.conf".into() } else { format!("{safe}.conf") };
        Ok(self.config_home()?.join(file))
    }

    /// Default port number of name servers: `YARP_PORT_RANGE`, else 10000.
    ///
    /// # Errors
    /// The variable is not a port number.
    pub fn default_port(&self) -> Result<u16, NetworkConfigError> {
        Ok(self.number("YARP_PORT_RANGE")?.unwrap_or(DEFAULT_PORT))
    }

    /// Key of `auth.conf` in the configuration folder; `None` without the file or without a key in it.
    ///
    /// # Errors
    /// The file exists but can't be read.
    pub fn auth(&self) -> Result<Option<Key>, NetworkConfigError> {
        let Ok(home) = self.config_home() else { return Ok(None) };
        let text = read(&home.join("auth.conf"))?.unwrap_or_default();
        let key = section(&text, "AUTH").find(|(_, key, _)| *key == "key").map(|(_, _, value)| value);
        Ok(key.filter(|k| !k.is_empty()).map(Key::new))
    }

    /// Applies the environment to a network, except for the server's address.
    ///
    /// # Errors
    /// A variable or file with an error.
    pub fn apply(&self, network: Network) -> Result<Network, NetworkConfigError> {
        let mut network = network.with_auth(self.auth()?).with_namespace(self.namespace()?);
        if let Some(prefix) = self.get("YARP_PORT_PREFIX") {
            network = network.with_prefix(prefix);
        }
        if let Some(value) = self.get("YARP_IP") {
            let what = "the whole IPv4 or IPv6 address to listen on was expected (prefixes are not supported)".into();
            let ip: IpAddr =
                value.parse().map_err(|_| NetworkConfigError::Variable { name: "YARP_IP", value, what })?;
            network = network.with_bind(ip);
        }
        Ok(network)
    }
}

/// Network of this environment.
///
/// # Errors
/// See [`Network::from_env`].
pub fn network(env: &Env) -> Result<Network, NetworkConfigError> {
    let path = env.address_file(&env.namespace()?)?;
    let text = read(&path)?.ok_or_else(|| NetworkConfigError::Missing(path.clone()))?;
    let (host, port) = address(&text).map_err(|(line, what)| NetworkConfigError::Wrong { path, line, what })?;
    env.apply(Network::of(host, port))
}

/// Network of this environment, or, if it gives none, the usual place on this computer.
///
/// # Errors
/// A file or variable with an error.
pub fn network_or_default(env: &Env) -> Result<Network, NetworkConfigError> {
    match network(env) {
        Err(NetworkConfigError::Missing(_) | NetworkConfigError::NoHome) => {
            env.apply(Network::of(crate::network::LOOPBACK.to_string(), env.default_port()?))
        }
        found => found,
    }
}

/// Host and port number in an address file of either form; otherwise the line and the error.
fn address(text: &str) -> Result<(String, u16), (usize, String)> {
    const FORM: &str = "`HOST PORT yarp` was expected, such as `127.0.0.1 10000 yarp`";
    let start = text.lines().position(|l| !l.trim().is_empty()).ok_or((1, format!("the file is empty; {FORM}")))?;
    let (line, host, port, mode);
    if text.trim_start().starts_with('[') {
        let entries: Vec<_> = section(text, "name").collect();
        let find = |k: &str| entries.iter().find(|(_, key, _)| *key == k).map(|(n, _, v)| (*n, *v));
        let missing = |key: &str| (start + 1, format!("the section `[name]` with `host` and `port` lacks `{key}`"));
        host = find("host").ok_or_else(|| missing("host"))?.1;
        (line, port) = find("port").ok_or_else(|| missing("port"))?;
        mode = find("mode").map_or("yarp", |(_, mode)| mode);
    } else {
        let mut words = text.split(blank).filter(|w| !w.is_empty());
        let mut next = || words.next().ok_or((start + 1, FORM.to_string()));
        (line, host, port) = (start + 1, next()?, next()?);
        mode = words.next().unwrap_or("yarp");
    }
    if mode != "yarp" {
        return Err((line, format!("name servers of mode `{mode}` are not supported, only `yarp`")));
    }
    match port.parse() {
        Ok(port) if port > 0 => Ok((host.to_string(), port)),
        _ => Err((line, format!("`{port}` is no port number; {FORM}"))),
    }
}

/// Entries of an ini section: line (from 1), key and value; `key value` and `key = value`, `#` and `//`
/// comments.
fn section<'a>(text: &'a str, name: &'a str) -> impl Iterator<Item = (usize, &'a str, &'a str)> {
    let mut inside = false;
    text.lines().enumerate().filter_map(move |(i, line)| {
        let line = line.trim();
        if let Some(head) = line.strip_prefix('[') {
            inside = head.trim_end_matches(']').trim() == name;
            return None;
        }
        if !inside || line.is_empty() || line.starts_with('#') || line.starts_with("//") {
            return None;
        }
        let (key, value) = line.split_once(|c: char| c == '=' || c.is_whitespace())?;
        let value = value.trim_start_matches(|c: char| c == '=' || c.is_whitespace());
        Some((i + 1, key, value.trim_matches('"')))
    })
}

/// True for characters between the words of an address file.
fn blank(c: char) -> bool {
    c == '"' || c.is_whitespace()
}

/// Text of a file; `None` if it does not exist.
fn read(path: &Path) -> Result<Option<String>, NetworkConfigError> {
    let unreadable = |why: String| NetworkConfigError::Unreadable { path: path.into(), why };
    match std::fs::metadata(path) {
        Ok(about) if about.len() > MAX_FILE_BYTES => return Err(unreadable(format!("it has {} bytes", about.len()))),
        // reading a pipe would block, and a device has no end
        Ok(about) if !about.is_file() => return Err(unreadable("it is no file".into())),
        _ => {}
    }
    match std::fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(e) if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => Ok(None),
        Err(e) => Err(unreadable(e.to_string())),
    }
}

#[cfg(test)]
mod tests;
