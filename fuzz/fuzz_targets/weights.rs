//! Weights: bytes that claim to be a safetensors file of the published card's network.
#![no_main]

use gravisight::internal::{ANY, sha256_hex};
use gravisight::{Card, Device, Localiser};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    // A card that vouches for them: else the checksum is all that is tried.
    let Ok(card) = Card::from_json(ANY.0, "card") else { return };
    let text = ANY.0.replace(&card.sha256, &sha256_hex(bytes));
    let Ok(card) = Card::from_json(&text, "card") else { return };
    let _ = Localiser::new(card, bytes.to_vec(), &Device::default());
});
