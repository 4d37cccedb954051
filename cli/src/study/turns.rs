//! Renderers that take turns: each renders a frame before any renders the next, so that other load on the machine
//! affects all of them alike.

use std::time::Instant;

use crate::report::run::FrameRow;
use diptych::exec::ranks::Devices;
use diptych::exec::{FrameParams, FrameReport, Renderer};
use diptych::loaded::LoadedScene;
use diptych::quality::Quality;
use diptych::scene::rig::Eye;
use diptych::trace::frames::record_devices;

use crate::bench::axes::{FRAMES_MAX, order};
use crate::failure::Failure;
use crate::faults::refuse_faults;
use crate::interrupt;
use crate::options::RenderOptions;
use crate::progress::Progress;
use crate::setup::{self, Tracing};

pub use crate::bench::axes::{FPS, HISTORY_FRAMES};

pub struct Turns<'a> {
    loaded: &'a LoadedScene,
    progress: &'a Progress,
    tracing: &'a Tracing,
    /// Number of settings that the run has measured before; offsets the frame numbers in the trace.
    first: usize,
    /// Renderers in the order in which they were added.
    pub renderers: Vec<Renderer>,
    /// Name and options of each renderer.
    pub settings: Vec<(String, RenderOptions)>,
    /// Gaze of the left and the right eye in the following frames, as fractions of each eye's image; `None` for the
    /// gaze of the configuration.
    pub gaze: Option<[[f64; 2]; 2]>,
}

impl<'a> Turns<'a> {
    pub fn new(loaded: &'a LoadedScene, progress: &'a Progress, tracing: &'a Tracing, first: usize) -> Self {
        Self { loaded, progress, tracing, first, renderers: Vec::new(), settings: Vec::new(), gaze: None }
    }

    /// Adds a renderer with a name, on devices that no other renderer uses.
    pub fn add(&mut self, name: String, options: RenderOptions, gpus: Devices) -> Result<(), Failure> {
        let Quality { fovea, polar, .. } = options.quality();
        if self.loaded.shot.rig.optics.is_some() && (fovea.is_some() || polar.is_some()) {
            let what = "motion: the experiment needs equal projections for both eyes, but the recording sets its own";
            return Err(Failure::Input(anyhow::anyhow!(what)));
        }
        self.progress.part(0.0, "starting");
        let renderer = setup::renderer(&options, self.loaded, gpus, self.tracing.recorder.origin())?;
        record_devices(&self.tracing.recorder, renderer.devices());
        self.renderers.push(renderer);
        self.settings.push((name, options));
        Ok(())
    }

    /// Renders a frame on each renderer and returns the reports in the order of [`Self::renderers`]. A different
    /// renderer goes first each time.
    pub fn render(&mut self, time_s: f64, index: u32) -> Result<Vec<FrameReport>, Failure> {
        let count = self.renderers.len();
        let mut frames = Vec::new();
        for which in order(count, index as usize) {
            frames.push((which, self.frame_at(which, time_s, index)?));
        }
        frames.sort_by_key(|(which, _)| *which);
        Ok(frames.into_iter().map(|(_, frame)| frame).collect())
    }

    /// Renders a sequence of frames along the path with one renderer, after a warm-up, with as many frames in flight as
    /// its settings allow. Returns the frames after the warm-up, and their total time in seconds.
    pub fn sequence(
        &mut self,
        which: usize,
        from_s: f64,
        round: u32,
        [warm_up, frames]: [u32; 2],
    ) -> Result<(Vec<FrameReport>, f64), Failure> {
        let first = round * (warm_up + frames);
        (0..warm_up).try_for_each(|i| self.frame_at(which, from_s, first + i).map(|_| ()))?;
        let most = self.settings[which].1.settings.frames_in_flight as usize;
        let (mut begun, mut reports, begin) = (0, Vec::new(), Instant::now());
        loop {
            let renderer = &mut self.renderers[which];
            while begun < frames && renderer.in_flight() < most {
                let time_s = from_s + f64::from(begun) / FPS;
                let params = renderer.frame(&self.loaded.shot.rig, time_s, first + warm_up + begun);
                renderer.begin(&params, &[])?;
                begun += 1;
            }
            let Some(report) = renderer.finish()? else { break };
            self.tell(which, report.makespan_ms)?;
            reports.push(report);
        }
        Ok((reports, begin.elapsed().as_secs_f64()))
    }

    fn frame_at(&mut self, which: usize, time_s: f64, index: u32) -> Result<FrameReport, Failure> {
        let renderer = &mut self.renderers[which];
        let params = renderer.frame(&self.loaded.shot.rig, time_s, index);
        let frame = renderer.render(&FrameParams { gaze: self.gaze.unwrap_or(params.gaze), ..params })?;
        self.tell(which, frame.makespan_ms)?;
        Ok(frame)
    }

    /// Tells that a renderer has finished a frame, unless a device failed or the user interrupted the run.
    fn tell(&self, which: usize, makespan_ms: f64) -> Result<(), Failure> {
        refuse_faults(&self.renderers[which])?;
        interrupt::check()?;
        let (name, _) = &self.settings[which];
        let event = serde_json::json!({ "event": "frame", "setting": name, "makespan_ms": makespan_ms });
        self.progress.step(format!("{name}, {makespan_ms:.1} ms"), &event);
        Ok(())
    }

    /// Returns the number of pixels of each eye that renderer `which` path traced in `frame`, divided by the number of
    /// pixels of an eye's screen.
    pub fn paths(&self, which: usize, time_s: f64, frame: &FrameReport) -> [f64; 2] {
        let (options, shot) = (&self.settings[which].1, &self.loaded.shot);
        let traced = frame.traced_pixels();
        let mut paths = [traced[0], traced[1]].map(|pixels| pixels as f64 / options.settings.size.area() as f64);
        let config = self.renderers[which].config();
        if let Some(polar) = config.envelope.most.polar {
            for eye in Eye::BOTH.into_iter().filter(|eye| *eye == Eye::LEFT || !options.settings.reproject) {
                let gaze = config.gaze_at(time_s)[eye.index()];
                paths[eye.index()] = polar.traced_fraction(gaze, &shot.rig.view(time_s, eye), options.settings.size);
            }
        }
        paths
    }

    /// Records a frame of renderer `which` in the trace, under a unique number. Returns its row, whose index is
    /// `number`.
    pub fn keep(&self, which: usize, time_s: f64, frame: &FrameReport, number: u32) -> FrameRow {
        let quality = self.settings[which].1.quality();
        let shown = FrameReport { index: (self.first + which) as u32 * FRAMES_MAX + frame.index, ..frame.clone() };
        self.tracing.record(&quality, None, &shown);
        FrameRow { index: number, ..FrameRow::new(frame, &quality, &self.loaded.shot.rig, time_s) }
    }
}
