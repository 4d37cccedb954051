//! The grid: compares each setting with the reference, and times all of them in turns, unless the journal has the
//! results.

use std::cell::Cell;
use std::ops::Range;
use std::time::Instant;

use crate::report::bench::{ERROR, Measured, SettingRow, Timed};
use crate::report::frames::FrameLine;
use crate::report::run::FrameRow;
use diptych::exec::ranks::Devices;
use diptych::exec::{FrameReport, PerView, Renderer};
use diptych::image::RgbImage;
use diptych::loaded::LoadedScene;
use diptych::quality::{Denoiser, Quality};
use diptych::trace::frames::record_devices;

use super::args::Args;
use super::axes::{FRAMES_MAX, order};
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

    /// Measures what the journal lacks, and returns a row for each setting of the grid and of `judged`, the rungs of
    /// --ladder. Each comparison, and each turn, is in the journal before the next one begins. An incomplete turn is not,
    /// since load may change until it is resumed.
    pub fn measure(&self, mut journal: Journal, judged: &[Quality]) -> Result<Vec<SettingRow>, Failure> {
        let mut settings = self.args.settings();
        let judged: Vec<_> = judged.iter().filter(|quality| !settings.contains(quality)).copied().collect();
        settings.extend(judged);
        let key = &self.reference.key;
        let is_missing = |s: &Quality| journal.find(key, s).is_none();
        let numbered = (0..).zip(settings.iter().copied());
        let missing: Vec<(u32, Quality)> = numbered.filter(|(_, s)| is_missing(s)).collect();
        let first = settings.first().map_or(0, |s| journal.turns(&settings, s).count());
        let turns = first..self.args.turns as usize;
        let mut ahead = GridProgress::new(self.args, &missing, &settings, turns.clone());
        for (number, setting) in &missing {
            let measured = self.compare(*number, setting, &mut ahead)?;
            journal.add(key, setting, &measured)?;
            ahead.compared(&measured, setting);
        }
        for turn in turns {
            let mut frames = Vec::new();
            for i in order(settings.len(), turn) {
                frames.push((settings[i], self.time(i as u32, &settings[i], turn as u32, &mut ahead)?));
            }
            journal.add_turn(frames)?;
            ahead.turned(turn);
        }
        ahead.progress.finish();
        let row = |s: &Quality| {
            let turns: Vec<Timed> = journal.turns(&settings, s).cloned().collect();
            Some(SettingRow::new(*s, journal.find(key, s)?.clone().timed(&turns)))
        };
        Ok(settings.iter().filter_map(row).collect())
    }

    /// Compares frames of a setting, the one with this number in the grid, with the reference.
    fn compare(&self, number: u32, setting: &Quality, ahead: &mut GridProgress) -> Result<Measured, Failure> {
        let Self { args, loaded, reference, .. } = self;
        let (mut renderer, options) = self.renderer(setting)?;
        let mut judge = Judge::new(loaded, reference, options.settings.time);
        let warm_up = args.warm_up_of(setting);
        for i in 0..args.frames_of(setting) {
            let frame = self.frame(&mut renderer, args.time_s(setting, i), i)?;
            ahead.frame(setting, frame.makespan_ms);
            if i >= warm_up {
                let row = self.record(number, &options, &frame, i, i - warm_up);
                judge.add(&frame, &row, &renderer.read_linear()?)?;
            }
        }
        self.gpus.set(renderer.into_devices());
        Ok(judge.conclude())
    }

    /// Times a frame of a setting in a turn. The renderers of all settings may not fit into memory together, so each is
    /// built again; the devices keep its pipelines.
    fn time(&self, number: u32, setting: &Quality, turn: u32, ahead: &mut GridProgress) -> Result<Timed, Failure> {
        let (mut renderer, options) = self.renderer(setting)?;
        let last = self.args.warm_up_of_turn(setting);
        for i in 0..last {
            let frame = self.frame(&mut renderer, options.settings.time, i)?;
            ahead.frame(setting, frame.makespan_ms);
        }
        let frame = self.frame(&mut renderer, options.settings.time, last)?;
        ahead.frame(setting, frame.makespan_ms);
        self.gpus.set(renderer.into_devices());
        let row = self.record(number, &options, &frame, FRAMES_MAX / 2 + turn, turn);
        Ok(Timed::new(&frame, FrameLine::from(&row)))
    }

    /// Records a frame of a setting in the trace as the setting's frame number `place`, which makes numbers unique across
    /// settings. Returns its row, whose index is `index`.
    fn record(&self, number: u32, options: &RenderOptions, frame: &FrameReport, place: u32, index: u32) -> FrameRow {
        let shown = FrameReport { index: number * FRAMES_MAX + place, ..frame.clone() };
        self.tracing.record(&options.quality(), None, &shown);
        FrameRow { index, ..FrameRow::new(frame, &options.quality(), &self.loaded.shot.rig, options.settings.time) }
    }

    fn renderer(&self, setting: &Quality) -> Result<(Renderer, RenderOptions), Failure> {
        let Self { args, loaded, tracing, .. } = self;
        let options = RenderOptions::new(args.options.clone(), Settings::default().limit(setting));
        let begin = Instant::now();
        let renderer = setup::renderer(&options, loaded, self.gpus.take(), tracing.recorder.origin())?;
        self.warm_up_s.set(self.warm_up_s.get() + begin.elapsed().as_secs_f64());
        record_devices(&tracing.recorder, renderer.devices());
        Ok((renderer, options))
    }

    /// Renders frame `i`, counted from the start of the warm-up, at an instant.
    fn frame(&self, renderer: &mut Renderer, time_s: f64, i: u32) -> Result<FrameReport, Failure> {
        let frame = renderer.render(&renderer.frame(&self.loaded.shot.rig, time_s, i))?;
        refuse_faults(renderer)?;
        interrupt::check()?;
        Ok(frame)
    }

    /// Renders the frames of a setting again without recording them in the trace. Returns the report and the linear
    /// image of the last frame.
    pub fn show(&self, setting: &Quality) -> Result<(FrameReport, PerView<RgbImage>), Failure> {
        let (mut renderer, _) = self.renderer(setting)?;
        let last = self.args.frames_of(setting) - 1;
        for i in 0..last {
            self.frame(&mut renderer, self.args.time_s(setting, i), i)?;
        }
        let frame = self.frame(&mut renderer, self.args.time_s(setting, last), last)?;
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
    compared: usize,
    turns: u32,
    /// Number of complete turns.
    turned: usize,
    /// Total cost of all frames to measure, in units of [`work`].
    work: u64,
    done: u64,
}

impl GridProgress {
    fn new(args: &Args, missing: &[(u32, Quality)], settings: &[Quality], turns: Range<usize>) -> Self {
        let compared: u64 = missing.iter().map(|(_, s)| work(s) * u64::from(args.frames_of(s))).sum();
        let turn: u64 = settings.iter().map(|s| work(s) * u64::from(args.warm_up_of_turn(s) + 1)).sum();
        let work = compared + turns.len() as u64 * turn;
        let progress = Progress::work(work, args.options.quiet, args.options.json);
        let (settings, compared) = (settings.len(), settings.len() - missing.len());
        let (begin, turned) = (Instant::now(), turns.start);
        Self { progress, begin, settings, compared, turns: args.turns, turned, work, done: 0 }
    }

    fn left_s(&self) -> f64 {
        self.begin.elapsed().as_secs_f64() * (self.work - self.done) as f64 / self.done.max(1) as f64
    }

    fn frame(&mut self, setting: &Quality, makespan_ms: f64) {
        self.done += work(setting);
        let event = serde_json::json!({ "event": "frame", "knobs": setting, "makespan_ms": makespan_ms });
        let Quality { bounces, spp, scale, .. } = *setting;
        let (denoiser, [iterations, ..]) = (Denoiser::name_of(setting.denoiser()), setting.iterations());
        let number = if self.compared < self.settings {
            format!("comparing {} of {}", self.compared + 1, self.settings)
        } else {
            format!("turn {} of {}", self.turned + 1, self.turns)
        };
        let what = format!("{number}: {denoiser} x{iterations}, {bounces} bounces, {spp} spp, scale {scale}");
        let left_s = self.left_s();
        self.progress.at(self.done, format!("{what}, {makespan_ms:.1} ms, {left_s:.0} s to go"), Some(&event));
    }

    fn compared(&mut self, measured: &Measured, quality: &Quality) {
        self.compared += 1;
        let event = serde_json::json!({
            "event": "setting", "done": self.compared, "of": self.settings, "left_s": self.left_s(), "knobs": quality,
            "error": measured.error(ERROR),
        });
        self.progress.at(self.done, String::new(), Some(&event));
    }

    fn turned(&mut self, turn: usize) {
        self.turned = turn + 1;
        let event = serde_json::json!({ "event": "turn", "done": turn + 1, "of": self.turns, "left_s": self.left_s() });
        self.progress.at(self.done, String::new(), Some(&event));
    }
}
