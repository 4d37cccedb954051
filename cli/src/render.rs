//! `diptych render`.

mod checks;
mod conclusion;
mod history;
mod noise;
mod references;
mod watched;

use std::time::Instant;

use crate::report::frames::FrameLine;
use crate::report::rectified::RectifiedFrame;
use crate::report::run::{FrameRow, ReferenceRow, RunReport};
use diptych::exec::{FrameReport, PerView, Renderer};
use diptych::image::RgbImage;
use diptych::image::display::mid_grey_ev;
use diptych::loaded::LoadedScene;
use diptych::quality::{Denoiser, Quality};
use diptych::scene::rig::Rig;
use diptych::trace::frames::record_devices;

use super::failure::Failure;
use super::faults::FaultLog;
use super::options::{self, RenderFlags, RenderOptions};
use super::others::Others;
use super::output::{self, Also, FrameImages, SHEET, Sheet};
use super::pictures::Pictures;
use super::preview::Preview;
use super::progress::Progress;
use super::quilt::Quilt;
use super::reference::Plan;
use super::setup::{self, Tracing};
use super::tev::{self, Viewer};
use super::{interrupt, metering, settings};
use conclusion::conclude;
use history::History;

#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    #[command(flatten)]
    pub flags: RenderFlags,
    /// Virtual devices on each adapter
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = options::DEVICES)]
    virtual_devices: u16,
    /// Render an unbiased reference, without denoiser and reprojection
    ///
    /// Samples are accumulated in passes, so their number is not limited. --spp defaults to 256.
    #[arg(long, help_heading = options::QUALITY)]
    reference: bool,
    /// More to write or show, such as sheet,details
    #[arg(long, value_delimiter = ',', value_name = "LIST", help_heading = options::OUTPUT)]
    also: Vec<Also>,
    /// Write the views as tiles of one picture for light-field displays, such as 8x6
    ///
    /// It has this many columns and rows, from the leftmost view at the bottom left to the rightmost one at the top
    /// right. --views defaults to their number.
    #[arg(long, hide_short_help = true, value_name = "COLUMNSxROWS", help_heading = options::OUTPUT)]
    quilt: Option<Quilt>,
    /// Warm-up frames, not saved [default: 0; enough for 16 spp if --frames is 1]
    ///
    /// These frames give the denoiser a history. A single frame with svgf or bmfr and fewer than 16 samples per pixel
    /// follows enough frames of the same instant to give each pixel 16 samples in total. In all other cases the default
    /// is 0.
    #[arg(long, value_name = "N", conflicts_with = "reference", value_parser = clap::value_parser!(u32).range(0..=1000), help_heading = options::SCENE)]
    warm_up: Option<u32>,
}

/// Samples per pixel that a still with history has by default, in all. In a single frame of 16 samples, pixels far from
/// the mean of their neighbours remain as speckle, though its FLIP is lower where noise is high.
const STILL_SPP: u32 = 16;

impl Args {
    pub fn has(&self, what: Also) -> bool {
        self.also.contains(&what)
    }

    /// Returns the number of warm-up frames before the first saved frame.
    fn warm_up_frames(&self, options: &RenderOptions) -> u32 {
        let quality = options.quality();
        let is_still = options.frames == 1 && quality.denoiser().is_some_and(Denoiser::keeps_history);
        let default = if is_still { STILL_SPP.div_ceil(quality.spp.least) - 1 } else { 0 };
        self.warm_up.unwrap_or(default)
    }

    fn progress(&self, options: &RenderOptions) -> Progress {
        let frames = self.warm_up_frames(options) + options.frames;
        Progress::new(frames.into(), options.quiet, options.json)
    }

    /// Returns a frame's entry in run.json.
    fn row(&self, frame: &FrameReport, quality: &Quality, rig: &Rig, time_s: f64) -> FrameRow {
        let row = FrameRow::new(frame, quality, rig, time_s);
        if self.has(Also::Details) { row.with_tasks(frame) } else { row }
    }
}

/// Frames and references of a run, for run.json.
#[derive(Default)]
struct Rows {
    frames: Vec<FrameRow>,
    references: Vec<ReferenceRow>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let args = &args.with_defaults();
    args.check().map_err(Failure::Input)?;
    let flags = &args.flags;
    let mut plan = args.reference.then(|| Plan::asked_for(flags)).transpose()?;
    let options = plan.as_ref().map_or_else(|| flags.options(), |plan| Ok(plan.options.clone()));
    let mut options = options.map_err(Failure::Input)?;
    if args.has(Also::Preview)
        && plan.is_none()
        && options.settings.noise.is_none()
        && args.warm_up_frames(&options) == 0
    {
        let what = "--also preview has no effect without warm-up frames and without --reference";
        return Err(Failure::Input(anyhow::anyhow!(what)));
    }
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let mut others = Others::begin();
    let viewer = args.has(Also::Tev).then(|| Viewer::connect(&tev::address())).transpose()?;
    let tracing = Tracing::start(&options)?;
    let mut progress = args.progress(&options);
    progress.phase("loading");
    let mut loaded = setup::load_rig(&options)?;
    setup::tell_remarks(&loaded.scene);
    args.check_views(&loaded.shot.rig)?;
    if args.has(Also::Overlay) && loaded.shot.rig.optics.is_some() && options.quality().polar.is_some() {
        let what = "--also overlay does not support polar --foveation with the eye projections of head motion: drop \
                    one of them";
        return Err(Failure::Input(anyhow::anyhow!(what)));
    }
    if let Some(warning) =
        setup::beyond_path(&loaded.shot.rig, options.settings.time, options.time_s(options.frames - 1))
    {
        progress.warn(&warning);
    }
    let mut preview = args.has(Also::Preview).then(|| Preview::new(&options.out));
    if let Some(plan) = &mut plan {
        plan.preview = preview.take();
        plan.prepare(&loaded, "passes_out")?;
    }
    let gpus = setup::open_devices(&options, usize::from(args.virtual_devices))?;
    let mut gpus = metering::meter(&options, &mut loaded, gpus, &progress)?;
    if let Some(wanted) = options.settings.noise {
        let most = plan.as_ref().map_or(options.quality().spp.least, |plan| plan.spp);
        let spp;
        (gpus, spp) = noise::samples_for(wanted, most, &options, &loaded, gpus, &progress)?;
        match &mut plan {
            Some(plan) => plan.spp = spp,
            None => options.envelope = Quality { spp: spp.into(), ..options.quality() }.into(),
        }
        progress = args.progress(&options);
    }
    let options = &options;
    // Without a trace, nobody looks at times.
    let tell = |progress: &Progress, warning: Option<String>| {
        warning.iter().filter(|_| options.trace.is_some()).for_each(|warning| progress.warn(warning));
    };
    progress.phase("warming up");
    let warm_up = Instant::now();
    let mut renderer = setup::renderer(options, &loaded, gpus, tracing.recorder.origin())?;
    record_devices(&tracing.recorder, renderer.devices());
    let warm_up_frames = args.warm_up_frames(options);
    let history = History::render(&mut renderer, options, &loaded, warm_up_frames, &progress, preview.as_ref())?;
    let warm_up_s = warm_up.elapsed().as_secs_f64();
    tell(&progress, others.begin_frames());
    let (rows, pictures) = (Rows::default(), Pictures::of_folder(&options.out));
    let mut run = Run {
        args,
        options,
        loaded: &loaded,
        renderer,
        tracing: &tracing,
        progress,
        begun: 0,
        last_ms: history.last_ms(),
        history,
        sheet: Sheet::default(),
        rows,
        pictures,
        viewer,
    };
    let ended = match &plan {
        None => run.frames(),
        Some(plan) => run.references(plan),
    };
    interrupt::as_none(ended)?;
    let _writing = interrupt::writing();
    let (others_share, warning) = others.end();
    tell(&run.progress, warning);
    if plan.is_none() {
        run.keep_history()?;
    }
    run.progress.finish();
    let Run { renderer, rows, mut pictures, history, sheet, .. } = run;
    if rows.frames.is_empty() && rows.references.is_empty() {
        // Only a signal ends a run before its first picture. The files of an earlier run remain.
        interrupt::check()?;
    }
    if args.has(Also::Sheet) {
        sheet.write(&options.out)?;
        pictures.add([SHEET.to_owned()]);
    }
    let devices = renderer.devices();
    let mut settings = settings::in_force(options, loaded.exposure_ev(), devices);
    settings.options.insert("warm_up".to_owned(), warm_up_frames.into());
    if loaded.shot.is_metered {
        settings.options.insert("exposure".to_owned(), "auto".into());
    }
    if let Some(plan) = &plan {
        settings.options.insert("spp".to_owned(), plan.spp.into());
    }
    let mut report =
        RunReport::new(settings, devices, &loaded.scene, loaded.needs, options.settings.skip_unused, rows.frames);
    (report.warm_up_s, report.warm_up_frames) = (warm_up_s, history.frames);
    (report.others_share, report.references) = (others_share, rows.references);
    report.faults = renderer.faults().to_vec();
    report.pictures = pictures.names();
    report.rectified = renderer.rectified().map(|frame| RectifiedFrame::new(frame, options.settings.size));
    FrameLine::csv_of(&report.frames).write(&options.out.join("frames.csv"))?;
    report.write(&options.out.join("run.json"))?;
    pictures.remove_earlier(options.quiet)?;
    tracing.finish()?;
    conclude(options, loaded.shot.rig.views, &report);
    interrupt::check()
}

/// State of a run.
struct Run<'a> {
    args: &'a Args,
    options: &'a RenderOptions,
    loaded: &'a LoadedScene,
    renderer: Renderer,
    tracing: &'a Tracing,
    progress: Progress,
    /// Number of frames submitted to the devices.
    begun: u32,
    /// Makespan of the last frame, ms.
    last_ms: Option<f64>,
    history: History,
    /// Pictures for the contact sheet.
    sheet: Sheet,
    rows: Rows,
    pictures: Pictures,
    viewer: Option<Viewer>,
}

impl Run<'_> {
    fn frames(&mut self) -> Result<(), Failure> {
        let options = self.options;
        let mut faults = FaultLog::default();
        self.begin_frames()?;
        while let Some(frame) = self.next_frame()? {
            self.last_ms = Some(frame.makespan_ms);
            let images = FrameImages::read(&mut self.renderer, &options.aovs)?;
            if self.rows.frames.is_empty() {
                self.warn_of_nothing_seen(&images.linear);
            }
            // With several frames in flight, submit the next ones before writing files. With only one, submit the next
            // frame after writing files, so that file output does not disturb its timing.
            if options.settings.frames_in_flight > 1 {
                self.begin_frames()?;
            }
            self.keep(&frame, images)?;
            faults.say_new(&self.renderer, self.tracing, &self.progress);
            self.begin_frames()?;
        }
        Ok(())
    }

    /// Records a frame and writes its images.
    fn keep(&mut self, frame: &FrameReport, mut images: FrameImages) -> Result<(), Failure> {
        let (options, shot) = (self.options, &self.loaded.shot);
        let time_s = options.time_s(frame.index);
        self.tracing.record(&options.quality(), None, frame);
        if self.args.has(Also::Overlay) {
            let rectified = shot.rig.optics.as_ref().zip(self.renderer.rectified());
            let gaze = self.renderer.config().gaze_at(time_s);
            match self.renderer.config().envelope.most.polar {
                Some(polar) => images.overlay_rings(polar, gaze, &shot.rig, time_s, frame.stripe_edges()),
                None => images.overlay(frame.stripe_edges(), rectified),
            }
            if let Some(foveation) = self.renderer.config().foveation() {
                images.overlay_layers(foveation, gaze, rectified);
            }
        }
        let tags = output::tags(&shot.rig, shot.exposure_ev, options.settings.size, time_s, frame.index);
        images.pixel_centre = frame.pixel_centre;
        let number = (options.frames > 1).then_some(frame.index);
        if let Some(viewer) = &mut self.viewer {
            images.show(viewer, &options.shot)?;
        }
        let _writing = interrupt::writing();
        self.pictures.add(images.write(&options.out, number, &self.args.also, self.args.quilt, &tags)?);
        if self.args.has(Also::Sheet) {
            self.sheet.add(&images);
        }
        let row = self.args.row(frame, &options.quality(), &shot.rig, time_s);
        let event = serde_json::json!({ "event": "frame", "index": row.index, "makespan_ms": row.makespan_ms });
        self.progress.step(format!("{:.1} ms", row.makespan_ms), &event);
        self.rows.frames.push(row);
        Ok(())
    }

    /// Warns about a picture of a single colour, which is usually a mistake. At the default exposure, also warns about
    /// a picture that is nearly black or white.
    fn warn_of_nothing_seen(&self, images: &PerView<RgbImage>) {
        for (eye, image) in images.with_eyes() {
            let first = image.pixels[0];
            if image.pixels.iter().all(|pixel| *pixel == first) {
                let what = if first == [0.0; 3] { "black" } else { "of a single colour" };
                let hint = "the camera may look away from the scene or be inside an object, or there is no light";
                let whose = match images.iter().len() {
                    2 => format!("the {eye} eye's picture"),
                    _ => format!("the picture {}", eye.file_stem()),
                };
                self.progress.warn(&format!("{whose} is {what}: {hint}"));
                return;
            }
        }
        let off_ev = mid_grey_ev(images.left());
        if self.loaded.shot.exposure_ev == 0.0 && !self.loaded.shot.is_metered && off_ev.abs() >= EVS_OFF {
            let what = if off_ev > 0.0 { "dark" } else { "bright" };
            self.progress.warn(&format!("the picture is very {what}: --exposure {off_ev:.0} would show more"));
        }
    }

    /// Submits frames to the devices until the maximum is in flight.
    fn begin_frames(&mut self) -> Result<(), Failure> {
        let options = self.options;
        let most = options.settings.frames_in_flight as usize;
        // If several frames may be in flight, each frame downloads its own images. Otherwise, the images are read from
        // the devices when the frame is finished.
        let reads = if most > 1 { FrameImages::on_devices(&options.aovs) } else { Vec::new() };
        if self.is_watched() {
            return Ok(());
        }
        while self.begun < options.frames && self.renderer.in_flight() < most && !interrupt::is_set() {
            let at_s = options.time_s(self.begun);
            let params = self.renderer.frame(&self.loaded.shot.rig, at_s, self.begun);
            self.renderer.begin(&params, &reads)?;
            self.begun += 1;
        }
        Ok(())
    }
}

/// Deviation from mid-grey, in stops, at which a picture gets a warning.
const EVS_OFF: f64 = 4.0;
