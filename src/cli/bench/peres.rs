//! `diptych bench --preset peres`: the experiments of Peres 2022, chapter 6, on our scenes.

use anyhow::anyhow;
use clap::ValueEnum;

use diptych::exec::Stereo;
use diptych::image::{Extent, RgbImage};
use diptych::metrics::Pair;
use diptych::quality::{Denoiser, Quality};
use diptych::report::csv::{Column, Csv};
use diptych::report::frames::FrameLine;
use diptych::report::html::Section;
use diptych::report::peres::{
    CONFIGURATIONS, Found, ImageErrors, QUALITY_NOTE, RESOLUTIONS, Row, SCENES, TIME_NOTE, peres_csv, quality_table,
    time_table,
};
use diptych::report::study::quartiles;

use super::Args;
use super::reference::own;
use super::timed::{Setting, Timed, TimedFrame};
use crate::cli::failure::Failure;
use crate::cli::foveation::Preset;
use crate::cli::interrupt;
use crate::cli::options::{RenderOptions, RunOptions};
use crate::cli::output;
use crate::cli::page::{self, and_page};
use crate::cli::progress::Progress;
use crate::cli::setup::{self, Loaded, Tracing};

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum StudyPreset {
    /// Tables 4 and 5 of Peres: foveated sampling and denoising in layers
    Peres,
}

#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = crate::cli::options::QUALITY)]
pub struct PresetOptions {
    /// Repeat a published study instead of measuring the grid
    #[arg(long, value_name = "STUDY", conflicts_with_all = ["seams", "shot", "size", "spp", "bounces", "denoiser", "iterations", "reference"])]
    preset: Option<StudyPreset>,
    /// With --preset: what stands for the study's scenes, in their order: Pink Room, Sponza, Forest
    #[arg(
        long,
        value_name = "SHOT,…",
        value_delimiter = ',',
        requires = "preset",
        default_value = "builtin:checker,builtin:atrium,builtin:forest"
    )]
    shots: Vec<String>,
    /// With --preset: factor on the study's widths and heights
    #[arg(long, value_name = "F", requires = "preset", default_value_t = 0.25, value_parser = size_factor)]
    size_factor: f64,
}

fn size_factor(text: &str) -> Result<f64, String> {
    let factor = text.parse().ok().filter(|factor: &f64| (0.01..=4.0).contains(factor));
    factor.ok_or_else(|| "give a number from 0.01 to 4".to_owned())
}

impl PresetOptions {
    pub fn is_wanted(&self) -> bool {
        self.preset.is_some()
    }
}

/// One frame of a configuration.
fn options(run: &RunOptions, preset: Preset) -> RenderOptions {
    let (spp, denoiser, (foveation, iterations)) = (Preset::SPP, Some(Denoiser::Atrous), preset.layers());
    let quality = Quality { spp, bounces: 6, denoiser, iterations, fovea: foveation.radii(), visual_polar: false, scale: 1.0 };
    let mut options = RenderOptions::single(run.clone(), &quality);
    options.foveated.iterations = Some(iterations);
    options
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let options = &args.options;
    options.check().map_err(Failure::Input)?;
    if args.preset.shots.len() > SCENES.len() {
        return Err(Failure::Input(anyhow!("--shots: the study has {} scenes, give no more", SCENES.len())));
    }
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(options)?;
    let settings = RESOLUTIONS.len() * args.preset.shots.len() * CONFIGURATIONS.len();
    let steps = settings as u64 * u64::from(args.warm_up + args.repeats);
    let mut study = Study {
        args,
        tracing: &tracing,
        progress: Progress::new(steps, options.quiet, options.json),
        rows: Vec::new(),
        frames: Vec::new(),
        notes: Vec::new(),
        settings: 0,
    };
    for resolution in 0..RESOLUTIONS.len() {
        for scene in 0..args.preset.shots.len() {
            study.scene(resolution, scene)?;
        }
    }
    study.progress.finish();
    study.write()?;
    tracing.finish()
}

struct Study<'a> {
    args: &'a Args,
    tracing: &'a Tracing,
    progress: Progress,
    rows: Vec<Row>,
    /// Those that were timed, each with its resolution, shot and configuration.
    frames: Vec<([String; 3], FrameLine)>,
    /// About each reference.
    notes: Vec<String>,
    /// Measured so far.
    settings: u32,
}

impl Study<'_> {
    /// All configurations of one of [`RESOLUTIONS`] and of the shots.
    fn scene(&mut self, resolution: usize, scene: usize) -> Result<(), Failure> {
        let (_, width, height) = RESOLUTIONS[resolution];
        let shrunk = |length: u32| ((f64::from(length) * self.args.preset.size_factor).round() as u32).max(1);
        let size = Extent::new(shrunk(width), shrunk(height));
        let shot = self.args.preset.shots[scene].clone();
        let run = RunOptions { shot: shot.clone(), size, ..self.args.options.clone() };
        let args = Args { options: run, ..self.args.clone() };
        let loaded = setup::load(&args.options)?;
        let reference = own(&args, &loaded, self.tracing, None)?;
        interrupt::check()?;
        let noise = reference.noise.as_ref().map_or(String::new(), |noise| format!("; its own noise: {noise}"));
        self.notes.push(format!("Reference of {shot} at {size}: {}{noise}.", reference.origin));
        let timed = Timed { args: &args, loaded: &loaded, progress: &self.progress, tracing: self.tracing };
        let mut base_ms = None;
        for (i, (configuration, preset)) in CONFIGURATIONS.into_iter().zip(Preset::value_variants()).enumerate() {
            let options = options(&args.options, *preset);
            let name = format!("{configuration} of {shot} at {size}");
            let virtual_devices = Some(args.virtual_devices);
            let warm = timed.frames(&Setting { number: self.settings, name, options, virtual_devices })?;
            self.settings += 1;
            let of = [RESOLUTIONS[resolution].0, &shot, configuration].map(str::to_owned);
            self.frames.extend(warm.frames.iter().map(|frame| (of.clone(), FrameLine::from(&frame.row))));
            let found = judge(&warm.frames, &reference.images, &loaded, &mut base_ms)?;
            self.rows.push(Row::new([resolution, scene, i], size.to_string(), shot.clone(), Some(found)));
        }
        Ok(())
    }

    fn write(&self) -> Result<(), Failure> {
        let Self { args, rows, notes, .. } = self;
        let options = &args.options;
        peres_csv(rows).write(&options.out.join("peres.csv"))?;
        let (of, lines): (Vec<_>, Vec<_>) = self.frames.iter().cloned().unzip();
        let columns: [Column<[String; 3]>; 3] = [
            ("resolution", |[resolution, _, _]| resolution.clone()),
            ("shot", |[_, shot, _]| shot.clone()),
            ("configuration", |[_, _, configuration]| configuration.clone()),
        ];
        Csv::new(&columns, &of).beside(FrameLine::csv(&lines)).write(&options.out.join("frames.csv"))?;
        let title = format!("Foveated layers after Peres, scale {}", args.preset.size_factor);
        let section = |heading, notes, table| Section { heading, notes, table: Some(table), figure: None };
        let quality_notes = [QUALITY_NOTE.to_owned()].into_iter().chain(notes.iter().cloned()).collect();
        let sections = [
            section("Time (table 4)", vec![TIME_NOTE.to_owned()], time_table(rows)),
            section("Quality (table 5)", quality_notes, quality_table(rows)),
        ];
        if args.report {
            page::write(&options.out, &title, &sections)?;
        }
        if options.json {
            say!("{}", serde_json::json!({ "event": "result", "rows": rows }));
        } else if !options.quiet {
            notes.iter().for_each(|note| say!("{note}"));
            say!("{}\n{TIME_NOTE}\n", time_table(rows).text().trim_end());
            say!("{}\n{QUALITY_NOTE}", quality_table(rows).text().trim_end());
            say!("{}peres.csv and frames.csv: {}", and_page(args.report), options.out.display());
        }
        Ok(())
    }
}

/// Times and errors of frames; the first to come is what the others' speed-ups are over.
fn judge(
    frames: &[TimedFrame],
    reference: &Stereo<RgbImage>,
    loaded: &Loaded,
    base_ms: &mut Option<f64>,
) -> Result<Found, Failure> {
    let time_ms = quartiles(frames.iter().map(|f| f.report.makespan_ms).collect());
    let (mut psnr, mut ssim) = (Vec::new(), Some(Vec::new()));
    for frame in frames {
        for (reference, image) in [(&reference.left, &frame.linear.left), (&reference.right, &frame.linear.right)] {
            let errors = Pair::new(reference, image, loaded.shot.exposure_ev)?.errors();
            psnr.push(errors.psnr);
            ssim = ssim.zip(errors.ssim).map(|(all, value)| [all, vec![value]].concat());
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let quality = ImageErrors::new(mean(&psnr), ssim.map(|values| mean(&values)));
    let speed_up = *base_ms.get_or_insert(time_ms[1]) / time_ms[1];
    Ok(Found { time_ms, speed_up, quality, exposure_ev: loaded.exposure_ev() })
}
