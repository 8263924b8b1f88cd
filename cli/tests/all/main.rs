//! The command's tests, one program.

mod adapt;
mod batch;
mod calibrate;
mod cameras;
mod cli;
mod common;
mod doubtful;
mod faults;
mod flights;
mod formats;
mod hostile;
mod import;
mod import_track;
mod label;
mod options;
mod report;
mod torture;
mod track;
