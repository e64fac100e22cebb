#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| whorl_fuzz::map(data));
