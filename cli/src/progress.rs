//! Progress: a bar on a terminal, plain lines elsewhere.

use indicatif::{ProgressBar, ProgressStyle};

/// Steps between two lines.
const LINE_EVERY: u64 = 20;

/// Progress of long work.
pub struct Progress {
    bar: ProgressBar,
    started: bool,
}

impl Progress {
    /// Nothing done yet.
    pub fn new() -> Self {
        let bar = ProgressBar::new(0);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} [{elapsed}<{eta}] {msg}") {
            bar.set_style(style);
        }
        Self { bar, started: false }
    }

    /// `done` of `all`, and what there is to say of it.
    pub fn set(&mut self, done: u64, all: u64, message: &str) {
        self.bar.set_length(all);
        self.bar.set_position(done);
        if !self.started {
            // What was done before this program started does not count towards the estimate.
            self.bar.reset_eta();
            self.started = true;
        }
        self.bar.set_message(message.to_string());
        if self.bar.is_hidden() && (done.is_multiple_of(LINE_EVERY) || done == all) {
            eprintln!("{}", format!("{done}/{all} {message}").trim_end());
        }
    }

    /// Another piece of work begins: it has its own length and rate.
    pub fn restart(&mut self) {
        self.bar.reset();
        self.started = false;
    }

    /// A line that stays.
    pub fn say(&self, line: &str) {
        match self.bar.is_hidden() {
            true => eprintln!("{line}"),
            false => self.bar.println(line),
        }
    }

    /// Takes the bar away.
    pub fn finish(self) {
        self.bar.finish_and_clear();
    }
}
