//! Any bytes as a request's header: refused or understood, and what is understood survives a round trip.

#![no_main]

use libfuzzer_sys::fuzz_target;
use rodgym_server::wire::{decode_request, encode};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(header) = decode_request(bytes, 4096) {
        let again = decode_request(&encode(&header), 1 << 20).expect("our own header");
        assert_eq!(header, again);
    }
});
