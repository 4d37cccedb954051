//! `diptych play`: a sequence inside a frame budget. The control loop is on.

mod disturb;
mod ladder;
mod page;
mod path;

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use diptych::control::{Budget, Controller, Decision, Knobs, Ladder, Makespan, Origin};
use diptych::exec::{FrameReport, Quality, Renderer};
use diptych::report::play::{ControlRow, Play, PlaySummary};
use diptych::report::run::{FrameRow, Quality as QualityRow, RunReport};
use diptych::trace::frames::{ControlKnobs, FrameKnobs, record_devices};

use super::failure::Failure;
use super::faults::FaultLog;
use super::foveation::{FoveationOptions, Iterations};
use super::interrupt;
use super::options::{Denoiser, RenderOptions, RunOptions};
use super::output::{self, FrameImages};
use super::page::and_page;
use super::progress::Progress;
use super::setup::{self, Loaded, Tracing};
use disturb::{Disturbance, Disturbances};
use ladder::{Calibration, Choice, qualities};
use page::Last;
use path::CameraPath;

#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    #[command(flatten)]
    options: RunOptions,
    /// Virtual devices on each chosen adapter
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    virtual_devices: u16,
    /// What a frame's makespan is kept within, milliseconds
    #[arg(long, default_value = "11..20", value_name = "LO..HI")]
    budget_ms: Budget,
    /// A quality ladder that `diptych bench` measured [default: a built-in one, its order guessed, its times measured at
    /// the start]
    #[arg(long, value_name = "FILE")]
    ladder: Option<PathBuf>,
    /// Of all frames [default: svgf; with --ladder the one that most rungs have]
    #[arg(long)]
    denoiser: Option<Denoiser>,
    #[command(flatten)]
    foveated: FoveationOptions,
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// Frames per second, of the clock and of the camera path, which is walked to its end and back again [default: as
    /// many as the upper end of the budget allows]
    #[arg(long)]
    fps: Option<f64>,
    /// Also write every Kth frame. Only the last one is written otherwise, as files take longer than frames; the clock
    /// stands still meanwhile
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..))]
    save_every: Option<u32>,
    /// Disturb the run: slow:devI@FROM..TO runs a device's work twice in these frames, scene-cut@FRAME makes the camera
    /// jump
    #[arg(long, value_name = "WHAT@WHEN")]
    disturb: Vec<Disturbance>,
    /// Also write report.html: the last picture beside a reference, frame times, rungs, and swimlanes of each frame
    #[arg(long)]
    report: bool,
    /// With --report: samples per pixel of the reference [default: what 10 seconds allow]
    #[arg(long, value_name = "N", requires = "report", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    report_spp: Option<u32>,
}

impl Args {
    fn fps(&self) -> f64 {
        self.fps.unwrap_or(1e3 / self.budget_ms.hi_ms())
    }

    fn layers(&self) -> Layers {
        let most = self.foveated.layer_iterations();
        Layers { foveal: most, all: self.foveated.iterations.is_some().then(|| most.into_iter().fold(0, u32::max)) }
    }

    /// Options with the most that any frame has.
    fn render_options(&self, choice: &Choice) -> RenderOptions {
        let most = choice.most(|k| k.iterations);
        let iterations = Iterations::All(self.layers().all.map_or(most, |limit| limit.min(most)));
        RenderOptions {
            run: self.options.clone(),
            spp: choice.most(|k| k.spp),
            scale: choice.least_scale(),
            bounces: choice.most(|k| k.bounces),
            denoiser: choice.denoiser,
            foveated: FoveationOptions { iterations: Some(iterations), ..self.foveated.clone() },
            frames: self.frames,
            fps: self.fps(),
            frames_in_flight: 1,
            aov: Vec::new(),
        }
    }

    /// What clap cannot see.
    fn check(&self, choice: &Choice, options: &RenderOptions) -> Result<(), Failure> {
        self.foveated.check().map_err(Failure::Input)?;
        if choice.denoiser != Denoiser::None && options.iterations() == 0 {
            return Err(Failure::Input(anyhow::anyhow!("--iterations 0 filters nothing: choose --denoiser none")));
        }
        options.check().map_err(Failure::Input)
    }
}

/// The most iterations of any frame.
pub struct Layers {
    /// Of frames with foveal layers, by layer.
    foveal: [u32; 3],
    /// Of all, where there is a limit.
    all: Option<u32>,
}

impl Layers {
    /// Of a rung.
    fn of(&self, knobs: &Knobs) -> [u32; 3] {
        match (knobs.fovea, self.all) {
            (Some(_), _) => self.foveal.map(|most| most.min(knobs.iterations)),
            (None, most) => [most.map_or(knobs.iterations, |most| most.min(knobs.iterations)); 3],
        }
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let choice = Choice::new(args)?;
    let options = args.render_options(&choice);
    args.check(&choice, &options)?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(&options)?;
    let progress = Progress::new(u64::from(options.frames), options.quiet, options.json);
    progress.phase("loading");
    let loaded = setup::load(&options)?;
    for warning in &loaded.scene.warnings {
        eprintln!("warning: {warning}");
    }
    let gpus = setup::open_devices(&options, usize::from(args.virtual_devices))?;
    Disturbances(&args.disturb).check(args.frames, gpus.len())?;
    progress.phase("warming up");
    let mut renderer = setup::varying_renderer(&options, &loaded, gpus, tracing.recorder.origin(), choice.mixes_spp())?;
    record_devices(&tracing.recorder, renderer.devices());
    let ladder = find_ladder(args, &choice, &loaded, &mut renderer, &progress)?;
    let play = Play {
        budget_ms: [args.budget_ms.lo_ms(), args.budget_ms.hi_ms()],
        ladder: ladder_name(args),
        rungs: ladder.rungs().len(),
        fps: options.fps,
    };
    let mut run = Run::new(args, &options, &loaded, renderer, &ladder, &tracing, progress);
    run.frames()?;
    run.progress.finish();
    let last = if args.report { Last::of(&mut run)? } else { None };
    let Run { renderer, rows, .. } = run;
    let settings = setup::run_settings(&options, renderer.policy_name());
    let devices = renderer.devices();
    let mut report = RunReport::new(settings, devices, &loaded.scene, loaded.needs, !options.no_skip, rows);
    report.faults = renderer.faults().to_vec();
    report.play = PlaySummary::of(&play, &report.frames);
    report.write(&options.out.join("run.json"))?;
    ladder.write(&options.out.join("ladder.toml")).map_err(anyhow::Error::from)?;
    tracing.finish()?;
    drop(renderer);
    if let Some(last) = &last {
        page::write(args, &options, &loaded, &report, last)?;
    }
    conclude(args, &options, &report);
    interrupt::check()
}

fn ladder_name(args: &Args) -> String {
    match &args.ladder {
        Some(path) => path.display().to_string(),
        None => "built in: times measured at the start, order of quality guessed".to_owned(),
    }
}

fn find_ladder(
    args: &Args,
    choice: &Choice,
    loaded: &Loaded,
    renderer: &mut Renderer,
    progress: &Progress,
) -> Result<Ladder, Failure> {
    if let Some(ladder) = &choice.ladder {
        return Ok(ladder.clone());
    }
    progress.phase("timing settings");
    let origin = Origin {
        shot: args.options.shot.clone(),
        size: args.options.size.to_string(),
        devices: Vec::new(),
        version: concat!(env!("CARGO_PKG_VERSION"), "; flip and relmse are guessed, not measured").to_owned(),
    };
    let ladder = Calibration::new(renderer, &loaded.shot.rig, args.options.time, &args.layers()).ladder(choice, origin);
    // The first frame is not to find what was timed.
    renderer.begin_anew();
    ladder
}

/// A run in the making.
struct Run<'a> {
    args: &'a Args,
    options: &'a RenderOptions,
    loaded: &'a Loaded,
    renderer: Renderer,
    qualities: Vec<Quality>,
    controller: Controller,
    tracing: &'a Tracing,
    progress: Progress,
    path: CameraPath,
    rows: Vec<FrameRow>,
    faults: FaultLog,
    /// Devices that were taken out.
    lost: usize,
}

impl<'a> Run<'a> {
    fn new(
        args: &'a Args,
        options: &'a RenderOptions,
        loaded: &'a Loaded,
        renderer: Renderer,
        ladder: &Ladder,
        tracing: &'a Tracing,
        progress: Progress,
    ) -> Self {
        Self {
            args,
            options,
            loaded,
            lost: renderer.faults().len(),
            renderer,
            qualities: qualities(ladder, &args.layers()),
            controller: Controller::new(ladder, args.budget_ms),
            tracing,
            progress,
            path: CameraPath::new(&loaded.shot.rig),
            rows: Vec::new(),
            faults: FaultLog::default(),
        }
    }

    fn frames(&mut self) -> Result<(), Failure> {
        let mut pace = Pace::new(self.options.fps);
        for index in 0..self.options.frames {
            if interrupt::is_set() {
                break;
            }
            let (decision, decide_ms) = self.decide();
            let quality = self.qualities[decision.rung].clone();
            let time_s = self.disturb(index);
            let late_ms = pace.wait();
            self.renderer.set_quality(quality)?;
            let frame = self.renderer.render(&self.loaded.shot.rig, time_s, index)?;
            self.take_in(&frame, &decision, late_ms, decide_ms);
            if self.args.save_every.is_some_and(|k| index % k == 0) {
                self.save(Some(index))?;
                pace.restart();
            }
        }
        if self.rows.is_empty() { Ok(()) } else { self.save(None) }
    }

    /// The rung of the next frame, and how long it took to choose it, ms.
    fn decide(&mut self) -> (Decision, f64) {
        let begin = Instant::now();
        let Self { renderer, qualities, controller, .. } = self;
        let foresight = RefCell::new((renderer.foresight(), HashMap::new()));
        let predict = |rung: usize| -> f64 {
            let (foresight, known) = &mut *foresight.borrow_mut();
            *known.entry(rung).or_insert_with(|| foresight.makespan_ms(&qualities[rung]).unwrap_or(f64::NAN))
        };
        let decision = controller.next(&predict);
        (decision, begin.elapsed().as_secs_f64() * 1e3)
    }

    /// Makes happen what is to happen in a frame; returns when on the camera's path it is.
    fn disturb(&mut self, index: u32) -> f64 {
        let disturbances = Disturbances(&self.args.disturb);
        let elapsed_s = self.options.time + f64::from(index) / self.options.fps;
        if disturbances.cuts_before(index) {
            self.path.cut(elapsed_s);
        }
        if !self.args.disturb.is_empty() {
            let base = &self.options.faults.slowdown;
            let devices = self.renderer.devices().len();
            let base = if let [all] = base[..] { vec![all; devices] } else { base.clone() };
            self.renderer.set_slowdown(disturbances.slowdown(index, &base, devices));
        }
        self.path.time_s(elapsed_s)
    }

    /// Tells the controller, the trace and whoever listens.
    fn take_in(&mut self, frame: &FrameReport, decision: &Decision, late_ms: f64, decide_ms: f64) {
        let Decision { rung, expected_ms, fits } = *decision;
        self.controller.observe(rung, Makespan::Ms(frame.makespan_ms));
        let lost = self.renderer.faults().len();
        if std::mem::replace(&mut self.lost, lost) != lost {
            self.controller.devices_changed();
        }
        let budget_ms = [self.args.budget_ms.lo_ms(), self.args.budget_ms.hi_ms()];
        let in_band = (budget_ms[0]..=budget_ms[1]).contains(&frame.makespan_ms);
        let quality = &self.qualities[rung];
        let (spp, bounces, iterations, scale) = (quality.spp, quality.bounces, quality.iterations(), quality.scale);
        let control = Some(ControlKnobs { rung, budget_ms });
        self.tracing.record_with(&FrameKnobs { spp, iterations, control }, frame);
        let quality = QualityRow { spp, bounces, iterations, scale };
        let mut row = FrameRow::new(frame, &quality, self.options.size);
        row.control = Some(ControlRow { rung, expected_ms, fits, in_band, late_ms, decide_ms });
        let event = serde_json::json!({
            "event": "frame", "index": row.index, "rung": rung, "spp": spp, "bounces": bounces,
            "iterations": iterations, "scale": scale, "predicted_ms": row.predicted_ms, "expected_ms": expected_ms, "fits": fits,
            "makespan_ms": row.makespan_ms, "in_band": in_band, "late_ms": late_ms,
        });
        let message =
            format!("{:.1} ms, {spp} spp, {bounces} bounces, {iterations} iterations, scale {scale}", row.makespan_ms);
        self.progress.step(message, &event);
        self.rows.push(row);
        self.faults.say_new(&self.renderer, self.tracing, &self.progress);
    }

    fn save(&mut self, number: Option<u32>) -> Result<(), Failure> {
        FrameImages::read(&mut self.renderer, &[])?.write(&self.options.out, number, false)
    }
}

/// When frames are due. One that is late moves all that follow.
struct Pace {
    period: Duration,
    due: Instant,
}

impl Pace {
    fn new(fps: f64) -> Self {
        // More than a day is as good as for ever.
        let period = Duration::from_secs_f64((1.0 / fps).min(1e5));
        Self { period, due: Instant::now() }
    }

    /// Waits until the next frame is due; returns how late it is, ms.
    fn wait(&mut self) -> f64 {
        std::thread::sleep(self.due.saturating_duration_since(Instant::now()));
        let now = Instant::now();
        let late = now - self.due;
        self.due = self.due.max(now - late.min(SLACK)) + self.period;
        late.as_secs_f64() * 1e3
    }

    /// The next frame is due now.
    fn restart(&mut self) {
        self.due = Instant::now();
    }
}

/// Lateness that sleeping may cause; it is made up for.
const SLACK: Duration = Duration::from_millis(1);

/// Says how the budget was kept, and where things are.
fn conclude(args: &Args, options: &RenderOptions, report: &RunReport) {
    let out = options.out.display();
    if options.json {
        say!("{}", serde_json::json!({ "event": "result", "out": out.to_string(), "play": report.play }));
        return;
    }
    if options.quiet {
        return;
    }
    if let Some(play) = &report.play {
        say!("ladder: {}, {} rungs", play.ladder, play.rungs);
        say!("{}", play.rungs_table().text().trim_end());
        say!("{play}");
        if report.frames.iter().filter_map(|f| f.control.as_ref()).any(|c| !c.fits) {
            say!("at times no rung was expected to fit the budget: the cheapest was held");
        }
    }
    say!("{}the last picture, run.json and ladder.toml: {out}", and_page(args.report));
    if let Some(trace) = &options.trace {
        say!("trace: {} (open it in https://ui.perfetto.dev)", trace.display());
    }
}
