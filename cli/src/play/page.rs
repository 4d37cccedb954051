//! `diptych play --report`: the last picture against a reference, frame times in their budget, and a breakdown of frame
//! times.

use anyhow::Context;

use crate::report::Table;
use crate::report::html::Section;
use crate::report::lanes::{LaneFrame, median_frame};
use crate::report::pictures::Group;
use crate::report::play::{PlaySummary, SETTLING_FRAMES};
use crate::report::record::SpooledRows;
use crate::report::run::RunReport;
use crate::report::samples::{FrameSamples, SampledFrame};
use crate::report::timeline::{Disturbed, timeline};
use diptych::exec::{Fault, InjectedKind, Injection};
use diptych::frame::Disturbance;
use diptych::loaded::LoadedScene;

use super::args::Args;
use super::references::{Kept, References};
use crate::failure::Failure;
use crate::options::RenderOptions;
use crate::{interrupt, page};

/// Renders the reference of the last frame and writes the page. After a signal, the page has no pictures.
pub fn write(
    args: &Args,
    options: &RenderOptions,
    loaded: &mut LoadedScene,
    report: &RunReport<&SpooledRows>,
    samples: &FrameSamples,
    last: Option<&Kept>,
) -> Result<(), Failure> {
    let [lo_ms, hi_ms] = [args.options.budget_ms.lo_ms(), args.options.budget_ms.hi_ms()];
    let title = format!("{} at {} in {lo_ms} to {hi_ms} ms a frame", options.shot, options.settings.size);
    let pictures = last.map(|last| pictures(args, options, loaded, last)).transpose();
    let mut sections: Vec<_> = interrupt::as_none(pictures)?.flatten().into_iter().collect();
    if let Some(play) = &report.play {
        sections.extend(budget(options, play, &report.faults, samples)?);
    }
    let makespans_ms: Vec<f64> = samples.frames().iter().map(|f| f.makespan_ms).collect();
    let frames: Vec<LaneFrame> = samples.frames().iter().map(lane_frame).collect();
    let note = "The frame that you choose above or here; initially a frame of median makespan.";
    sections.push(page::swimlanes(note.to_owned(), &frames, median_frame(&makespans_ms), Some([lo_ms, hi_ms]))?);
    let settings = Table::of_fields(&report.settings);
    sections.push(Section { heading: "Settings", table: Some(settings), ..Section::default() });
    let devices = Table::of_devices([report.devices.as_slice()]);
    let faults =
        report.faults.iter().map(|f| format!("Device {} was dropped in frame {}: {}", f.device, f.frame, f.what));
    sections.push(Section { heading: "Devices", notes: faults.collect(), table: Some(devices), figure: None });
    sections.push(page::scene(options, loaded));
    page::write(&options.out, &title, &sections)
}

/// Returns the swimlanes of a frame, whose task times are relative to its start.
fn lane_frame(frame: &SampledFrame) -> LaneFrame<'_> {
    let SampledFrame { index, makespan_ms, tasks, .. } = frame;
    LaneFrame { name: format!("frame {index}"), makespan_ms: *makespan_ms, begin_ms: 0.0, tasks }
}

fn pictures(args: &Args, options: &RenderOptions, loaded: &mut LoadedScene, last: &Kept) -> Result<Section, Failure> {
    let mut references = References::new(args, options, loaded, options.settings.report_spp)?;
    let (reference, row) = references.of(last, loaded)?;
    let index = last.index;
    let groups = [
        page::against(format!("frame {index}"), &last.linear, &reference, loaded)?,
        Group::of_frame(format!("reference, {} spp", row.spp), &reference, loaded.shot.exposure_ev),
    ];
    let noise = row.noise.as_ref().map_or(String::new(), |noise| format!(" Standard error of the reference: {noise}."));
    let note = format!(
        "Frame {index}, the last, and a reference of the same camera and instant without denoiser and reprojection: {} \
         samples per pixel in {:.1} s, as many as {}.{noise} {}",
        row.spp,
        row.elapsed_s,
        if options.settings.report_spp.is_some() { "report_spp asked for" } else { "the time allowed" },
        page::flip_note(loaded),
    );
    page::pictures(note, &groups)
}

fn budget(
    options: &RenderOptions,
    play: &PlaySummary,
    faults: &[Fault],
    samples: &FrameSamples,
) -> Result<[Section; 2], Failure> {
    let disturbed = options.settings.disturb.iter().filter_map(disturbed);
    let failed = faults.iter().map(|&Fault { frame, device, kind, .. }| Disturbed {
        name: format!("{}: device {device}", kind.name()),
        from: frame,
        to: frame,
    });
    let disturbed: Vec<Disturbed> = disturbed.chain(failed).collect();
    let figure = timeline(play.budget_ms, play.rungs, samples.frames(), &disturbed);
    let figure = figure.context("cannot encode the frames")?;
    let how = "Frame times, with the budget shaded, and samples per pixel; below them the rung of the quality ladder, \
        where 0 is the cheapest, and the rows that each of several devices path traces, from the top of the image to \
        its bottom. Triangles mark frames beyond the axis, and red ticks at the top frames that missed their refresh of the display. \
        Click a frame to choose it, or use the arrow keys.";
    let judged = format!("The first {SETTLING_FRAMES} frames of a longer run are not judged: the loop is settling.");
    let mut notes = vec![how.to_owned(), judged];
    if samples.stride() > 1 {
        notes.push(format!("Of every {} consecutive frames, the figures show the slowest.", samples.stride()));
    }
    let rungs = vec![format!("Ladder: {}. Shares are fractions of the judged frames.", play.ladder)];
    Ok([
        Section { heading: "Frames in their budget", notes, table: Some(play.table()), figure: Some(figure) },
        Section { heading: "Rungs", notes: rungs, table: Some(play.rungs_table()), figure: None },
    ])
}

/// Returns a disturbance that the figure marks. It marks the faults that happened in place of those to inject.
fn disturbed(what: &Disturbance) -> Option<Disturbed> {
    match what {
        Disturbance::Device(Injection { kind: InjectedKind::Slow, device, frames }) => {
            Some(Disturbed { name: format!("slow: device {device}"), from: frames.start, to: frames.end })
        }
        Disturbance::Device(_) => None,
        Disturbance::SceneCut { frame } => Some(Disturbed { name: "scene cut".into(), from: *frame, to: *frame }),
    }
}
