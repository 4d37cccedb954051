//! `diptych bench --preset andersson`: the thesis's log-polar modes against full resolution, with a static and with a
//! moving camera. The renderers take turns.

use anyhow::Context;

use crate::device::DeviceInfo;
use crate::loaded::LoadedScene;
use crate::quality::{Denoiser, LogPolar, PolarSpace, Quality};
use crate::report::Table;
use crate::report::andersson::{
    AnderssonRow, CAMERAS, MODES, NOTE, RINGS, andersson_csv, andersson_table, cited, measured, viewing,
};
use crate::report::csv::{Column, Csv};
use crate::report::frames::FrameLine;
use crate::report::pictures::Group;
use crate::report::rings::{self, FrameRings, RingRow, over_frames, ring_charts, ring_csv, ring_table};
use crate::scene::rig::{Eye, RigKey};
use crate::scene::shot::Gaze;
use crate::stages::Polar;

use super::args::Args;
use super::axes::FPS;
use super::findings::{Findings, section};
use super::judge::{Judge, pairs};
use super::over_shots::over_shots;
use super::reference::{Reference, own};
use super::turns::Turns;
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::options::{RenderOptions, RunOptions};
use crate::cli::page;
use crate::cli::progress::Progress;
use crate::cli::setup::{self, Tracing};

pub const REFUSES: &[&str] = &["size_factor", "frames", "simulate", "fresh"];

/// Baseline at full resolution, without foveation.
const BASIC: Quality = Quality {
    spp: 1,
    bounces: 6,
    denoiser: Some(Denoiser::SVGF),
    iterations: [Denoiser::DEFAULT_ITERATIONS; 3],
    fovea: None,
    polar: None,
    scale: 1.0,
};

/// Returns the qualities of [`MODES`], without the blur, which the thesis omits from its error tests.
fn qualities() -> impl Iterator<Item = Quality> {
    let polar = |(_, mode)| Quality { polar: Some(PolarSpace::Log(LogPolar { blur: false, ..mode })), ..BASIC };
    [BASIC].into_iter().chain(LogPolar::PRESETS.map(polar))
}

/// Returns `count` evenly spaced instants along the path, from after its start to its end, so that the camera has moved
/// before each. Empty if the camera is static.
fn on_path(keys: &[RigKey], count: u32) -> Vec<f64> {
    let [first, .., last] = keys else { return Vec::new() };
    let length_s = last.time_s - first.time_s;
    (1..=count).map(|i| first.time_s + length_s * f64::from(i) / f64::from(count)).collect()
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let still = args.frames_of(&BASIC);
    let moving = args.preset.instants * (args.warm_up_of(&BASIC) + 1);
    let mut found = Results::default();
    let frames = u64::from(still + moving) * MODES.len() as u64;
    over_shots(args, frames, |args, progress, tracing| found.measure(args, progress, tracing))?;
    found.write(args)
}

#[derive(Default)]
struct Results {
    rows: Vec<AnderssonRow>,
    rings: Vec<RingRow>,
    /// Timed frames, each with its shot, camera and mode.
    frames: Vec<([String; 3], FrameLine)>,
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
    /// Time step along the camera's path during warm-up, seconds.
    step_s: f64,
}

impl Results {
    /// Measures all modes on the shot of `args`.
    fn measure(&mut self, args: &Args, progress: &Progress, tracing: &Tracing) -> Result<(), Failure> {
        let options = &args.options;
        let mut loaded = setup::load(options)?;
        loaded.shot.gaze = Gaze::default();
        let mut turns = Turns::new(&loaded, progress, tracing, self.rows.len());
        for (name, quality) in MODES.iter().zip(qualities()) {
            let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
            turns.add(format!("{name} of {}", options.shot), RenderOptions::single(options.clone(), &quality), gpus)?;
        }
        let mut begun = 0;
        let moving = on_path(&loaded.shot.rig.keys, args.preset.instants);
        for (camera, instants) in CAMERAS.into_iter().zip([vec![options.time], moving]) {
            let is_still = camera == CAMERAS[0];
            let mut views = Vec::new();
            for time_s in instants {
                let args = Args { options: RunOptions { time: time_s, ..options.clone() }, ..args.clone() };
                let reference = own(&args, &loaded, tracing, None)?;
                interrupt::check()?;
                self.notes.push(format!("{time_s} s: {}", reference.note(&options.shot, options.size)));
                let judged = args.frames_of(&BASIC) - args.warm_up_of(&BASIC);
                let (frames, step_s) = if is_still { (judged, 0.0) } else { (1, 1.0 / FPS) };
                views.push(View { time_s, reference, frames, step_s });
            }
            if !views.is_empty() {
                self.measure_views(args, &loaded, &mut turns, &mut begun, camera, &views)?;
            }
        }
        self.devices = turns.renderers[0].devices().to_vec();
        Ok(())
    }

    /// Measures all modes in all views of a camera. `begun` counts the frames that each renderer has begun.
    fn measure_views(
        &mut self,
        args: &Args,
        loaded: &LoadedScene,
        turns: &mut Turns,
        begun: &mut u32,
        camera: &'static str,
        views: &[View],
    ) -> Result<(), Failure> {
        let options = &args.options;
        let (warm_up, seen) = (args.warm_up_of(&BASIC), viewing(options.size));
        let mut judges = MODES.map(|_| Judge::new(loaded, &views[0].reference, options.time));
        let mut rings = MODES.map(|_| Vec::new());
        let mut traced = [0.0; MODES.len()];
        let mut number = 0;
        for View { time_s, reference, frames, step_s } in views {
            judges.iter_mut().for_each(|judge| judge.turn_to(reference));
            for i in 0..warm_up + frames {
                let time_s = time_s - step_s * f64::from(warm_up.saturating_sub(i));
                let reports = turns.render(time_s, *begun)?;
                *begun += 1;
                if i < warm_up {
                    continue;
                }
                let mut basic = None;
                for (which, report) in reports.iter().enumerate() {
                    let row = turns.keep(which, time_s, report, number);
                    let image = turns.renderers[which].read_linear()?;
                    judges[which].add(report, &row, &image)?;
                    traced[which] += turns.paths(which, time_s, report)[0];
                    let of = judges[which].last().map(|eyes| eyes.each_ref().map(|eye| eye.rings(&seen, RINGS)));
                    let to_basic = basic.as_ref().map(|basic| pairs(loaded, basic, &image)).transpose()?;
                    let basic_rings = to_basic.map(|eyes| eyes.each_ref().map(|eye| eye.rings(&seen, RINGS)));
                    rings[which].extend(of.map(|reference| FrameRings { reference, basic: basic_rings }));
                    if args.report && number + 1 == views.iter().map(|view| view.frames).sum::<u32>() {
                        let name = format!("{} of {}, {camera}", MODES[which], options.shot);
                        self.pictures.push(page::against(name, &image, &reference.images, loaded)?);
                    }
                    basic.get_or_insert(image);
                }
                number += 1;
            }
        }
        let mut found = Vec::new();
        for (((which, quality), judge), frames) in qualities().enumerate().zip(judges).zip(&rings) {
            let rows = over_frames(&options.shot, camera, MODES[which], frames);
            self.rings.extend(rows.iter().cloned());
            let measured = judge.conclude();
            let of = [options.shot.clone(), camera.to_owned(), MODES[which].to_owned()];
            self.frames.extend(measured.frames.iter().map(|line| (of.clone(), line.clone())));
            found.push((measured, [dispatched(&quality, loaded, options), traced[which] / f64::from(number)], rows));
        }
        self.rows.extend(measured(&options.shot, camera, &found));
        Ok(())
    }

    fn write(mut self, args: &Args) -> Result<(), Failure> {
        self.rows.extend(cited());
        let (of, lines): (Vec<_>, Vec<_>) = self.frames.into_iter().unzip();
        let columns: [Column<[String; 3]>; 3] = [
            ("shot", |[shot, ..]| shot.clone()),
            ("camera", |[_, camera, _]| camera.clone()),
            ("mode", |[.., mode]| mode.clone()),
        ];
        let frames = Csv::new(&columns, &of).beside(FrameLine::csv(&lines));
        let notes = [NOTE.to_owned()].into_iter().chain(self.notes).collect();
        let mut more = vec![section("Devices", Vec::new(), Table::of_devices([&self.devices[..]]))];
        if args.report {
            let mut by_ring = section("By ring", vec![rings::NOTE.to_owned()], ring_table(&self.rings, &MODES));
            by_ring.figure = Some(ring_charts(&self.rings, &MODES).context("cannot draw the rings")?);
            let note = "The last frame of each mode and camera, and its FLIP against the reference.";
            more.splice(0..0, [by_ring, page::pictures(note.to_owned(), &self.pictures)?]);
        }
        Findings {
            title: format!("Log-polar images after Andersson & Hansson, at {}", args.options.size),
            rows: &self.rows,
            files: vec![
                ("andersson.csv", andersson_csv(&self.rows)),
                ("rings.csv", ring_csv(&self.rings)),
                ("frames.csv", frames),
            ],
            run: None,
            tables: vec![section("Log-polar, and every pixel of the screen", notes, andersson_table(&self.rows))],
            more,
        }
        .write(args)
    }
}

/// Returns the number of pixels in the left eye's image as a fraction of those on its screen.
fn dispatched(quality: &Quality, loaded: &LoadedScene, options: &RunOptions) -> f64 {
    let polar = |space| Polar { gaze: [0, 1].map(|_| loaded.shot.gaze.clone()), space };
    let view = loaded.shot.rig.view(options.time, Eye::Left);
    quality.polar.map_or(1.0, |space| polar(space).share(Eye::Left, options.time, &view, options.size))
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
