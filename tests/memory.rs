//! Inference uses its buffers again: `cargo test --release --test memory`.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::Device;
use gravisight::model::{Pen, PenConfig, decode};

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
    let device = Device::flex();
    device.seed(1);
    let config = PenConfig::compact(7.0);
    let runner = Pen::new(&config, &device).unwrap().runner(gravisight::Size::new(96, 64), &device);
    let run = |picture: usize| {
        let values = (0..64 * 96 * 3).map(|index| ((index + picture) % 251) as f32 / 251.0).collect();
        let depth = decode(runner.run(values), &config).depth.into_data().iter::<f32>().next().unwrap();
        assert!(depth.is_finite());
    };
    // Threads take their work buffers at different times.
    (0..200).for_each(run);
    let before = HELD.load(Ordering::Relaxed);
    (0..1000).for_each(run);
    let after = HELD.load(Ordering::Relaxed);
    assert!(after <= before + 64 * 1024, "{before} bytes held after 200 pictures, {after} after 1,200");
}
