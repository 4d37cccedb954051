//! Options of commands that keep frames inside a budget.

use std::path::PathBuf;

use diptych::control::{Budget, Ladder, Measure, Origin};
use diptych::scene::head::{Recording, Space};

use crate::failure::Failure;
use crate::options::{DEVICES, OUTPUT, QUALITY, RunOptions};
use crate::progress::Progress;

#[derive(clap::Args, Clone, Debug)]
pub struct LoopOptions {
    #[command(flatten)]
    pub run: RunOptions,
    /// Virtual devices on each adapter
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = DEVICES)]
    pub virtual_devices: u16,
    /// Budget: range for the frame time (makespan), ms
    #[arg(long, default_value = "11..20", value_name = "LO..HI", help_heading = QUALITY)]
    pub budget_ms: Budget,
    /// Quality ladder measured by `bench` [default: a built-in one]
    ///
    /// For the built-in ladder some settings are timed at the start, and errors are estimated.
    #[arg(long, value_name = "FILE", help_heading = QUALITY)]
    pub ladder: Option<PathBuf>,
    /// Record head poses to FILE, for the setting motion
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    pub record_motion: Option<PathBuf>,
}

impl LoopOptions {
    /// Creates the file of --record-motion, if requested. Renames a file that a killed run left, with a warning.
    pub fn recording(&self, space: Space, progress: &Progress) -> Result<Option<Recording>, Failure> {
        let Some(path) = &self.record_motion else { return Ok(None) };
        let (recording, kept) = Recording::create(space, path)?;
        if let Some(kept) = kept {
            let kept = kept.display();
            progress.warn(&format!("the last recording of {} did not finish: it is kept in {kept}", path.display()));
        }
        Ok(Some(recording))
    }

    /// Describes where the rungs come from.
    pub fn ladder_name(&self, ladder: &Ladder) -> String {
        let Origin { shot, size, measure, .. } = ladder.origin();
        match (&self.ladder, measure) {
            (None, _) => "built in (some settings timed at the start, errors estimated)".to_owned(),
            (Some(path), Measure::Estimate) => format!("{} (estimated for {shot} at {size})", path.display()),
            (Some(path), _) => format!("{} ({} measured on {shot} at {size})", path.display(), measure.name()),
        }
    }
}
