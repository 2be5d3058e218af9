#![no_main]

#[path = "../promises/admin.rs"]
mod admin;

libfuzzer_sys::fuzz_target!(|input: &[u8]| admin::hold(input));
