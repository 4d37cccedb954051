//! Measures a study: all arrangements render the same frames in turns, and each is compared with the reference.

use super::args::StudyArgs;
use super::arrangement::{Arrangement, dispatched};
use super::columns::{FOVEA, Found, Measures, RINGS};
use super::definition::{Camera, Study};
use super::instants::{from_end_to_end, on_path};
use super::locked::{self, Conditions};
use super::measuring::Measuring;
use super::moving_gaze::with_moving_gaze;
use super::path;
use super::results::Results;
use super::rows::Labels;
use super::subject::subjects;
use super::times::FrameTimes;
use super::turns::{FPS, HISTORY_FRAMES, Turns};
use crate::bench::judge::{Judge, pairs};
use crate::bench::reference::{Reference, own};
use crate::failure::Failure;
use crate::interrupt;
use crate::options::RenderOptions;
use crate::output;
use crate::page;
use crate::progress::Progress;
use crate::report::frames::FrameLine;
use crate::report::rings::{self, FrameRings};
use crate::setup::{self, Tracing};
use diptych::quality::Denoiser;
use diptych::scene::shot::Gaze;

/// Runs a study. `has_shot` tells whether the command line names SHOT.
pub fn run(study: &'static Study, args: &StudyArgs, has_shot: bool) -> Result<(), Failure> {
    let all: Vec<Conditions> = conditions(study, &args.conditions);
    let subjects = subjects(study, args, has_shot)?;
    for conditions in &all {
        study.arrangements.iter().try_for_each(|one| one.options(conditions, &args.options).map(|_| ()))?;
    }
    args.options.check().map_err(Failure::Input)?;
    output::prepare(&args.options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(&args.options)?;
    let runs = subjects.len() * all.len() * study.arrangements.len();
    let frames: u32 = study.cameras.iter().map(|camera| frames(study, args, *camera)).sum();
    let progress = Progress::new(runs as u64 * u64::from(frames), args.options.quiet, args.options.json);
    let mut results = Results::new(study);
    let measured = subjects.iter().try_for_each(|subject| {
        let load = if study.views.is_some() { setup::load_rig } else { setup::load };
        let mut loaded = load(&subject.options)?;
        setup::tell_remarks(&loaded.scene);
        if study.gazes_ahead {
            loaded.shot.gaze = Gaze::default();
        }
        all.iter().try_for_each(|conditions| {
            let measuring = Measuring { study, args, subject, conditions, loaded: &loaded, tracing: &tracing };
            measuring.run(&progress, &mut results)
        })
    });
    // A signal ends the measurement, and the results so far are written.
    if interrupt::as_none(measured)?.is_none() && results.is_empty() {
        return Err(Failure::Interrupted);
    }
    let _writing = interrupt::writing();
    progress.finish();
    tracing.finish()?;
    results.write(args)?;
    interrupt::check()
}

/// Returns the conditions that the command line lists, each once.
fn conditions(study: &Study, names: &[String]) -> Vec<Conditions> {
    let published = locked::published(study.name);
    let of = |name: &str| match name {
        locked::PUBLISHED => vec![published.clone()],
        locked::TODAY => vec![locked::today(study.name)],
        _ => locked::departures(study.name).iter().map(|departure| published.clone().with(departure)).collect(),
    };
    crate::report::once(names.iter().flat_map(|name| of(name)))
}

/// Returns the largest number of frames that an arrangement renders for a camera.
fn frames(study: &Study, args: &StudyArgs, camera: Camera) -> u32 {
    let warm_up = args.warm_up.max(HISTORY_FRAMES);
    match camera {
        Camera::Approaching | Camera::Still if study.moves_gaze() => 2 * (warm_up + args.repeats),
        Camera::Approaching | Camera::Still => warm_up + args.repeats,
        Camera::Moving => args.frames_of(study) * (warm_up + 1),
        Camera::Stepping => args.frames_of(study) * (warm_up + args.repeats),
        Camera::Following => path::ROUNDS * (args.warm_up + args.frames_of(study)),
    }
}

/// A camera view at an instant, with its reference; `frames` excludes the warm-up.
struct View {
    time_s: f64,
    reference: Reference,
    frames: u32,
}

impl Measuring<'_> {
    fn run(&self, progress: &Progress, results: &mut Results) -> Result<(), Failure> {
        let Self { study, args, subject, conditions, loaded, tracing } = self;
        let mut turns = Turns::new(loaded, progress, tracing, results.renderers);
        let (mut beside, mut prepared) = (Vec::new(), Vec::new());
        for arrangement in study.arrangements {
            let (options, measures) = self.prepare(arrangement)?;
            beside.push(measures);
            prepared.push(options.clone());
            let mut gpus = setup::open_devices(&subject.options, usize::from(args.virtual_devices))?;
            path::check(args, study, gpus.len()).map_err(Failure::Input)?;
            gpus.truncate(arrangement.devices.unwrap_or(gpus.len()));
            let options = arrangement.distributed(options, gpus.len());
            turns.add(format!("{}, {}, {}", subject.name(), conditions.name, arrangement.name), options, gpus)?;
        }
        results.renderers += turns.renderers.len();
        results.devices = turns.renderers[0].devices().to_vec();
        let qualities = prepared.iter().map(RenderOptions::quality);
        let keeps_history = qualities.clone().any(|quality| quality.denoiser().is_some_and(Denoiser::keeps_history));
        let warm_up = if keeps_history { args.warm_up.max(HISTORY_FRAMES) } else { args.warm_up };
        let bounces = qualities.map(|quality| quality.bounces).max().unwrap_or(0);
        let mut begun = 0;
        for &camera in study.cameras {
            let labels = self.labels(camera, turns.renderers[0].devices().len());
            if camera == Camera::Following {
                path::measure(self, &mut turns, &prepared, beside.clone(), &labels, results)?;
                continue;
            }
            let views = self.views(camera, bounces, results)?;
            if !views.is_empty() {
                let found = self.measure_views(&mut turns, &mut begun, (camera, warm_up), &views, &beside, results)?;
                results.keep(&labels, &found);
            }
        }
        Ok(())
    }

    fn labels(&self, camera: Camera, devices: usize) -> Labels {
        let Self { study, subject, conditions, .. } = self;
        Labels {
            source: "measured",
            conditions: conditions.name.clone(),
            scene: subject.options.shot.clone(),
            stands_for: subject.stands_for.clone(),
            resolution: if study.sizes.len() > 1 { subject.resolution.to_owned() } else { String::new() },
            size: subject.options.settings.size.to_string(),
            camera: if study.cameras.len() > 1 { camera.name().to_owned() } else { String::new() },
            devices: devices.to_string(),
            arrangement: String::new(),
        }
    }

    /// Returns the options of an arrangement, and its measures that do not depend on frames.
    fn prepare(&self, arrangement: &Arrangement) -> Result<(RenderOptions, Measures), Failure> {
        let Self { subject, loaded, conditions, .. } = self;
        let mut options = arrangement.options(conditions, &subject.options)?;
        let most = &mut options.envelope.most;
        most.fovea = most.fovea.map(|radii| subject.layer_radii.unwrap_or(radii));
        let mut measures = arrangement.adapt.map_or_else(Measures::new, |adapt| adapt(&mut options, loaded));
        measures.insert("exposure_ev", loaded.exposure_ev());
        measures.insert("views", loaded.shot.rig.views as f64);
        measures.insert("dispatched", dispatched(&options, loaded));
        Ok((options, measures))
    }

    /// Returns the views of a camera, with their references.
    fn views(&self, camera: Camera, bounces: u32, results: &mut Results) -> Result<Vec<View>, Failure> {
        let Self { study, args, subject, loaded, tracing, .. } = self;
        let (options, keys) = (&subject.options, &loaded.shot.rig.keys);
        let (instants, frames) = match camera {
            Camera::Moving => (on_path(keys, args.frames_of(study)), 1),
            Camera::Stepping => (from_end_to_end(keys, options.settings.time, args.frames_of(study)), args.repeats),
            _ => (vec![options.settings.time], args.repeats.max(2)),
        };
        let view = |time_s| {
            let mut options = options.clone();
            options.settings.time = time_s;
            let reference = own(&args.reference(&options, bounces), loaded, tracing, None)?;
            interrupt::check()?;
            let Reference { origin, noise, .. } = &reference;
            let noise = noise.as_ref().map_or(String::new(), |noise| format!("; its own noise: {noise}"));
            results.note(&format!("{}, {bounces} bounces, {time_s} s", subject.name()), &format!("{origin}{noise}."));
            Ok(View { time_s, reference, frames })
        };
        instants.into_iter().map(view).collect()
    }

    /// Measures all arrangements in all views of a camera after a warm-up. `begun` counts the frames that each renderer
    /// has begun. `beside` has each arrangement's measures that do not depend on frames.
    fn measure_views(
        &self,
        turns: &mut Turns,
        begun: &mut u32,
        (camera, warm_up): (Camera, u32),
        views: &[View],
        beside: &[Measures],
        results: &mut Results,
    ) -> Result<Vec<Found>, Failure> {
        let Self { study, args, subject, loaded, .. } = self;
        let total: u32 = views.iter().map(|view| view.frames).sum();
        let seen = study.has_rings().then(|| rings::viewing(subject.options.settings.size));
        let start = |others: &Measures| Found { others: others.clone(), ..Found::default() };
        let mut found: Vec<Found> = beside.iter().map(start).collect();
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
                if i < warm_up {
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
                        *found[which].others.entry(name).or_default() += paths / f64::from(total);
                    }
                    if let (Some(seen), Some(eyes)) = (&seen, judges[which].last()) {
                        let to_first = first.as_ref().map(|first| pairs(loaded, first, &image)).transpose()?;
                        rings[which].push(FrameRings::new(seen, eyes, to_first.as_ref()));
                    }
                    if args.report && number + 1 == total {
                        let name = format!("{}, {}", turns.settings[which].0, camera.name());
                        results.pictures.push(page::against(name, &image, &reference.images, loaded)?);
                    }
                    first.get_or_insert(image);
                }
                number += 1;
            }
            found.iter_mut().zip(judges).for_each(|(found, judge)| found.instants.push(judge.conclude()));
        }
        if study.moves_gaze() && views.len() == 1 {
            let count = [warm_up, warm_up + total];
            let foveae = with_moving_gaze(&subject.options, loaded, &views[0].reference, turns, begun, count)?;
            for (found, fovea) in found.iter_mut().zip(foveae) {
                found.others.extend(FOVEA.into_iter().zip(fovea).filter_map(|(name, value)| Some((name, value?))));
            }
        }
        let scene = format!("{}, {}", subject.options.shot, self.conditions.name);
        for ((arrangement, found), rings) in study.arrangements.iter().zip(&mut found).zip(&rings) {
            let rows = rings::over_frames(&scene, camera.name(), arrangement.name, rings);
            found.others.extend(RINGS.into_iter().zip(rings::ends(&rows)).filter_map(|(name, v)| Some((name, v?))));
            results.rings.extend(rows);
        }
        Ok(found)
    }
}
