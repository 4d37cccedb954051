//! `diptych bench --preset late`: frames that are shown later than their pose was sampled, with and without late
//! reprojection, against frames rendered from the true pose.

use crate::device::DeviceInfo;
use crate::exec::{FrameParams, Renderer, Stereo};
use crate::image::RgbImage;
use crate::loaded::LoadedScene;
use crate::metrics::Pair;
use crate::quality::Quality;
use crate::report::Table;
use crate::report::late::{BORDER_DEG, Instant, LATENCIES, LateRow, NOTE, late_csv, late_table};
use crate::report::rectified::RectifiedFrame;
use crate::scene::optics::Optics;
use crate::scene::rig::{Eye, Rig};
use anyhow::{anyhow, ensure};

use super::args::Args;
use super::axes::FPS;
use super::findings::{Findings, section};
use super::over_shots::over_shots;
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::options::RenderOptions;
use crate::cli::progress::Progress;
use crate::cli::setup::{self, Tracing};

pub const REFUSES: &[&str] = &["size_factor", "frames", "simulate", "fresh", "repeats", "warm_up"];

/// Samples per pixel, unless --reference-spp is given.
const SPP: u32 = 64;

/// Frames per instant: one rendered from the instant's own pose and, for each latency, two rendered from the later pose
/// and one reprojected to it.
const FRAMES: u32 = 1 + 3 * LATENCIES.len() as u32;

pub fn run(args: &Args) -> Result<(), Failure> {
    if args.options.motion.is_none() {
        return Err(Failure::Input(anyhow!("--preset late needs a head motion: give it with --motion")));
    }
    let mut found = Results::default();
    let frames = u64::from(FRAMES * args.preset.instants);
    over_shots(args, frames, |args, progress, tracing| found.measure(args, progress, tracing))?;
    found.write(args)
}

#[derive(Default)]
struct Results {
    rows: Vec<LateRow>,
    devices: Vec<DeviceInfo>,
    notes: Vec<String>,
}

impl Results {
    /// Measures the errors at all latencies on the shot of `args`.
    fn measure(&mut self, args: &Args, progress: &Progress, tracing: &Tracing) -> Result<(), Failure> {
        let options = &args.options;
        let mut loaded = setup::load(options)?;
        let rig = &mut loaded.shot.rig;
        let optics = rig.optics.map(|optics| optics.widened(BORDER_DEG));
        rig.optics = Some(optics.unwrap_or_else(|| Optics::with_border(rig, options.size, BORDER_DEG)));
        let times_s = instants(rig, args.preset.instants).map_err(Failure::Input)?;
        let mut renderer = renderer(args, &loaded, tracing)?;
        let frame = renderer.rectified().map(|frame| RectifiedFrame::new(frame, options.size));
        self.notes.extend(frame.map(|frame| format!("{}: {frame}.", options.shot)));
        let mut found = LATENCIES.map(|_| Vec::new());
        for (begin, &time_s) in (0..).step_by(FRAMES as usize).zip(&times_s) {
            let mut number = begin;
            let mut image = |at_s: f64, later_s: Option<f64>| {
                interrupt::check()?;
                renderer.begin_anew();
                let shown_from = later_s.map(|later_s| loaded.shot.rig.at(later_s));
                let params = FrameParams { shown_from, ..renderer.frame(&loaded.shot.rig, at_s, number) };
                let frame = renderer.render(&params)?;
                number += 1;
                let event = serde_json::json!({ "event": "frame", "time_s": at_s, "makespan_ms": frame.makespan_ms });
                progress.step(format!("{:.1} ms", frame.makespan_ms), &event);
                Ok::<_, Failure>(renderer.read_linear()?)
            };
            let own = image(time_s, None)?;
            for (latency, found) in LATENCIES.into_iter().zip(&mut found) {
                let later_s = time_s + f64::from(latency) / FPS;
                let (right, again) = (image(later_s, None)?, image(later_s, None)?);
                let corrected = image(time_s, Some(later_s))?;
                let flips = [
                    flips(&right, &own, &loaded)?,
                    flips(&right, &corrected, &loaded)?,
                    flips(&right, &again, &loaded)?,
                ];
                let (turned_deg, moved_mm) = moved(&loaded.shot.rig, time_s, later_s);
                found.push(Instant { turned_deg, moved_mm, flips });
            }
        }
        let rows = LATENCIES.into_iter().zip(&found);
        self.rows.extend(rows.map(|(latency, found)| LateRow::of(&options.shot, latency, FPS, found)));
        self.devices = renderer.devices().to_vec();
        Ok(())
    }

    fn write(self, args: &Args) -> Result<(), Failure> {
        let notes = [NOTE.to_owned()].into_iter().chain(self.notes).collect();
        Findings {
            title: format!("Late reprojection of head motion, at {}", args.options.size),
            rows: &self.rows,
            files: vec![("late.csv", late_csv(&self.rows))],
            run: None,
            tables: vec![section("Late frames, uncorrected and reprojected", notes, late_table(&self.rows))],
            more: vec![section("Devices", Vec::new(), Table::of_devices([&self.devices[..]]))],
        }
        .write(args)
    }
}

/// Returns `count` evenly spaced instants of the head motion, in seconds. Each instant plus the highest latency is
/// still within the motion.
fn instants(rig: &Rig, count: u32) -> Result<Vec<f64>, anyhow::Error> {
    let longest_s = f64::from(LATENCIES[LATENCIES.len() - 1]) / FPS;
    let [first_s, last_s] = [rig.keys.first(), rig.keys.last()].map(|key| key.map_or(0.0, |key| key.time_s));
    let length_s = last_s - first_s - longest_s;
    ensure!(length_s > 0.0, "--motion: the motion is shorter than the highest latency, {:.0} ms", 1e3 * longest_s);
    Ok((0..count).map(|i| first_s + length_s * (f64::from(i) + 0.5) / f64::from(count)).collect())
}

fn renderer(args: &Args, loaded: &LoadedScene, tracing: &Tracing) -> Result<Renderer, Failure> {
    let spp = args.reference_spp.unwrap_or(SPP);
    let quality = Quality { spp, bounces: 6, denoiser: None, iterations: [0; 3], fovea: None, polar: None, scale: 1.0 };
    let options = RenderOptions { is_late: true, ..RenderOptions::single(args.options.clone(), &quality) };
    let gpus = setup::open_devices(&options, usize::from(args.virtual_devices))?;
    setup::renderer(&options, loaded, gpus, tracing.recorder.origin())
}

/// Returns the FLIP of the left and the right eye of `image`. `right` is the reference: the right (correct) image.
fn flips(right: &Stereo<RgbImage>, image: &Stereo<RgbImage>, loaded: &LoadedScene) -> Result<[f64; 2], Failure> {
    let ev = loaded.shot.exposure_ev;
    let flip = |right, image| Ok::<_, Failure>(Pair::new(right, image, ev)?.errors().flip);
    Ok([flip(&right.left, &image.left)?, flip(&right.right, &image.right)?])
}

/// Returns the rotation (degrees) and the translation (millimetres) of the left eye between two instants.
fn moved(rig: &Rig, from_s: f64, to_s: f64) -> (f64, f64) {
    let [from, to] = [from_s, to_s].map(|time_s| rig.view(time_s, Eye::Left));
    let moved = f64::from(from.origin.distance(to.origin)) * rig.metres_per_unit * 1e3;
    (f64::from(from.forward.angle_between(to.forward)).to_degrees(), moved)
}
