//! The protocol between `mobee ctl` and a run: one JSON object per line, requests and replies in turn.
//!
//! ```text
//! {"words":["swap","icub","agent"],"offer":{"file":"faster.toml","config":{...},"texts":{"icub.xml":"<ZRP>..."}}}
//! {"done":true,"lines":["built and checked"]}
//! ```

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;
use tokio::io::{AsyncBufRead, AsyncBufReadExt, AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};

/// Maximum length of a line, bytes: a configuration with its models and a table of recorded poses.
pub(super) const MAX_LINE_BYTES: usize = 32 << 20;

/// A request to a run.
#[derive(Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Request {
    /// The command and its arguments.
    pub(super) words: Vec<String>,
    /// With `swap`: the configuration of the new part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) offer: Option<SentConfig>,
}

/// A configuration as its client read it. The run opens no file that is named here.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SentConfig {
    /// The client's path of the configuration.
    pub(super) file: PathBuf,
    /// Its values, with all layers merged.
    pub(super) config: Value,
    /// The contents of the files that it names.
    pub(super) texts: BTreeMap<PathBuf, String>,
    /// The contents of files that are not text, two hexadecimal digits per byte.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) binaries: BTreeMap<PathBuf, String>,
}

impl SentConfig {
    /// Adds a file.
    pub(super) fn put(&mut self, path: PathBuf, bytes: Vec<u8>) {
        match String::from_utf8(bytes) {
            Ok(text) => self.texts.insert(path, text),
            Err(e) => self.binaries.insert(path, e.into_bytes().iter().map(|b| format!("{b:02x}")).collect()),
        };
    }

    /// The contents of all files.
    ///
    /// # Errors
    /// If a file's digits are malformed.
    pub(super) fn files(&self) -> Result<BTreeMap<PathBuf, Vec<u8>>, String> {
        let mut files: BTreeMap<PathBuf, Vec<u8>> =
            self.texts.iter().map(|(path, text)| (path.clone(), text.clone().into_bytes())).collect();
        for (path, digits) in &self.binaries {
            let digit = |c: u8| char::from(c).to_digit(16);
            let byte = |two: &[u8]| match two {
                [high, low] => u8::try_from(digit(*high)? << 4 | digit(*low)?).ok(),
                _ => None,
            };
            let bytes: Option<Vec<u8>> = digits.as_bytes().chunks(2).map(byte).collect();
            let bytes = bytes.ok_or_else(|| format!("{} was not sent whole", path.display()))?;
            files.insert(path.clone(), bytes);
        }
        Ok(files)
    }
}

/// The reply to a request.
#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Reply {
    /// True if the request succeeded.
    pub(super) done: bool,
    /// The text of the reply.
    pub(super) lines: Vec<String>,
    /// True if the run has ended: no further reply follows on this connection.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(super) over: bool,
}

/// A connection of any kind.
pub(super) trait CtlStream: AsyncRead + AsyncWrite + Send + Unpin {}
impl<T: AsyncRead + AsyncWrite + Send + Unpin> CtlStream for T {}

/// Reads the next line; `None` at the end of the connection.
///
/// # Errors
/// If the line is too long or malformed, or the connection broke.
pub(super) async fn read<T: DeserializeOwned>(from: &mut (impl AsyncBufRead + Unpin)) -> io::Result<Option<T>> {
    let mut line = Vec::new();
    let most = MAX_LINE_BYTES as u64 + 1;
    if from.take(most).read_until(b'\n', &mut line).await? == 0 {
        return Ok(None);
    }
    let invalid = |what: String| io::Error::new(io::ErrorKind::InvalidData, what);
    if line.len() > MAX_LINE_BYTES {
        return Err(invalid(format!("more than {} MiB were sent at once", MAX_LINE_BYTES >> 20)));
    }
    serde_json::from_slice(&line).map(Some).map_err(|e| invalid(format!("this is not a request of `mobee ctl`: {e}")))
}

/// Writes one line.
///
/// # Errors
/// If the line would be too long, or the connection broke.
pub(super) async fn write(to: &mut (impl AsyncWrite + Unpin), what: &impl Serialize) -> io::Result<()> {
    let mut line = serde_json::to_vec(what)?;
    if line.len() >= MAX_LINE_BYTES {
        let what = format!("the files exceed {} MiB in total", MAX_LINE_BYTES >> 20);
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    line.push(b'\n');
    to.write_all(&line).await?;
    to.flush().await
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::BufReader;

    async fn parsed(bytes: &[u8]) -> io::Result<Option<Request>> {
        read(&mut BufReader::new(bytes)).await
    }

    #[tokio::test]
    async fn what_is_written_is_read() {
        let mut bytes = Vec::new();
        let words = vec!["world".to_owned(), "mk\n\u{1b}\"".to_owned()];
        write(&mut bytes, &Request { words: words.clone(), offer: None }).await.expect("it fits");
        assert_eq!(parsed(&bytes).await.expect("a request").expect("one").words, words);
        assert!(parsed(b"").await.expect("the end").is_none());
    }

    #[test]
    fn files_of_any_kind_arrive_as_they_are() {
        let mut sent = SentConfig {
            file: "a.toml".into(),
            config: Value::Null,
            texts: BTreeMap::new(),
            binaries: BTreeMap::new(),
        };
        let text = "<ZRP>".as_bytes().to_vec();
        let network = (0..=255).collect::<Vec<u8>>();
        sent.put("icub.xml".into(), text.clone());
        sent.put("cup.onnx".into(), network.clone());
        assert!(sent.texts.len() == 1 && sent.binaries.len() == 1, "texts can be read by people");
        let files = sent.files().expect("whole");
        assert_eq!(files.into_values().collect::<Vec<_>>(), [network, text]);
        for broken in ["0", "0g", "+1", "é"] {
            sent.binaries.insert("cup.onnx".into(), broken.into());
            assert!(sent.files().expect_err(broken).contains("cup.onnx"));
        }
    }

    #[tokio::test]
    async fn nonsense_and_floods_are_errors() {
        for bytes in [&b"GET / HTTP/1.1\r\n"[..], b"CONNECT attacker\n", b"{\"words\":[\"stop\"]", b"{}\n", b"\xff\n"] {
            assert_eq!(parsed(bytes).await.expect_err("no request").kind(), io::ErrorKind::InvalidData);
        }
        let flood = vec![b'['; MAX_LINE_BYTES + 2];
        let error = parsed(&flood).await.expect_err("too long").to_string();
        assert!(error.contains("MiB"), "{error}");
    }
}
