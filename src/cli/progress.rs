//! Progress: a bar on a terminal, JSON lines with `--json`, nothing with `--quiet`.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

pub struct Progress {
    bar: Option<ProgressBar>,
    json: bool,
}

impl Progress {
    pub fn new(steps: u64, quiet: bool, json: bool) -> Self {
        let shown = !quiet && !json && std::io::stderr().is_terminal();
        let bar = shown.then(|| {
            let bar = ProgressBar::new(steps);
            let style = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} {eta}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        Self { bar, json: json && !quiet }
    }

    /// A phase without steps.
    pub fn phase(&self, message: &'static str) {
        if let Some(bar) = &self.bar {
            bar.set_message(message);
            bar.tick();
        }
        if self.json {
            say!("{}", serde_json::json!({ "event": "phase", "phase": message }));
        }
    }

    /// A finished step.
    pub fn step(&self, message: String, event: &serde_json::Value) {
        if let Some(bar) = &self.bar {
            bar.set_message(message);
            bar.inc(1);
        }
        if self.json {
            say!("{event}");
        }
    }

    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
