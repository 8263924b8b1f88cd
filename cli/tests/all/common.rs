//! What the tests share.
#[path = "../../../src/testing.rs"]
mod testing;

pub use testing::*;
