//! Reading files that users name: regular files only, without waiting for anybody, and never more than is asked for.
//!
//! A path may lead anywhere: to a FIFO that nobody writes to, to a device without an end, to a file of many gigabytes. All
//! code that reads what a user named opens it here.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom};
use std::path::Path;

/// Bytes in a MiB.
pub const MIB: u64 = 1 << 20;
/// Bytes that [`find_record`] looks at before it reads on.
const SEARCHED_AT_ONCE: u64 = 1 << 16;

/// Opens a regular file for reading.
///
/// # Errors
/// If it can't be opened, or is a folder, a FIFO, a device or a socket.
pub fn open(path: &Path) -> Result<File> {
    let mut options = File::options();
    options.read(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        // a FIFO is opened at once, though nobody may ever write to it; what it is shows then
        options.custom_flags((rustix::fs::OFlags::NONBLOCK | rustix::fs::OFlags::NOCTTY).bits() as i32);
    }
    let file = options.open(path).map_err(|e| match path_remedy(path).filter(|_| e.kind() == ErrorKind::NotFound) {
        Some(help) => Error::new(e.kind(), format!("{e}; {help}")),
        None => e,
    })?;
    let kind = file.metadata()?.file_type();
    match kind.is_file() {
        true => Ok(file),
        false if kind.is_dir() => Err(Error::new(ErrorKind::IsADirectory, "it is a folder, not a file")),
        false => Err(Error::new(ErrorKind::InvalidInput, "it is a device or a pipe, not a file")),
    }
}

/// The bytes of a regular file of at most `most` bytes. Never holds more than one byte beyond that in memory.
///
/// # Errors
/// As for [`open`], and if the file is longer.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>> {
    let file = open(path)?;
    let long = || Error::new(ErrorKind::FileTooLarge, format!("it has more than the {} that are read", size(most)));
    if file.metadata()?.len() > most {
        return Err(long());
    }
    // a file may grow while it is read, and those of the system say that they are empty
    let mut bytes = Vec::new();
    file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most { Err(long()) } else { Ok(bytes) }
}

/// The text of a regular file of at most `most` bytes, without its byte order mark.
///
/// # Errors
/// As for [`read`], and if it is not UTF-8.
pub fn read_text(path: &Path, most: u64) -> Result<String> {
    text(read(path, most)?).map_err(|(not_text, _)| {
        let NotText { at, line, what } = not_text;
        Error::new(ErrorKind::InvalidData, format!("byte {} of it, in line {line}, {what}; {SAVE_AS_UTF8}", at + 1))
    })
}

/// What to do about a file in another encoding.
pub(crate) const SAVE_AS_UTF8: &str = "save it as UTF-8";

/// A place where a file is not UTF-8 text.
pub(crate) struct NotText {
    /// The byte, from 0.
    pub at: usize,
    /// Its line, from 1.
    pub line: usize,
    /// What it is instead, as the end of a sentence that begins with the byte.
    pub what: String,
}

/// The text of a file, without its byte order mark.
///
/// # Errors
/// Where it is not UTF-8, and the bytes.
pub(crate) fn text(mut bytes: Vec<u8>) -> std::result::Result<String, (NotText, Vec<u8>)> {
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes.drain(..3);
    }
    // in UTF-16, what is ASCII has a zero in every other byte
    let wide = match bytes[..] {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => true,
        [first, second, ..] => (first == 0) != (second == 0),
        _ => false,
    };
    let (at, bytes) = match String::from_utf8(bytes) {
        Ok(text) if !wide => return Ok(text),
        Ok(text) => (0, text.into_bytes()),
        Err(e) => (e.utf8_error().valid_up_to(), e.into_bytes()),
    };
    let looks = match wide {
        true => "UTF-16",
        false if bytes.contains(&0) => "no text at all",
        false => "Latin-1 or Windows-1252",
    };
    let line = bytes.iter().take(at).filter(|b| **b == b'\n').count() + 1;
    let what = format!("0x{:02x}, is not UTF-8 text: the file looks like {looks}", bytes.get(at).unwrap_or(&0));
    Err((NotText { at, line, what }, bytes))
}

/// What to do about a path that leads nowhere because of how it is written.
pub fn path_remedy(path: &Path) -> Option<&'static str> {
    let path = path.to_string_lossy();
    let variable = || path.split('/').any(|step| step.starts_with(['~', '$']));
    match () {
        () if path.contains('\\') => Some("write / between folders, not \\"),
        () if variable() => Some(
            "write the path in full: of ~ and variables, only ~/ and $HOME/ that begin a path in a file are expanded",
        ),
        () => None,
    }
}

/// The first place in a file, from `from` on, at which `is_record` accepts the `N` bytes there. Readers of records resume with it behind
/// damage: a record has a length and a checksum, so that other bytes are not taken for one.
///
/// # Errors
/// If the file can't be read, or `is_record` returns an error.
pub fn find_record<const N: usize>(
    file: &File,
    from: u64,
    mut is_record: impl FnMut(u64, &[u8; N]) -> Result<bool>,
) -> Result<Option<u64>> {
    let mut at = from;
    loop {
        let mut window = Vec::new();
        let mut reader = file;
        reader.seek(SeekFrom::Start(at))?;
        reader.take(SEARCHED_AT_ONCE).read_to_end(&mut window)?;
        for (place, bytes) in (at..).zip(window.windows(N)) {
            if let Ok(bytes) = bytes.try_into()
                && is_record(place, bytes)?
            {
                return Ok(Some(place));
            }
        }
        if (window.len() as u64) < SEARCHED_AT_ONCE {
            return Ok(None);
        }
        // a record may begin in the last bytes of this window
        at += window.len().saturating_sub(N - 1).max(1) as u64;
    }
}

/// A number of bytes for people.
fn size(bytes: u64) -> String {
    if bytes.is_multiple_of(MIB) { format!("{} MiB", bytes / MIB) } else { format!("{bytes} bytes") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_up_to_its_bound_and_not_beyond() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f");
        std::fs::write(&path, "12345").unwrap();
        assert_eq!(read_text(&path, 5).unwrap(), "12345");
        assert_eq!(read(&path, 4).unwrap_err().kind(), ErrorKind::FileTooLarge);
        std::fs::write(&path, b"12\xff").unwrap();
        let e = read_text(&path, 5).unwrap_err();
        assert!(e.to_string().contains("byte 3"), "{e}");
        for (bytes, expected) in [
            (&b"a\n\nb\xe9c"[..], "byte 5 of it, in line 3, 0xe9, is not UTF-8 text: the file looks like Latin-1"),
            (
                b"\xff\xfea\0",
                "byte 1 of it, in line 1, 0xff, is not UTF-8 text: the file looks like UTF-16; save it as UTF-8",
            ),
            (b"a\0b\0", "UTF-16"),
            (b"\0a\0b", "UTF-16"),
            (b"\x89PNG\r\n\0", "no text at all"),
        ] {
            std::fs::write(&path, bytes).unwrap();
            let e = read_text(&path, 20).unwrap_err();
            assert!(e.to_string().contains(expected), "{e}");
        }
        std::fs::write(&path, "\u{feff}a,b").unwrap();
        assert_eq!(read_text(&path, 20).unwrap(), "a,b");
    }

    #[test]
    fn a_path_that_is_written_in_another_way_is_named() {
        let of = |path: &str| read(Path::new(path), 5).unwrap_err().to_string();
        assert!(of("a\\b.csv").contains("write / between folders, not \\"), "{}", of("a\\b.csv"));
        for path in ["~/b.csv", "$DATA/b.csv", "a/~b/c.csv"] {
            assert!(of(path).contains("in full"), "{}", of(path));
        }
        assert!(!of("a/b.csv").contains(';'));
    }

    #[test]
    fn a_record_is_found_wherever_it_begins() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f");
        let edge = SEARCHED_AT_ONCE as usize;
        for place in [0, 1, edge - 3, edge - 2, edge - 1, edge, 3 * edge + 5] {
            let mut bytes = vec![b'.'; 3 * edge + 9];
            bytes[place..place + 4].copy_from_slice(b"here");
            std::fs::write(&path, &bytes).unwrap();
            let file = open(&path).unwrap();
            let find =
                |from: usize| find_record(&file, from as u64, |_, bytes: &[u8; 4]| Ok(bytes == b"here")).unwrap();
            assert_eq!((find(0), find(place), find(place + 1)), (Some(place as u64), Some(place as u64), None));
        }
    }

    #[test]
    fn what_is_no_file_is_refused_at_once() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(read(dir.path(), 5).unwrap_err().kind(), ErrorKind::IsADirectory);
        assert_eq!(read(&dir.path().join("nothing"), 5).unwrap_err().kind(), ErrorKind::NotFound);
        // no length is told of it, and it has no end
        #[cfg(unix)]
        assert_eq!(read(Path::new("/dev/zero"), 5).unwrap_err().kind(), ErrorKind::InvalidInput);
    }
}
