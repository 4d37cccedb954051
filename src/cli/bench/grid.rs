//! The grid: each setting rendered, timed and compared, but those that the journal has.

use std::cell::Cell;
use std::time::Instant;

use anyhow::Context;
use serde_json::{Value, json};

use diptych::control::Knobs;
use diptych::device::GpuDevice;
use diptych::exec::{FrameReport, Renderer, Stereo};
use diptych::image::RgbImage;
use diptych::metrics::Pair;
use diptych::metrics::rings::Viewing;
use diptych::metrics::temporal::Change;
use diptych::quality::Denoiser;
use diptych::report::bench::{Measured, Repeat, Row, SeenErrors};
use diptych::report::frames::FrameLine;
use diptych::report::once;
use diptych::report::run::FrameRow;
use diptych::scene::shot::Shot;
use diptych::stages::Foveation;
use diptych::trace::frames::record_devices;

use super::Args;
use super::journal::Journal;
use super::reference::{Reference, single};
use crate::cli::failure::Failure;
use crate::cli::faults::refuse_faults;
use crate::cli::foveation::{FoveationMode, FoveationOptions};
use crate::cli::interrupt;
use crate::cli::options::{DenoiserChoice, RenderOptions};
use crate::cli::progress::Progress;
use crate::cli::setup::{self, Loaded, Tracing};

/// Frames per second of the camera on its way to the instant that is compared, and how many of them at least history takes.
const FPS: f64 = 72.0;
const HISTORY_FRAMES: u32 = 15;

/// More than the frames of a setting can be.
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

    fn denoisers(&self) -> Vec<DenoiserChoice> {
        chosen(&self.denoiser, &Denoiser::CHOICES)
    }

    fn foveations(&self) -> Vec<FoveationMode> {
        chosen(&self.foveation, &[FoveationMode::None])
    }

    fn scales(&self) -> Vec<f64> {
        chosen(&self.scale, if self.quick { &[1.0, 0.5] } else { &[1.0, 0.7, 0.5] })
    }

    /// What is measured, by the names of the options' fields.
    pub fn measured(&self) -> [(&'static str, Value); 6] {
        [
            ("spp", json!(self.spp())),
            ("bounces", json!(self.bounces())),
            ("iterations", json!(self.iterations())),
            ("denoiser", json!(self.denoisers().into_iter().map(Denoiser::name_of).collect::<Vec<_>>())),
            ("foveation", json!(self.foveations().iter().map(setup::name).collect::<Vec<_>>())),
            ("scale", json!(self.scales())),
        ]
    }

    /// Frames of a setting that are compared: flicker is between two.
    fn judged_frames(&self) -> u32 {
        self.repeats.max(2)
    }

    /// The settings of the grid, samples changing fastest. Pixels are only left out where something filters.
    fn settings(&self) -> Vec<Setting> {
        let mut settings = Vec::new();
        for denoiser in self.denoisers() {
            let filters = denoiser.is_some();
            let iterations = if filters { self.iterations() } else { vec![0] };
            let foveations = if filters { self.foveations() } else { vec![FoveationMode::None] };
            let scales = if filters { self.scales() } else { vec![1.0] };
            for (iterations, &foveation) in iterations.iter().flat_map(|i| foveations.iter().map(move |f| (*i, f))) {
                for (bounces, &scale) in self.bounces().iter().flat_map(|b| scales.iter().map(move |s| (*b, s))) {
                    let samples = self.samples(scale).into_iter();
                    settings.extend(samples.map(|spp| Setting {
                        denoiser,
                        iterations,
                        foveation,
                        bounces,
                        scale,
                        spp,
                    }));
                }
            }
        }
        settings
    }

    /// Samples per pixel that a render scale is measured with: below 1 it stands for fewer than the fewest.
    fn samples(&self, scale: f64) -> Vec<u32> {
        let mut spp = self.spp();
        if scale < 1.0 {
            spp = spp.into_iter().min().into_iter().collect();
        }
        spp
    }
}

/// What is asked for, each once, or else the default.
fn chosen<T: Copy + PartialEq>(asked: &[T], default: &[T]) -> Vec<T> {
    once(if asked.is_empty() { default } else { asked }.iter().copied())
}

#[derive(Clone, Copy)]
pub struct Setting {
    denoiser: DenoiserChoice,
    iterations: u32,
    foveation: FoveationMode,
    bounces: u32,
    scale: f64,
    spp: u32,
}

impl Setting {
    /// With these knobs; none where no options stand for them.
    pub fn of(knobs: &Knobs) -> Option<Self> {
        let Knobs { spp, bounces, denoiser, iterations, scale, .. } = *knobs;
        let foveation = if knobs.fovea.is_some() { FoveationMode::Layers } else { FoveationMode::None };
        let setting = Self { denoiser, iterations, foveation, bounces, scale, spp };
        let filters = denoiser.is_some();
        let is_whole = (iterations > 0) == filters && (filters || (scale == 1.0 && knobs.fovea.is_none()));
        (is_whole && setting.knobs() == *knobs).then_some(setting)
    }

    fn knobs(&self) -> Knobs {
        let Self { denoiser, iterations, foveation, bounces, scale, spp } = *self;
        let fovea = (foveation == FoveationMode::Layers).then_some(Foveation::RADII);
        Knobs { spp, bounces, denoiser, iterations, fovea, scale }
    }

    fn foveated(&self) -> FoveationOptions {
        match self.foveation {
            FoveationMode::None => FoveationOptions::none(self.iterations),
            FoveationMode::Layers => FoveationOptions::layers(self.iterations),
        }
    }

    /// Frames of the camera's way before those that are measured: enough for a history to grow old, where there is one.
    fn warm_up(&self, args: &Args) -> u32 {
        if self.denoiser == Some(Denoiser::Svgf) { args.warm_up.max(HISTORY_FRAMES) } else { args.warm_up }
    }

    /// All its frames.
    fn frames(&self, args: &Args) -> u32 {
        self.warm_up(args) + args.judged_frames()
    }

    /// How long its frames take, about, in any unit.
    fn total_work(&self, args: &Args) -> u64 {
        self.work() * u64::from(self.frames(args))
    }

    /// About how long a frame takes, in any unit: as samples, and once for all else.
    fn work(&self) -> u64 {
        u64::from(self.spp) + 1
    }
}

/// What all settings have in common.
pub struct Grid<'a> {
    args: &'a Args,
    loaded: &'a Loaded,
    reference: &'a Reference,
    tracing: &'a Tracing,
    /// Those of all settings, but while one is measured.
    gpus: Cell<Vec<GpuDevice>>,
    warm_up_s: Cell<f64>,
}

impl<'a> Grid<'a> {
    pub fn new(
        args: &'a Args,
        loaded: &'a Loaded,
        reference: &'a Reference,
        tracing: &'a Tracing,
        gpus: Vec<GpuDevice>,
    ) -> Self {
        Self { args, loaded, reference, tracing, gpus: Cell::new(gpus), warm_up_s: Cell::new(0.0) }
    }

    /// How long settings took, in all, until their first frames could begin.
    pub fn warm_up_s(&self) -> f64 {
        self.warm_up_s.get()
    }

    /// A row per setting of the grid, and of these others. What is measured is in the journal before the next setting is
    /// begun.
    pub fn measure(&self, mut journal: Journal, judged: &[Knobs]) -> Result<Vec<Row>, Failure> {
        let mut settings = self.args.settings();
        let judged = judged.iter().filter(|k| settings.iter().all(|s| s.knobs() != **k)).filter_map(Setting::of);
        settings.extend(judged.collect::<Vec<_>>());
        let key = &self.reference.key;
        let missing: Vec<_> = settings.iter().filter(|s| journal.find(key, &s.knobs()).is_none()).copied().collect();
        let mut ahead = Ahead::new(self.args, &missing, settings.len());
        for (number, setting) in missing.iter().enumerate() {
            let measured = self.measure_one(number as u32, setting, &mut ahead)?;
            journal.add(key, &setting.knobs(), &measured)?;
            ahead.row(&measured, &setting.knobs());
        }
        ahead.progress.finish();
        let row = |s: &Setting| Some(Row::new(s.knobs(), journal.find(key, &s.knobs())?.clone()));
        Ok(settings.iter().filter_map(row).collect())
    }

    /// Times and errors of a setting, the `number`th.
    fn measure_one(&self, number: u32, setting: &Setting, ahead: &mut Ahead) -> Result<Measured, Failure> {
        let Self { args, loaded, reference, tracing, .. } = self;
        let (mut renderer, options) = self.renderer(setting)?;
        record_devices(&tracing.recorder, renderer.devices());
        let Shot { gaze, rig, exposure_ev, .. } = &loaded.shot;
        let viewing = Viewing { gaze: gaze.at(options.time), yfov_deg: rig.yfov_rad.to_degrees() };
        let (mut repeats, mut changes) = (Vec::new(), [Change::default(); 2]);
        let mut before: Option<[Pair; 2]> = None;
        let warm_up = setting.warm_up(args);
        for i in 0..setting.frames(args) {
            let frame = self.frame(&mut renderer, setting, i)?;
            ahead.frame(setting, frame.makespan_ms);
            if i >= warm_up {
                // Each setting's frames get numbers of their own in the trace.
                tracing.record(&options, &FrameReport { index: number * FRAMES_MAX + i, ..frame.clone() });
                let image = renderer.read_linear()?;
                let pairs = [
                    Pair::new(&reference.images.left, &image.left, *exposure_ev)?,
                    Pair::new(&reference.images.right, &image.right, *exposure_ev)?,
                ];
                let [left, right] = [&pairs[0], &pairs[1]].map(|pair| SeenErrors::new(pair, &viewing));
                let row = FrameRow::new(&frame, &setup::frame_settings(&options), rig, options.time);
                let line = FrameLine::from(&FrameRow { index: i - warm_up, ..row });
                repeats.push(Repeat::new(&frame, Stereo { left, right }, line));
                for (e, before) in before.iter().flatten().enumerate() {
                    changes[e] = changes[e] + pairs[e].change_at_rest(before)?;
                }
                before = Some(pairs);
            }
        }
        self.gpus.set(renderer.into_devices());
        let [left, right] = changes;
        Ok(Measured::of(&repeats, Stereo { left, right }))
    }

    fn renderer(&self, setting: &Setting) -> Result<(Renderer, RenderOptions), Failure> {
        let Self { args, loaded, tracing, .. } = self;
        let Setting { denoiser, bounces, scale, spp, .. } = *setting;
        let foveated = setting.foveated();
        let options = RenderOptions { spp, bounces, scale, foveated, ..single(args.options.clone(), denoiser) };
        let begin = Instant::now();
        let renderer = setup::renderer(&options, loaded, self.gpus.take(), tracing.recorder.origin())?;
        self.warm_up_s.set(self.warm_up_s.get() + begin.elapsed().as_secs_f64());
        Ok((renderer, options))
    }

    /// The `i`th frame of a setting, its warm-up counted.
    fn frame(&self, renderer: &mut Renderer, setting: &Setting, i: u32) -> Result<FrameReport, Failure> {
        let Self { args, loaded, .. } = self;
        // The camera comes along its path, so that history is of other frames than the ones that are compared, and rests
        // when it is there.
        let ahead_s = f64::from(setting.warm_up(args).saturating_sub(i)) / FPS;
        let frame = renderer.render(&loaded.shot.rig, args.options.time - ahead_s, i)?;
        refuse_faults(renderer)?;
        interrupt::check()?;
        Ok(frame)
    }

    /// The last of a setting's frames, which is in no trace, and its picture.
    pub fn show(&self, knobs: &Knobs) -> Result<(FrameReport, Stereo<RgbImage>), Failure> {
        let setting = &Setting::of(knobs).context("the front has a setting of no grid")?;
        let (mut renderer, _) = self.renderer(setting)?;
        let last = setting.frames(self.args) - 1;
        for i in 0..last {
            self.frame(&mut renderer, setting, i)?;
        }
        let frame = self.frame(&mut renderer, setting, last)?;
        let image = renderer.read_linear()?;
        self.gpus.set(renderer.into_devices());
        Ok((frame, image))
    }
}

/// How far the settings are, and how long the rest will take.
struct Ahead {
    progress: Progress,
    begin: Instant,
    settings: usize,
    rows: usize,
    /// Of [`Setting::work`].
    work: u64,
    done: u64,
}

impl Ahead {
    fn new(args: &Args, missing: &[Setting], settings: usize) -> Self {
        let work = missing.iter().map(|s| s.total_work(args)).sum();
        let progress = Progress::work(work, args.options.quiet, args.options.json);
        Self { progress, begin: Instant::now(), settings, rows: settings - missing.len(), work, done: 0 }
    }

    fn left_s(&self) -> f64 {
        self.begin.elapsed().as_secs_f64() * (self.work - self.done) as f64 / self.done.max(1) as f64
    }

    fn frame(&mut self, setting: &Setting, makespan_ms: f64) {
        self.done += setting.work();
        let knobs = setting.knobs();
        let event = serde_json::json!({ "event": "frame", "knobs": knobs, "makespan_ms": makespan_ms });
        let Knobs { denoiser, iterations, bounces, spp, scale, .. } = knobs;
        let denoiser = Denoiser::name_of(denoiser);
        let (number, settings, left_s) = (self.rows + 1, self.settings, self.left_s());
        let what =
            format!("{number} of {settings}: {denoiser} x{iterations}, {bounces} bounces, {spp} spp, scale {scale}");
        self.progress.at(self.done, format!("{what}, {makespan_ms:.1} ms, {left_s:.0} s to go"), Some(&event));
    }

    fn row(&mut self, measured: &Measured, knobs: &Knobs) {
        self.rows += 1;
        let event = serde_json::json!({
            "event": "setting", "done": self.rows, "of": self.settings, "left_s": self.left_s(), "knobs": knobs,
            "time_ms": measured.time_ms,
        });
        self.progress.at(self.done, String::new(), Some(&event));
    }
}
