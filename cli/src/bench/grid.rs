//! The grid: renders, times and compares each setting that the journal lacks.

use std::cell::Cell;
use std::time::Instant;

use crate::report::bench::{Measured, SettingRow};
use crate::report::run::FrameRow;
use diptych::exec::ranks::Devices;
use diptych::exec::{FrameReport, Renderer, Stereo};
use diptych::image::RgbImage;
use diptych::loaded::LoadedScene;
use diptych::quality::{Denoiser, Quality};
use diptych::trace::frames::record_devices;

use super::args::Args;
use super::axes::FRAMES_MAX;
use super::journal::Journal;
use super::judge::Judge;
use super::reference::Reference;
use crate::failure::Failure;
use crate::faults::refuse_faults;
use crate::interrupt;
use crate::options::RenderOptions;
use crate::progress::Progress;
use crate::setup::{self, Tracing};
use diptych::frame::settings::Settings;

/// Estimates the relative cost of a frame: one unit for each sample per pixel, plus one for the rest of the frame.
fn work(quality: &Quality) -> u64 {
    u64::from(quality.spp.least) + 1
}

/// A grid of settings, with the inputs and devices that they share.
pub struct Grid<'a> {
    args: &'a Args,
    loaded: &'a LoadedScene,
    reference: &'a Reference,
    tracing: &'a Tracing,
    /// Devices that all settings use, one after another; empty while the renderer of a setting owns them.
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

    /// Measures the settings that the journal lacks, and returns a row for each setting of the grid and of `judged`,
    /// the rungs of --ladder. Each measurement is in the journal before the next one begins.
    pub fn measure(&self, mut journal: Journal, judged: &[Quality]) -> Result<Vec<SettingRow>, Failure> {
        let mut settings = self.args.settings();
        let judged: Vec<_> = judged.iter().filter(|quality| !settings.contains(quality)).copied().collect();
        settings.extend(judged);
        let key = &self.reference.key;
        let missing: Vec<_> = settings.iter().filter(|s| journal.find(key, s).is_none()).copied().collect();
        let mut ahead = GridProgress::new(self.args, &missing, settings.len());
        for (number, setting) in missing.iter().enumerate() {
            let measured = self.measure_one(number as u32, setting, &mut ahead)?;
            journal.add(key, setting, &measured)?;
            ahead.row(&measured, setting);
        }
        ahead.progress.finish();
        let row = |s: &Quality| Some(SettingRow::new(*s, journal.find(key, s)?.clone()));
        Ok(settings.iter().filter_map(row).collect())
    }

    /// Measures the times and errors of a setting. `number` is its index among the settings to measure.
    fn measure_one(&self, number: u32, setting: &Quality, ahead: &mut GridProgress) -> Result<Measured, Failure> {
        let Self { args, loaded, reference, tracing, .. } = self;
        let (mut renderer, options) = self.renderer(setting)?;
        record_devices(&tracing.recorder, renderer.devices());
        let mut judge = Judge::new(loaded, reference, options.settings.time);
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
                let row = FrameRow::new(&frame, &options.quality(), &loaded.shot.rig, options.settings.time);
                judge.add(&frame, &FrameRow { index: i - warm_up, ..row }, &renderer.read_linear()?)?;
            }
        }
        self.gpus.set(renderer.into_devices());
        Ok(judge.conclude())
    }

    fn renderer(&self, setting: &Quality) -> Result<(Renderer, RenderOptions), Failure> {
        let Self { args, loaded, tracing, .. } = self;
        let options = RenderOptions::new(args.options.clone(), Settings::default().limit(setting));
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

    /// Renders the frames of a setting again without recording them in the trace. Returns the report and the linear
    /// image of the last frame.
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
struct GridProgress {
    progress: Progress,
    begin: Instant,
    settings: usize,
    rows: usize,
    /// Total cost of all frames to measure, in units of [`work`].
    work: u64,
    done: u64,
}

impl GridProgress {
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
        let Quality { bounces, spp, scale, .. } = *setting;
        let (denoiser, [iterations, ..]) = (Denoiser::name_of(setting.denoiser()), setting.iterations());
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
