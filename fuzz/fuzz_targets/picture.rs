//! A picture's bytes: decoded, made the network's input, calibrated on.
#![no_main]

use gravisight::internal::Normalisation;
use gravisight::{Picture, Size};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(picture) = Picture::decode(bytes) else { return };
    let size = picture.size();
    assert!(u64::from(size.width) * u64::from(size.height) <= 64 << 20);
    let input = picture.network_input(Size::new(64, 64), &Normalisation::default());
    assert!(input.values.iter().all(|value| value.is_finite()));
});
