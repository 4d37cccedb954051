//! The ladder to fall back on: candidates whose errors are guessed, and what rungs cost one another.

use super::{Knobs, Rung};
use crate::graph::Stage;
use crate::schedule::Effort;

/// Samples per pixel and bounces of the candidates, and iterations of those that filter.
pub const SPP: [u32; 8] = [1, 2, 3, 4, 5, 6, 7, 8];
pub const BOUNCES: [u32; 5] = [1, 2, 3, 4, 6];
pub const ITERATIONS: [u32; 5] = [1, 2, 3, 4, 5];

/// Stages whose cost changes with samples and bounces. Those of filters go with the number of iterations, which graphs
/// have.
pub const TRACING: [Stage; 3] = [Stage::Gbuffer, Stage::PathTrace, Stage::HoleFill];

/// All settings that the built-in ladder may have; `denoiser` as the command line names it.
pub fn candidates(denoiser: &str) -> Vec<Knobs> {
    let iterations: &[u32] = if denoiser == "none" { &[0] } else { &ITERATIONS };
    let knobs = |spp, bounces, iterations| Knobs {
        spp,
        bounces,
        denoiser: denoiser.to_owned(),
        iterations,
        fovea: None,
        scale: 1.0,
    };
    let of = |&iterations: &u32| SPP.map(|spp| BOUNCES.map(|bounces| knobs(spp, bounces, iterations))).concat();
    iterations.iter().flat_map(of).collect()
}

/// A number that falls as pictures are expected to get better: noise, which samples and iterations average down, and
/// light that is missing, half of it with each bounce. It only puts settings in order and was not measured.
pub fn guessed_error(knobs: &Knobs) -> f64 {
    let filtered = if knobs.iterations == 0 { 1.5 } else { 0.55 + 0.45 * 0.5f64.powi(knobs.iterations as i32 - 1) };
    let noise = 0.12 * filtered / f64::from(knobs.spp).sqrt();
    noise + 0.25 * 0.5f64.powi(knobs.bounces.clamp(1, 30) as i32)
}

/// Path tracing's work, where nothing was measured: Russian roulette ends most paths after four reflections.
pub fn guessed_paths(knobs: &Knobs) -> f64 {
    f64::from(knobs.spp) * f64::from(1 + knobs.bounces.clamp(1, 4))
}

/// What tracing costs on each rung, held against the first. From the rungs' own times if all have them, else guessed.
pub fn efforts(rungs: &[Rung]) -> Vec<Effort> {
    let paths = Stage::PathTrace.name();
    let are_timed = rungs.iter().all(|r| r.stage_ms.get(paths).is_some_and(|ms| *ms > 0.0));
    let Some(first) = rungs.first() else { return Vec::new() };
    let measured = |rung: &Rung, stage: Stage| {
        let ms = |r: &Rung| r.stage_ms.get(stage.name()).copied().filter(|ms| *ms > 0.0);
        Some((stage, ms(rung)? / ms(first)?))
    };
    let guessed = |rung: &Rung| {
        let paths = guessed_paths(&rung.knobs) / guessed_paths(&first.knobs);
        Effort::new([(Stage::PathTrace, paths), (Stage::HoleFill, paths)])
    };
    let of = |rung: &Rung| match are_timed {
        true => Effort::new(TRACING.into_iter().filter_map(|stage| measured(rung, stage))),
        false => guessed(rung),
    };
    rungs.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rung(spp: u32, bounces: u32, path_ms: Option<f64>) -> Rung {
        let knobs = Knobs { spp, bounces, denoiser: "svgf".into(), iterations: 3, fovea: None, scale: 1.0 };
        let stage_ms = path_ms.map(|ms| ("path_trace".to_owned(), ms)).into_iter().collect();
        Rung { time_ms: 1.0, flip: 0.1, relmse: 0.1, knobs, stage_ms }
    }

    #[test]
    fn more_of_anything_is_guessed_to_be_better_and_a_flip_that_files_may_have() {
        let all = candidates("svgf");
        assert_eq!(all.len(), 200);
        for a in &all {
            assert!((0.0..1.0).contains(&guessed_error(a)));
            let more = |b: &&Knobs| b.spp >= a.spp && b.bounces >= a.bounces && b.iterations >= a.iterations && *b != a;
            assert!(all.iter().filter(more).all(|b| guessed_error(b) < guessed_error(a)), "{a:?}");
        }
        assert!(candidates("none").iter().all(|k| k.iterations == 0));
    }

    #[test]
    fn efforts_are_measured_where_all_rungs_are() {
        let of = |rungs: &[Rung]| efforts(rungs).iter().map(|e| e.of(Stage::PathTrace)).collect::<Vec<_>>();
        assert_eq!(of(&[rung(1, 1, Some(2.0)), rung(4, 1, Some(9.0))]), [1.0, 4.5]);
        assert_eq!(of(&[rung(1, 1, Some(2.0)), rung(4, 2, None)]), [1.0, 6.0]);
    }
}
