#![no_main]

#[path = "../promises/bottle_text.rs"]
mod bottle_text;

libfuzzer_sys::fuzz_target!(|input: &[u8]| bottle_text::hold(input));
