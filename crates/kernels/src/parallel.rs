//! Work on every core natively, in a browser on the threads that were started; and memory that is used again.

use std::cell::Cell;
use std::sync::Mutex;
#[cfg(not(target_arch = "wasm32"))]
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator};

thread_local! {
    /// Whether this thread runs one of so many tasks that nothing is gained by splitting it further.
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

/// Threads that [`for_each`] would use here.
pub fn threads() -> usize {
    if INSIDE.get() { 1 } else { rayon::current_num_threads() }
}

/// Runs `work(0)`, …, `work(count - 1)` in any order, at the same time where there are threads.
pub fn for_each(count: usize, work: impl Fn(usize) + Sync + Send) {
    if count > 1 && threads() > 1 {
        let enough = count >= threads();
        (0..count).into_par_iter().with_max_len(1).for_each(|index| {
            let _outer = Restore(INSIDE.replace(enough));
            work(index);
        });
        return;
    }
    (0..count).for_each(work);
}

/// Runs `work` on each of `parts` and its number, as [`for_each`] does.
pub fn for_each_of<T: Send>(parts: Vec<T>, work: impl Fn(usize, T) + Sync + Send) {
    if parts.len() > 1 && threads() > 1 {
        let enough = parts.len() >= threads();
        parts.into_par_iter().enumerate().with_max_len(1).for_each(|(index, part)| {
            let _outer = Restore(INSIDE.replace(enough));
            work(index, part);
        });
        return;
    }
    parts.into_iter().enumerate().for_each(|(index, part)| work(index, part));
}

/// Sets [`INSIDE`] back, after a panic too: rayon's threads outlive one.
struct Restore(bool);

impl Drop for Restore {
    fn drop(&mut self) {
        INSIDE.set(self.0);
    }
}

/// Whether threads are being kept awake.
#[cfg(not(target_arch = "wasm32"))]
static AWAKE: AtomicBool = AtomicBool::new(false);

/// How long a thread is kept awake without anything to do. It must end: a thread may have begun to wait in the middle of a
/// task that `work` waits for (between looking for its own jobs and stealing one of `work`'s, it was sent to wait).
#[cfg(not(target_arch = "wasm32"))]
const PATIENCE: Duration = Duration::from_millis(2);

/// Runs `work`, in which [`for_each`] is called again and again, with all threads awake: to wake one takes as
/// long as a small layer. One caller at a time has that; others run without. `work` must not hold a lock that
/// another such call waits for.
pub fn with_threads_awake<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    #[cfg(not(target_arch = "wasm32"))]
    if threads() > 1 && !AWAKE.swap(true, Ordering::Acquire) {
        return rayon::scope(|scope| {
            let asleep = Asleep(Arc::new(AtomicBool::new(false)));
            let (done, here) = (asleep.0.clone(), rayon::current_thread_index());
            scope.spawn_broadcast(move |_, context| {
                let mut last = Instant::now();
                while Some(context.index()) != here && !done.load(Ordering::Relaxed) && last.elapsed() < PATIENCE {
                    if rayon::yield_now() == Some(rayon::Yield::Executed) {
                        last = Instant::now();
                    } else {
                        std::thread::yield_now();
                    }
                }
            });
            work()
        });
    }
    work()
}

/// Lets waiting threads go when dropped, after a panic too.
#[cfg(not(target_arch = "wasm32"))]
struct Asleep(Arc<AtomicBool>);

#[cfg(not(target_arch = "wasm32"))]
impl Drop for Asleep {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
        AWAKE.store(false, Ordering::Release);
    }
}

/// Cache lines of zeros that are worth a thread's while: 256 KiB.
const LEAST_LINES: usize = 4096;

/// `len` zeros, written on all threads. (Those that an allocator hands out are written on one, unless they are fresh from the
/// system, while the other threads wait: a twentieth of a training step's samples.)
pub fn zeros(len: usize) -> Vec<f32> {
    if threads() == 1 {
        return vec![0.0; len];
    }
    let lines: Vec<[f32; 16]> =
        (0..len.div_ceil(16)).into_par_iter().with_min_len(LEAST_LINES).map(|_| [0.0; 16]).collect();
    let mut zeros = lines.into_flattened();
    zeros.truncate(len);
    zeros
}

/// A cache line, which the widest vector fills.
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
struct CacheLine([f32; 16]);

/// Floats that begin at a cache line, so that vectors do not lie across two.
#[derive(Debug, Clone, Default)]
pub struct Buffer(Vec<CacheLine>);

impl Buffer {
    /// Floats in it.
    fn len(&self) -> usize {
        16 * self.0.len()
    }

    /// At least `len` zeros.
    pub fn zeros(len: usize) -> Self {
        Self(vec![CacheLine::default(); len.div_ceil(16)])
    }

    /// Its floats.
    pub fn values(&self) -> &[f32] {
        bytemuck::cast_slice(&self.0)
    }

    /// Its floats.
    pub fn values_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.0)
    }
}

/// Work buffers, one to a task at a time, smallest first; kept for the next one.
static SCRATCH: Mutex<Vec<Buffer>> = Mutex::new(Vec::new());

/// Most floats that kept buffers hold, for each thread (64 MiB): more than training the published network at its
/// size takes. Whatever needs a larger one computes so long on it that taking it anew does not count.
const MOST_KEPT: usize = 16 << 20;

/// Lends a buffer of `len` floats of any content to `work`.
///
/// There are never more buffers than tasks have run at once, and none is larger than a task needed; the largest are
/// given back to the system where all together hold more than [`MOST_KEPT`].
pub fn with_scratch<R>(len: usize, work: impl FnOnce(&mut [f32]) -> R) -> R {
    let taken = SCRATCH.lock().ok().and_then(|mut buffers| {
        // The smallest that is large enough, else the largest.
        let fits = buffers.iter().position(|buffer| buffer.len() >= len);
        let index = fits.or_else(|| buffers.len().checked_sub(1))?;
        Some(buffers.remove(index))
    });
    let mut buffer = taken.unwrap_or_default();
    if buffer.len() < len {
        buffer.0.resize(len.div_ceil(16), CacheLine::default());
    }
    let result = work(&mut buffer.values_mut()[..len]);
    if let Ok(mut buffers) = SCRATCH.lock() {
        keep(&mut buffers, buffer, MOST_KEPT.saturating_mul(rayon::current_num_threads()));
    }
    result
}

/// Puts a buffer back, and gives the largest away while all together hold more than `most` floats.
fn keep(buffers: &mut Vec<Buffer>, buffer: Buffer, most: usize) {
    let place = buffers.partition_point(|other| other.len() < buffer.len());
    buffers.insert(place, buffer);
    let mut kept: usize = buffers.iter().map(Buffer::len).sum();
    while kept > most
        && let Some(largest) = buffers.pop()
    {
        kept -= largest.len();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_as_many_zeros_as_were_asked_for() {
        for len in [0, 1, 15, 16, 17, 16 * LEAST_LINES + 3, 100 * 16 * LEAST_LINES] {
            let values = zeros(len);
            assert!(values.len() == len && values.iter().all(|&value| value == 0.0), "{len}");
        }
    }

    #[test]
    fn kept_buffers_hold_no_more_than_their_bound_and_the_small_ones_stay() {
        let mut buffers = Vec::new();
        for len in [160, 32, 320, 16, 160] {
            keep(&mut buffers, Buffer::zeros(len), 400);
        }
        let lengths: Vec<usize> = buffers.iter().map(Buffer::len).collect();
        assert_eq!(lengths, [16, 32, 160, 160]);
    }
}
