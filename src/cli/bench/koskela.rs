//! `diptych bench --preset koskela`: visual-polar images against full resolution and against other distributions of the
//! same sample count, log-polar images among them. The renderers take turns.

use crate::device::DeviceInfo;
use crate::loaded::LoadedScene;
use crate::metrics::Pair;
use crate::metrics::rings::Viewing;
use crate::metrics::temporal::{Change, TemporalError};
use crate::quality::{Denoiser, LogPolar, PolarSpace, Quality};
use crate::report::Table;
use crate::report::csv::{Column, Csv};
use crate::report::frames::FrameLine;
use crate::report::koskela::{
    ARRANGEMENTS, Beside, FALLOFF_DEG, GAZE_DEG_PER_S, KoskelaRow, LOG_POLAR_ALPHA, NEAR_DEG, NOTE, cited, koskela_csv,
    koskela_table, measured,
};
use crate::report::pictures::Group;
use crate::scene::rig::Eye;
use crate::stages::{Foveation, Polar};

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

pub const REFUSES: &[&str] = &["size_factor", "instants", "frames", "simulate", "fresh"];

/// Denoiser iterations of every layer.
const ITERATIONS: [u32; 3] = [Denoiser::DEFAULT_ITERATIONS; 3];

/// Baseline at full resolution, without foveation.
const FULL: Quality = Quality {
    spp: 1,
    bounces: 6,
    denoiser: Some(Denoiser::SVGF),
    iterations: ITERATIONS,
    fovea: None,
    polar: None,
    scale: 1.0,
};

/// Angle that the gaze sweeps before it turns back, degrees.
const SWEEP_DEG: f64 = 10.0;

/// An arrangement: its options, the sampling probability beyond the linear falloff, and σ of log-polar images.
type Arranged = (RenderOptions, Option<f64>, Option<f64>);

/// Returns the options of each of [`ARRANGEMENTS`]. All but the first sample about as many pixels as a visual-polar
/// image has.
fn arrangements(run: &RunOptions, loaded: &LoadedScene) -> [Arranged; ARRANGEMENTS.len()] {
    let gaze = || [0, 1].map(|_| loaded.shot.gaze.clone());
    let view = loaded.shot.rig.view(run.time, Eye::Left);
    let share = Polar { gaze: gaze(), space: PolarSpace::Visual }.share(Eye::Left, run.time, &view, run.size).min(1.0);
    let [width, _] = tan_half(loaded, run).map(|tan| 2.0 * tan);
    let radii = FALLOFF_DEG.map(|degrees| degrees.to_radians().tan() / width);
    let falloff = Foveation { radii, ..Foveation::new(gaze()) };
    let unsampled = falloff.unsampled_fraction_for(share, run.time, run.size);
    let of = |quality| {
        let mut options = RenderOptions::single(run.clone(), &quality);
        options.foveated.iterations = Some(ITERATIONS);
        options
    };
    let mut linear = of(Quality { fovea: Some(radii), ..FULL });
    linear.foveated.unsampled_fraction = Some(unsampled);
    let log = log_polar(share, run, loaded);
    [
        (of(FULL), None, None),
        (of(Quality { scale: share.sqrt(), ..FULL }), None, None),
        (linear, Some(1.0 - unsampled), None),
        (of(Quality { polar: Some(PolarSpace::Visual), ..FULL }), None, None),
        (of(Quality { polar: Some(PolarSpace::Log(log)), ..FULL }), None, Some(log.sigma)),
    ]
}

/// Finds the σ at which log-polar images trace the fraction `share` of the screen's pixels. Their count is proportional
/// to 1 / σ², except for a margin around the screen, so a few iterations suffice.
fn log_polar(share: f64, run: &RunOptions, loaded: &LoadedScene) -> LogPolar {
    let aspect = f64::from(run.size.width) / f64::from(run.size.height);
    let mut map = LogPolar { sigma: 1.0, alpha: LOG_POLAR_ALPHA, gaze: 0.0, aspect, blur: true };
    let view = loaded.shot.rig.view(run.time, Eye::Left);
    for _ in 0..4 {
        let polar = Polar { gaze: [0, 1].map(|_| loaded.shot.gaze.clone()), space: PolarSpace::Log(map) };
        map.sigma *= (polar.traced_fraction(Eye::Left, run.time, &view, run.size) / share).sqrt();
    }
    map
}

/// Returns the tangents of half the horizontal and half the vertical field of view.
fn tan_half(loaded: &LoadedScene, run: &RunOptions) -> [f64; 2] {
    let vertical = (loaded.shot.rig.yfov_rad / 2.0).tan();
    [vertical * f64::from(run.size.width) / f64::from(run.size.height), vertical]
}

/// Returns the gaze after sweeping by `degrees` at constant screen height, from `[x, y]` towards the screen's middle
/// and back again before it leaves the screen.
fn turned([x, y]: [f64; 2], [tan_x, tan_y]: [f64; 2], degrees: f64) -> [f64; 2] {
    let distance = ((1.0 - 2.0 * y) * tan_y).hypot(1.0);
    let begin = ((2.0 * x - 1.0) * tan_x / distance).atan();
    let range = SWEEP_DEG.to_radians().min((tan_x / distance).atan());
    let along = degrees.to_radians() % (2.0 * range);
    let angle = begin - (range - (range - along).abs()).copysign(begin);
    [(distance * angle.tan() / tan_x + 1.0) / 2.0, y]
}

pub fn run(args: &Args) -> Result<(), Failure> {
    // The gaze is static at first, then moves.
    let frames = 2 * u64::from(args.frames_of(&FULL)) * ARRANGEMENTS.len() as u64;
    let mut found = Results::default();
    over_shots(args, frames, |args, progress, tracing| found.measure(args, progress, tracing))?;
    found.write(args)
}

#[derive(Default)]
struct Results {
    rows: Vec<KoskelaRow>,
    /// Timed frames, each with its shot and arrangement.
    frames: Vec<([String; 2], FrameLine)>,
    devices: Vec<DeviceInfo>,
    /// A note on each reference.
    notes: Vec<String>,
    /// Last frame of each arrangement with a static gaze, as pictures for the HTML report.
    pictures: Vec<Group>,
}

impl Results {
    /// Measures all arrangements on the shot of `args`.
    fn measure(&mut self, args: &Args, progress: &Progress, tracing: &Tracing) -> Result<(), Failure> {
        let options = &args.options;
        let loaded = setup::load(options)?;
        let reference = own(args, &loaded, tracing, None)?;
        interrupt::check()?;
        self.notes.push(reference.note(&options.shot, options.size));
        let arranged = arrangements(options, &loaded);
        let mut turns = Turns::new(&loaded, progress, tracing, self.rows.len());
        for (name, (own, ..)) in ARRANGEMENTS.iter().zip(&arranged) {
            let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
            turns.add(format!("{name} of {}", options.shot), own.clone(), gpus)?;
        }
        let mut judges = ARRANGEMENTS.map(|_| Judge::new(&loaded, &reference, options.time));
        let mut traced = [[0.0; 2]; ARRANGEMENTS.len()];
        let (warm_up, all) = (args.warm_up_of(&FULL), args.frames_of(&FULL));
        for i in 0..all {
            let time_s = args.time_s(&FULL, i);
            let frames = turns.render(time_s, i)?;
            let Some(number) = i.checked_sub(warm_up) else { continue };
            for (which, frame) in frames.iter().enumerate() {
                let row = turns.keep(which, time_s, frame, number);
                let image = turns.renderers[which].read_linear()?;
                judges[which].add(frame, &row, &image)?;
                for (sum, paths) in traced[which].iter_mut().zip(turns.paths(which, time_s, frame)) {
                    *sum += paths / f64::from(all - warm_up);
                }
                if args.report && i + 1 == all {
                    let name = format!("{} of {}", ARRANGEMENTS[which], options.shot);
                    self.pictures.push(page::against(name, &image, &reference.images, &loaded)?);
                }
            }
        }
        let foveae = with_moving_gaze(args, &loaded, &reference, &mut turns)?;
        let mut found = Vec::new();
        for (which, (judge, fovea)) in judges.into_iter().zip(foveae).enumerate() {
            let measured = judge.conclude();
            let of = [options.shot.clone(), ARRANGEMENTS[which].to_owned()];
            self.frames.extend(measured.frames.iter().map(|line| (of.clone(), line.clone())));
            let ((_, floor, sigma), paths) = (&arranged[which], traced[which]);
            found.push((measured, Beside { floor: *floor, sigma: *sigma, paths, fovea }));
        }
        self.rows.extend(measured(&options.shot, found));
        self.devices = turns.renderers[0].devices().to_vec();
        Ok(())
    }

    fn write(mut self, args: &Args) -> Result<(), Failure> {
        self.rows.extend(cited());
        let (of, lines): (Vec<_>, Vec<_>) = self.frames.into_iter().unzip();
        let columns: [Column<[String; 2]>; 2] =
            [("shot", |[shot, _]| shot.clone()), ("arrangement", |[_, arrangement]| arrangement.clone())];
        let frames = Csv::new(&columns, &of).beside(FrameLine::csv(&lines));
        let notes = [NOTE.to_owned()].into_iter().chain(self.notes).collect();
        let mut more = vec![section("Devices", Vec::new(), Table::of_devices([&self.devices[..]]))];
        if args.report {
            let note =
                "The last frame of each arrangement, with a gaze that rests, and its FLIP against the reference.";
            more.insert(0, page::pictures(note.to_owned(), &self.pictures)?);
        }
        Findings {
            title: format!("Visual-polar images after Koskela et al., at {}", args.options.size),
            rows: &self.rows,
            files: vec![("koskela.csv", koskela_csv(&self.rows)), ("frames.csv", frames)],
            run: None,
            tables: vec![section("Visual-polar, and as many samples elsewhere", notes, koskela_table(&self.rows))],
            more,
        }
        .write(args)
    }
}

/// Measures FLIP and flicker of the fovea in each renderer while the gaze moves and camera and scene rest. Returns
/// means over both eyes. Warm-up frames fill the history and are not compared.
fn with_moving_gaze(
    args: &Args,
    loaded: &LoadedScene,
    reference: &Reference,
    turns: &mut Turns,
) -> Result<Vec<[Option<f64>; 2]>, Failure> {
    let options = &args.options;
    let (warm_up, all) = (args.warm_up_of(&FULL), args.frames_of(&FULL));
    let (rig, from) = (&loaded.shot.rig, loaded.shot.gaze.at(options.time));
    let mut flips = ARRANGEMENTS.map(|_| Some(0.0));
    let mut changes = ARRANGEMENTS.map(|_| [Change::default(); 2]);
    let mut before: [Option<([Pair; 2], Viewing)>; ARRANGEMENTS.len()] = Default::default();
    for i in 0..all {
        let gaze = turned(from, tan_half(loaded, options), GAZE_DEG_PER_S * f64::from(i + 1) / FPS);
        turns.gaze = Some([gaze; 2]);
        turns.render(options.time, all + i)?;
        if i < warm_up {
            continue;
        }
        let viewing = Viewing { gaze, yfov_deg: rig.yfov_rad.to_degrees() };
        for (which, renderer) in turns.renderers.iter_mut().enumerate() {
            let now = pairs(loaded, &reference.images, &renderer.read_linear()?)?;
            for pair in &now {
                let frames = 2.0 * f64::from(all - warm_up);
                flips[which] =
                    flips[which].zip(pair.flip_near_gaze(&viewing, NEAR_DEG)).map(|(sum, f)| sum + f / frames);
            }
            if let Some((last, seen)) = &before[which] {
                for (eye, change) in changes[which].iter_mut().enumerate() {
                    *change = *change + now[eye].change_near_gaze(&last[eye], [&viewing, seen], NEAR_DEG)?;
                }
            }
            before[which] = Some((now, viewing));
        }
    }
    let mean = |[left, right]: [Change; 2]| {
        let of = |eye: Change| TemporalError::from(eye).flicker;
        Some((of(left)? + of(right)?) / 2.0)
    };
    Ok(flips.into_iter().zip(changes).map(|(flip, eyes)| [flip, mean(eyes)]).collect())
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn a_gaze_turns_evenly_towards_the_middle_and_back() {
        let tan_half = [1.2, 0.8];
        let ray = |[x, y]: [f64; 2]| DVec3::new((2.0 * x - 1.0) * tan_half[0], (1.0 - 2.0 * y) * tan_half[1], 1.0);
        for from in [[0.5, 0.5], [0.3, 0.8], [1.0, 0.0]] {
            for (degrees, expected) in [(0.0, 0.0), (0.2, 0.2), (9.0, 9.0), (13.0, 7.0), (24.0, 4.0)] {
                let to = turned(from, tan_half, degrees);
                let angle = ray(from).angle_between(ray(to)).to_degrees();
                assert!((angle - expected).abs() < 1e-6 && to[1] == from[1], "{from:?}, {degrees}: {angle}");
                assert!((to[0] - 0.5).abs() <= (from[0] - 0.5).abs().max(0.2), "{to:?}");
            }
        }
        // The gaze stays on a screen that is narrower than the sweep.
        let narrow = [0.05, 0.05];
        for degrees in [1.0, 2.5, 3.0, 5.0, 77.0] {
            let [x, _] = turned([0.5, 0.5], narrow, degrees);
            assert!((0.0..=1.0).contains(&x), "{degrees}: {x}");
        }
    }
}
