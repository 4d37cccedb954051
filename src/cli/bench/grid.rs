//! The grid: renders, times and compares each setting that the journal lacks.

use std::cell::Cell;
use std::time::Instant;

use serde_json::{Value, json};

use crate::exec::ranks::Devices;
use crate::exec::{FrameReport, Renderer, Stereo};
use crate::image::RgbImage;
use crate::loaded::LoadedScene;
use crate::quality::{Denoiser, Quality};
use crate::report::bench::{Measured, Row};
use crate::report::once;
use crate::report::run::FrameRow;
use crate::stages::Foveation;
use crate::trace::frames::record_devices;

use super::Args;
use super::journal::Journal;
use super::judge::Judge;
use super::reference::Reference;
use crate::cli::failure::Failure;
use crate::cli::faults::refuse_faults;
use crate::cli::foveation::FoveationMode;
use crate::cli::interrupt;
use crate::cli::options::{DenoiserChoice, RenderOptions};
use crate::cli::progress::Progress;
use crate::cli::settings;
use crate::cli::setup::{self, Tracing};

/// Frame rate at which the camera approaches the compared instant.
pub const FPS: f64 = 72.0;
/// Minimum number of warm-up frames for denoisers that keep a history.
const HISTORY_FRAMES: u32 = 15;

/// Denoisers that are measured by default.
const MEASURED: [DenoiserChoice; 3] = [None, Some(Denoiser::ATROUS), Some(Denoiser::SVGF)];

/// Upper bound on the frames of a setting, which keeps the settings' frame numbers in the trace apart.
pub const FRAMES_MAX: u32 = 10_000;

impl Args {
    fn spp(&self) -> Vec<u32> {
        chosen(&self.spp, if self.quick { &[1, 4] } else { &[1, 2, 4, 8, 16] })
    }

    pub fn bounces(&self) -> Vec<u32> {
        chosen(&self.bounces, &[2, 6])
    }

    fn iterations(&self) -> Vec<u32> {
        chosen(&self.iterations, if self.quick { &[5] } else { &[3, 5] })
    }

    pub fn denoisers(&self) -> Vec<DenoiserChoice> {
        chosen(&self.denoiser, &MEASURED)
    }

    fn foveations(&self) -> Vec<FoveationMode> {
        chosen(&self.foveation, &[FoveationMode::None])
    }

    fn scales(&self) -> Vec<f64> {
        chosen(&self.scale, if self.quick { &[1.0, 0.5] } else { &[1.0, 0.7, 0.5] })
    }

    /// Returns the measured values, by the names of the options' fields.
    pub fn measured(&self) -> [(&'static str, Value); 7] {
        [
            ("spp", json!(self.spp())),
            ("bounces", json!(self.bounces())),
            ("iterations", json!(self.iterations())),
            ("denoiser", json!(self.denoisers().into_iter().map(Denoiser::name_of).collect::<Vec<_>>())),
            ("foveation", json!(self.foveations().iter().map(setup::name).collect::<Vec<_>>())),
            ("scale", json!(self.scales())),
            ("balance", settings::balance(&self.options.balances())),
        ]
    }

    /// Returns the number of compared frames per setting: at least two, because flicker compares consecutive frames.
    fn judged_frames(&self) -> u32 {
        self.repeats.max(2)
    }

    /// Returns the number of warm-up frames, in which the camera approaches along its path. They suffice to fill the
    /// history of denoisers that keep one.
    pub fn warm_up_of(&self, quality: &Quality) -> u32 {
        if quality.denoiser.is_some_and(Denoiser::keeps_history) {
            self.warm_up.max(HISTORY_FRAMES)
        } else {
            self.warm_up
        }
    }

    /// Returns the number of frames of a setting, warm-up included.
    pub fn frames_of(&self, quality: &Quality) -> u32 {
        self.warm_up_of(quality) + self.judged_frames()
    }

    /// Returns the instant of frame `i`, seconds. The camera moves along its path during the warm-up, so that the
    /// history comes from other views than the compared frames. Then it rests.
    pub fn time_s(&self, quality: &Quality, i: u32) -> f64 {
        self.options.time - f64::from(self.warm_up_of(quality).saturating_sub(i)) / FPS
    }

    /// Returns the settings of the grid; the sample count varies fastest. Without a denoiser there is neither foveation
    /// nor a render scale below 1.
    fn settings(&self) -> Vec<Quality> {
        let mut settings = Vec::new();
        for denoiser in self.denoisers() {
            let filters = denoiser.is_some();
            let iterations =
                denoiser.map_or(vec![0], |d| once(self.iterations().into_iter().map(|n| n.min(d.most_iterations()))));
            let foveations = if filters { self.foveations() } else { vec![FoveationMode::None] };
            let scales = if filters { self.scales() } else { vec![1.0] };
            for (&iterations, foveation) in iterations.iter().flat_map(|i| foveations.iter().map(move |f| (i, f))) {
                let (iterations, fovea, polar) = ([iterations; 3], foveation.radii(), foveation.space(self.polar));
                for (bounces, &scale) in self.bounces().iter().flat_map(|b| scales.iter().map(move |s| (*b, s))) {
                    let quality = |spp| Quality { spp, bounces, denoiser, iterations, fovea, polar, scale };
                    settings.extend(self.samples(scale).into_iter().map(quality));
                }
            }
        }
        settings
    }

    /// Returns the sample counts to measure at a render scale. A scale below 1 is a cheaper alternative to the lowest
    /// sample count, so only that count is measured.
    fn samples(&self, scale: f64) -> Vec<u32> {
        let mut spp = self.spp();
        if scale < 1.0 {
            spp = spp.into_iter().min().into_iter().collect();
        }
        spp
    }
}

/// Returns the requested values without duplicates, or the default if none are requested.
fn chosen<T: Copy + PartialEq>(asked: &[T], default: &[T]) -> Vec<T> {
    once(if asked.is_empty() { default } else { asked }.iter().copied())
}

/// Whether command-line options can express this quality.
pub fn is_of_options(quality: &Quality) -> bool {
    let Quality { denoiser, iterations, fovea, scale, .. } = *quality;
    let is_whole = match denoiser {
        Some(_) => iterations != [0; 3],
        None => iterations == [0; 3] && scale == 1.0 && fovea.is_none(),
    };
    is_whole && fovea.is_none_or(|radii| radii == Foveation::RADII)
}

/// Estimates the relative cost of a frame: one unit per sample, and one for everything else.
fn work(quality: &Quality) -> u64 {
    u64::from(quality.spp) + 1
}

/// A grid of settings, with the inputs and devices that they share.
pub struct Grid<'a> {
    args: &'a Args,
    loaded: &'a LoadedScene,
    reference: &'a Reference,
    tracing: &'a Tracing,
    /// Devices of all settings; empty while a setting is being measured.
    gpus: Cell<Devices>,
    warm_up_s: Cell<f64>,
}

impl<'a> Grid<'a> {
    pub fn new(
        args: &'a Args,
        loaded: &'a LoadedScene,
        reference: &'a Reference,
        tracing: &'a Tracing,
        gpus: Devices,
    ) -> Self {
        Self { args, loaded, reference, tracing, gpus: Cell::new(gpus), warm_up_s: Cell::new(0.0) }
    }

    /// Returns the total time that building the renderers took, seconds.
    pub fn warm_up_s(&self) -> f64 {
        self.warm_up_s.get()
    }

    /// Returns a row for each setting of the grid and each one in `judged`. Each measurement is in the journal before
    /// the next one begins.
    pub fn measure(&self, mut journal: Journal, judged: &[Quality]) -> Result<Vec<Row>, Failure> {
        let mut settings = self.args.settings();
        let judged: Vec<_> = judged.iter().filter(|quality| !settings.contains(quality)).copied().collect();
        settings.extend(judged);
        let key = &self.reference.key;
        let missing: Vec<_> = settings.iter().filter(|s| journal.find(key, s).is_none()).copied().collect();
        let mut ahead = Ahead::new(self.args, &missing, settings.len());
        for (number, setting) in missing.iter().enumerate() {
            let measured = self.measure_one(number as u32, setting, &mut ahead)?;
            journal.add(key, setting, &measured)?;
            ahead.row(&measured, setting);
        }
        ahead.progress.finish();
        let row = |s: &Quality| Some(Row::new(*s, journal.find(key, s)?.clone()));
        Ok(settings.iter().filter_map(row).collect())
    }

    /// Measures the times and errors of a setting. `number` is its index among the settings to measure.
    fn measure_one(&self, number: u32, setting: &Quality, ahead: &mut Ahead) -> Result<Measured, Failure> {
        let Self { args, loaded, reference, tracing, .. } = self;
        let (mut renderer, options) = self.renderer(setting)?;
        record_devices(&tracing.recorder, renderer.devices());
        let mut judge = Judge::new(loaded, reference, options.time);
        let warm_up = args.warm_up_of(setting);
        for i in 0..args.frames_of(setting) {
            let frame = self.frame(&mut renderer, setting, i)?;
            ahead.frame(setting, frame.makespan_ms);
            if i >= warm_up {
                // Frame numbers in the trace are unique across settings.
                tracing.record(
                    &options.quality(),
                    None,
                    &FrameReport { index: number * FRAMES_MAX + i, ..frame.clone() },
                );
                let row = FrameRow::new(&frame, &options.quality(), &loaded.shot.rig, options.time);
                judge.add(&frame, &FrameRow { index: i - warm_up, ..row }, &renderer.read_linear()?)?;
            }
        }
        self.gpus.set(renderer.into_devices());
        Ok(judge.conclude())
    }

    fn renderer(&self, setting: &Quality) -> Result<(Renderer, RenderOptions), Failure> {
        let Self { args, loaded, tracing, .. } = self;
        let options = RenderOptions::single(args.options.clone(), setting);
        let begin = Instant::now();
        let renderer = setup::renderer(&options, loaded, self.gpus.take(), tracing.recorder.origin())?;
        self.warm_up_s.set(self.warm_up_s.get() + begin.elapsed().as_secs_f64());
        Ok((renderer, options))
    }

    /// Renders frame `i` of a setting, counted from the start of its warm-up.
    fn frame(&self, renderer: &mut Renderer, setting: &Quality, i: u32) -> Result<FrameReport, Failure> {
        let frame = renderer.render(&renderer.frame(&self.loaded.shot.rig, self.args.time_s(setting, i), i))?;
        refuse_faults(renderer)?;
        interrupt::check()?;
        Ok(frame)
    }

    /// Renders a setting again without tracing it; returns the last frame and its picture.
    pub fn show(&self, setting: &Quality) -> Result<(FrameReport, Stereo<RgbImage>), Failure> {
        let (mut renderer, _) = self.renderer(setting)?;
        let last = self.args.frames_of(setting) - 1;
        for i in 0..last {
            self.frame(&mut renderer, setting, i)?;
        }
        let frame = self.frame(&mut renderer, setting, last)?;
        let image = renderer.read_linear()?;
        self.gpus.set(renderer.into_devices());
        Ok((frame, image))
    }
}

/// Progress over all settings, with an estimate of the remaining time.
struct Ahead {
    progress: Progress,
    begin: Instant,
    settings: usize,
    rows: usize,
    /// Total cost of all frames to measure, in units of [`work`].
    work: u64,
    done: u64,
}

impl Ahead {
    fn new(args: &Args, missing: &[Quality], settings: usize) -> Self {
        let work = missing.iter().map(|s| work(s) * u64::from(args.frames_of(s))).sum();
        let progress = Progress::work(work, args.options.quiet, args.options.json);
        Self { progress, begin: Instant::now(), settings, rows: settings - missing.len(), work, done: 0 }
    }

    fn left_s(&self) -> f64 {
        self.begin.elapsed().as_secs_f64() * (self.work - self.done) as f64 / self.done.max(1) as f64
    }

    fn frame(&mut self, setting: &Quality, makespan_ms: f64) {
        self.done += work(setting);
        let event = serde_json::json!({ "event": "frame", "knobs": setting, "makespan_ms": makespan_ms });
        let Quality { denoiser, iterations: [iterations, ..], bounces, spp, scale, .. } = *setting;
        let denoiser = Denoiser::name_of(denoiser);
        let (number, settings, left_s) = (self.rows + 1, self.settings, self.left_s());
        let what =
            format!("{number} of {settings}: {denoiser} x{iterations}, {bounces} bounces, {spp} spp, scale {scale}");
        self.progress.at(self.done, format!("{what}, {makespan_ms:.1} ms, {left_s:.0} s to go"), Some(&event));
    }

    fn row(&mut self, measured: &Measured, quality: &Quality) {
        self.rows += 1;
        let event = serde_json::json!({
            "event": "setting", "done": self.rows, "of": self.settings, "left_s": self.left_s(), "knobs": quality,
            "time_ms": measured.time_ms,
        });
        self.progress.at(self.done, String::new(), Some(&event));
    }
}
