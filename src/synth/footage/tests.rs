//! What is filmed is where the truth says.
