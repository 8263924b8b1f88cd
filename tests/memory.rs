//! Inference uses its buffers again: `cargo test --test memory`.

#![cfg(not(target_arch = "wasm32"))]

#[path = "all/common.rs"]
mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use common::{golden, root, tiny_card};
use gravisight::Clips;
use gravisight::Device;
use gravisight::{LocaliseOptions, Localiser, Picture, Size};

/// The system's allocator, counting.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);

// SAFETY: hands every call on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        HELD.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs pictures one after the other; `each` hears of every one that is done.
fn localise(count: usize, mut each: impl FnMut(usize)) {
    let localiser = Localiser::new(tiny_card(), golden("tiny.safetensors"), &Device::flex()).unwrap();
    let camera = Clips::read(&root().join("tests/samples")).unwrap().clips[0].camera.resized(Size::square(64)).unwrap();
    for number in 0..count {
        let values: Vec<u8> = (0..64 * 64 * 4).map(|index| ((index + number) % 251) as u8).collect();
        let picture = Picture::from_rgba(&values, Size::square(64)).unwrap();
        let found = pollster::block_on(localiser.localise(&picture, &camera, LocaliseOptions::default())).unwrap();
        assert!(found.depth.is_finite());
        each(number + 1);
    }
}

#[test]
fn a_thousand_pictures_take_no_more_memory_than_the_first_ones() {
    let mut before = 0;
    // Threads take their work buffers at different times.
    localise(1200, |done| match done {
        200 => before = HELD.load(Ordering::Relaxed),
        1200 => {
            let after = HELD.load(Ordering::Relaxed);
            assert!(after <= before + 64 * 1024, "{before} bytes held after 200 pictures, {after} after 1,200");
        }
        _ => (),
    });
}

/// `scripts/torture` runs it.
#[test]
#[ignore = "a quarter of an hour"]
#[cfg(target_os = "linux")]
fn a_million_pictures_take_no_more_memory_than_the_first_ones() {
    const COUNT: usize = 1_000_000;
    /// Pages that the process holds, MB.
    fn resident() -> f64 {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
    }
    let mut start = std::time::Instant::now();
    let mut first = 0.0;
    localise(COUNT, |done| {
        if done % (COUNT / 10) == 0 {
            println!(
                "{done} pictures: {:.3} ms each, {:.1} MB",
                1e4 * start.elapsed().as_secs_f64() / COUNT as f64,
                resident()
            );
            start = std::time::Instant::now();
        }
        if done == COUNT / 10 {
            first = resident();
        }
    });
    assert!(resident() <= first + 2.0, "{first} MB after a tenth, {} at the end", resident());
}
