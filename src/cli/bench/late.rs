//! Measures frames that are displayed later than their pose was sampled, with and without late reprojection, against
//! frames rendered from the pose of display (the true pose).

use super::args::Args;
use super::axes::FPS;
use super::instants::before_latency;
use super::judge::Judge;
use super::reference::Reference;
use super::turns::Turns;
use crate::cli::failure::Failure;
use crate::loaded::LoadedScene;
use crate::report::bench::Measured;
use crate::report::experiment::{Experiment, Found, FrameTimes, LATENCY, OtherMeasures};
use crate::report::frames::FrameLine;
use crate::scene::rig::{Eye, Rig};

/// Frames per arrangement and instant: one rendered from the instant's own pose, two rendered from the true pose, and
/// one reprojected to it.
pub const FRAMES: u32 = 4;

/// Measures all arrangements at several instants. `others` has each arrangement's measures that do not depend on
/// frames.
pub fn measure(
    args: &Args,
    experiment: &Experiment,
    loaded: &LoadedScene,
    turns: &mut Turns,
    others: Vec<OtherMeasures>,
) -> Result<Vec<Found>, Failure> {
    let rig = &loaded.shot.rig;
    let latencies = experiment.all.iter().map(|arrangement| arrangement.late_frames.unwrap_or(0));
    let longest_s = f64::from(latencies.clone().max().unwrap_or(0)) / FPS;
    let times_s = before_latency(rig, longest_s, args.of_study().instants).map_err(Failure::Input)?;
    let mut all = Vec::new();
    for (which, (latency, others)) in (0..).zip(latencies.clone().zip(others)) {
        let latency_s = f64::from(latency) / FPS;
        let mut found = Found { others, ..Found::default() };
        let mut moves = [0.0; 2];
        for (instant, &time_s) in (0..).zip(&times_s) {
            // Arrangements share the random numbers of the late frame, and no other frames have the same.
            let own = instant * (1 + 3 * experiment.all.len() as u32);
            let first = own + 1 + 3 * which;
            let later_s = time_s + latency_s;
            let mut image = |number: u32, at_s: f64, later_s: Option<f64>| {
                let report = turns.alone(which as usize, at_s, number, later_s)?;
                let row = turns.keep(which as usize, at_s, &report, instant);
                Ok::<_, Failure>((report, row, turns.renderers[which as usize].read_linear()?))
            };
            let late = image(own, time_s, None)?;
            found.times.push(FrameTimes::measured(&late.0));
            found.lines.push(FrameLine::from(&late.1));
            let (_, _, right) = image(first, later_s, None)?;
            let reference = Reference::of_frame(right);
            let judge = |(report, row, image)| -> Result<Measured, Failure> {
                let mut judge = Judge::new(loaded, &reference, later_s);
                judge.add(&report, &row, &image)?;
                Ok(judge.conclude())
            };
            found.instants.push(judge(late)?);
            found.repeated.push(judge(image(first + 1, later_s, None)?)?);
            found.corrected.push(judge(image(first + 2, time_s, Some(later_s))?)?);
            let moved = moved(rig, time_s, later_s);
            moves = [0, 1].map(|i| moves[i] + moved[i]);
        }
        let [turned_deg, moved_mm] = moves.map(|sum| sum / times_s.len() as f64);
        found.others.extend(LATENCY.into_iter().zip([f64::from(latency), 1e3 * latency_s, turned_deg, moved_mm]));
        all.push(found);
    }
    Ok(all)
}

/// Returns the rotation (degrees) and the translation (millimetres) of the left eye between two instants.
fn moved(rig: &Rig, from_s: f64, to_s: f64) -> [f64; 2] {
    let [from, to] = [from_s, to_s].map(|time_s| rig.view(time_s, Eye::Left));
    let moved = f64::from(from.origin.distance(to.origin)) * rig.metres_per_unit * 1e3;
    [f64::from(from.forward.angle_between(to.forward)).to_degrees(), moved]
}
