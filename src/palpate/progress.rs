//! Progress of long work: a bar on a terminal, a line per stage elsewhere.

use indicatif::{ProgressBar, ProgressStyle};
use palpate::tell;
use std::io::IsTerminal;
use std::time::Instant;

/// Shows the stages of one piece of work.
pub struct Progress {
    bar: ProgressBar,
    terminal: bool,
    stage: String,
    began: Instant,
}

impl Progress {
    /// Nothing shown yet.
    pub fn new() -> Self {
        let bar = ProgressBar::new(1);
        if let Ok(style) = ProgressStyle::with_template("{elapsed:>4} {bar:30} {msg}") {
            bar.set_style(style);
        }
        Self { bar, terminal: std::io::stderr().is_terminal(), stage: String::new(), began: Instant::now() }
    }

    /// `what` is being done now, `done` of `of` are behind.
    pub fn show(&mut self, what: &str, done: usize, of: usize) {
        self.bar.set_length(of as u64);
        self.bar.set_position(done as u64);
        if self.stage != what {
            self.stage = what.to_owned();
            self.bar.set_message(self.stage.clone());
            if !self.terminal {
                tell!("{:6.2} s  {what}", self.began.elapsed().as_secs_f64());
            }
        }
    }

    /// Replaces the bar by `what` came of it.
    pub fn finish(self, what: &str) {
        self.bar.finish_and_clear();
        tell!("{:6.2} s  {what}", self.began.elapsed().as_secs_f64());
    }
}
