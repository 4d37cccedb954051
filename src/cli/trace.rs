//! `diptych trace`.

use std::path::PathBuf;

use diptych::trace::TraceError;
use diptych::trace::summary::Summary;

use super::failure::Failure;

#[derive(clap::Args)]
pub struct Args {
    /// A trace-file (Chrome trace events)
    file: PathBuf,
    /// As JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let summary = Summary::read(&args.file).map_err(|e: TraceError| Failure::Input(e.into()))?;
    if args.json {
        say!("{}", serde_json::to_string_pretty(&summary).map_err(anyhow::Error::from)?);
    } else {
        say!("{}", summary.to_string().trim_end());
    }
    Ok(())
}
