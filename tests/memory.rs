//! Inference uses its buffers again: `cargo test --test memory`.

#![cfg(not(target_arch = "wasm32"))]

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

#[test]
fn a_thousand_pictures_take_no_more_memory_than_the_first_ones() {
    let localiser = Localiser::new(tiny_card(), golden("tiny.safetensors"), &Device::flex()).unwrap();
    let camera = Clips::read(&root().join("tests/samples")).unwrap().clips[0].camera.resized(Size::square(64)).unwrap();
    let run = |number: usize| {
        let values: Vec<u8> = (0..64 * 64 * 4).map(|index| ((index + number) % 251) as u8).collect();
        let picture = Picture::from_rgba(&values, Size::square(64)).unwrap();
        let found = pollster::block_on(localiser.localise(&picture, &camera, LocaliseOptions::default())).unwrap();
        assert!(found.depth.is_finite());
    };
    // Threads take their work buffers at different times.
    (0..200).for_each(run);
    let before = HELD.load(Ordering::Relaxed);
    (0..1000).for_each(run);
    let after = HELD.load(Ordering::Relaxed);
    assert!(after <= before + 64 * 1024, "{before} bytes held after 200 pictures, {after} after 1,200");
}
