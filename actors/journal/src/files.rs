//! Digests of a run's files, taken after it has ended in order: they reveal later changes of a file.
//!
//! ```text
//! files.sha256: a line for each file, as `sha256sum` writes and checks them      its own digest is in journal.seal
//! ```

use super::journal::{self, Seal};
use mobee_contract::{Before, create_private};
use mobee_model::file::{MIB, open, read_text};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::io::{ErrorKind, Read, Write};
use std::path::Path;

/// Name of the file in a run's folder.
pub const FILE: &str = "files.sha256";
/// Largest size, bytes.
const MAX_BYTES: u64 = MIB;
/// Size of a read, bytes.
const BLOCK: usize = 1 << 18;

/// True if a run writes a file of this name and does not change it after the end.
fn is_of_run(name: &str) -> bool {
    let is = |start: &str, end: &str| name.starts_with(start) && name.ends_with(end);
    let plain = !name.contains(['\n', '\\', '/']);
    let whole = ["config.json", "summary.json", journal::FILE].contains(&name);
    let many = is("roadmap-", ".json") || is("poses-", ".track") || is("poses-", ".ring") || is("recording", ".rrd");
    plain && (whole || many || name.ends_with(".frames"))
}

/// Writes the digests of the files in a run's folder, and returns the digest of that file.
///
/// # Errors
/// If a file can't be read, or the digests can't be written.
pub(crate) fn write(dir: &Path) -> std::io::Result<String> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(dir)? {
        let entry = entry?;
        names.extend(entry.file_name().into_string().ok().filter(|name| is_of_run(name)));
    }
    names.sort();
    let mut text = String::new();
    for name in names {
        let _ = writeln!(text, "{}  {name}", digest(&dir.join(&name))?);
    }
    let part = dir.join(format!("{FILE}.part"));
    let file = dir.join(FILE);
    create_private(&part, Before::Empty)?.write_all(text.as_bytes())?;
    std::fs::rename(part, file)?;
    Ok(hex(Sha256::digest(&text).as_slice()))
}

/// Compares a run's files with their digests. Returns the number of unchanged files and a description of each
/// damaged one. `expected` is the digest of the digest file, from the seal.
pub(crate) fn judge(dir: &Path, expected: &str) -> (usize, Vec<String>) {
    let text = match read_text(&dir.join(FILE), MAX_BYTES) {
        Ok(text) => text,
        Err(e) if e.kind() == ErrorKind::NotFound => return (0, vec![format!("{FILE} is missing")]),
        Err(e) => return (0, vec![format!("{FILE} can't be read: {e}")]),
    };
    let mut whole = 0;
    let mut damage = Vec::new();
    if hex(Sha256::digest(&text).as_slice()) != expected {
        damage.push(format!("{FILE} is not the one that journal.seal has the digest of: one of the two is damaged"));
    }
    for line in text.lines() {
        let Some((written, name)) = line.split_once("  ").filter(|(_, name)| is_of_run(name)) else { continue };
        match digest(&dir.join(name)) {
            Ok(found) if found == written => whole += 1,
            Ok(_) => damage.push(format!("{name} is not as it was when the run ended")),
            Err(e) if e.kind() == ErrorKind::NotFound => damage.push(format!("{name} is missing")),
            Err(e) => damage.push(format!("{name} can't be read: {e}")),
        }
    }
    (whole, damage)
}

/// Describes each damaged file of a run that ended in order and was not resumed since.
pub fn changed(dir: &Path) -> Vec<String> {
    let seal: Option<Seal> = journal::read_seal(&dir.join(journal::FILE)).ok().flatten();
    seal.and_then(|seal| seal.files).map_or_else(Vec::new, |files| judge(dir, &files).1)
}

fn digest(path: &Path) -> std::io::Result<String> {
    let mut file = open(path)?;
    let mut sum = Sha256::new();
    let mut block = vec![0; BLOCK];
    loop {
        match file.read(&mut block)? {
            0 => return Ok(hex(sum.finalize().as_slice())),
            n => sum.update(block.get(..n).unwrap_or_default()),
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_of_any_file_shows_and_files_of_others_do_not_count() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let names = ["config.json", "poses-a.track", "eyes.left.frames", "recording-2.rrd", "roadmap-a.json"];
        names.iter().for_each(|name| std::fs::write(at(name), name).unwrap());
        std::fs::write(at("notes.txt"), "mine").unwrap();
        let expected = write(dir.path()).unwrap();
        assert_eq!(judge(dir.path(), &expected), (names.len(), vec![]));
        std::fs::write(at("notes.txt"), "mine, too").unwrap();
        std::fs::write(at("config.json"), "config.jsoN").unwrap();
        std::fs::write(at("eyes.left.frames"), "").unwrap();
        std::fs::remove_file(at("recording-2.rrd")).unwrap();
        let damage = judge(dir.path(), &expected).1;
        let reported = |what: &str| damage.iter().filter(|d| d.contains(what)).count();
        assert_eq!(
            (damage.len(), reported("config.json is not as"), reported("eyes.left.frames is not as")),
            (3, 1, 1)
        );
        assert_eq!(reported("recording-2.rrd is missing"), 1);
        std::fs::write(at(FILE), "").unwrap();
        assert_eq!(
            judge(dir.path(), &expected),
            (0, vec![format!("{FILE} is not the one that journal.seal has the digest of: one of the two is damaged")])
        );
        std::fs::remove_file(at(FILE)).unwrap();
        assert_eq!(judge(dir.path(), &expected), (0, vec![format!("{FILE} is missing")]));
    }
}
