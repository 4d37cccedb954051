//! `diptych bench --preset peres`: the experiments of Peres 2022, chapter 6, on our scenes.

use anyhow::anyhow;
use clap::ValueEnum;

use crate::exec::Stereo;
use crate::image::{Extent, RgbImage};
use crate::metrics::Pair;
use crate::quality::{Denoiser, Quality};
use crate::report::csv::{Column, Csv};
use crate::report::frames::FrameLine;
use crate::report::peres::{
    CONFIGURATIONS, ConfigurationResults, ImageErrors, PeresRow, QUALITY_NOTE, RESOLUTIONS, Resolution, SCENES,
    TIME_NOTE, over_instants, peres_csv, quality_table, time_table,
};
use crate::report::study::quartiles;
use crate::scene::rig::Rig;

use super::args::Args;
use super::findings::{Findings, section};
use super::reference::own;
use super::turns::Turns;
use crate::cli::failure::Failure;
use crate::cli::foveation::Preset;
use crate::cli::interrupt;
use crate::cli::options::{RenderOptions, RunOptions};
use crate::cli::output;
use crate::cli::progress::Progress;
use crate::cli::setup::{self, Tracing};

pub const REFUSES: &[&str] = &["shot", "size", "frames", "simulate"];

/// Default shots, in place of the thesis's scenes.
const SHOTS: [&str; 3] = ["builtin:checker", "builtin:atrium", "builtin:forest"];

/// Returns the options of a frame in the configuration `preset`. `radii` are the outer radii of its inner and middle
/// layer as fractions of the image width, if it has layers.
fn options(run: &RunOptions, preset: Preset, radii: [f64; 2]) -> RenderOptions {
    let (spp, denoiser, (foveation, iterations)) = (Preset::SPP, Some(Denoiser::ATROUS), preset.layers());
    let fovea = foveation.radii().map(|_| radii);
    let quality = Quality { spp, bounces: 6, denoiser, iterations, fovea, polar: None, scale: 1.0 };
    let mut options = RenderOptions::single(run.clone(), &quality);
    options.foveated.iterations = Some(iterations);
    options
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let options = &args.options;
    options.check().map_err(Failure::Input)?;
    let mut shots = args.preset.shots.clone();
    if shots.is_empty() {
        shots = SHOTS.map(str::to_owned).to_vec();
    }
    if shots.len() > SCENES.len() {
        return Err(Failure::Input(anyhow!("--shots: give at most {}, one per scene of Peres 2022", SCENES.len())));
    }
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(options)?;
    let settings = RESOLUTIONS.len() * shots.len() * CONFIGURATIONS.len();
    let frames = u64::from(args.preset.instants) * u64::from(args.warm_up + args.repeats);
    let mut study = Study {
        args,
        tracing: &tracing,
        progress: Progress::new(settings as u64 * frames, options.quiet, options.json),
        rows: Vec::new(),
        frames: Vec::new(),
        notes: Vec::new(),
    };
    for resolution in 0..RESOLUTIONS.len() {
        for (scene, shot) in shots.iter().enumerate() {
            study.scene(resolution, scene, shot)?;
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
    rows: Vec<PeresRow>,
    /// Timed frames, each with its resolution, shot and configuration.
    frames: Vec<([String; 3], FrameLine)>,
    /// A note on each reference.
    notes: Vec<String>,
}

/// Measurements of a configuration over all instants.
#[derive(Default)]
struct Measured {
    times_ms: Vec<f64>,
    /// Errors at each instant.
    errors: Vec<ImageErrors>,
}

impl Study<'_> {
    /// Measures all configurations at one of [`RESOLUTIONS`] in one scene.
    fn scene(&mut self, resolution: usize, scene: usize, shot: &str) -> Result<(), Failure> {
        let Resolution { name: of_resolution, width, height, .. } = RESOLUTIONS[resolution];
        let shrunk = |length: u32| ((f64::from(length) * self.args.preset.size_factor).round() as u32).max(1);
        let size = Extent::new(shrunk(width), shrunk(height));
        let run = RunOptions { shot: shot.to_owned(), size, ..self.args.options.clone() };
        let loaded = setup::load(&run)?;
        let mut turns = Turns::new(&loaded, &self.progress, self.tracing, self.rows.len());
        for (configuration, preset) in CONFIGURATIONS.iter().zip(Preset::value_variants()) {
            let gpus = setup::open_devices(&run, usize::from(self.args.virtual_devices))?;
            let name = format!("{configuration} of {shot} at {size}");
            turns.add(name, options(&run, *preset, RESOLUTIONS[resolution].radii()), gpus)?;
        }
        let mut measured: [Measured; CONFIGURATIONS.len()] = Default::default();
        let Args { warm_up, repeats, .. } = *self.args;
        for (instant, time_s) in (0..).zip(instants(&loaded.shot.rig, run.time, self.args.preset.instants)) {
            let args = Args { options: RunOptions { time: time_s, ..run.clone() }, ..self.args.clone() };
            let reference = own(&args, &loaded, self.tracing, None)?;
            interrupt::check()?;
            self.notes.push(format!("{time_s} s: {}", reference.note(shot, size)));
            let mut images: [Vec<_>; CONFIGURATIONS.len()] = Default::default();
            for i in 0..warm_up + repeats {
                let reports = turns.render(time_s, instant * (warm_up + repeats) + i)?;
                for (which, report) in reports.iter().enumerate().filter(|_| i >= warm_up) {
                    let row = turns.keep(which, time_s, report, instant * repeats + i - warm_up);
                    let of = [of_resolution, shot, CONFIGURATIONS[which]].map(str::to_owned);
                    self.frames.push((of, FrameLine::from(&row)));
                    measured[which].times_ms.push(report.makespan_ms);
                    images[which].push(turns.renderers[which].read_linear()?);
                }
            }
            for (measured, images) in measured.iter_mut().zip(&images) {
                measured.errors.push(judge(images, &reference.images, loaded.shot.exposure_ev)?);
            }
        }
        let times = measured.each_ref().map(|of| quartiles(of.times_ms.clone()));
        for (i, (of, time_ms)) in measured.iter().zip(times).enumerate() {
            let (quality, deviation) = over_instants(&of.errors);
            let (speed_up, instants) = (times[0][1] / time_ms[1], of.errors.len());
            let found = ConfigurationResults {
                time_ms,
                speed_up,
                instants,
                quality,
                deviation,
                exposure_ev: loaded.exposure_ev(),
            };
            self.rows.push(PeresRow::new([resolution, scene, i], size.to_string(), shot.to_owned(), Some(found)));
        }
        Ok(())
    }

    fn write(self) -> Result<(), Failure> {
        let Self { args, rows, notes, .. } = self;
        let (of, lines): (Vec<_>, Vec<_>) = self.frames.into_iter().unzip();
        let columns: [Column<[String; 3]>; 3] = [
            ("resolution", |[resolution, _, _]| resolution.clone()),
            ("shot", |[_, shot, _]| shot.clone()),
            ("configuration", |[_, _, configuration]| configuration.clone()),
        ];
        let frames = Csv::new(&columns, &of).beside(FrameLine::csv(&lines));
        let quality_notes = [QUALITY_NOTE.to_owned()].into_iter().chain(notes).collect();
        Findings {
            title: format!("Foveated layers after Peres, scale {}", args.preset.size_factor),
            rows: &rows,
            files: vec![("peres.csv", peres_csv(&rows)), ("frames.csv", frames)],
            run: None,
            tables: vec![
                section("Time (table 4)", vec![TIME_NOTE.to_owned()], time_table(&rows)),
                section("Quality (table 5)", quality_notes, quality_table(&rows)),
            ],
            more: Vec::new(),
        }
        .write(args)
    }
}

/// Returns `count` evenly spaced instants along the path, both ends included; only `time_s` for a count of 1 or a
/// static camera.
fn instants(rig: &Rig, time_s: f64, count: u32) -> Vec<f64> {
    let [first, .., last] = &rig.keys[..] else { return vec![time_s] };
    if count == 1 {
        return vec![time_s];
    }
    let length_s = last.time_s - first.time_s;
    (0..count).map(|i| first.time_s + length_s * f64::from(i) / f64::from(count - 1)).collect()
}

/// Returns the errors of `frames` against `reference`, as means over frames and eyes.
fn judge(frames: &[Stereo<RgbImage>], reference: &Stereo<RgbImage>, exposure_ev: f32) -> Result<ImageErrors, Failure> {
    let (mut psnr, mut ssim) = (Vec::new(), Some(Vec::new()));
    for frame in frames {
        for (reference, image) in [(&reference.left, &frame.left), (&reference.right, &frame.right)] {
            let errors = Pair::new(reference, image, exposure_ev)?.errors();
            psnr.push(errors.psnr);
            ssim = ssim.zip(errors.ssim).map(|(all, value)| [all, vec![value]].concat());
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    Ok(ImageErrors::new(mean(&psnr), ssim.map(|values| mean(&values))))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use crate::scene::rig::RigKey;

    use super::*;

    #[test]
    fn instants_are_even_from_end_to_end() {
        let key = |time_s| RigKey { time_s, position: DVec3::ZERO, target: DVec3::X, up: DVec3::Y };
        let rig = |times: &[f64]| Rig::of_keys(times.iter().copied().map(key).collect());
        let moving = rig(&[1.0, 1.5, 4.0]);
        assert_eq!(instants(&moving, 0.5, 4), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!((instants(&moving, 0.5, 1), instants(&rig(&[1.0]), 0.5, 4)), (vec![0.5], vec![0.5]));
    }
}
