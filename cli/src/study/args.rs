//! Options of `diptych study`.

use std::path::PathBuf;

use anyhow::anyhow;

use super::definition::Study;
use super::locked;
use crate::bench::reference::{Wanted, reference_time};
use crate::failure::Failure;
use crate::options::{self, RunOptions};
use crate::reference::PASS_SPP;
use crate::settings::Given;

#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Studies:
  leria             Leria et al. 2024: distribute every stage, or only path tracing
  leria-lightfield  Leria et al. 2024: rows of views on several devices
  seams             Leria et al. 2024: every filtering across stripes at every device count
  bmfr              Xu, Tong & Xu: bmfr with and without feature noise, and svgf
  koskela           Koskela et al. 2019: visual-polar space against equal-sample alternatives
  andersson         Andersson & Hansson 2020: log-polar modes, by rings around the gaze
  peres             Peres 2022: foveated sampling and denoising in layers

Examples:
  diptych study koskela --shots builtin:cornell --fraction 0.1 --out out/koskela
  diptych study leria --virtual 2 --threads-per-device 1 --conditions published,today,each
  diptych study seams builtin:atrium --counts 2,4 --out out/seams")]
pub struct StudyArgs {
    /// Name of the study
    #[arg(value_name = "NAME")]
    pub name: String,
    /// Timed and compared frames per arrangement and instant
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000), help_heading = options::SCENE)]
    pub repeats: u32,
    /// Untimed frames before the timed ones
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=1000), help_heading = options::SCENE)]
    pub warm_up: u32,
    #[command(flatten)]
    pub options: RunOptions,
    /// Virtual devices on each adapter
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = options::DEVICES)]
    pub virtual_devices: u16,
    /// Conditions: published, today, and each departure of today from published
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "published,today", value_parser = ["published", "today", "each"], help_heading = options::QUALITY)]
    pub conditions: Vec<String>,
    /// Shots to measure in place of the study's; only seams takes SHOT alone
    #[arg(long, value_name = "SHOT,…", value_delimiter = ',', help_heading = options::SCENE)]
    pub shots: Vec<String>,
    /// Fraction of the published width and height, and of the number of frames
    #[arg(long, value_name = "F", default_value_t = 0.25, value_parser = fraction, help_heading = options::SCENE)]
    pub fraction: f64,
    /// Device counts to predict, for leria and leria-lightfield
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", default_value = "4", value_parser = clap::value_parser!(u16).range(2..=64), help_heading = options::DEVICES)]
    pub simulate: Vec<u16>,
    /// Virtual devices on each adapter, for seams
    #[arg(long, value_delimiter = ',', default_value = "2,3,4", value_name = "N,N,…", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = options::DEVICES)]
    pub counts: Vec<u16>,
    /// Samples per pixel of the reference
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(2 * i64::from(PASS_SPP)..), help_heading = options::QUALITY)]
    pub reference_spp: u32,
    /// Folder of references for later runs [default: reference in --out]
    #[arg(long = "reference-cache", value_name = "DIR", help_heading = options::OUTPUT)]
    pub reference_dir: Option<PathBuf>,
    /// Also write report.html
    #[arg(long, help_heading = options::OUTPUT)]
    pub report: bool,
}

fn fraction(text: &str) -> Result<f64, String> {
    let fraction = text.parse().ok().filter(|fraction: &f64| (0.01..=4.0).contains(fraction));
    fraction.ok_or_else(|| "give a number from 0.01 to 4".to_owned())
}

impl StudyArgs {
    /// Returns the reference of frames with these options and this number of bounces.
    pub fn reference<'a>(&self, options: &'a RunOptions, bounces: u32) -> Wanted<'a> {
        Wanted {
            options,
            virtual_devices: self.virtual_devices,
            spp: self.reference_spp,
            bounces,
            time_limit: reference_time(&self.options.settings),
            kept: self.reference_dir.clone().unwrap_or_else(|| self.options.out.join("reference")),
        }
    }

    /// Returns the number of frames or instants of a study: at least two.
    pub fn frames_of(&self, study: &Study) -> u32 {
        ((f64::from(study.frames) * self.fraction).round() as u32).max(2)
    }

    /// Refuses options and settings that were given, by the names of their fields.
    pub fn refuse(&self, ids: &[&str]) -> Result<(), Failure> {
        let set = |id: &&str| self.options.settings.is_given(id).then(|| (*id).to_owned());
        let typed = ids.iter().find_map(|id| Given::here().and_then(|given| given.typed(id)).or_else(|| set(id)));
        typed.map_or(Ok(()), |option| {
            Err(Failure::Input(anyhow!("study {} does not read {option}: leave it out", self.name)))
        })
    }

    /// Refuses settings that the study fixes.
    pub fn refuse_fixed(&self) -> Result<(), Failure> {
        let fixed = self.options.settings.given().iter().find(|key| !locked::is_given(key));
        fixed.map_or(Ok(()), |key| {
            Err(Failure::Input(anyhow!("study {} fixes the setting {key}: leave it out", self.name)))
        })
    }
}
