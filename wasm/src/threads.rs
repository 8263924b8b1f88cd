//! Threads in a browser: Workers that share the core's memory are those of rayon's pool, together with the one that has started them.
//!
//! A Worker of a browser cannot be started from here. The package starts it, gives it this module and its memory, and lets it call
//! [`run_thread`], where it waits for [`start_threads`].

use std::sync::{Condvar, Mutex, PoisonError};

use rayon::{ThreadBuilder, ThreadPoolBuilder};
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

/// Threads of the pool that no Worker runs yet.
static STARTING: Mutex<Vec<ThreadBuilder>> = Mutex::new(Vec::new());
static STARTED: Condvar = Condvar::new();

/// Lets the core work on `count` threads: this one and those that have called {@link runThread}, one fewer.
#[wasm_bindgen(js_name = startThreads)]
pub fn start_threads(count: usize) -> Result<(), JsError> {
    let spawn = |thread: ThreadBuilder| {
        STARTING.lock().unwrap_or_else(PoisonError::into_inner).push(thread);
        STARTED.notify_one();
        Ok(())
    };
    Ok(ThreadPoolBuilder::new().num_threads(count).use_current_thread().spawn_handler(spawn).build_global()?)
}

/// Runs one of the core's threads, and does not return.
#[wasm_bindgen(js_name = runThread)]
pub fn run_thread() {
    let mut starting = STARTING.lock().unwrap_or_else(PoisonError::into_inner);
    let thread = loop {
        match starting.pop() {
            Some(thread) => break thread,
            None => starting = STARTED.wait(starting).unwrap_or_else(PoisonError::into_inner),
        }
    };
    drop(starting);
    thread.run();
}
