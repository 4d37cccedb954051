//! Options of `diptych view`.

use std::path::PathBuf;

use crate::options::{OUTPUT, RunOptions, SCENE};
use crate::play::options::LoopOptions;

/// Help of `--out`, which has no effect without a headset: the window writes only files that options name.
const OUT: &str = "With --xr: folder for run.json and frames.csv; created if missing";

#[derive(clap::Args, Clone, Debug)]
#[command(mut_arg("out", |out| out.required(false).default_value(".").hide(!cfg!(feature = "xr")).help(OUT)))]
pub struct Args {
    /// Close after this number of frames
    #[arg(long, help_heading = SCENE, value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) frames: Option<u32>,
    #[command(flatten)]
    pub(super) options: LoopOptions,
    /// Render into a headset through OpenXR [needs the feature `xr`]
    ///
    /// The runtime sets the time and pose of frames. --size defaults to its recommended resolution and --budget-ms to
    /// 0.55 to 1 times its display period.
    #[arg(long, help_heading = SCENE)]
    pub(super) xr: bool,
    /// With --xr: overscan for late reprojection, degrees; 0 turns it off
    #[cfg(feature = "xr")]
    #[arg(long, requires = "xr", default_value_t = 2.0, value_name = "DEG", value_parser = late_border, help_heading = SCENE)]
    pub(super) late_border: f64,
    /// With --xr: show the panel with frame times from the start
    #[cfg(feature = "xr")]
    #[arg(long, requires = "xr", help_heading = SCENE)]
    pub(super) panel: bool,
    /// Write the last picture as a PNG
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    pub(super) screenshot: Option<PathBuf>,
}

#[cfg(feature = "xr")]
fn late_border(text: &str) -> Result<f64, String> {
    let degrees = text.parse().ok().filter(|degrees| (0.0..=30.0).contains(degrees));
    degrees.ok_or_else(|| format!("'{text}' is not a number of degrees from 0 to 30"))
}

impl Args {
    pub fn run_options(&mut self) -> Option<&mut RunOptions> {
        Some(&mut self.options.run)
    }
}
