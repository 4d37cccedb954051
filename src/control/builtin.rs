//! The built-in ladder, used if none was measured: candidates with estimated errors, and relative costs of rungs.

use std::f64::consts::PI;

use super::Rung;
use crate::graph::Stage;
use crate::passes::gbuffer::STAGE as GBUFFER;
use crate::passes::path_trace::{HOLE_FILL, STAGE as PATH_TRACE};
use crate::quality::{Denoiser, Filter, Quality};
use crate::samples::Samples;
use crate::schedule::RelativeCost;

/// Maximum samples per pixel of the candidates.
const MOST_SPP: u32 = 64;
/// Steps in which the candidates' samples double: a step is about 5 % of a frame's time, since paths take up to three
/// quarters of it.
const STEPS: u32 = 10;
/// Fractions of a sample, 1 / `PARTS`, to which the candidates' samples are rounded.
const PARTS: f64 = 16.0;
/// Maximum bounces of the candidates.
pub const BOUNCES: [u32; 5] = [1, 2, 3, 4, 6];
/// Iterations of the candidates that have a denoiser.
pub const ITERATIONS: [u32; 5] = [1, 2, 3, 4, 5];
/// Maximum iterations of the candidates that have a denoiser.
pub const MOST_ITERATIONS: u32 = ITERATIONS[ITERATIONS.len() - 1];
/// Render scales of denoised candidates that trace less than one sample per pixel.
pub const SPARSE_SCALES: [f64; 7] = [0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3];
/// Radii of the inner and the middle foveal layer, as fractions of the image width, for candidates with such layers.
pub const FOVEAE: [[f64; 2]; 3] = [[0.3, 0.6], [0.15, 0.3], [0.1, 0.2]];

/// Stages whose cost changes with samples and bounces. The cost of filters changes with the number of iterations, which
/// the graph accounts for.
pub const TRACING: [Stage; 3] = [GBUFFER, PATH_TRACE, HOLE_FILL];

/// Returns the samples per pixel of the candidates: from 1 to [`MOST_SPP`], in even ratios.
fn samples() -> impl Iterator<Item = Samples> {
    (0..=MOST_SPP.ilog2() * STEPS).map(|step| {
        let mean = (2f64.powf(f64::from(step) / f64::from(STEPS)) * PARTS).round() / PARTS;
        Samples::of_mean(mean)
    })
}

/// Returns all candidates for the built-in ladder, including those with foveal layers if `foveated`.
pub fn candidates(denoiser: Option<Denoiser>, foveated: bool) -> Vec<Quality> {
    let filters = denoiser.map_or(vec![None], |d| {
        ITERATIONS.into_iter().filter(|n| *n <= d.most_iterations()).map(|n| Some(Filter::new(d, n))).collect()
    });
    let foveae = if foveated { FOVEAE.map(Some).to_vec() } else { vec![None] };
    let mut all = Vec::new();
    for (&filter, &fovea) in filters.iter().flat_map(|i| foveae.iter().map(move |f| (i, f))) {
        for spp in samples() {
            let sparse = if spp == Samples::ONE && filter.is_some() { &SPARSE_SCALES[..] } else { &[] };
            for &scale in sparse.iter().chain(&[1.0]) {
                all.extend(BOUNCES.map(|bounces| Quality { spp, bounces, filter, fovea, polar: None, scale }));
            }
        }
    }
    all
}

/// Exposure, in stops, of the images to which [`guessed_error`] was fitted. The shot's exposure does not change it.
pub const ESTIMATES_EV: f64 = 0.0;

/// Returns the fraction of pixels that are sampled.
fn sampled_fraction(quality: &Quality) -> f64 {
    let Some(radii) = quality.fovea else { return quality.scale * quality.scale };
    // Assumes a 16:9 image with the gaze at its centre. All pixels of the inner layer are sampled, about three quarters
    // of those of the middle layer, and half of those of the outer layer.
    let [inner, outer] = radii.map(|r| (PI * r * r * 16.0 / 9.0).min(1.0));
    quality.scale * quality.scale * (0.5 + 0.25 * (inner + outer))
}

/// FLIP of frames with [`MOST_ITERATIONS`] over that with one iteration: of frames with one sample per pixel, at its
/// centre, and of frames with two, which are jittered.
pub type BlurErrors = [f64; 2];

/// Estimates the FLIP of a setting, shown at [`ESTIMATES_EV`]. The estimate combines missing light with noise and blur,
/// for which each denoiser has its own formula. `missing_light` is the fraction of light that further bounces would add.
/// `blur` replaces the denoiser's own number if it was measured.
pub fn guessed_error(quality: &Quality, missing_light: f64, blur: Option<BlurErrors>) -> f64 {
    let samples = quality.spp.mean() * sampled_fraction(quality);
    let noise = match quality.filter {
        Some(filter) => {
            let method = filter.denoiser.method();
            let most = match blur {
                None => method.estimated_blur(),
                Some([centred, _]) if quality.spp.least == 1 => centred,
                // In three scenes, the difference falls with a power of samples from -0.2 to -0.5.
                Some([_, jittered]) => 1.0 + (jittered - 1.0) * (quality.spp.mean() / 2.0).powf(-0.3),
            };
            // Each iteration changes the error half as much as the one before.
            let part = |iterations: u32| 1.0 - 0.5f64.powi(iterations as i32 - 1);
            let change = (most - 1.0) * part(filter.most_iterations()) / part(MOST_ITERATIONS);
            method.estimated_flip(samples) * (1.0 + change)
        }
        None => 0.3 * samples.powf(-0.35),
    };
    let dark = 1.55 * missing_light.powf(0.78);
    noise.hypot(dark).min(1.0)
}

/// Estimates the relative cost of path tracing without measurements. Russian roulette ends most paths after four
/// bounces.
pub fn guessed_paths(quality: &Quality) -> f64 {
    quality.spp.mean() * sampled_fraction(quality) * f64::from(1 + quality.bounces.clamp(1, 4))
}

/// Estimates the relative cost of tracing at a quality without measurements.
pub fn guessed_relative_cost(quality: &Quality) -> RelativeCost {
    RelativeCost::new([PATH_TRACE, HOLE_FILL].map(|stage| (stage, guessed_paths(quality))))
}

/// True if all rungs have a measured time of path tracing.
fn have_path_times(rungs: &[Rung]) -> bool {
    rungs.iter().all(|r| r.stage_ms.get(PATH_TRACE.name()).is_some_and(|ms| *ms > 0.0))
}

/// True if some rungs have measured stage times, but at least one rung has no time of path tracing. In this case
/// [`relative_costs`] ignores the measured times.
pub fn lack_path_times(rungs: &[Rung]) -> bool {
    rungs.iter().any(|r| !r.stage_ms.is_empty()) && !have_path_times(rungs)
}

/// Least number of rays per pixel from which a stage's relative cost is taken. With fewer, as in hole filling where
/// nothing is disoccluded, the ratio of two rungs is noise.
const MIN_RAYS: f64 = 1e-3;

/// Returns the relative cost of tracing on each rung. It is the number of rays of stages that trace paths if all rungs
/// have it. Otherwise it is their measured time if all rungs have one of path tracing, or an estimate. A rung's relative
/// cost of path tracing does not depend on the other rungs, so costs learned with one set of rungs hold for another.
pub fn relative_costs(rungs: &[Rung]) -> Vec<RelativeCost> {
    let are_timed = have_path_times(rungs);
    let Some(first) = rungs.first() else { return Vec::new() };
    let measured = |rung: &Rung, stage: Stage| {
        let ms = |r: &Rung| r.stage_ms.get(stage.name()).copied().filter(|ms| *ms > 0.0);
        let unit = if stage == GBUFFER { ms(first)? } else { 1.0 };
        Some((stage, ms(rung)? / unit))
    };
    let traces = [PATH_TRACE, HOLE_FILL];
    let rays = |rung: &Rung, stage: Stage| rung.rays.get(stage.name()).copied().filter(|rays| *rays > MIN_RAYS);
    let are_counted = |stage: Stage| rungs.iter().all(|rung| rays(rung, stage).is_some());
    let (counts_paths, counts_holes) = (are_counted(PATH_TRACE), are_counted(HOLE_FILL));
    let of = |rung: &Rung| match are_timed {
        true if counts_paths => {
            // Without enough rays in holes, their number is assumed to rise like that of all paths.
            let holes = if counts_holes { HOLE_FILL } else { PATH_TRACE };
            let counted = traces.into_iter().zip([PATH_TRACE, holes]);
            let counted = counted.filter_map(|(stage, like)| Some((stage, rays(rung, like)?)));
            RelativeCost::new(counted.chain(measured(rung, GBUFFER)))
        }
        true => RelativeCost::new(TRACING.into_iter().filter_map(|stage| measured(rung, stage))),
        false => guessed_relative_cost(&rung.quality),
    };
    rungs.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rung(spp: u32, bounces: u32, path_ms: Option<f64>) -> Rung {
        let filter = Some(Filter::new(Denoiser::SVGF, 3));
        let quality = Quality { spp: spp.into(), bounces, filter, ..Quality::default() };
        let stage_ms = path_ms.map(|ms| ("path_trace".to_owned(), ms)).into_iter().collect();
        let rays = Default::default();
        let (flip, flicker, relmse, is_estimated) = (None, None, None, true);
        Rung { time_ms: 1.0, error: 0.1, flip, flicker, relmse, is_estimated, quality, stage_ms, rays }
    }

    #[test]
    fn guessed_error_falls_with_each_quality_setting() {
        let svgf = Some(Denoiser::SVGF);
        for (all, count) in [(candidates(svgf, false), 1700), (candidates(svgf, true), 5100)] {
            assert_eq!(all.len(), count);
            for a in &all {
                let missing_light = |k: &Quality| 0.2 * 0.5f64.powi(k.bounces as i32);
                let error = |k: &Quality| guessed_error(k, missing_light(k), None);
                assert!((0.0..1.0).contains(&error(a)));
                let more = |b: &&Quality| {
                    let wider = b.fovea.zip(a.fovea).is_none_or(|([b, _], [a, _])| b >= a);
                    let numbers = |q: &Quality| (q.spp.mean(), q.bounces, q.iterations());
                    let ((bs, bb, bi), (s, bounces, i)) = (numbers(b), numbers(a));
                    bs >= s && bb >= bounces && bi == i && b.scale >= a.scale && wider && *b != a
                };
                assert!(all.iter().filter(more).all(|b| error(b) < error(a)), "{a:?}");
            }
        }
        let blurred = |iterations, blur: f64| {
            let filter = Some(Filter::new(Denoiser::SVGF, iterations));
            guessed_error(&Quality { filter, ..Quality::default() }, 0.1, Some([blur, 1.0]))
        };
        assert!(blurred(1, 1.1) < blurred(2, 1.1) && blurred(2, 1.1) < blurred(5, 1.1));
        assert!(blurred(1, 0.9) > blurred(2, 0.9) && blurred(1, 0.9) == blurred(1, 1.1));
        let fitted = candidates(Some(Denoiser::BMFR), true);
        assert!(fitted.len() == 1020 && fitted.iter().all(|q| q.iterations() == [1; 3] && q.check().is_ok()));
        assert!(candidates(None, false).iter().all(|q| q.filter.is_none() && q.scale == 1.0));
    }

    #[test]
    fn relative_costs_are_measured_where_all_rungs_are() {
        let of = |rungs: &[Rung]| relative_costs(rungs).iter().map(|e| e.of(PATH_TRACE)).collect::<Vec<_>>();
        assert_eq!(of(&[rung(1, 1, Some(2.0)), rung(4, 1, Some(9.0))]), [2.0, 9.0]);
        let counted = |spp: u32, rays: f64| Rung {
            rays: [("path_trace".to_owned(), rays), ("hole_fill".to_owned(), 0.0)].into(),
            ..rung(spp, 1, Some(f64::from(spp)))
        };
        assert_eq!(of(&[counted(1, 3.0), counted(4, 12.0)]), [3.0, 12.0]);
        assert_eq!(of(&[counted(1, 3.0), rung(4, 1, Some(9.0))]), [1.0, 9.0]);
        let holes = relative_costs(&[counted(1, 3.0), counted(4, 12.0)]);
        assert_eq!(holes[1].of(HOLE_FILL), 12.0);
        let mixed = [rung(1, 1, Some(2.0)), rung(4, 2, None)];
        assert_eq!(of(&mixed), [2.0, 12.0]);
        assert!(lack_path_times(&mixed) && !lack_path_times(&mixed[..1]) && !lack_path_times(&mixed[1..]));
    }
}
