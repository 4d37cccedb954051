//! Times sequences of frames along the camera's path, and predicts frames on other numbers of devices. There is no
//! reference.

use anyhow::{Context, anyhow, ensure};

use super::args::StudyArgs;
use super::columns::{Found, Measures};
use super::definition::{Camera, Study};
use super::measuring::Measuring;
use super::results::Results;
use super::rows::Labels;
use super::times::FrameTimes;
use super::turns::{FPS, Turns};
use crate::bench::axes::order;
use crate::failure::Failure;
use crate::options::RenderOptions;
use crate::output::same_bits;
use crate::page;
use crate::registry::registered;
use crate::report::frames::FrameLine;
use crate::report::html::Section;
use crate::report::lanes::{LaneFrame, median_frame};
use crate::report::statistics::mean;
use crate::report::{Chart, Series, line_chart_svg, median_of, once};
use crate::setup;
use crate::simulate::predict;
use diptych::exec::{FrameReport, PerView};
use diptych::image::RgbImage;
use diptych::metrics::Pair;
use diptych::passes::FrameSpec;

/// Number of sequences of each arrangement.
pub const ROUNDS: u32 = 3;

/// Checks that the devices and the options of the command line suit the study.
pub fn check(args: &StudyArgs, study: &Study, devices: usize) -> Result<(), anyhow::Error> {
    if study.cameras != [Camera::Following] {
        return Ok(());
    }
    if let Some(count) = args.options.settings.ratios.first().map(|rule| rule.ratios.len()) {
        let is_other = args.simulate.iter().any(|simulated| usize::from(*simulated) != count);
        ensure!(!is_other, "--simulate: ratios are for {count} devices: give --simulate {count}");
    }
    ensure!(devices > 1, "study {} distributes rows over at least two devices: try --virtual 2", study.name);
    Ok(())
}

/// Renders the sequence with one arrangement after the other, several times, and keeps the results. `prepared` has the
/// arrangements' options, and `others` their measures that do not depend on frames.
pub fn measure(
    measuring: &Measuring,
    turns: &mut Turns,
    prepared: &[RenderOptions],
    others: Vec<Measures>,
    labels: &Labels,
    results: &mut Results,
) -> Result<(), Failure> {
    let Measuring { study, args, subject, loaded, .. } = measuring;
    let (from_s, frames) = (subject.options.settings.time, args.frames_of(study));
    let beyond = setup::beyond_path(&loaded.shot.rig, from_s, from_s + f64::from(frames - 1) / FPS);
    beyond.into_iter().for_each(|warning| log!("warning: {warning}"));
    let mut found: Vec<Found> = others.into_iter().map(|others| Found { others, ..Found::default() }).collect();
    let mut reports: Vec<Vec<FrameReport>> = found.iter().map(|_| Vec::new()).collect();
    let mut totals_s: Vec<Vec<f64>> = found.iter().map(|_| Vec::new()).collect();
    let count = turns.renderers.len();
    for round in 0..ROUNDS {
        for which in order(count, round as usize) {
            let (sequence, total_s) = turns.sequence(which, from_s, round, [args.warm_up, frames])?;
            totals_s[which].push(total_s);
            for (number, report) in (round * frames..).zip(&sequence) {
                let time_s = from_s + f64::from(number % frames) / FPS;
                let row = turns.keep(which, time_s, report, number);
                found[which].times.push(FrameTimes::measured(report));
                found[which].lines.push(FrameLine::from(&row));
            }
            reports[which].extend(sequence);
        }
    }
    let over = |base: usize, own: &[f64]| totals_s[base].iter().zip(own).map(|(base, own)| base / own).collect();
    let one = alone(study);
    for (found, own) in found.iter_mut().zip(&totals_s) {
        let ratios: Vec<f64> = over(0, own);
        found.others.extend(one.map(|one| ("over_one", median_of(over(one, own)))));
        let ends = [f64::min, f64::max].map(|end| ratios.iter().copied().reduce(end));
        found.others.extend([
            ("frames", f64::from(frames)),
            ("total_s", median_of(own.clone())),
            ("speedup", median_of(ratios)),
            ("speedup_least", ends[0].unwrap_or(f64::NAN)),
            ("speedup_most", ends[1].unwrap_or(f64::NAN)),
        ]);
    }
    let pictures = turns.renderers.iter_mut().map(|renderer| renderer.read_linear()).collect::<Result<Vec<_>, _>>()?;
    if let Some(traced) = prepared.iter().position(|options| !options.settings.reproject) {
        for (found, picture) in found.iter_mut().zip(&pictures) {
            found.others.insert("flip_traced", mean_flip(&pictures[traced], picture, loaded.shot.exposure_ev)?);
        }
    }
    results.keep(labels, &found);
    if args.report {
        results.sections.extend(sections(measuring, &found, &reports)?);
    }
    let is_same = (0..count).all(|which| same_bits(&pictures[which], &pictures[alike(study, which)]));
    let same = if is_same { "the same bytes" } else { "other bytes" };
    results.note(
        &format!("{}, {}", labels.scene, labels.conditions),
        &format!("the last frames of the same settings have {same}."),
    );
    simulate(measuring, turns, prepared, &reports, labels, results)
}

/// Returns the arrangement that runs on one device, if there is one.
fn alone(study: &Study) -> Option<usize> {
    study.arrangements.iter().position(|one| one.devices == Some(1))
}

/// Returns the last arrangement with the settings of this one.
fn alike(study: &Study, which: usize) -> usize {
    let of = |which: usize| study.arrangements[which].settings;
    (which..study.arrangements.len()).rev().find(|other| of(*other) == of(which)).unwrap_or(which)
}

/// Returns the mean FLIP of all views.
fn mean_flip(right: &PerView<RgbImage>, image: &PerView<RgbImage>, exposure_ev: f32) -> Result<f64, Failure> {
    let of = |(right, image)| Ok(Pair::new(right, image, exposure_ev)?.errors().flip);
    Ok(mean(&right.iter().zip(image.iter()).map(of).collect::<Result<Vec<f64>, Failure>>()?))
}

/// Predicts a frame of each arrangement on other numbers of devices, with the costs of the last one with its settings.
fn simulate(
    measuring: &Measuring,
    turns: &Turns,
    prepared: &[RenderOptions],
    reports: &[Vec<FrameReport>],
    labels: &Labels,
    results: &mut Results,
) -> Result<(), Failure> {
    let Measuring { study, args, loaded, .. } = measuring;
    for devices in once(args.simulate.iter().copied().map(usize::from)) {
        let mut found = Vec::new();
        for (which, (arrangement, own)) in study.arrangements.iter().zip(prepared).enumerate() {
            let (measured, devices) = (alike(study, which), arrangement.devices.unwrap_or(devices));
            let spec = reports[measured].last().context("there is no frame")?.spec.clone();
            let program = registered().program(&FrameSpec { devices, ..spec });
            let model = turns.renderers[measured].costs().on_devices(&program, &vec![1.0; devices]);
            let (graph, prediction) = predict(&arrangement.distributed(own.clone(), devices), &model)?;
            let times = vec![FrameTimes::simulated(&graph, &prediction)];
            let others = Measures::from([("views", loaded.shot.rig.views as f64)]);
            found.push(Found { times, others, ..Found::default() });
        }
        let ms = |found: &Found| found.times[0].makespan_ms;
        let (first, one) = (ms(&found[0]), alone(study).map(|one| ms(&found[one])));
        for found in &mut found {
            let own = ms(found);
            found.others.insert("speedup", first / own);
            found.others.extend(one.map(|one| ("over_one", one / own)));
        }
        results.keep(&Labels { source: "simulated", devices: devices.to_string(), ..labels.clone() }, &found);
    }
    Ok(())
}

/// Returns sections of the page: the makespans along the path, and the swimlanes of a frame of each arrangement.
fn sections(measuring: &Measuring, found: &[Found], reports: &[Vec<FrameReport>]) -> Result<Vec<Section>, Failure> {
    let Measuring { study, subject, conditions, .. } = measuring;
    let names = study.arrangements.iter().map(|one| one.name);
    let line = |(name, found): (&str, &Found)| {
        let points = (0u32..).zip(&found.times).map(|(i, frame)| (f64::from(i), frame.makespan_ms)).collect();
        Series { name: name.to_owned(), points, ..Series::default() }
    };
    let title = format!("{}, {}", subject.name(), conditions.name);
    let chart = Chart::new(title.clone(), ["frame", "makespan, ms"], false);
    let series: Vec<Series> = names.clone().zip(found).map(line).collect();
    let figure = Some(line_chart_svg(&chart, &series).map_err(|error| anyhow!("cannot draw the frames: {error}"))?);
    let median = |frames: &Vec<FrameReport>| median_frame(&frames.iter().map(|f| f.makespan_ms).collect::<Vec<_>>());
    let lanes = names.zip(reports).map(|(name, frames)| LaneFrame::new(name.to_owned(), &frames[median(frames)]));
    let note = format!("A frame of median makespan of each arrangement: {title}.");
    let lanes: Vec<LaneFrame> = lanes.collect();
    let lanes = page::swimlanes(note, &lanes, lanes.len() - 1, None)?;
    Ok(vec![Section { heading: "Frames along the path", figure, ..Section::default() }, lanes])
}
