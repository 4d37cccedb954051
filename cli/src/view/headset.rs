//! `diptych view --xr`: the control loop in a headset. The OpenXR runtime sets the time and the pose of each frame.

mod panel_quad;
mod placement;

use std::sync::Arc;
use std::time::Instant;

use anyhow::anyhow;

use crate::report::headset::{HeadsetRow, HeadsetSummary};
use crate::report::record::FrameRecord;
use crate::report::rectified::RectifiedFrame;
use diptych::control::Budget;
use diptych::exec::PerView;
use diptych::graph::Resource;
use diptych::headset::{Headset, HeadsetError, HeadsetFrame, Next, Picture, Pixels, Runtime, Shown};
use diptych::image::display::{DisplayImage, write_png};
use diptych::image::{Image, stereo};
use diptych::loaded::LoadedScene;
use diptych::passes::tonemap::DISPLAY;
use diptych::passes::{Aov, aov_image};
use diptych::scene::head::Recording;

use super::args::Args;
use super::renderer::frame_status;
use super::shared::Status;
use super::status::ViewStatus;
use crate::failure::Failure;
use crate::play::{Prepared, Session};
use crate::progress::Progress;
use crate::settings::Given;
use crate::setup::{self, Tracing};
use crate::{interrupt, output};
use panel_quad::PanelQuad;
use placement::{Late, Placement};

/// Lower end of the frame budget, as a fraction of the display's period.
const LEAST_SHARE: f64 = 0.55;

pub fn run(args: &Args) -> Result<(), Failure> {
    let typed = |id: &str| Given::here().and_then(|given| given.typed(id));
    let is_given = |key: &&str| args.options.run.settings.is_given(key);
    if let Some(option) = ["motion", "fps"].into_iter().find(is_given) {
        return Err(Failure::Input(anyhow!("{option} cannot be combined with --xr: the headset sets times and poses")));
    }
    // Create the folder first: --record-motion may name a file in it.
    let writes = typed("out").is_some();
    if writes {
        output::prepare(&args.options.run.out, "--out")?;
    }
    let mut prepared = Prepared::new(&args.options, args.frames)?;
    interrupt::watch()?;
    let runtime = Runtime::open()?;
    if !args.options.run.settings.is_given("size") {
        prepared.render.run.settings.size = runtime.recommended;
    }
    let tracing = Tracing::start(&prepared.render)?;
    let progress = Progress::text(prepared.render.quiet, prepared.render.json);
    progress.phase("loading");
    let mut loaded = setup::load(&prepared.render)?;
    setup::tell_remarks(&loaded.scene);
    let mut device = None;
    let gpus = setup::open_devices_with(&prepared.render, usize::from(args.options.virtual_devices), |first| {
        Ok(device.insert(runtime.open_device(first)?).renderer())
    })?;
    let device = device.ok_or_else(|| anyhow!("no device was opened")).map_err(Failure::Run)?;
    let mut headset = Headset::start(runtime, device, prepared.render.settings.size)?;
    progress.phase("waiting for the headset");
    let Some(first) = first_frame(&mut headset)? else { return ended(&headset) };
    if typed("budget_ms").is_none() {
        prepared.options.budget_ms = budget(first.period_ms())?;
    }
    if first.period_ms() > 0.0 {
        prepared.render.fps = 1e3 / first.period_ms();
    }
    if headset.takes_depth() {
        prepared.render.aovs = vec![Aov::Depth];
    }
    let world = Placement::new(&mut loaded, first.eyes, prepared.render.settings.size, args.late_border)?;
    prepared.render.is_late = args.late_border > 0.0;
    tell(&headset, &prepared, first.period_ms(), &progress);
    let mut session = Session::start(&mut prepared, &loaded, gpus, tracing, progress)?;
    if let Some(rectified) = session.renderer.rectified().filter(|_| !prepared.render.quiet && !prepared.render.json) {
        session.progress.tell(&RectifiedFrame::new(rectified, prepared.render.settings.size).to_string());
    }
    headset.begin_anew();
    let late = Late::new(headset.locator());
    session.renderer.set_pose_source(prepared.render.is_late.then(|| late.source()));
    let outputs = [DISPLAY, aov_image(0)];
    session.renderer.set_outputs(if headset.takes_depth() { &outputs } else { &outputs[..1] });
    let motion = prepared.options.recording(world.space, &session.progress)?;
    let record = writes.then(|| session.record(&prepared.render.out)).transpose()?;
    let look = ViewStatus::new(&prepared, &loaded, session.renderer.devices());
    let (status, board) = (Status::default(), None);
    let mut show = Show { session, headset, world, late, motion, record, look, status, board, opens_board: args.panel };
    // Write the results so far, even after an error.
    let shown = show.frames(&prepared);
    let finished = show.finish(args, &prepared, &loaded, first.period_ms());
    shown.and(finished)
}

/// Returns the frame budget for a display period.
fn budget(period_ms: f64) -> Result<Budget, Failure> {
    Budget::new(LEAST_SHARE * period_ms, period_ms)
        .map_err(|_| Failure::Run(anyhow!("the headset does not report its display period: give --budget-ms LO..HI")))
}

/// Waits for the first frame, which describes the eyes, and skips it. Returns `None` if the session ended before.
fn first_frame(headset: &mut Headset) -> Result<Option<Box<HeadsetFrame>>, Failure> {
    loop {
        if interrupt::is_set() {
            headset.ask_to_end()?;
        }
        match headset.next_frame()? {
            Next::Frame(frame) => {
                headset.skip(&frame)?;
                if !interrupt::is_set() {
                    return Ok(Some(frame));
                }
            }
            Next::Idle => {}
            Next::Ended => return Ok(None),
        }
    }
}

fn ended(headset: &Headset) -> Result<(), Failure> {
    if headset.is_lost() {
        return Err(HeadsetError::Lost.into());
    }
    interrupt::check()
}

fn tell(headset: &Headset, prepared: &Prepared, period_ms: f64, progress: &Progress) {
    let options = &prepared.render;
    if options.quiet || options.json {
        return;
    }
    let runtime = headset.runtime();
    let budget = prepared.options.budget_ms;
    progress.tell(&format!(
        "{} ({}): {} for each eye, {} recommended, {}; display period {period_ms:.2} ms, budget {:.1} to {:.1} ms",
        runtime.headset,
        runtime.name,
        options.settings.size,
        runtime.recommended,
        if headset.renders() { "images stay on device 0" } else { "images are copied through the host" },
        budget.lo_ms(),
        budget.hi_ms(),
    ));
}

/// A session in a headset.
struct Show {
    session: Session,
    headset: Headset,
    world: Placement,
    late: Arc<Late>,
    motion: Option<Recording>,
    /// Record of the frames; `None` without --out.
    record: Option<FrameRecord>,
    look: ViewStatus,
    status: Status,
    /// The panel, while it is shown.
    board: Option<PanelQuad>,
    /// True if the panel opens with the next frame.
    opens_board: bool,
}

impl Show {
    /// Renders frames until the session ends.
    fn frames(&mut self, prepared: &Prepared) -> Result<(), Failure> {
        let most = prepared.frames.unwrap_or(u32::MAX);
        let (mut index, mut ending) = (0, None);
        loop {
            let is_over = index == most || interrupt::is_set();
            if is_over {
                // The runtime decides when the session ends.
                ending.get_or_insert_with(interrupt::writing);
                self.headset.ask_to_end()?;
            }
            match self.headset.next_frame()? {
                Next::Ended => return Ok(()),
                Next::Idle => {}
                Next::Frame(frame) if is_over => self.headset.skip(&frame)?,
                Next::Frame(frame) => {
                    self.frame(&frame, index, prepared.render.settings.time)?;
                    index += 1;
                }
            }
        }
    }

    fn frame(&mut self, frame: &HeadsetFrame, index: u32, begin_s: f64) -> Result<(), Failure> {
        let Self { session, headset, world, late, motion, record, look, status, board, opens_board } = self;
        let posed = Instant::now();
        let (rig, time_s) = (world.rig_of(frame)?, begin_s + frame.display_s);
        let decided = session.decide();
        if let Some(gaze) = frame.gaze {
            session.gaze = Some(gaze);
        }
        let late_ms = f64::from(frame.missed) * frame.period_ms();
        late.begin(index, frame, world);
        let (mut row, report) = session.render(decided, late_ms, &rig, time_s, index)?;
        row.miss(frame.missed);
        session.complete(&mut row, &report, decided, None);
        let images = pixels(session, headset, DISPLAY)?;
        let distances = headset.takes_depth().then(|| pixels(session, headset, aov_image(0))).transpose()?;
        // Ask for the latched pose only after readback: if the frame is rendered again during readback, it latches a
        // new pose.
        let answered = late.end();
        let mut frame = *frame;
        let shown_from = report.shown_from.as_ref().map_or(&rig, |pose| &pose.rig);
        let corrected_ms = report.shown_from.as_ref().and(answered).and_then(|sample| frame.show_from(sample));
        let opens = std::mem::take(opens_board);
        if opens != frame.input.toggles_panel {
            *board = if board.is_none() { PanelQuad::open(headset, &frame)? } else { None };
        }
        status.add(frame_status(row.clone(), posed));
        status.rungs = session.ladder().rungs().len();
        let panel = board.as_mut().map(|board| board.panel(headset, look, status)).transpose()?.flatten();
        let picture = Picture { images, distances, metres_per_unit: rig.metres_per_unit, panel };
        let shown = {
            let _span = tracing::info_span!("present").entered();
            headset.show(&frame, &picture)?
        };
        let Shown { ahead_ms, motion_to_photon_ms } = shown;
        let HeadsetFrame { display_s, missed, .. } = frame;
        let period_ms = frame.period_ms();
        row.headset = Some(HeadsetRow { display_s, period_ms, motion_to_photon_ms, corrected_ms, ahead_ms, missed });
        if let Some(ms) = motion_to_photon_ms {
            let series = [("predicted", ms), ("missed periods", frame.missed.into())];
            session.tracing.recorder.counter("motion to photon (ms)", 1e3 * report.begin_ms, &series);
        }
        if let Some(motion) = motion {
            motion.add(time_s, shown_from, time_s, session.gaze(time_s))?;
        }
        if let Some(record) = record {
            record.add(&row)?;
        }
        session.announce(&row, &report);
        Ok(())
    }

    /// Writes the requested files and prints a summary.
    fn finish(self, args: &Args, prepared: &Prepared, loaded: &LoadedScene, period_ms: f64) -> Result<(), Failure> {
        let Self { mut session, headset, motion, record, .. } = self;
        let _writing = interrupt::writing();
        session.progress.finish();
        let options = &prepared.render;
        motion.map_or(Ok(()), Recording::finish)?;
        if let Some(path) = args.screenshot.as_ref().filter(|_| session.renderer.has_frame()) {
            write_png(path, &side_by_side(&session.renderer.read_display()?)?)?;
        }
        if let Some(record) = &record {
            let mut report = session.report(prepared, loaded, record);
            let summary = summary(&headset, period_ms, options.is_late).with(&record.headset);
            if !options.quiet && !options.json {
                say!("{summary}");
            }
            report.headset = Some(summary);
            report.write(&options.out.join("run.json"))?;
            record.finish()?;
        }
        session.tracing.finish()?;
        ended(&headset)
    }
}

/// Returns an output of the newest frame: buffers if it is on the headset's device, else a host copy.
fn pixels(session: &mut Session, headset: &Headset, image: Resource) -> Result<PerView<Pixels>, Failure> {
    if headset.renders()
        && let Some((0, buffers)) = session.renderer.output_buffers(image)?
    {
        return Ok(buffers.map(Pixels::Buffer));
    }
    Ok(session.read(|renderer| renderer.read_output(image))?.map(Pixels::Bytes))
}

fn side_by_side(images: &PerView<Image<[u8; 4]>>) -> Result<DisplayImage, Failure> {
    let [left, right] = images.outer();
    let opaque = |image: &Image<[u8; 4]>| Image {
        extent: image.extent,
        pixels: image.pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
    };
    Ok(stereo::side_by_side(&opaque(left), &opaque(right))?)
}

fn summary(headset: &Headset, period_ms: f64, is_late: bool) -> HeadsetSummary {
    let runtime = headset.runtime();
    HeadsetSummary {
        runtime: runtime.name.clone(),
        headset: runtime.headset.clone(),
        recommended_size: runtime.recommended.to_string(),
        period_ms,
        depth: headset.takes_depth(),
        host_copies: !headset.renders(),
        late_poses: is_late,
        states: headset.states().iter().map(ToString::to_string).collect(),
        ..HeadsetSummary::default()
    }
}
