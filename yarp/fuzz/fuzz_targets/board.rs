#![no_main]

#[path = "../promises/board.rs"]
mod board;

libfuzzer_sys::fuzz_target!(|input: &[u8]| board::hold(input));
