//! Progress: a bar on a terminal, JSON lines with `--json`, nothing with `--quiet`, otherwise a line every few seconds.

use std::cell::RefCell;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::console;

pub struct Progress {
    bar: Option<ProgressBar>,
    json: bool,
    lines: Option<RefCell<Lines>>,
}

/// Minimum interval between two lines.
const INTERVAL: Duration = Duration::from_secs(5);

/// Lines of progress for outputs that are no terminal.
struct Lines {
    done: u64,
    steps: u64,
    printed: Instant,
}

impl Lines {
    /// Returns the line to print after step `done`, if one is due at `now`.
    fn at(&mut self, done: u64, message: &str, now: Instant) -> Option<String> {
        self.done = done;
        if now < self.printed + INTERVAL {
            return None;
        }
        self.printed = now;
        let count = if self.steps > 0 { format!("{}/{} ", self.done, self.steps) } else { String::new() };
        Some(format!("{count}{}", message.lines().next().unwrap_or_default()))
    }
}

impl Progress {
    pub fn new(steps: u64, quiet: bool, json: bool) -> Self {
        Self::with_template(steps, "{bar:30} {pos}/{len} {msg} {eta}", quiet, json)
    }

    /// Creates a bar that counts samples per pixel. Messages give the elapsed and the remaining time.
    pub fn samples(spp: u64, quiet: bool, json: bool) -> Self {
        Self::with_template(spp, "{bar:30} {pos}/{len} spp {msg}", quiet, json)
    }

    /// Creates a bar for steps of unequal cost. `units` is their total cost; the bar shows messages, but no counts.
    pub fn work(units: u64, quiet: bool, json: bool) -> Self {
        Self::with_template(units, "{bar:30} {msg}", quiet, json)
    }

    /// Creates a display of messages of one or more lines, without a bar.
    pub fn text(quiet: bool, json: bool) -> Self {
        Self::with_template(0, "{msg}", quiet, json)
    }

    fn with_template(steps: u64, template: &str, quiet: bool, json: bool) -> Self {
        let shown = !quiet && !json && console::is_terminal();
        let bar = shown.then(|| {
            let bar = ProgressBar::new(steps);
            let style = ProgressStyle::with_template(template);
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        let has_lines = !quiet && !json && bar.is_none();
        let lines = Lines { done: 0, steps, printed: Instant::now() };
        Self { bar, json: json && !quiet, lines: has_lines.then(|| RefCell::new(lines)) }
    }

    /// Announces a phase without steps.
    pub fn phase(&self, message: &'static str) {
        if let Some(bar) = &self.bar {
            bar.set_message(message);
            bar.tick();
        }
        self.line(self.done(), message);
        if self.json {
            say!("{}", serde_json::json!({ "event": "phase", "phase": message }));
        }
    }

    /// Counts a finished step.
    pub fn step(&self, message: String, event: &serde_json::Value) {
        self.at(self.done() + 1, message, Some(event));
    }

    /// Returns the number of steps done so far, if they are shown.
    fn done(&self) -> u64 {
        let by_lines = self.lines.as_ref().map_or(0, |lines| lines.borrow().done);
        self.bar.as_ref().map_or(by_lines, ProgressBar::position)
    }

    /// True if the bar is drawn on a terminal.
    pub fn is_drawn(&self) -> bool {
        self.bar.is_some()
    }

    pub fn draw(&self, text: String) {
        if let Some(bar) = &self.bar {
            bar.set_message(text);
        }
    }

    /// Prints the value that `event` returns as a JSON line if --json was given. Otherwise, does not call `event`.
    pub fn event(&self, event: impl FnOnce() -> serde_json::Value) {
        if self.json {
            say!("{}", event());
        }
    }

    /// Sets the number of steps done so far.
    pub fn at(&self, position: u64, message: String, event: Option<&serde_json::Value>) {
        if let Some(bar) = &self.bar {
            bar.set_position(position);
        }
        self.line(position, &message);
        self.draw(message);
        if let Some(event) = event.filter(|_| self.json) {
            say!("{event}");
        }
    }

    fn line(&self, done: u64, message: &str) {
        let line = self.lines.as_ref().and_then(|lines| lines.borrow_mut().at(done, message, Instant::now()));
        if let Some(line) = line {
            log!("{line}");
        }
    }

    /// Prints a warning, and draws the bar again below it.
    pub fn warn(&self, message: &str) {
        self.beside_bar(|| log!("warning: {message}"));
    }

    /// Prints a message, and draws the bar again below it.
    pub fn tell(&self, message: &str) {
        self.beside_bar(|| say!("{message}"));
    }

    fn beside_bar(&self, print: impl FnOnce()) {
        match &self.bar {
            Some(bar) => bar.suspend(print),
            None => print(),
        }
    }

    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_lines_appear_at_intervals() {
        let begin = Instant::now();
        let mut lines = Lines { done: 0, steps: 8, printed: begin };
        assert_eq!(lines.at(1, "a", begin + INTERVAL / 2), None);
        assert_eq!(lines.at(2, "b\nc", begin + INTERVAL).as_deref(), Some("2/8 b"));
        assert_eq!(lines.at(3, "d", begin + INTERVAL * 3 / 2), None);
        assert_eq!(lines.at(4, "e", begin + INTERVAL * 2).as_deref(), Some("4/8 e"));
    }
}
