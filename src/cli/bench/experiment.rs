//! Experiments of `diptych study`: several arrangements of options render the
//! same frames alternately, and each is compared with the reference.

use std::path::Path;

use anyhow::{Context, anyhow};

use crate::device::DeviceInfo;
use crate::loaded::LoadedScene;
use crate::quality::Quality;
use crate::report::experiment::{
    Camera, Experiment, ExperimentRow, FOVEA, Found, FrameTimes, OtherMeasures, RINGS, Texts, text_of,
};
use crate::report::frames::FrameLine;
use crate::report::html::Section;
use crate::report::pictures::Group;
use crate::report::rectified::RectifiedFrame;
use crate::report::rings::{self, FrameRings, RingRow, ring_charts, ring_csv, ring_table};
use crate::report::{Csv, Table};
use crate::samples::Samples;
use crate::scene::optics::Optics;
use crate::scene::shot::Gaze;

use super::args::{Args, refuse};
use super::arrangement;
use super::axes::FPS;
use super::findings::{Findings, section};
use super::following::{self, Followed};
use super::instants::{from_end_to_end, on_path};
use super::judge::{Judge, pairs};
use super::late;
use super::moving_gaze::with_moving_gaze;
use super::reference::{Reference, own};
use super::subject::{Subject, subjects};
use super::turns::Turns;
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::options::RenderOptions;
use crate::cli::output;
use crate::cli::page;
use crate::cli::progress::Progress;
use crate::cli::settings::Given;
use crate::cli::setup::{self, Tracing};

/// Returns the options that an experiment does not accept, by the names of their fields.
fn refused(experiment: &Experiment) -> impl Iterator<Item = &'static str> {
    let (has_sizes, has_shots) = (!experiment.resolutions.is_empty(), !experiment.shots.is_empty());
    let (cameras, is_late) = (experiment.cameras(), experiment.cameras() == [Camera::Late]);
    let follows = experiment.cameras() == [Camera::Following];
    [
        ("frames", !follows),
        ("simulate", !follows),
        ("shots", follows),
        ("quick", follows),
        ("reference_spp", follows),
        ("reference_time_limit", follows),
        ("reference_dir", follows),
        ("fresh", true),
        ("size", has_sizes),
        ("size_factor", !has_sizes),
        ("shot", has_shots),
        ("instants", !cameras.iter().any(|camera| camera.visits_instants())),
        ("repeats", is_late || follows),
        ("warm_up", is_late),
    ]
    .into_iter()
    .filter_map(|(id, is_refused)| is_refused.then_some(id))
}

/// Runs the experiment in a file.
pub fn run_file(args: &Args, path: &Path) -> Result<(), Failure> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read the experiment {}", path.display()));
    run_text(args, &text.map_err(Failure::Input)?, &format!("study {}", path.display()))
}

/// Runs an experiment from its TOML text. `origin` is the option that selected it, for error messages.
pub fn run_text(args: &Args, text: &str, origin: &str) -> Result<(), Failure> {
    let experiment = Experiment::parse(text).map_err(|reason| Failure::Input(anyhow!("{origin}: {reason}")))?;
    refuse(origin, &args.options.settings, refused(&experiment))?;
    if experiment.cameras().contains(&Camera::Late) && args.options.motion.is_none() {
        return Err(Failure::Input(anyhow!("{origin} needs a head motion: give it with --motion")));
    }
    // Leaked, because result tables refer to its names until the process ends.
    let experiment: &'static Experiment = Box::leak(Box::new(experiment));
    let is_typed = |id| Given::here().and_then(|given| given.typed(id)).is_some();
    let mut args = args.clone();
    args.warm_up = experiment.frames.warm_up.filter(|_| !is_typed("warm_up")).unwrap_or(args.warm_up);
    args.repeats = experiment.frames.repeats.filter(|_| !is_typed("repeats")).unwrap_or(args.repeats);
    let all = arrangements(&args, experiment).with_context(|| format!("{origin}: wrong options"));
    let all = all.map_err(Failure::Input)?;
    // The reference uses the largest number of bounces of all arrangements.
    args.bounces = all.iter().map(|options| options.quality().bounces).max().into_iter().collect();
    run(&args, experiment, &all)
}

fn run(args: &Args, experiment: &'static Experiment, all: &[RenderOptions]) -> Result<(), Failure> {
    let quality = slowest(args, all);
    let frames_of = |camera: &Camera| match camera {
        Camera::Moving => args.of_study().instants * (args.warm_up_of(&quality) + 1),
        Camera::Stepping => args.of_study().instants * (args.warm_up_of(&quality) + args.repeats),
        Camera::Late => args.of_study().instants * late::FRAMES,
        Camera::Following => args.warm_up + args.of_study().frames,
        _ if experiment.has_any(&FOVEA) => 2 * args.frames_of(&quality),
        _ => args.frames_of(&quality),
    };
    let frames = experiment.cameras().iter().map(frames_of).sum::<u32>();
    let options = &args.options;
    options.check().map_err(Failure::Input)?;
    let subjects = subjects(args, experiment).map_err(Failure::Input)?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(options)?;
    let frames = (subjects.len() * all.len()) as u64 * u64::from(frames);
    let progress = Progress::new(frames, options.quiet, options.json);
    let mut found = Results::new(experiment);
    for subject in &subjects {
        let args = Args { options: subject.options.clone(), ..args.clone() };
        found.measure(&args, subject, &progress, &tracing)?;
    }
    progress.finish();
    tracing.finish()?;
    found.write(args)
}

/// Returns the options of all arrangements.
fn arrangements(args: &Args, experiment: &Experiment) -> Result<Vec<RenderOptions>, anyhow::Error> {
    let follows = experiment.cameras() == [Camera::Following];
    arrangement::of(experiment, &args.options, if follows { args.warm_up + args.of_study().frames } else { 1 })
}

/// Returns the quality that needs the most warm-up frames. All arrangements render that many.
fn slowest(args: &Args, all: &[RenderOptions]) -> Quality {
    let qualities = all.iter().map(RenderOptions::quality);
    qualities.max_by_key(|quality| args.warm_up_of(quality)).unwrap_or_default()
}

struct Results {
    experiment: &'static Experiment,
    rows: Vec<ExperimentRow>,
    rings: Vec<RingRow>,
    /// Timed frames, each with its cells in the columns of [`Experiment::frame_labels`].
    frames: Vec<(Vec<String>, FrameLine)>,
    devices: Vec<DeviceInfo>,
    /// Notes on the references.
    notes: Vec<String>,
    /// Pictures of the last frame of each row, for the page.
    pictures: Vec<Group>,
    /// Further results of [`Camera::Following`].
    followed: Option<Followed>,
}

/// A camera view at an instant, with its reference; `frames` excludes the warm-up.
struct View {
    time_s: f64,
    reference: Reference,
    frames: u32,
}

/// A camera motion, with its measured views and the number of warm-up frames before each view.
struct Shown<'a> {
    subject: &'a Subject,
    camera: Camera,
    warm_up: u32,
    views: Vec<View>,
}

impl Results {
    fn new(experiment: &'static Experiment) -> Self {
        let (rows, rings, frames, devices, notes, pictures, followed) = Default::default();
        Self { experiment, rows, rings, frames, devices, notes, pictures, followed }
    }

    /// Measures all arrangements on a subject, whose options are those of `args`.
    fn measure(
        &mut self,
        args: &Args,
        subject: &Subject,
        progress: &Progress,
        tracing: &Tracing,
    ) -> Result<(), Failure> {
        let (options, experiment) = (&args.options, self.experiment);
        let mut loaded = setup::load(options)?;
        if experiment.gazes_ahead {
            loaded.shot.gaze = Gaze::default();
        }
        if experiment.overscan_deg > 0.0 {
            let (rig, border_deg) = (&mut loaded.shot.rig, experiment.overscan_deg);
            let optics = rig.optics.map(|optics| optics.widened(border_deg));
            rig.optics = Some(optics.unwrap_or_else(|| Optics::with_border(rig, options.settings.size, border_deg)));
        }
        let arranged = arrangements(args, experiment).map_err(Failure::Input)?;
        let quality = slowest(args, &arranged);
        let warm_up = args.warm_up_of(&quality);
        let mut turns = Turns::new(&loaded, progress, tracing, self.rows.len());
        let (mut beside, mut prepared) = (Vec::new(), Vec::new());
        for (arrangement, mut own) in experiment.all.iter().zip(arranged) {
            let mut measures = OtherMeasures::from([("exposure_ev", loaded.exposure_ev())]);
            if own.envelope.most.fovea.is_some() {
                own.envelope.most.fovea = subject.layer_radii.or(own.envelope.most.fovea);
            }
            if arrangement.as_visual_polar {
                measures.extend(arrangement::sample_as_visual_polar(&mut own, &loaded));
            }
            if arrangement.late_frames.is_some() {
                let quality = own.quality();
                let spp = args.reference_spp.map_or(quality.spp, Samples::from);
                (own.is_late, own.envelope) = (true, Quality { spp, ..quality }.into());
            }
            measures.insert("dispatched", arrangement::dispatched(&own, &loaded));
            beside.push(measures);
            prepared.push(own.clone());
            let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
            following::check(args, experiment, gpus.len()).map_err(Failure::Input)?;
            let own = arrangement::distributed(arrangement, own, gpus.len());
            turns.add(format!("{} of {}", arrangement.name, subject.name), own, gpus)?;
        }
        let frame = turns.renderers[0].rectified().map(|frame| RectifiedFrame::new(frame, options.settings.size));
        self.notes.extend(frame.map(|frame| format!("{}: {frame}.", subject.name)));
        self.devices = turns.renderers[0].devices().to_vec();
        let mut texts = subject.texts.clone();
        texts.insert("devices".to_owned(), self.devices.len().into());
        let mut begun = 0;
        for &camera in experiment.cameras() {
            texts.insert("camera".to_owned(), camera.name().into());
            if camera == Camera::Late {
                let found = late::measure(args, experiment, &loaded, &mut turns, beside.clone())?;
                self.keep(&texts, &found);
                continue;
            }
            if camera == Camera::Following {
                let followed = following::measure(args, experiment, &loaded, &mut turns, &prepared, beside.clone())?;
                self.keep(&texts, &followed.found);
                texts.insert("source".to_owned(), "simulated".into());
                for (devices, found) in &followed.simulated {
                    texts.insert("devices".to_owned(), (*devices).into());
                    self.keep(&texts, found);
                }
                self.followed = Some(followed);
                continue;
            }
            let keys = &loaded.shot.rig.keys;
            let (instants, frames) = match camera {
                Camera::Moving => (on_path(keys, args.of_study().instants), 1),
                Camera::Stepping => {
                    (from_end_to_end(keys, options.settings.time, args.of_study().instants), args.repeats)
                }
                _ => (vec![options.settings.time], args.frames_of(&quality) - warm_up),
            };
            let mut views = Vec::new();
            for time_s in instants {
                let mut args = args.clone();
                args.options.settings.time = time_s;
                let reference = own(&args, &loaded, tracing, None)?;
                interrupt::check()?;
                let instant = experiment.cameras.as_ref().map_or(String::new(), |_| format!("{time_s} s: "));
                self.notes.push(instant + &reference.note(&options.shot, options.settings.size));
                views.push(View { time_s, reference, frames });
            }
            if !views.is_empty() {
                let shown = Shown { subject, camera, warm_up, views };
                let found = self.measure_views(args, &loaded, &mut turns, &mut begun, &shown, beside.clone())?;
                self.keep(&texts, &found);
            }
        }
        Ok(())
    }

    /// Adds the results of all arrangements to the rows and the frames.
    fn keep(&mut self, texts: &Texts, found: &[Found]) {
        let experiment = self.experiment;
        for (arrangement, found) in experiment.all.iter().zip(found) {
            let texts = experiment.texts_of(texts, &arrangement.name);
            let labels = experiment.frame_labels().into_iter();
            let cells: Vec<String> = labels.map(|label| text_of(&texts, label).unwrap_or_default()).collect();
            self.frames.extend(found.lines.iter().map(|line| (cells.clone(), line.clone())));
        }
        self.rows.extend(experiment.measured(texts, found));
    }

    /// Measures all arrangements in all views of a camera. `begun` counts the frames that each renderer has begun.
    /// `beside` has each arrangement's measures that do not depend on frames.
    fn measure_views(
        &mut self,
        args: &Args,
        loaded: &LoadedScene,
        turns: &mut Turns,
        begun: &mut u32,
        Shown { subject, camera, warm_up, views }: &Shown,
        mut beside: Vec<OtherMeasures>,
    ) -> Result<Vec<Found>, Failure> {
        let (options, experiment) = (&args.options, self.experiment);
        let total: u32 = views.iter().map(|view| view.frames).sum();
        let seen = experiment.has_any(&RINGS).then(|| rings::viewing(options.settings.size));
        let mut found: Vec<Found> = beside.iter().map(|_| Found::default()).collect();
        let mut rings: Vec<Vec<FrameRings>> = beside.iter().map(|_| Vec::new()).collect();
        let mut number = 0;
        for View { time_s, reference, frames } in views {
            let mut judges: Vec<Judge> = beside.iter().map(|_| Judge::new(loaded, reference, *time_s)).collect();
            for i in 0..warm_up + frames {
                let rests = matches!(camera, Camera::Still | Camera::Stepping);
                let before = if rests { 0 } else { warm_up.saturating_sub(i) };
                let time_s = time_s - f64::from(before) / FPS;
                let reports = turns.render(time_s, *begun)?;
                *begun += 1;
                if i < *warm_up {
                    continue;
                }
                let mut first = None;
                for (which, report) in reports.iter().enumerate() {
                    let row = turns.keep(which, time_s, report, number);
                    let image = turns.renderers[which].read_linear()?;
                    judges[which].add(report, &row, &image)?;
                    found[which].times.push(FrameTimes::measured(report));
                    found[which].lines.push(FrameLine::from(&row));
                    for (name, paths) in
                        ["paths_left", "paths_right"].into_iter().zip(turns.paths(which, time_s, report))
                    {
                        *beside[which].entry(name).or_default() += paths / f64::from(total);
                    }
                    if let (Some(seen), Some(eyes)) = (&seen, judges[which].last()) {
                        let to_first = first.as_ref().map(|first| pairs(loaded, first, &image)).transpose()?;
                        rings[which].push(FrameRings::new(seen, eyes, to_first.as_ref()));
                    }
                    if args.report && number + 1 == total {
                        let name = format!("{} of {}", experiment.all[which].name, subject.name);
                        let of_camera = experiment.cameras.as_ref().map(|_| format!(", {}", camera.name()));
                        let name = name + &of_camera.unwrap_or_default();
                        self.pictures.push(page::against(name, &image, &reference.images, loaded)?);
                    }
                    first.get_or_insert(image);
                }
                number += 1;
            }
            found.iter_mut().zip(judges).for_each(|(found, judge)| found.instants.push(judge.conclude()));
        }
        if experiment.has_any(&FOVEA) && !camera.visits_instants() {
            let count = [*warm_up, warm_up + total];
            let foveae = with_moving_gaze(options, loaded, &views[0].reference, turns, begun, count)?;
            for (beside, fovea) in beside.iter_mut().zip(foveae) {
                beside.extend(FOVEA.into_iter().zip(fovea).filter_map(|(name, value)| Some((name, value?))));
            }
        }
        for (((arrangement, found), mut beside), rings) in experiment.all.iter().zip(&mut found).zip(beside).zip(&rings)
        {
            let rows = rings::over_frames(&options.shot, camera.name(), &arrangement.name, rings);
            beside.extend(RINGS.into_iter().zip(rings::ends(&rows)).filter_map(|(name, ssim)| Some((name, ssim?))));
            self.rings.extend(rows);
            found.others = beside;
        }
        Ok(found)
    }

    fn write(mut self, args: &Args) -> Result<(), Failure> {
        let experiment = self.experiment;
        self.rows.extend(experiment.cited());
        let (lines, frames): (Vec<_>, Vec<_>) = self.frames.into_iter().unzip();
        let columns = experiment.frame_labels().into_iter().map(str::to_owned).collect();
        let file = format!("{}.csv", experiment.name);
        let mut files = vec![
            (&file[..], experiment.csv(&self.rows)),
            ("frames.csv", Csv { columns, lines }.beside(FrameLine::csv(&frames))),
        ];
        let mut more = vec![section("Devices", Vec::new(), Table::of_devices([&self.devices[..]]))];
        if args.report && !self.pictures.is_empty() {
            let note = "The last frame of each arrangement and its FLIP against the reference.";
            more.insert(0, page::pictures(note.to_owned(), &self.pictures)?);
        }
        if experiment.has_any(&RINGS) {
            files.insert(1, ("rings.csv", ring_csv(&self.rings)));
        }
        if experiment.has_any(&RINGS) && args.report {
            let names: Vec<&str> = experiment.all.iter().map(|arrangement| &arrangement.name[..]).collect();
            let mut by_ring = section("By ring", vec![rings::NOTE.to_owned()], ring_table(&self.rings, &names));
            by_ring.figure = Some(ring_charts(&self.rings, &names).context("cannot draw the rings")?);
            more.insert(0, by_ring);
        }
        let sizes = match &experiment.resolutions[..] {
            [] => args.options.settings.size.to_string(),
            of => {
                of.iter().map(|of| of.size(args.of_study().size_factor).to_string()).collect::<Vec<_>>().join(" and ")
            }
        };
        let tables = experiment.tables(&self.rows, self.notes).into_iter();
        let mut tables: Vec<Section> = tables.map(|(heading, notes, table)| section(heading, notes, table)).collect();
        let run = self.followed.map(|Followed { run, figure, more: sections, .. }| {
            tables[0].figure = Some(figure);
            more.splice(..0, sections);
            run
        });
        Findings {
            title: format!("{}, at {sizes}", experiment.title),
            rows: &self.rows.iter().map(|row| experiment.json(row)).collect::<Vec<_>>(),
            files,
            run,
            tables,
            more,
        }
        .write(args)
    }
}
