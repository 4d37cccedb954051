//! Quality ladders and their files: written ladders can be read, invalid ones are rejected with a reason, and fronts
//! are Pareto optimal.

use diptych::control::{Ladder, MIN_STEP, Measure, Origin, Rung, STEEPEST};
use diptych::quality::Denoiser;
use proptest::prelude::*;

use super::hold;
use super::plant::{ladder, times};

fn three() -> Ladder {
    ladder(&times(10.0, &[1.5, 1.5]))
}

fn refusal(text: &str) -> String {
    Ladder::parse(text).expect_err(text).to_string()
}

#[test]
fn ladder_round_trips_through_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ladder.toml");
    let mut rungs = three().rungs().to_vec();
    rungs[1].quality.fovea = Some([0.15, 0.3]);
    rungs[1].time_ms = 15.000_000_000_000_002;
    rungs[2].stage_ms.insert("path_trace".into(), 1.0 / 3.0);
    let written = Ladder::new(three().origin().clone(), rungs).unwrap();
    written.write(&path).unwrap();
    assert_eq!(Ladder::read(&path).unwrap(), written);
}

#[test]
fn estimated_values_are_marked_in_the_file() {
    let mut rungs = three().rungs().to_vec();
    rungs.iter_mut().for_each(|r| (r.flip, r.flicker, r.relmse, r.is_estimated) = (None, None, None, true));
    rungs[0].stage_ms.insert("path_trace".into(), 1.5);
    let origin = Origin { measure: Measure::Estimate, ..three().origin().clone() };
    let estimated = Ladder::new(origin, rungs).unwrap();
    let text = estimated.text().unwrap();
    for key in ["measure = \"estimate\"", "estimated = true", "estimated_ms = 10.0", "estimated_error = 0.9"] {
        assert!(text.contains(key), "{key}: {text}");
    }
    for key in ["\ntime_ms", "\nerror", "flip", "flicker", "relmse", ".stage_ms"] {
        assert!(!text.contains(key), "{key}: {text}");
    }
    assert_eq!(Ladder::parse(&text).unwrap(), estimated);
}

/// Ladders from before rungs were judged over frames: FLIP alone, from `bench`, or estimates left by `play`.
#[test]
fn old_ladders_keep_their_meaning() {
    let text = |version: &str| {
        format!(
            "[origin]\nshot = 's'\nsize = '8x8'\ndevices = []\nversion = '{version}'\n\
             [[rung]]\ntime_ms = 10.0\nflip = 0.4\nrelmse = 0.3\n\
             knobs = {{ spp = 1, bounces = 2, denoiser = 'svgf', iterations = 5, scale = 1.0 }}\n\
             [[rung]]\ntime_ms = 20.0\nflip = 0.2\n\
             knobs = {{ spp = 2, bounces = 2, denoiser = 'none', iterations = 0, scale = 1.0 }}\n"
        )
    };
    let measured = Ladder::parse(&text("0.1.0")).unwrap();
    let rung = &measured.rungs()[0];
    assert_eq!((measured.origin().measure, rung.error, rung.flip, rung.flicker), (Measure::Flip, 0.4, Some(0.4), None));
    assert!(!rung.is_estimated && rung.relmse == Some(0.3));
    assert_eq!(measured.denoisers(), [(Some(Denoiser::SVGF), 1), (None, 1)]);
    let estimated = Ladder::parse(&text("0.1.0; flip is estimated")).unwrap();
    let rung = &estimated.rungs()[1];
    assert_eq!((estimated.origin().measure, rung.error, rung.flip), (Measure::Estimate, 0.2, None));
    assert!(rung.is_estimated);
}

#[test]
fn rejects_invalid_ladders_with_the_reason() {
    let text = three().text().unwrap();
    assert!(Ladder::parse(&text).is_ok());
    let changed = |from: &str, to: &str| {
        assert!(text.contains(from), "{from} in {text}");
        refusal(&text.replacen(from, to, 1))
    };
    for (from, to, part) in [
        ("time_ms = 15.0", "time_ms = 10.0", "rung 2: its 10 ms are not more than the 10 ms of the rung before"),
        ("time_ms = 15.0", "time_ms = nan", "rung 2: time_ms NaN is out of range"),
        ("time_ms = 10.0", "time_ms = -1.0", "rung 1: time_ms -1 is out of range"),
        ("time_ms = 10.0", "time_ms = inf", "rung 1: time_ms inf is out of range"),
        ("error = 0.9", "error = 0.2", "rung 2: its error, 0.45, is not below the 0.2 of the rung before"),
        ("error = 0.9", "error = 2.5", "rung 1: error 2.5 is out of range"),
        ("flip = 0.8", "flip = 1.5", "rung 1: flip 1.5 is out of range"),
        ("flicker = 0.1", "flicker = -0.1", "rung 1: flicker -0.1 is out of range"),
        ("spp = 1", "spp = 0", "rung 1: spp 0 is out of range"),
        ("spp = 1", "spp = -1", "spp"),
        ("scale = 1.0", "scale = 0.0", "rung 1: scale 0 is out of range"),
        ("scale = 1.0", "scale = 1.0\nfovea = [0.3, 0.15]", "rung 1: fovea's outer radius 0.15 is out of range"),
        ("spp = 1", "spp = 1\nssp = 2", "unknown field `ssp`"),
        ("error = 0.9", "", "rung 1: it has no error"),
        ("time_ms = 15.0", "", "rung 2: it has no time_ms"),
        ("error = 0.9", "estimated = true", "rung 1: it has no estimated_ms"),
        ("flip_flicker", "beauty", "unknown variant `beauty`"),
        ("relmse = 0.1", "relmse = -1.0", "rung 1: relmse -1 is out of range"),
        ("denoiser = \"none\"", "denoiser = \"\"", "the denoiser \"\" is unknown"),
        ("[origin]", "[origin", "not a valid ladder file"),
    ] {
        let message = changed(from, to);
        assert!(message.contains(part), "{to}: {message}");
    }
    let origin = text.split("[[rung]]").next().unwrap();
    assert_eq!(refusal(origin), "the ladder has no rungs");
    let missing = Ladder::read("/nowhere/ladder.toml".as_ref()).unwrap_err().to_string();
    assert!(missing.contains("/nowhere/ladder.toml"), "{missing}");
}

#[test]
fn front_keeps_exactly_the_efficient_settings() {
    let template = three().rungs()[0].clone();
    let points = prop::collection::vec((1.0f64..20.0, 0.01f64..1.0), 1..60);
    hold(points, |points| {
        let rung = |&(time_ms, error): &(f64, f64)| Rung { time_ms, error, ..template.clone() };
        let measured: Vec<Rung> = points.iter().map(rung).collect();
        let front = Ladder::of_measured(three().origin().clone(), &measured).unwrap();
        let rungs = front.rungs();
        for step in rungs.windows(2) {
            let (saved, lost) = (step[1].time_ms / step[0].time_ms, step[0].error / step[1].error);
            assert!(saved >= 1.0 + MIN_STEP && lost > 1.0 && lost <= saved.powf(STEEPEST), "{step:?}");
        }
        for other in &measured {
            assert!(!rungs.iter().any(|r| other.time_ms < r.time_ms && other.error <= r.error));
            // A setting off the ladder has one of two reasons. It is no better than a rung that costs no more, within
            // the step, or it saves too little against a better rung.
            let reach_ms = other.time_ms * (1.0 + MIN_STEP);
            let is_beaten = rungs.iter().any(|r| r.time_ms <= reach_ms && r.error <= other.error);
            let is_steep = |r: &Rung| other.error / r.error > (r.time_ms / other.time_ms).powf(STEEPEST);
            let mut better = rungs.iter().filter(|r| r.time_ms > other.time_ms);
            assert!(is_beaten || better.any(is_steep), "{other:?} is missing");
        }
    });
}

#[test]
fn settings_without_finite_numbers_are_on_no_front() {
    let mut measured = three().rungs().to_vec();
    measured[0].time_ms = f64::NAN;
    measured[1].error = f64::INFINITY;
    let origin = three().origin().clone();
    assert_eq!(Ladder::of_measured(origin.clone(), &measured).unwrap().rungs(), &measured[2..]);
    let message = Ladder::of_measured(origin, &measured[..2]).unwrap_err().to_string();
    assert_eq!(message, "the ladder has no rungs");
}

#[test]
fn interpolated_rungs_differ_only_in_samples() {
    let mut rungs = ladder(&times(10.0, &[2.0, 1.5])).rungs().to_vec();
    rungs[1].quality.spp = 4.into();
    (rungs[2].quality.spp, rungs[2].quality.bounces) = (6.into(), 2);
    for (rung, rays) in rungs.iter_mut().zip([2.0, 8.0, 9.0]) {
        rung.rays.insert("path_trace".into(), rays);
        rung.stage_ms.insert("path_trace".into(), rung.time_ms / 2.0);
    }
    let measured = Ladder::new(three().origin().clone(), rungs).unwrap();
    let fine = measured.clone().refined();
    let added: Vec<&Rung> = fine.rungs().iter().filter(|rung| !measured.rungs().contains(rung)).collect();
    assert_eq!(fine.rungs().len(), measured.rungs().len() + added.len(), "measured rungs stay");
    for pair in fine.rungs().windows(2).filter(|pair| pair[1].quality.bounces == pair[0].quality.bounces) {
        let [low, high] = [&pair[0], &pair[1]];
        let step = high.time_ms / low.time_ms;
        assert!(1.0 < step && step <= 1.05 + 1e-9 && high.error < low.error, "{low:?} {high:?}");
    }
    for rung in added {
        let mean = rung.quality.spp.mean();
        let part = (mean - 1.0) / 3.0;
        assert!(rung.is_estimated && rung.flip.is_none() && 1.0 < mean && mean < 4.0, "{rung:?}");
        let off = [rung.time_ms - (10.0 + 10.0 * part), rung.rays["path_trace"] - (2.0 + 6.0 * part)];
        assert!(off.iter().all(|off| off.abs() < 1e-9), "{rung:?}");
    }
    let text = fine.text().unwrap();
    assert_eq!(Ladder::parse(&text).unwrap(), fine);
    assert_eq!(fine.clone().refined(), fine, "added rungs get no others between them");
}
