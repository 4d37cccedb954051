//! Options of `diptych scale`.

use crate::options::{self, DEFAULT_FPS, RenderFlags};
use crate::simulate;

#[derive(clap::Args, Debug)]
#[command(mut_arg("frames", |frames| frames.default_value("12").help("Timed frames per device count")))]
pub struct Args {
    /// Frames before the timed ones
    #[arg(long, default_value_t = 3, help_heading = options::SCENE)]
    pub warm_up: u32,
    #[command(flatten)]
    pub flags: RenderFlags,
    /// Virtual devices on each adapter; one device is always measured
    #[arg(long, value_delimiter = ',', default_value = "1,2", value_name = "N,N,…", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = options::DEVICES)]
    pub counts: Vec<u16>,
    /// Let the pixels grow with the devices, as in weak scaling
    #[arg(long, conflicts_with = "simulate", help_heading = options::DEVICES)]
    pub weak: bool,
    #[command(flatten)]
    pub simulation: simulate::Args,
    /// Also write report.html
    #[arg(long, help_heading = options::OUTPUT)]
    pub report: bool,
}

impl Args {
    /// Makes all counts have the same default of threads per device, on all ranks.
    pub fn share_cores(&mut self) {
        self.flags.run.most_virtual_devices = self.counts.iter().copied().max().unwrap_or(1);
    }

    /// Returns the instant of a frame in seconds. `number` counts frames from the first warm-up frame.
    pub fn time_s(&self, number: u32) -> f64 {
        self.flags.run.settings.time
            + f64::from(number.saturating_sub(self.warm_up)) / self.flags.run.settings.fps.unwrap_or(DEFAULT_FPS)
    }
}
