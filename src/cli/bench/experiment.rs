//! `diptych bench --experiment`, and the presets that such files define: several arrangements of options render the
//! same frames alternately, and each is compared with the reference.

use std::path::Path;

use anyhow::{Context, anyhow};

use crate::device::DeviceInfo;
use crate::loaded::LoadedScene;
use crate::quality::Quality;
use crate::report::experiment::{Camera, Experiment, ExperimentRow, FOVEA, OtherMeasures, RINGS};
use crate::report::frames::FrameLine;
use crate::report::pictures::Group;
use crate::report::rings::{self, FrameRings, RingRow, ring_charts, ring_csv, ring_table};
use crate::report::{Csv, Table};
use crate::scene::rig::RigKey;
use crate::scene::shot::Gaze;

use super::args::Args;
use super::arrangement;
use super::axes::FPS;
use super::findings::{Findings, section};
use super::judge::{Judge, pairs};
use super::moving_gaze::with_moving_gaze;
use super::over_shots::over_shots;
use super::reference::{Reference, own};
use super::turns::Turns;
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::options::{RenderOptions, RunOptions};
use crate::cli::page;
use crate::cli::progress::Progress;
use crate::cli::settings::Given;
use crate::cli::setup::{self, Tracing};

/// Options that experiments defined by a file reject.
pub const REFUSES: &[&str] = &["size_factor", "frames", "simulate", "fresh"];

/// Runs the experiment in a file.
pub fn run_file(args: &Args, path: &Path) -> Result<(), Failure> {
    let text = std::fs::read_to_string(path).with_context(|| format!("--experiment: cannot read {}", path.display()));
    run_text(args, &text.map_err(Failure::Input)?, &format!("--experiment {}", path.display()))
}

/// Runs an experiment from its TOML text. `origin` is the option that selected it, for error messages.
pub fn run_text(args: &Args, text: &str, origin: &str) -> Result<(), Failure> {
    let experiment = Experiment::parse(text).map_err(|reason| Failure::Input(anyhow!("{origin}: {reason}")))?;
    let all = arrangement::of(&experiment, &args.options).with_context(|| format!("{origin}: wrong options"));
    let all = all.map_err(Failure::Input)?;
    let is_typed = |id| Given::here().and_then(|given| given.typed(id)).is_some();
    if is_typed("instants") && !experiment.cameras().contains(&Camera::Moving) {
        let what = anyhow!("{origin} cannot be combined with --instants: leave one of them out");
        return Err(Failure::Input(what));
    }
    // Leaked, because result tables refer to its names until the process ends.
    let experiment: &'static Experiment = Box::leak(Box::new(experiment));
    let mut args = args.clone();
    // The reference uses the largest number of bounces of all arrangements.
    args.bounces = all.iter().map(|options| options.bounces).max().into_iter().collect();
    args.warm_up = experiment.frames.warm_up.filter(|_| !is_typed("warm_up")).unwrap_or(args.warm_up);
    args.repeats = experiment.frames.repeats.filter(|_| !is_typed("repeats")).unwrap_or(args.repeats);
    run(&args, experiment, &all)
}

fn run(args: &Args, experiment: &'static Experiment, all: &[RenderOptions]) -> Result<(), Failure> {
    let quality = slowest(args, all);
    let frames_of = |camera: &Camera| match camera {
        Camera::Moving => args.preset.instants * (args.warm_up_of(&quality) + 1),
        _ if experiment.has_any(&FOVEA) => 2 * args.frames_of(&quality),
        _ => args.frames_of(&quality),
    };
    let frames = experiment.cameras().iter().map(frames_of).sum::<u32>();
    let mut found = Results::new(experiment);
    over_shots(args, u64::from(frames) * all.len() as u64, |args, progress, tracing| {
        found.measure(args, progress, tracing)
    })?;
    found.write(args)
}

/// Returns the quality that needs the most warm-up frames. All arrangements render that many.
fn slowest(args: &Args, all: &[RenderOptions]) -> Quality {
    let qualities = all.iter().map(RenderOptions::quality);
    qualities.max_by_key(|quality| args.warm_up_of(quality)).unwrap_or(arrangement::QUALITY)
}

/// Returns `count` evenly spaced instants along the path, from after its start to its end, so that the camera has moved
/// before each. Empty if the camera is static.
fn on_path(keys: &[RigKey], count: u32) -> Vec<f64> {
    let [first, .., last] = keys else { return Vec::new() };
    let length_s = last.time_s - first.time_s;
    (1..=count).map(|i| first.time_s + length_s * f64::from(i) / f64::from(count)).collect()
}

struct Results {
    experiment: &'static Experiment,
    rows: Vec<ExperimentRow>,
    rings: Vec<RingRow>,
    /// Timed frames, each with the names of its shot, of its camera if there are several, and of its arrangement.
    frames: Vec<(Vec<String>, FrameLine)>,
    devices: Vec<DeviceInfo>,
    /// A note on each reference.
    notes: Vec<String>,
    /// Pictures of the last frame of each row, for the page.
    pictures: Vec<Group>,
}

/// A camera view at an instant, with its reference; `frames` excludes the warm-up.
struct View {
    time_s: f64,
    reference: Reference,
    frames: u32,
}

/// A camera motion, with its measured views and the number of warm-up frames before each view.
struct Shown {
    camera: Camera,
    warm_up: u32,
    views: Vec<View>,
}

impl Results {
    fn new(experiment: &'static Experiment) -> Self {
        let (rows, rings, frames, devices, notes, pictures) = Default::default();
        Self { experiment, rows, rings, frames, devices, notes, pictures }
    }

    /// Measures all arrangements on the shot of `args`.
    fn measure(&mut self, args: &Args, progress: &Progress, tracing: &Tracing) -> Result<(), Failure> {
        let (options, experiment) = (&args.options, self.experiment);
        let mut loaded = setup::load(options)?;
        if experiment.gazes_ahead {
            loaded.shot.gaze = Gaze::default();
        }
        let arranged = arrangement::of(experiment, options).map_err(Failure::Input)?;
        let quality = slowest(args, &arranged);
        let warm_up = args.warm_up_of(&quality);
        let mut turns = Turns::new(&loaded, progress, tracing, self.rows.len());
        let mut beside = Vec::new();
        for (arrangement, mut own) in experiment.all.iter().zip(arranged) {
            let mut measures = OtherMeasures::new();
            if arrangement.as_visual_polar {
                measures = arrangement::sample_as_visual_polar(&mut own, &loaded);
            }
            measures.insert("dispatched", arrangement::dispatched(&own, &loaded));
            beside.push(measures);
            let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
            turns.add(format!("{} of {}", arrangement.name, options.shot), own, gpus)?;
        }
        let mut begun = 0;
        for &camera in experiment.cameras() {
            let is_moving = camera == Camera::Moving;
            let frames = if is_moving { 1 } else { args.frames_of(&quality) - warm_up };
            let keys = &loaded.shot.rig.keys;
            let mut views = Vec::new();
            for time_s in if is_moving { on_path(keys, args.preset.instants) } else { vec![options.time] } {
                let args = Args { options: RunOptions { time: time_s, ..options.clone() }, ..args.clone() };
                let reference = own(&args, &loaded, tracing, None)?;
                interrupt::check()?;
                let instant = experiment.cameras.as_ref().map_or(String::new(), |_| format!("{time_s} s: "));
                self.notes.push(instant + &reference.note(&options.shot, options.size));
                views.push(View { time_s, reference, frames });
            }
            if !views.is_empty() {
                let shown = Shown { camera, warm_up, views };
                self.measure_views(args, &loaded, &mut turns, &mut begun, &shown, beside.clone())?;
            }
        }
        self.devices = turns.renderers[0].devices().to_vec();
        Ok(())
    }

    /// Measures all arrangements in all views of a camera. `begun` counts the frames that each renderer has begun.
    /// `beside` has each arrangement's measures that do not depend on frames.
    fn measure_views(
        &mut self,
        args: &Args,
        loaded: &LoadedScene,
        turns: &mut Turns,
        begun: &mut u32,
        Shown { camera, warm_up, views }: &Shown,
        mut beside: Vec<OtherMeasures>,
    ) -> Result<(), Failure> {
        let (options, experiment) = (&args.options, self.experiment);
        let total: u32 = views.iter().map(|view| view.frames).sum();
        let seen = experiment.has_any(&RINGS).then(|| rings::viewing(options.size));
        let judge = |_: &OtherMeasures| Judge::new(loaded, &views[0].reference, options.time);
        let mut judges: Vec<Judge> = beside.iter().map(judge).collect();
        let mut rings: Vec<Vec<FrameRings>> = beside.iter().map(|_| Vec::new()).collect();
        let mut number = 0;
        for View { time_s, reference, frames } in views {
            judges.iter_mut().for_each(|judge| judge.turn_to(reference));
            for i in 0..warm_up + frames {
                let before = if *camera == Camera::Still { 0 } else { warm_up.saturating_sub(i) };
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
                        let name = format!("{} of {}", experiment.all[which].name, options.shot);
                        let of_camera = experiment.cameras.as_ref().map(|_| format!(", {}", camera.name()));
                        let name = name + &of_camera.unwrap_or_default();
                        self.pictures.push(page::against(name, &image, &reference.images, loaded)?);
                    }
                    first.get_or_insert(image);
                }
                number += 1;
            }
        }
        if experiment.has_any(&FOVEA) && *camera != Camera::Moving {
            let count = [*warm_up, warm_up + total];
            let foveae = with_moving_gaze(options, loaded, &views[0].reference, turns, begun, count)?;
            for (beside, fovea) in beside.iter_mut().zip(foveae) {
                beside.extend(FOVEA.into_iter().zip(fovea).filter_map(|(name, value)| Some((name, value?))));
            }
        }
        let mut measured = Vec::new();
        for (((arrangement, judge), mut beside), rings) in experiment.all.iter().zip(judges).zip(beside).zip(&rings) {
            let rows = rings::over_frames(&options.shot, camera.name(), &arrangement.name, rings);
            beside.extend(RINGS.into_iter().zip(rings::ends(&rows)).filter_map(|(name, ssim)| Some((name, ssim?))));
            self.rings.extend(rows);
            let of = judge.conclude();
            let camera = experiment.cameras.as_ref().map(|_| camera.name().to_owned());
            let names = [options.shot.clone()].into_iter().chain(camera).chain([arrangement.name.clone()]);
            let names: Vec<String> = names.collect();
            self.frames.extend(of.frames.iter().map(|line| (names.clone(), line.clone())));
            measured.push((of, beside));
        }
        self.rows.extend(experiment.measured(&options.shot, *camera, &measured));
        Ok(())
    }

    fn write(mut self, args: &Args) -> Result<(), Failure> {
        let experiment = self.experiment;
        self.rows.extend(experiment.cited());
        let (lines, frames): (Vec<_>, Vec<_>) = self.frames.into_iter().unzip();
        let columns = ["shot"].into_iter().chain(experiment.labels().into_iter().skip(2));
        let columns = columns.map(str::to_owned).collect();
        let file = format!("{}.csv", experiment.name);
        let mut files = vec![
            (&file[..], experiment.csv(&self.rows)),
            ("frames.csv", Csv { columns, lines }.beside(FrameLine::csv(&frames))),
        ];
        let mut more = vec![section("Devices", Vec::new(), Table::of_devices([&self.devices[..]]))];
        if args.report {
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
        let notes = experiment.captions().into_iter().chain(self.notes).collect();
        Findings {
            title: format!("{}, at {}", experiment.title, args.options.size),
            rows: &self.rows.iter().map(|row| experiment.json(row)).collect::<Vec<_>>(),
            files,
            run: None,
            tables: vec![section(&experiment.heading, notes, experiment.table(&self.rows))],
            more,
        }
        .write(args)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn the_camera_has_come_some_way_at_every_instant() {
        let key = |time_s| RigKey { time_s, position: DVec3::ZERO, target: DVec3::X, up: DVec3::Y };
        assert_eq!(on_path(&[1.0, 1.5, 4.0].map(key), 3), [2.0, 3.0, 4.0]);
        assert!(on_path(&[key(1.0)], 3).is_empty());
    }
}
