//! `diptych play`: a sequence inside a frame budget. The control loop sets the quality.

mod args;
mod comparison;
pub(super) mod fitting_size;
mod heartbeat;
mod ladder;
mod misfit;
mod status_lines;
pub mod options;
mod pace;
mod page;
mod path;
mod prepared;
mod references;
mod replay;
mod session;

use crate::report::play::SETTLING_FRAMES;
use crate::report::record::{FrameRecord, SpooledRows};
use crate::report::run::RunReport;
use crate::report::samples::FrameSamples;
use diptych::frame::Disturbance;
use diptych::loaded::LoadedScene;
use diptych::passes::tonemap::{DISPLAY, LINEAR};
use diptych::quality::{Denoiser, SettingError};
use diptych::scene::head::Recording;
use diptych::scene::rig::Rig;

use super::failure::Failure;
use super::options::RenderOptions;
use super::others::Others;
use super::output::{self, FrameImages};
use super::page::and_page;
use super::pictures::Pictures;
use super::progress::Progress;
use super::setup::{self, Tracing};
use super::{interrupt, metering, settings};
pub use args::Args;
use misfit::Misfit;
pub use pace::Pace;
pub use path::CameraPath;
pub use prepared::Prepared;
use references::Kept;
use replay::Replay;
pub use session::Session;

pub fn run(args: &Args) -> Result<(), Failure> {
    let settings = &args.options.run.settings;
    let compares = settings.controller.len() > 1;
    if settings.report_spp.is_some() && !args.report && !compares {
        return Err(Failure::Input(anyhow::anyhow!("report_spp needs --report, or several controllers")));
    }
    let replays = |key: &&str| args.replay.is_some() && settings.is_given(key);
    if let Some(key) = ["fps", "controller"].into_iter().find(replays) {
        return Err(Failure::Input(SettingError::Conflict("--replay", key).into()));
    }
    if !compares {
        return play(args);
    }
    if args.frames as usize <= SETTLING_FRAMES {
        let what = "several controllers need --frames greater than";
        return Err(Failure::Input(anyhow::anyhow!("{what} {SETTLING_FRAMES}, the frames in which they settle")));
    }
    let options = &args.options;
    let alone = [
        ("--report", args.report),
        ("--save-every", args.save_every.is_some()),
        ("--trace", options.run.trace.is_some()),
        ("--record-motion", options.record_motion.is_some()),
    ];
    match alone.into_iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => Err(Failure::Input(SettingError::Conflict(option, "several controllers").into())),
        None => comparison::run(args),
    }
}

fn play(args: &Args) -> Result<(), Failure> {
    let (replay, args) = match &args.replay {
        Some(path) => Replay::read(args, path).map(|(replay, args)| (Some(replay), args))?,
        None => (None, args.clone()),
    };
    let args = &args;
    let mut prepared = Prepared::new(&args.loop_options(), Some(args.frames))?;
    prepared.fits_size = Some(args.fit);
    let options = &prepared.render;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let mut others = Others::begin();
    let tracing = Tracing::start(options)?;
    let progress = Progress::text(options.quiet, options.json);
    progress.phase("loading");
    let mut loaded = setup::load(options)?;
    setup::tell_remarks(&loaded.scene);
    let gpus = setup::open_devices(options, usize::from(args.options.virtual_devices))?;
    let gpus = metering::meter(options, &mut loaded, gpus, &progress)?;
    if let Some(replay) = &replay {
        let settings = settings::in_force(options, loaded.exposure_ev(), &[]);
        replay.check(&settings.options, prepared.choice.qualities.len()).map_err(Failure::Input)?;
    }
    let mut session = Session::start(&mut prepared, &loaded, gpus, tracing, progress)?;
    let options = &prepared.render;
    if let Some(replay) = replay {
        session.set_controller(Box::new(replay));
    }
    if !options.quiet && !options.json {
        let rungs = session.ladder().rungs();
        let times = match rungs {
            [one] => format!("1 rung of {:.1} ms", one.time_ms),
            [first, .., last] => format!("{} rungs of {:.1} to {:.1} ms", rungs.len(), first.time_ms, last.time_ms),
            [] => "no rungs".to_owned(),
        };
        session.progress.tell(&format!(
            "{} at {}, denoiser {}, {times}; ladder: {}; ready after {:.1} s",
            options.shot,
            options.settings.size,
            Denoiser::name_of(prepared.choice.denoiser),
            args.options.ladder_name(session.ladder()),
            session.warm_up_s
        ));
    }
    others.begin_frames().iter().for_each(|warning| session.progress.warn(warning));
    let mut run = Run::new(args, options, &loaded, session)?;
    run.samples = args.report.then(FrameSamples::default);
    let stopped = run.frames()?;
    let (others_share, warning) = others.end();
    warning.iter().for_each(|warning| run.session.progress.warn(warning));
    let writing = interrupt::writing();
    let last = if args.report { run.kept()? } else { None };
    let Run { session, motion, record, samples, pictures, .. } = run;
    motion.map_or(Ok(()), Recording::finish)?;
    session.progress.finish();
    let mut report = session.report(&prepared, &loaded, &record);
    (report.pictures, report.others_share) = (pictures.names(), others_share);
    report.write(&options.out.join("run.json"))?;
    record.finish()?;
    pictures.remove_earlier(options.quiet)?;
    session.ladder().write(&options.out.join("ladder.toml")).map_err(anyhow::Error::from)?;
    session.tracing.finish()?;
    drop((session.inner, writing));
    let samples = samples.filter(|samples| !samples.frames().is_empty());
    if let Some(samples) = &samples {
        page::write(args, options, &mut loaded, &report, samples, last.as_ref())?;
    }
    conclude(samples.is_some(), options, &report, record.play.lacked_rung);
    interrupt::check()?;
    stopped.map_or(Ok(()), |reason| Err(Failure::Run(anyhow::anyhow!(reason))))
}

/// Makespan from which a frame counts as slow, ms. The time to read its images back is short by comparison.
const SLOW_MS: f64 = 200.0;

/// State of a run.
struct Run<'a> {
    args: &'a Args,
    options: &'a RenderOptions,
    loaded: &'a LoadedScene,
    session: Session,
    path: CameraPath,
    motion: Option<Recording>,
    record: FrameRecord,
    /// Frames for the figures of the page; `None` without --report.
    samples: Option<FrameSamples>,
    /// Index and instant (seconds) of the newest frame.
    newest: Option<(u32, f64)>,
    /// Images of the newest frame if it was slow: a signal may come while devices are busy with the next one.
    slow: Option<FrameImages>,
    pictures: Pictures,
    /// Interval of the frames after the settling ones that are kept, and these frames; `None` keeps none.
    watched: Option<(usize, Vec<Kept>)>,
}

impl<'a> Run<'a> {
    fn new(
        args: &'a Args,
        options: &'a RenderOptions,
        loaded: &'a LoadedScene,
        session: Session,
    ) -> Result<Self, Failure> {
        Ok(Self {
            path: CameraPath::new(&loaded.shot.rig),
            motion: args.options.recording(loaded.space, &session.progress)?,
            record: session.record(&options.out)?,
            pictures: Pictures::of_folder(&options.out),
            args,
            options,
            loaded,
            session,
            samples: None,
            newest: None,
            slow: None,
            watched: None,
        })
    }

    /// Returns true if the frame is to be kept.
    fn is_watched(&self, index: u32) -> bool {
        let is_due = |every: usize| (index as usize).checked_sub(SETTLING_FRAMES).is_some_and(|i| i % every == 0);
        self.watched.as_ref().is_some_and(|(every, _)| is_due(*every))
    }

    /// Renders the frames. Returns the reason if the run stopped because nothing fits the budget.
    fn frames(&mut self) -> Result<Option<String>, Failure> {
        let mut pace = Pace::new(self.options.fps);
        let (mut misfit, mut stopped, mut is_slow) = (Misfit::of_run(self.args, self.options), None, false);
        for index in 0..self.options.frames {
            let is_last = index + 1 == self.options.frames || interrupt::is_set();
            let is_watched = self.is_watched(index);
            let is_saved = is_last
                || is_slow
                || is_watched
                || misfit.may_stop_after(index)
                || self.args.save_every.is_some_and(|k| index % k == 0);
            // Only saved frames need linear output; the others are only displayed.
            self.session.renderer.set_outputs(if is_saved { &[DISPLAY, LINEAR] } else { &[DISPLAY] });
            let decided = self.session.decide();
            let cut = Disturbance::SceneCut { frame: index };
            if self.options.settings.disturb.contains(&cut) {
                self.path.cut(self.options.time_s(index));
            }
            let late_ms = pace.wait();
            let (rig, time_s) = (self.rig(index), self.options.time_s(index));
            let rendered = self.session.render(decided, late_ms, &rig, time_s, index);
            let Some((mut row, frame)) = interrupt::as_none(rendered)? else { break };
            let deadline = pace.complete(self.session.tracing.recorder.origin());
            self.session.complete(&mut row, &frame, decided, Some(deadline));
            if let Some(motion) = &mut self.motion {
                motion.add(time_s, &rig, time_s, self.session.gaze(time_s))?;
            }
            if let Some(samples) = &mut self.samples {
                samples.add(&row, frame.tasks_since_begin());
            }
            let row = if self.options.settings.details { row.with_tasks(&frame) } else { row };
            self.record.add(&row)?;
            self.newest = Some((index, time_s));
            is_slow = row.makespan_ms > SLOW_MS;
            self.slow =
                (is_slow && is_saved).then(|| FrameImages::read(&mut self.session.renderer, &[])).transpose()?;
            self.session.announce(&row, &frame);
            if self.args.save_every.is_some_and(|k| index % k == 0) {
                self.save(Some(index))?;
                pace.restart();
            }
            if is_watched {
                let mut kept = self.kept()?;
                self.watched.iter_mut().for_each(|(_, frames)| frames.extend(kept.take()));
                pace.restart();
            }
            if let Some(median_ms) = misfit.add(&row, self.session.budget()) {
                let Session { inner, fit, .. } = &self.session;
                stopped = Some(misfit::reason(self.options, inner.budget(), fit.as_ref(), median_ms));
            }
            if is_last || stopped.is_some() {
                break;
            }
        }
        self.save(None)?;
        Ok(stopped)
    }

    /// Returns the camera of a frame.
    fn rig(&self, index: u32) -> Rig {
        self.path.rig(self.options.time_s(index))
    }

    /// Reads the newest frame back; `None` before the first one.
    fn kept(&mut self) -> Result<Option<Kept>, Failure> {
        let Some((index, time_s)) = self.newest else { return Ok(None) };
        let read = self.session.renderer.read_linear().map_err(Failure::from);
        let linear = interrupt::as_none(read)?.or_else(|| self.slow.as_ref().map(|images| images.linear.clone()));
        Ok(linear.map(|linear| Kept { index, linear, rig: self.rig(index), time_s }))
    }

    /// Writes the pictures of the newest frame, if there is one.
    fn save(&mut self, number: Option<u32>) -> Result<(), Failure> {
        let Some((index, time_s)) = self.newest else { return Ok(()) };
        let exposure_ev = self.loaded.shot.exposure_ev;
        let tags = output::tags(&self.rig(index), exposure_ev, self.options.settings.size, time_s, index);
        let images = interrupt::as_none(FrameImages::read(&mut self.session.renderer, &[]))?;
        let Some(images) = images.as_ref().or(self.slow.as_ref()) else { return Ok(()) };
        let _writing = interrupt::writing();
        self.pictures.add(images.write(&self.options.out, number, &[], None, &tags)?);
        Ok(())
    }
}

/// Prints how well frames kept the budget, and the output folder.
fn conclude(has_page: bool, options: &RenderOptions, report: &RunReport<&SpooledRows>, lacked_rung: bool) {
    let out = options.out.display();
    if options.json {
        say!("{}", serde_json::json!({ "event": "result", "out": out.to_string(), "play": report.play }));
        return;
    }
    if options.quiet {
        return;
    }
    if let Some(play) = &report.play {
        say!("{}", play.rungs_table().text().trim_end());
        say!("{play}");
        if lacked_rung {
            say!("for some frames no rung was expected to fit the budget: they used the cheapest rung");
        }
    }
    report.rectified.iter().for_each(|rectified| say!("{rectified}"));
    let picture = if report.pictures.is_empty() { "" } else { "the last picture, " };
    say!("{}{picture}run.json, frames.csv and ladder.toml: {out}", and_page(has_page));
    options.say_trace();
}
