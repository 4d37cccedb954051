//! Progress: a bar on a terminal, JSON lines with `--json`, nothing with `--quiet`, otherwise a line every few seconds.

use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::console;

pub struct Progress {
    bar: Option<ProgressBar>,
    json: bool,
    lines: Option<RefCell<Lines>>,
    steps: u64,
    /// Number of steps done.
    done: Cell<u64>,
    /// Time of the last event about a part of a step.
    told: Cell<Option<Instant>>,
}

/// Time from the beginning of the command to the first line, and the minimum interval between two lines.
const FIRST: Duration = Duration::from_secs(1);
const INTERVAL: Duration = Duration::from_secs(5);
/// Minimum interval between two events about a part of a step.
const EVENT_INTERVAL: Duration = Duration::from_millis(500);

/// Divisions of a step on a bar.
const DIVISIONS: u64 = 1000;

/// Lines of progress for outputs that are no terminal.
struct Lines {
    steps: u64,
    /// Unit of the steps, such as ` spp`, if lines count them.
    unit: Option<&'static str>,
    /// Time from which the next line may be printed.
    due: Instant,
}

impl Lines {
    /// Returns the line to print with `done` steps done, if one is due at `now`.
    fn at(&mut self, done: f64, message: &str, now: Instant) -> Option<String> {
        if now < self.due {
            return None;
        }
        self.due = now + INTERVAL;
        let message = message.lines().next().unwrap_or_default();
        let steps = self.steps;
        if steps == 0 {
            return Some(message.to_owned());
        }
        let percent = percent(done / steps as f64);
        match self.unit.filter(|_| steps > 1) {
            Some(unit) => Some(format!("{percent} {}/{steps}{unit} {message}", done as u64)),
            None => Some(format!("{percent} {message}")),
        }
    }
}

/// Formats a fraction in percent, rounded down.
fn percent(fraction: f64) -> String {
    format!("{} %", (100.0 * fraction.clamp(0.0, 1.0)) as u32)
}

impl Progress {
    pub fn new(steps: u64, quiet: bool, json: bool) -> Self {
        Self::with_template(steps, Some(""), "{bar:30} {percent:>3} % {msg} {eta}", quiet, json)
    }

    /// Creates a bar that counts samples per pixel. Messages give the elapsed and the remaining time.
    pub fn samples(spp: u64, quiet: bool, json: bool) -> Self {
        Self::with_template(spp, Some(" spp"), "{bar:30} {percent:>3} % {msg}", quiet, json)
    }

    /// Creates a bar for steps of unequal cost. `units` is their total cost; the bar shows messages, but no counts.
    pub fn work(units: u64, quiet: bool, json: bool) -> Self {
        Self::with_template(units, None, "{bar:30} {percent:>3} % {msg}", quiet, json)
    }

    /// Creates a display of messages of one or more lines, without a bar.
    pub fn text(quiet: bool, json: bool) -> Self {
        Self::with_template(0, None, "{msg}", quiet, json)
    }

    fn with_template(steps: u64, unit: Option<&'static str>, template: &str, quiet: bool, json: bool) -> Self {
        let shown = !quiet && !json && console::is_terminal();
        let bar = shown.then(|| {
            let bar = ProgressBar::new(steps * DIVISIONS);
            let style = ProgressStyle::with_template(template);
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        let has_lines = !quiet && !json && bar.is_none();
        let lines = Lines { steps, unit, due: console::begun() + FIRST };
        let lines = has_lines.then(|| RefCell::new(lines));
        Self { bar, json: json && !quiet, lines, steps, done: Cell::new(0), told: Cell::new(None) }
    }

    /// Announces a phase without steps.
    pub fn phase(&self, message: &'static str) {
        if let Some(bar) = &self.bar {
            bar.set_message(message);
            bar.tick();
        }
        self.line(self.done.get() as f64, message);
        if self.json {
            say!("{}", serde_json::json!({ "event": "phase", "phase": message }));
        }
    }

    /// Shows the fraction of a phase that is done.
    pub fn phase_part(&self, phase: &str, fraction: f64) {
        let text = format!("{phase}: {}", percent(fraction));
        self.line(self.done.get() as f64, &text);
        self.draw(text);
        self.tell_part(|| serde_json::json!({ "event": "progress", "phase": phase, "fraction": fraction }));
    }

    /// Shows the fraction of the current step that is done.
    pub fn part(&self, fraction: f64, message: &str) {
        self.part_of(1, fraction, message);
    }

    /// Shows the fraction of the next `steps` steps that is done.
    pub fn part_of(&self, steps: u64, fraction: f64, message: &str) {
        let done = self.done.get() as f64 + fraction * steps as f64;
        if let Some(bar) = &self.bar {
            bar.set_position((done * DIVISIONS as f64) as u64);
        }
        self.line(done, message);
        self.draw(message.to_owned());
        let all = done / self.steps.max(1) as f64;
        self.tell_part(|| serde_json::json!({ "event": "progress", "fraction": all }));
    }

    /// Prints an event about a part of a step, unless the last one is recent.
    fn tell_part(&self, event: impl FnOnce() -> serde_json::Value) {
        if self.json && self.told.get().is_none_or(|told| told.elapsed() >= EVENT_INTERVAL) {
            self.told.set(Some(Instant::now()));
            say!("{}", event());
        }
    }

    /// Counts a finished step.
    pub fn step(&self, message: String, event: &serde_json::Value) {
        self.at(self.done.get() + 1, message, Some(event));
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
        self.done.set(position);
        if let Some(bar) = &self.bar {
            bar.set_position(position * DIVISIONS);
        }
        self.line(position as f64, &message);
        self.draw(message);
        if let Some(event) = event.filter(|_| self.json) {
            say!("{event}");
        }
    }

    fn line(&self, done: f64, message: &str) {
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
        let mut lines = Lines { steps: 8, unit: Some(""), due: begin + FIRST };
        assert_eq!(lines.at(1.0, "a", begin + FIRST / 2), None);
        assert_eq!(lines.at(2.5, "b\nc", begin + FIRST).as_deref(), Some("31 % 2/8 b"));
        assert_eq!(lines.at(3.0, "d", begin + INTERVAL), None);
        assert_eq!(lines.at(4.0, "e", begin + FIRST + INTERVAL).as_deref(), Some("50 % 4/8 e"));
    }

    #[test]
    fn lines_count_only_steps_of_equal_cost() {
        let now = Instant::now();
        let line = |steps, unit, done| Lines { steps, unit, due: now }.at(done, "a", now).unwrap();
        assert_eq!(line(1, Some(""), 0.257), "25 % a");
        assert_eq!(line(64, Some(" spp"), 16.0), "25 % 16/64 spp a");
        assert_eq!(line(64, None, 16.0), "25 % a");
        assert_eq!(line(0, None, 0.0), "a");
    }
}
