//! Name client: one short connection per request, every answer limited in time and length (spec section 3).

use super::text::{self, LONGEST_LINE};
use crate::{Contact, Network};
use std::io;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpStream;
use tokio::time::timeout;

/// Greatest size of an answer, bytes: more than the registrations of any name server.
const LONGEST_ANSWER: u64 = 16 * 1024 * 1024;

/// Reason why a request to a name server failed.
#[derive(Debug, thiserror::Error)]
pub enum NameError {
    /// No connection, or it broke.
    #[error("the YARP name server at {server} can't be reached ({why}): is it running? (`mobee yarp server`)")]
    Unreachable {
        /// Address of the server.
        server: String,
        /// The system's reason.
        why: String,
    },
    /// It answered, but not as a name server does.
    #[error("{server} does not answer as a YARP name server does ({got}): does yarp.conf give its port number?")]
    NotUnderstood {
        /// Address of the server.
        server: String,
        /// Answer received.
        got: String,
    },
    /// A word that the protocol can't express.
    #[error("\"{0}\" can't be a YARP name: it is empty, longer than 1000 bytes, or has blanks or quotes in it")]
    BadName(String),
}

impl Network {
    /// Looks up a port; `None` if its name is not registered.
    ///
    /// # Errors
    /// The name server can't be reached, or the name is invalid.
    pub async fn query(&self, name: &str) -> Result<Option<Contact>, NameError> {
        let lines = self.ask(&["query", name]).await?;
        Ok(lines.iter().find_map(|l| text::extract(l)))
    }

    /// Registers a port that listens on this host and number; returns the registration of the server. The
    /// host `...` stands for the address that the server sees. Replaces an earlier registration of the name
    /// (spec section 3.3).
    ///
    /// # Errors
    /// The name server can't be reached, the name is invalid, or the server is full.
    pub async fn register(&self, name: &str, host: &str, port: u16) -> Result<Contact, NameError> {
        let lines = self.ask(&["register", name, "tcp", host, &port.to_string()]).await?;
        let found = lines.iter().find_map(|l| text::extract(l));
        found.ok_or_else(|| self.not_understood(lines.first().map_or("no registration", |l| l)))
    }

    /// Removes the registration of a port, if there is one.
    ///
    /// # Errors
    /// The name server can't be reached, or the name is invalid.
    pub async fn unregister(&self, name: &str) -> Result<(), NameError> {
        self.ask(&["unregister", name]).await.map(drop)
    }

    /// All ports whose names begin with this prefix (whole components), in the order of their names; "" for
    /// all.
    ///
    /// # Errors
    /// The name server can't be reached, or the prefix is invalid.
    pub async fn list(&self, prefix: &str) -> Result<Vec<Contact>, NameError> {
        let lines = if prefix.is_empty() { self.ask(&["list"]).await? } else { self.ask(&["list", prefix]).await? };
        Ok(lines.iter().filter_map(|l| text::extract(l)).collect())
    }

    /// Sets a property of a registered port; several values are a list.
    ///
    /// # Errors
    /// The name server can't be reached, or a word is invalid.
    pub async fn set(&self, name: &str, key: &str, values: &[&str]) -> Result<(), NameError> {
        let mut words = vec!["set", name, key];
        words.extend(values);
        self.ask(&words).await.map(drop)
    }

    /// A property of a port, as text; `None` if the port or the property is unknown.
    ///
    /// # Errors
    /// The name server can't be reached, or a word is invalid.
    pub async fn get(&self, name: &str, key: &str) -> Result<Option<String>, NameError> {
        let lines = self.ask(&["get", name, key]).await?;
        let value = lines.first().and_then(|l| l.split_once(" = ")).map(|(_, value)| value.trim().to_string());
        Ok(value.filter(|v| !v.is_empty()))
    }

    /// Reports that a port listens now, so that the server makes its pending persistent connections.
    ///
    /// # Errors
    /// The name server can't be reached, or the name is invalid.
    pub async fn announce(&self, name: &str) -> Result<(), NameError> {
        self.ask(&["announce", name]).await.map(drop)
    }

    /// Sends one request to the name server. Returns the lines of its answer, without the terminator.
    ///
    /// # Errors
    /// The name server can't be reached, a word is invalid, or the answer is not understood.
    pub async fn ask(&self, words: &[&str]) -> Result<Vec<String>, NameError> {
        if let Some(word) = words.iter().find(|w| !text::sayable(w)) {
            return Err(NameError::BadName((*word).into()));
        }
        let request = format!("{}{}\n", text::REQUEST, words.join(" "));
        let (host, port) = self.server();
        let mut stream = self.connect_tcp(host, port).await.map_err(|e| self.name_error(e))?;
        let answer = async {
            stream.write_all(request.as_bytes()).await?;
            answer(&mut stream, one_line(words)).await
        };
        let late = || self.name_error(format!("no answer within {:?}", self.timeout()));
        match timeout(self.timeout(), answer).await.map_err(|_| late())? {
            Ok(lines) => Ok(lines),
            Err(e) if e.kind() == io::ErrorKind::InvalidData => Err(self.not_understood(&e.to_string())),
            Err(e) => Err(self.name_error(e)),
        }
    }

    fn not_understood(&self, got: &str) -> NameError {
        let (host, port) = self.server();
        let got = match got.contains('\u{fffd}') {
            true => "bytes that are no text; has it an auth.conf that is missing here?".into(),
            false => got.chars().filter(|c| !c.is_control()).take(100).collect(),
        };
        NameError::NotUnderstood { server: format!("{host}:{port}"), got }
    }
}

/// True if the answer is one line without a terminator.
fn one_line(words: &[&str]) -> bool {
    matches!(words, ["bot", ..] | ["subscribe" | "topic"] | ["subscribe", _])
}

/// Reads lines up to the end of an answer, and omits the terminator.
async fn answer(stream: &mut TcpStream, one_line: bool) -> io::Result<Vec<String>> {
    let mut reader = BufReader::new(stream.take(LONGEST_ANSWER));
    let mut lines = Vec::new();
    loop {
        let mut line = Vec::new();
        reader.read_until(b'\n', &mut line).await?;
        if line.last() != Some(&b'\n') {
            let what = if line.is_empty() { "it closed the connection".into() } else { lossy(&line) };
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
        let line = lossy(&line).trim_end().to_string();
        if line.starts_with(text::END) {
            return Ok(lines);
        }
        if line.starts_with('*') {
            return Err(io::Error::new(io::ErrorKind::InvalidData, line));
        }
        let last = one_line || text::ends(&line);
        lines.push(line);
        if last {
            return Ok(lines);
        }
    }
}

fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes.get(..bytes.len().min(LONGEST_LINE)).unwrap_or(bytes)).into_owned()
}
