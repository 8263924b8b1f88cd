//! Work that keeps its threads awake ends, however the system schedules them.

use std::hint::black_box;
use std::sync::mpsc::channel;
use std::time::Duration;

use parallel::{for_each, with_threads_awake};

// By itself, in a process of its own: other tests would take its threads.
#[allow(dead_code)]
#[path = "../src/kernels/parallel.rs"]
mod parallel;

/// More threads than cores, so that each is stopped at any place.
const POOLS: usize = 4;
const THREADS: usize = 3;
const ROUNDS: usize = 500_000;

#[test]
fn threads_kept_awake_never_wait_for_each_other() {
    let (done, all) = channel();
    for _ in 0..POOLS {
        let done = done.clone();
        std::thread::spawn(move || {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(THREADS).build().unwrap();
            for _ in 0..ROUNDS {
                pool.install(|| with_threads_awake(|| for_each(8, |index| drop(black_box(vec![index; 100])))));
            }
            done.send(()).unwrap();
        });
    }
    for _ in 0..POOLS {
        // A hang would stop the other tests, too.
        all.recv_timeout(Duration::from_secs(120)).expect("threads wait for each other");
    }
}
