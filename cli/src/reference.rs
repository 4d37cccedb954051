//! References: unbiased images, accumulated in passes that a later run can resume.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::report::run::{ReferenceRow, aov_ms};
use diptych::accumulation::{Accumulation, Checkpoint, Done, Fingerprint, Job, Subject, accumulate};
use diptych::device::Traversal;
use diptych::exec::{FrameReport, PerView, Renderer};
use diptych::frame::settings::FoveationMode;
use diptych::image::display::{DisplayImage, tonemap, write_png};
use diptych::image::stereo;
use diptych::loaded::LoadedScene;
use diptych::quality::Quality;
use diptych::samples::Samples;
use diptych::scene::shot::Shot;

use super::failure::Failure;
use super::interrupt::INTERRUPTED;
use super::options::{RenderFlags, RenderOptions};
use super::output;
use super::preview::Preview;
use super::progress::Progress;
use super::setup::{self, Tracing};

/// Default samples per pixel of a pass: few enough that even a slow device soon ends a pass, after which it can stop,
/// and enough that readback after each pass takes a fast device little time.
pub const PASS_SPP: u32 = 8;

/// Default samples per pixel of a reference.
const SPP: u32 = 256;

/// Most samples per pixel, by default, of a reference with a wanted noise.
const NOISE_SPP: u32 = 1 << 20;

/// Settings that a reference overrides, and the reasons, which follow the words "a reference".
pub const OVERRULED: [(&str, &str); 9] = [
    ("clamp", "is unbiased"),
    ("denoiser", "is not filtered"),
    ("iterations", "is not filtered"),
    ("foveation", "samples every pixel alike"),
    ("gaze", "samples every pixel alike"),
    ("polar", "samples every pixel alike"),
    ("render_scale", "samples every pixel"),
    ("reproject", "traces both eyes"),
    ("frames_in_flight", "is made in passes, one after another"),
];

/// Settings of the accumulation, the same for every frame.
pub struct Plan {
    /// Options of a pass: its sample count, and no denoiser, reprojection or clamp.
    pub options: RenderOptions,
    /// Requested samples per pixel.
    pub spp: u32,
    time_limit: Option<Duration>,
    /// Folder of the checkpoints, if they are kept.
    folder: Option<PathBuf>,
    /// File of the picture so far, if it is wanted.
    pub preview: Option<Preview>,
    /// Ray traversal that the selected devices use.
    pub traversal: Traversal,
}

impl Plan {
    /// Plans the reference that flags ask for, of [`SPP`] samples per pixel by default.
    ///
    /// # Errors
    /// The errors of [`Plan::new`], and [`Failure::Input`] if the command line sets an option in [`OVERRULED`] to a value that
    /// a reference cannot have.
    pub fn asked_for(flags: &RenderFlags) -> Result<Self, Failure> {
        let mut flags = flags.clone();
        let settings = &mut flags.run.settings;
        let wrong = |what: String| Err(Failure::Input(anyhow::anyhow!(what)));
        for (key, why) in OVERRULED {
            let agrees = match key {
                "denoiser" => settings.denoiser.is_none(),
                "foveation" => settings.foveation == FoveationMode::None,
                "render_scale" => settings.render_scale == 1.0,
                "reproject" => !settings.reproject,
                "frames_in_flight" => settings.frames_in_flight == 1,
                "clamp" => settings.clamp == 0.0,
                _ => false,
            };
            if settings.is_given(key) && !agrees {
                return wrong(format!(
                    "{key} conflicts with --reference, since a reference {why}: leave one of them out"
                ));
            }
        }
        let spp = match settings.noise {
            _ if settings.is_given("spp") => settings.spp,
            Some(_) => NOISE_SPP.into(),
            None => SPP.into(),
        };
        if spp.varies() {
            return wrong(format!("--reference takes a whole number of samples, not --spp {spp}"));
        }
        // Passes have other numbers of samples, within the limit of a frame.
        (settings.spp, settings.denoiser, settings.foveation) = (Samples::ONE, None, FoveationMode::None);
        (settings.render_scale, settings.reproject) = (1.0, false);
        let time_limit = settings.time_limit();
        let (folder, pass_spp) = (settings.passes_out.clone(), settings.pass_spp);
        let plan = Self::new(flags.options().map_err(Failure::Input)?, spp.least, pass_spp, time_limit)?;
        Ok(Self { folder, ..plan })
    }

    /// Plans a reference with `spp` samples per pixel, `pass_spp` of them in each pass. `options` may have any quality;
    /// only their bounces count.
    ///
    /// # Errors
    /// [`Failure::Input`] for options that a reference cannot have, and for devices that do not exist.
    pub fn new(
        mut options: RenderOptions,
        spp: u32,
        pass_spp: u32,
        time_limit: Option<Duration>,
    ) -> Result<Self, Failure> {
        let bounces = options.quality().bounces;
        let quality = Quality { spp: pass_spp.into(), bounces, filter: None, ..Quality::default() };
        (options.envelope, options.gaze) = (quality.into(), None);
        let settings = &mut options.run.settings;
        (settings.reproject, settings.clamp) = (false, 0.0);
        let traversal = setup::traversal(&options)?;
        Ok(Self { options, spp, time_limit, folder: None, preview: None, traversal })
    }

    /// Keeps checkpoints in a subfolder of `folder`, named by the fingerprint; returns the subfolder.
    pub fn keep_below(&mut self, folder: &Path, loaded: &LoadedScene) -> PathBuf {
        let folder = folder.join(self.fingerprint(loaded, 0).key());
        self.folder = Some(folder.clone());
        folder
    }

    /// Returns the fingerprint of the inputs that a frame's samples depend on.
    pub fn fingerprint(&self, loaded: &LoadedScene, frame: u32) -> Fingerprint {
        let options = &self.options;
        Fingerprint::of(&Subject {
            scene: &loaded.at(self.options.time_s(frame)),
            rig: &loaded.shot.rig,
            time_s: self.options.time_s(frame),
            extent: options.settings.size,
            seed: options.settings.seed,
            frame,
            sampler: options.settings.sampler,
            bounces: options.quality().bounces,
            pass_spp: options.quality().spp.least,
            traversal: self.traversal,
        })
    }

    fn checkpoint(&self, loaded: &LoadedScene, frame: u32) -> Option<Checkpoint> {
        let folder = self.folder.as_ref()?;
        let name = match self.options.frames {
            1 => "reference.state".to_owned(),
            _ => format!("reference.{frame:04}.state"),
        };
        let fingerprint = self.fingerprint(loaded, frame);
        let (extent, views) = (self.options.settings.size, loaded.shot.rig.views);
        Some(Checkpoint { path: folder.join(name), fingerprint, extent, views })
    }

    /// Creates the folder of the checkpoints, which `option` names. Fails before anything is rendered if a checkpoint
    /// in it cannot be resumed.
    pub fn prepare(&self, loaded: &LoadedScene, option: &str) -> Result<(), Failure> {
        self.folder.as_ref().map_or(Ok(()), |folder| output::prepare(folder, option))?;
        (0..self.options.frames).try_for_each(|i| self.begun(loaded, i).map(drop))
    }

    /// Loads a frame's checkpoint, or begins an empty accumulation.
    pub fn begun(&self, loaded: &LoadedScene, frame: u32) -> Result<Accumulation, Failure> {
        let there = self.checkpoint(loaded, frame).map_or(Ok(None), |c| c.load())?;
        Ok(there.unwrap_or_else(|| Accumulation::new(self.options.settings.size, loaded.shot.rig.views)))
    }

    /// Accumulates passes of a frame on top of `begun` until the requested samples are reached, the time is up or the
    /// run is interrupted.
    pub fn accumulate(
        &self,
        renderer: &mut Renderer,
        loaded: &LoadedScene,
        frame: u32,
        begun: Accumulation,
        tracing: &Tracing,
    ) -> Result<Accumulated, Failure> {
        let checkpoint = self.checkpoint(loaded, frame);
        let resumed_spp = begun.samples();
        let bar = Progress::samples(u64::from(self.spp), self.options.quiet, self.options.json);
        bar.at(u64::from(resumed_spp.min(self.spp)), String::new(), None);
        let mut progress = PassProgress { bar: &bar, spp: self.spp, said: None };
        let job = Job {
            rig: &loaded.shot.rig,
            time_s: self.options.time_s(frame),
            frame,
            pass_spp: self.options.quality().spp.least,
            spp: self.spp,
            time_limit: self.time_limit,
            checkpoint: checkpoint.as_ref(),
            stop: &INTERRUPTED,
            progress: &|samples, fraction| bar.part_of(u64::from(samples), fraction, "reference"),
        };
        let (mut report, mut number, mut kept) = (None, 0, Ok(()));
        let done = accumulate(renderer, &job, begun, |pass| {
            // The trace numbers passes consecutively.
            tracing.record(&self.options.quality(), None, &FrameReport { index: number, ..pass.report.clone() });
            number += 1;
            fold(&mut report, pass.report);
            progress.pass(pass.accumulation.samples(), pass.elapsed_s, pass.left_s);
            if let Some(checkpoint) = checkpoint.as_ref().filter(|_| pass.saved && kept.is_ok()) {
                kept = write_preview(checkpoint, pass.accumulation, &loaded.shot);
            }
            if let Some(preview) = self.preview.as_ref().filter(|_| kept.is_ok()) {
                kept = preview.show(|| Ok(display(pass.accumulation, &loaded.shot)));
            }
        })?;
        bar.finish();
        kept?;
        Ok(Accumulated { row: self.row(frame, resumed_spp, &done), accumulation: done.accumulation, report })
    }

    /// Returns the entry of a frame in run.json. `resumed_spp` of its samples are from earlier runs.
    pub fn row(&self, frame: u32, resumed_spp: u32, done: &Done) -> ReferenceRow {
        ReferenceRow {
            index: frame,
            spp: done.accumulation.samples(),
            spp_wanted: self.spp,
            spp_resumed: resumed_spp,
            pass_spp: self.options.quality().spp.least,
            passes: done.passes,
            elapsed_s: done.elapsed_s,
            out_of_time: done.out_of_time,
            nonfinite_samples: done.accumulation.dropped(),
            noise: done.accumulation.noise(),
        }
    }
}

/// The accumulated samples of a frame.
pub struct Accumulated {
    pub accumulation: Accumulation,
    pub row: ReferenceRow,
    /// Report on this run's passes: times and counts are summed over the passes, stages are those of the last pass.
    /// `None` if the run rendered no pass.
    pub report: Option<FrameReport>,
}

fn fold(total: &mut Option<FrameReport>, mut pass: FrameReport) {
    // An interval between frames has no meaning for a sum of passes.
    pass.interval_ms = None;
    if let Some(before) = total {
        // The sum excludes the time of auxiliary images. Subtract it here for earlier passes; the report subtracts it
        // for the last pass, whose tasks it keeps.
        let aov_ms = aov_ms(&before.tasks);
        pass.makespan_ms += before.makespan_ms - aov_ms;
        pass.predicted_ms = pass.predicted_ms.zip(before.predicted_ms).map(|(a, b)| a + b - aov_ms);
        pass.plan_ms += before.plan_ms;
        for (tally, b) in pass.tallies.iter_mut().zip(&before.tallies) {
            *tally = *tally + *b;
        }
    }
    *total = Some(pass);
}

/// Returns the mean of the samples, tonemapped in the same way as on the devices.
pub fn display(accumulation: &Accumulation, shot: &Shot) -> PerView<DisplayImage> {
    let mean = accumulation.mean();
    mean.iter().map(|image| tonemap(image, shot.exposure_ev, shot.tone)).collect()
}

fn write_preview(checkpoint: &Checkpoint, accumulation: &Accumulation, shot: &Shot) -> Result<(), Failure> {
    let shown = display(accumulation, shot);
    let path = checkpoint.path.with_extension("preview.png");
    Ok(write_png(&path, &stereo::outer(shown.values())?)?)
}

/// Progress over passes, with at most two JSON lines per second.
struct PassProgress<'a> {
    bar: &'a Progress,
    spp: u32,
    said: Option<Instant>,
}

impl PassProgress<'_> {
    fn pass(&mut self, samples: u32, elapsed_s: f64, left_s: f64) {
        let due = left_s == 0.0 || self.said.is_none_or(|at| at.elapsed() > Duration::from_millis(500));
        let event = due.then(|| {
            self.said = Some(Instant::now());
            serde_json::json!({
                "event": "pass", "spp": samples, "spp_wanted": self.spp, "elapsed_s": elapsed_s, "left_s": left_s,
            })
        });
        self.bar.at(u64::from(samples), format!("{elapsed_s:.0} s, {left_s:.0} s to go"), event.as_ref());
    }
}
