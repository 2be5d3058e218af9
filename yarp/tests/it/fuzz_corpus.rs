//! What the fuzzers found worth keeping is replayed against the promises that they attack: a parser that once failed there
//! does not fail there again.

use std::fs;
use std::path::Path;

#[path = "../../fuzz/promises/admin.rs"]
mod admin;
#[path = "../../fuzz/promises/board.rs"]
mod board;
#[path = "../../fuzz/promises/bottle_binary.rs"]
mod bottle_binary;
#[path = "../../fuzz/promises/bottle_text.rs"]
mod bottle_text;
#[path = "../../fuzz/promises/framing.rs"]
mod framing;
#[path = "../../fuzz/promises/name_server.rs"]
mod name_server;

/// Replays each input whole and without its last byte, as a connection that breaks delivers it.
fn replay(target: &str, hold: fn(&[u8])) {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target);
    let mut inputs: Vec<_> = fs::read_dir(&corpus).expect("a corpus").map(|e| e.expect("an entry").path()).collect();
    inputs.sort();
    assert!(inputs.len() > 50, "{} holds {} inputs only", corpus.display(), inputs.len());
    for input in inputs {
        let bytes = fs::read(&input).expect("an input");
        // the harness shows this line if the input breaks a promise
        println!("{}", input.display());
        hold(&bytes);
        hold(bytes.split_last().map_or(&[], |(_, head)| head));
    }
}

#[test]
fn administrative_commands() {
    replay("admin", admin::hold);
}

#[test]
fn requests_to_a_board() {
    replay("board", board::hold);
}

#[test]
fn binary_bottles() {
    replay("bottle_binary", bottle_binary::hold);
}

#[test]
fn text_bottles() {
    replay("bottle_text", bottle_text::hold);
}

#[test]
fn frames_and_datagrams() {
    replay("framing", framing::hold);
}

#[test]
fn questions_to_the_name_server() {
    replay("name_server", name_server::hold);
}
