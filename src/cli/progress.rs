//! Progress: a bar on a terminal, JSON lines with `--json`, nothing with `--quiet`.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

pub struct Progress {
    bar: Option<ProgressBar>,
    json: bool,
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
        let shown = !quiet && !json && std::io::stderr().is_terminal();
        let bar = shown.then(|| {
            let bar = ProgressBar::new(steps);
            let style = ProgressStyle::with_template(template);
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        Self { bar, json: json && !quiet }
    }

    /// Announces a phase without steps.
    pub fn phase(&self, message: &'static str) {
        if let Some(bar) = &self.bar {
            bar.set_message(message);
            bar.tick();
        }
        if self.json {
            say!("{}", serde_json::json!({ "event": "phase", "phase": message }));
        }
    }

    /// Counts a finished step.
    pub fn step(&self, message: String, event: &serde_json::Value) {
        if let Some(bar) = &self.bar {
            bar.inc(1);
        }
        self.say(message, Some(event));
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
        self.say(message, event);
    }

    fn say(&self, message: String, event: Option<&serde_json::Value>) {
        if let Some(bar) = &self.bar {
            bar.set_message(message);
        }
        if let Some(event) = event.filter(|_| self.json) {
            say!("{event}");
        }
    }

    /// Prints a warning, and draws the bar again below it.
    pub fn warn(&self, message: &str) {
        self.beside_bar(|| eprintln!("warning: {message}"));
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
