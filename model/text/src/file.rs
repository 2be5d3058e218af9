//! Reads files named by users: regular files only, without blocking, and never more bytes than requested.
//!
//! A path may refer to a FIFO without a writer, to an endless device or to a file of many gigabytes. All code that
//! reads a user's file opens it here.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom};
use std::path::Path;

/// Number of bytes in a MiB.
pub const MIB: u64 = 1 << 20;
/// Size of the window, in bytes, in which [`find_record`] searches at a time.
const SEARCH_WINDOW_BYTES: u64 = 1 << 16;

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
        // Opening a FIFO would block until it has a writer; the file type is checked below.
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

/// Reads a regular file of at most `most` bytes. Never holds more than one byte beyond that in memory.
///
/// # Errors
/// As for [`open`], and if the file is longer.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>> {
    let file = open(path)?;
    let long = || Error::new(ErrorKind::FileTooLarge, format!("it has more than the {} that are read", size(most)));
    if file.metadata()?.len() > most {
        return Err(long());
    }
    // A file may grow while it is read, and files of the kernel report a length of zero.
    let mut bytes = Vec::new();
    file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most { Err(long()) } else { Ok(bytes) }
}

/// Reads the text of a regular file of at most `most` bytes, without its byte order mark.
///
/// # Errors
/// As for [`read`], and if it is not UTF-8.
pub fn read_text(path: &Path, most: u64) -> Result<String> {
    text(read(path, most)?).map_err(|(not_text, _)| {
        let NotText { at, line, what } = not_text;
        Error::new(ErrorKind::InvalidData, format!("byte {} of it, in line {line}, {what}; {SAVE_AS_UTF8}", at + 1))
    })
}

/// Remedy for a file in another encoding.
pub const SAVE_AS_UTF8: &str = "save it as UTF-8";

/// Position of the first byte of a file that is not UTF-8 text.
pub struct NotText {
    /// Offset of the byte, from 0.
    pub at: usize,
    /// Line of the byte, from 1.
    pub line: usize,
    /// Description of the byte and of the probable encoding; continues a sentence that begins with the byte.
    pub what: String,
}

/// Decodes the bytes of a file as text, without a byte order mark.
///
/// # Errors
/// The position at which it is not UTF-8, and the bytes.
pub fn text(mut bytes: Vec<u8>) -> std::result::Result<String, (NotText, Vec<u8>)> {
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes.drain(..3);
    }
    // In UTF-16, every other byte of ASCII text is zero.
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

/// Remedy for a path that does not exist because of its notation.
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

/// Finds the first offset in a file, at or after `from`, at which `is_record` accepts the next `N` bytes. Readers of
/// records use it to resume after damage: a record has a length and a checksum, so that other bytes are not mistaken
/// for one.
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
        reader.take(SEARCH_WINDOW_BYTES).read_to_end(&mut window)?;
        for (place, bytes) in (at..).zip(window.windows(N)) {
            if let Ok(bytes) = bytes.try_into()
                && is_record(place, bytes)?
            {
                return Ok(Some(place));
            }
        }
        if (window.len() as u64) < SEARCH_WINDOW_BYTES {
            return Ok(None);
        }
        // A record may begin in the last `N - 1` bytes of this window.
        at += window.len().saturating_sub(N - 1).max(1) as u64;
    }
}

/// Formats a number of bytes for messages.
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
    fn a_path_in_foreign_notation_gets_a_remedy() {
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
        let edge = SEARCH_WINDOW_BYTES as usize;
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
    fn devices_and_folders_are_rejected_at_once() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(read(dir.path(), 5).unwrap_err().kind(), ErrorKind::IsADirectory);
        assert_eq!(read(&dir.path().join("nothing"), 5).unwrap_err().kind(), ErrorKind::NotFound);
        // The device reports no length and never ends.
        #[cfg(unix)]
        assert_eq!(read(Path::new("/dev/zero"), 5).unwrap_err().kind(), ErrorKind::InvalidInput);
    }
}
