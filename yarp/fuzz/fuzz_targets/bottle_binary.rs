#![no_main]

#[path = "../promises/bottle_binary.rs"]
mod bottle_binary;

libfuzzer_sys::fuzz_target!(|input: &[u8]| bottle_binary::hold(input));
