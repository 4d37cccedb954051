//! `diptych compare`.

use std::path::PathBuf;

use diptych::image::display::write_png;
use diptych::image::exr::read_rgb;
use diptych::metrics;

use super::failure::Failure;

#[derive(clap::Args)]
pub struct Args {
    /// What is right
    reference: PathBuf,
    /// What is judged
    image: PathBuf,
    /// Writes the error as a colour-coded PNG
    #[arg(long, value_name = "FILE")]
    heatmap: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let read = |path: &PathBuf| read_rgb(path).map_err(|e| Failure::Input(e.into()));
    let (reference, image) = (read(&args.reference)?, read(&args.image)?);
    let result = metrics::compare(&reference, &image).map_err(|e| Failure::Input(e.into()))?;
    if let Some(path) = &args.heatmap {
        write_png(path, &metrics::heatmap::heatmap(&reference, &image)?)?;
    }
    if args.json {
        say!("{}", serde_json::to_string(&result).map_err(anyhow::Error::from)?);
    } else {
        say!("{result}");
    }
    Ok(())
}
