//! The `gravisight` command.

use std::os::raw::c_long;

use libmimalloc_sys::mi_option_set;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// `mi_option_purge_delay` of mimalloc.h, versions 2 and 3: milliseconds until free memory goes back to the system; −1: never.
const PURGE_DELAY: i32 = 15;
const NEVER: c_long = -1;

fn main() -> std::process::ExitCode {
    if std::env::args_os().nth(1).is_some_and(|command| command == "train") {
        // Each step takes the same memory. To give it back and take it again costs up to a sixth of the CPU's time.
        // SAFETY: sets a number of the allocator's, which has this one.
        unsafe { mi_option_set(PURGE_DELAY, NEVER) };
    }
    gravisight_cli::main()
}
