//! Measures image errors near the gaze while the gaze moves.

use diptych::loaded::LoadedScene;
use diptych::metrics::Pair;
use diptych::metrics::rings::Viewing;
use diptych::metrics::temporal::{Change, TemporalError};

use super::arrangement::tan_half;
use super::turns::{FPS, Turns};
use crate::bench::judge::pairs;
use crate::bench::reference::Reference;
use crate::failure::Failure;
use crate::options::RunOptions;

/// Eccentricity up to which pixels count as near the gaze, degrees.
const NEAR_DEG: f64 = 5.0;
/// Speed of the gaze, degrees per second.
const GAZE_DEG_PER_S: f64 = 15.0;

/// Angle that the gaze sweeps before it turns back, degrees.
const SWEEP_DEG: f64 = 10.0;

/// Returns the gaze, as fractions of the screen, after a horizontal sweep of `degrees` in total. The gaze moves from
/// `[x, y]` towards the middle of the screen, turns back after [`SWEEP_DEG`], or after half the screen's width if
/// that is less, and repeats. `tan_x` and `tan_y` are the tangents of half the field of view.
fn turned([x, y]: [f64; 2], [tan_x, tan_y]: [f64; 2], degrees: f64) -> [f64; 2] {
    let distance = ((1.0 - 2.0 * y) * tan_y).hypot(1.0);
    let begin = ((2.0 * x - 1.0) * tan_x / distance).atan();
    let range = SWEEP_DEG.to_radians().min((tan_x / distance).atan());
    let along = degrees.to_radians() % (2.0 * range);
    let angle = begin - (range - (range - along).abs()).copysign(begin);
    [(distance * angle.tan() / tan_x + 1.0) / 2.0, y]
}

/// Renders `all` frames with each renderer while the gaze moves and the camera and the scene are static. Returns
/// `[FLIP, flicker]` near the gaze for each renderer, as means over both eyes. The first `warm_up` frames fill the
/// history and are not compared. `begun` counts the frames that each renderer has begun; the function advances it.
pub fn with_moving_gaze(
    options: &RunOptions,
    loaded: &LoadedScene,
    reference: &Reference,
    turns: &mut Turns,
    begun: &mut u32,
    [warm_up, all]: [u32; 2],
) -> Result<Vec<[Option<f64>; 2]>, Failure> {
    let (rig, from) = (&loaded.shot.rig, loaded.shot.gaze.at(options.settings.time));
    let mut flips = vec![Some(0.0); turns.renderers.len()];
    let mut changes = vec![[Change::default(); 2]; flips.len()];
    let mut before: Vec<Option<([Pair; 2], Viewing)>> = flips.iter().map(|_| None).collect();
    for i in 0..all {
        let gaze = turned(from, tan_half(loaded, options.settings.size), GAZE_DEG_PER_S * f64::from(i + 1) / FPS);
        turns.gaze = Some([gaze; 2]);
        turns.render(options.settings.time, *begun)?;
        *begun += 1;
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
    turns.gaze = None;
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
    fn gaze_sweeps_evenly_to_the_middle_and_back() {
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
