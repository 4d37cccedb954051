//! `diptych study`: published experiments, the study of seams and your own experiments.
//!
//! To add a study, write a file in `experiments` and add it to [`PUBLISHED`].

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::anyhow;

use super::args::{Args, StudyOptions, refuse};
use super::{experiment, seams};
use crate::cli::failure::Failure;
use crate::cli::options::{self, RunOptions};
use crate::cli::reference::{PASS_SPP, seconds};
use crate::cli::settings::Given;
use crate::report::once;

/// Names of studies, and their experiments as text.
const PUBLISHED: [(&str, &str); 6] = [
    ("andersson", include_str!("experiments/andersson.toml")),
    ("bmfr", include_str!("experiments/bmfr.toml")),
    ("koskela", include_str!("experiments/koskela.toml")),
    ("late", include_str!("experiments/late.toml")),
    ("leria", include_str!("experiments/leria.toml")),
    ("peres", include_str!("experiments/peres.toml")),
];

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Studies:
  leria      Leria et al.: distribute every stage, or only path tracing
  bmfr       Xu, Tong & Xu: bmfr with and without feature noise, and svgf
  koskela    Koskela et al.: visual-polar space against equal-sample alternatives
  andersson  Andersson & Hansson: four log-polar modes, by rings around the gaze
  peres      Peres: foveated sampling and denoising in layers
  late       late reprojection of frames 1, 2 and 4 periods late; needs --motion
  seams      every filtering across stripes at every device count
  FILE.toml  an experiment of your own, as docs/experiments.md describes

Examples:
  diptych study koskela --shots builtin:cornell --size 320x180 --out out/koskela
  diptych study seams builtin:atrium --counts 2,4 --out out/seams")]
pub struct StudyArgs {
    /// Name of the study, or the file of an experiment
    #[arg(value_name = "NAME|FILE.toml")]
    name: String,
    #[command(flatten)]
    pub options: RunOptions,
    /// Virtual devices on each adapter
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = options::DEVICES)]
    virtual_devices: u16,
    /// Shots to measure, for all but leria and seams
    ///
    /// For peres they replace the scenes of the thesis: Pink Room, Sponza, Forest [default: builtin:checker,
    /// builtin:atrium and builtin:forest].
    #[arg(long, value_name = "SHOT,…", value_delimiter = ',', help_heading = options::SCENE)]
    shots: Vec<String>,
    /// Scale factor of the resolutions of peres
    #[arg(long, value_name = "F", default_value_t = 0.25, value_parser = size_factor, help_heading = options::SCENE)]
    size_factor: f64,
    /// Instants on the path, for peres, andersson and late
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000), help_heading = options::SCENE)]
    instants: u32,
    /// Frames along the path, for leria
    #[arg(long, value_name = "N", default_value_t = 104, value_parser = clap::value_parser!(u32).range(1..=5000), help_heading = options::SCENE)]
    frames: u32,
    /// Device counts to predict, for leria
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", default_value = "4", value_parser = clap::value_parser!(u16).range(2..=64), help_heading = options::DEVICES)]
    simulate: Vec<u16>,
    /// Virtual devices on each adapter, for seams
    #[arg(long, value_delimiter = ',', default_value = "2,3,4", value_name = "N,N,…", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = options::DEVICES)]
    counts: Vec<u16>,
    /// Timed and compared frames per arrangement
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000), help_heading = options::SCENE)]
    repeats: u32,
    /// Untimed frames before the timed ones
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=1000), help_heading = options::SCENE)]
    warm_up: u32,
    /// Samples per pixel of the reference
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(2 * i64::from(PASS_SPP)..), help_heading = options::QUALITY)]
    reference_spp: u32,
    /// Time limit of the reference, seconds; later runs resume it
    #[arg(long, default_value = "600", value_name = "S", value_parser = seconds, help_heading = options::QUALITY)]
    reference_time_limit: Duration,
    /// Folder of references for later runs [default: reference in --out]
    #[arg(long = "reference-cache", value_name = "DIR", help_heading = options::OUTPUT)]
    reference_dir: Option<PathBuf>,
    /// Also write report.html
    #[arg(long, help_heading = options::OUTPUT)]
    report: bool,
}

fn size_factor(text: &str) -> Result<f64, String> {
    let factor = text.parse().ok().filter(|factor: &f64| (0.01..=4.0).contains(factor));
    factor.ok_or_else(|| "give a number from 0.01 to 4".to_owned())
}

impl StudyArgs {
    /// Returns these options as those of `bench`.
    fn of_bench(&self) -> Args {
        let all = self.clone();
        Args {
            options: all.options,
            virtual_devices: all.virtual_devices,
            spp: Vec::new(),
            bounces: Vec::new(),
            denoiser: Vec::new(),
            iterations: Vec::new(),
            foveation: Vec::new(),
            scale: Vec::new(),
            ladder: None,
            quick: false,
            fresh: false,
            repeats: all.repeats,
            warm_up: all.warm_up,
            by_kind: false,
            reference: None,
            reference_spp: Some(all.reference_spp),
            reference_time_limit: all.reference_time_limit,
            reference_dir: all.reference_dir,
            report: all.report,
            peers: None,
            study: Some(StudyOptions {
                shots: all.shots,
                size_factor: all.size_factor,
                instants: all.instants,
                frames: all.frames,
                simulate: once(all.simulate.into_iter().map(usize::from)),
                counts: all.counts.into_iter().filter(|count| *count > 1).collect(),
            }),
        }
    }
}

pub fn run(study: &StudyArgs) -> Result<(), Failure> {
    let (args, name) = (study.of_bench(), study.name.as_str());
    let origin = format!("study {name}");
    let settings = &args.options.settings;
    let is_typed = |id: &str| Given::here().is_some_and(|given| given.typed(id).is_some());
    if is_typed("shot") && is_typed("shots") {
        return Err(Failure::Input(anyhow!("give either SHOT or --shots, not both")));
    }
    if name == "seams" {
        let others = ["virtual_devices", "seam", "shots", "size_factor", "instants", "frames", "simulate"];
        refuse(&origin, settings, others)?;
        return seams::run(&args);
    }
    refuse(&origin, settings, ["counts", "spp", "bounces", "denoiser", "iterations", "foveation", "render_scale"])?;
    if let Some((_, text)) = PUBLISHED.iter().find(|(published, _)| *published == name) {
        return experiment::run_text(&args, text, &origin);
    }
    if Path::new(name).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
        return experiment::run_file(&args, Path::new(name));
    }
    let names: Vec<&str> = PUBLISHED.iter().map(|(name, _)| *name).chain(["seams"]).collect();
    Err(Failure::Input(anyhow!("there is no study '{name}': give {} or a .toml file", names.join(", "))))
}
