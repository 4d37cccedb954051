//! `diptych trace`.

use std::path::{Path, PathBuf};

use crate::report::trace::{comparison_text, frame_text, late_text, summary_text};
use diptych::trace::compare::Comparison;
use diptych::trace::late::LateSummary;
use diptych::trace::read::read;
use diptych::trace::summary::{FrameDetail, Summary};
use serde::Serialize;

use super::failure::Failure;

#[derive(clap::Args)]
pub struct Args {
    /// Trace file (Chrome trace events), complete or truncated
    file: PathBuf,
    /// Second trace, to compare with the first
    other: Option<PathBuf>,
    /// Print one frame and its critical path step by step
    #[arg(long, value_name = "N", conflicts_with = "other")]
    frame: Option<u64>,
    /// Print the late frames of `play`, with their causes
    #[arg(long, conflicts_with_all = ["other", "frame"])]
    late: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let trace = read(&args.file)?;
    let name = |path: &Path| path.display().to_string();
    if let Some(path) = &args.other {
        let other = read(path)?;
        let comparison = Comparison::of([(&trace, &name(&args.file)), (&other, &name(path))])?;
        return show(args, &comparison, comparison_text);
    }
    if args.late {
        return show(args, &LateSummary::of(&trace, &name(&args.file))?, late_text);
    }
    match args.frame {
        Some(frame) => show(args, &FrameDetail::of(&trace, frame, &name(&args.file))?, frame_text),
        None => show(args, &Summary::of(&trace), summary_text),
    }
}

fn show<T: Serialize>(args: &Args, found: &T, text: impl Fn(&T) -> String) -> Result<(), Failure> {
    if args.json {
        say!("{}", serde_json::to_string_pretty(found).map_err(anyhow::Error::from)?);
    } else {
        say!("{}", text(found).trim_end());
    }
    Ok(())
}
