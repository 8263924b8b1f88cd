//! Work that keeps its threads awake ends, however the system schedules them.

use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::Duration;

use crate::common::{golden, root, tiny_card};
use gravisight::Clips;
use gravisight::Device;
use gravisight::{LocaliseOptions, Localiser, Picture, Size};

/// More threads than cores, so that each is stopped at any place.
const POOLS: usize = 4;
const THREADS: usize = 3;
/// Pictures, each of a few dozen layers that wait for their threads.
fn rounds() -> usize {
    std::env::var("GRAVISIGHT_ROUNDS").ok().and_then(|text| text.parse().ok()).unwrap_or(20_000)
}

#[test]
fn threads_kept_awake_never_wait_for_each_other() {
    let localiser = Localiser::new(tiny_card(), golden("tiny.safetensors"), &Device::flex()).unwrap();
    let camera = Clips::read(&root().join("tests/samples")).unwrap().clips[0].camera.resized(Size::square(64)).unwrap();
    let picture = Picture::from_rgba(&[100; 64 * 64 * 4], Size::square(64)).unwrap();
    let shared = Arc::new((localiser, camera, picture));
    let (done, all) = channel();
    for _ in 0..POOLS {
        let (done, shared) = (done.clone(), shared.clone());
        std::thread::spawn(move || {
            let (localiser, camera, picture) = &*shared;
            let pool = rayon::ThreadPoolBuilder::new().num_threads(THREADS).build().unwrap();
            for _ in 0..rounds() {
                let found = pool
                    .install(|| pollster::block_on(localiser.localise(picture, camera, LocaliseOptions::default())));
                assert!(found.unwrap().depth.is_finite());
            }
            done.send(()).unwrap();
        });
    }
    for _ in 0..POOLS {
        // A hang would stop the other tests, too.
        all.recv_timeout(Duration::from_secs(120)).expect("threads wait for each other");
    }
}
