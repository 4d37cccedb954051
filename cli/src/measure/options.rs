//! Options of `diptych info --check`.

use std::path::PathBuf;

use diptych::image::Extent;

/// Options of the measurement, and of its output.
#[derive(clap::Args, Clone, Debug)]
pub struct Options {
    /// Folder of --check for report.html and machine.json
    #[arg(long, default_value = "out/machine", value_name = "DIR")]
    pub out: PathBuf,
    /// Time of --check in minutes; what does not fit is left out
    #[arg(long, default_value_t = 10.0, value_name = "M", value_parser = minutes)]
    pub minutes: f64,
    /// Sizes of each eye's image that --check times
    #[arg(long, value_delimiter = ',', default_value = "320x180,640x360,1280x720", value_name = "WxH,…")]
    pub sizes: Vec<Extent>,
    /// Print no progress and no tables
    #[arg(long)]
    pub quiet: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

fn minutes(text: &str) -> Result<f64, String> {
    let minutes = text.parse().ok().filter(|m| (0.05..=600.0).contains(m));
    minutes.ok_or_else(|| "give a time from 0.05 to 600 minutes".to_owned())
}
