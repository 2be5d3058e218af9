#![no_main]

#[path = "../promises/framing.rs"]
mod framing;

libfuzzer_sys::fuzz_target!(|input: &[u8]| framing::hold(input));
