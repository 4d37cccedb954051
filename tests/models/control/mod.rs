//! The control loop keeps its budget on simulated renderers with random ladders: under any load, with wrong
//! predictions, and when frame times arrive one to three frames late.
//!
//! `DIPTYCH_CONTROL_CASES` sets the number of cases of each test.

mod ladder;
mod plant;

use std::fmt::Debug;
use std::sync::atomic::{AtomicUsize, Ordering};

use diptych::control::{Budget, CLIMB_BACK_AFTER, CLIMB_EVERY, Controller};
use plant::{HI_MS, LO_MS, Plant, Run, times};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

fn hold<S: Strategy>(strategy: S, case: impl Fn(S::Value))
where
    S::Value: Debug,
{
    let cases = std::env::var("DIPTYCH_CONTROL_CASES").map_or(200, |n| n.parse().expect("a number of cases"));
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let result = TestRunner::new(config).run(&strategy, |value| {
        case(value);
        Ok(())
    });
    result.unwrap_or_else(|failure| panic!("{failure}"));
}

/// Generates the times of ladders from at most 4 ms to at least 55 ms. Their steps are so fine that for any load from
/// 1/3 to 2.5 some rung lies between the band's lower end and the target, with the margin for scatter.
fn ladders() -> impl Strategy<Value = Vec<f64>> {
    let steps = prop::collection::vec(1.03f64..1.3, 130);
    (1.5f64..4.0, steps).prop_map(|(floor_ms, steps)| {
        let mut times_ms = times(floor_ms, &steps);
        let enough = times_ms.iter().position(|ms| *ms > 55.0).unwrap_or(130);
        times_ms.truncate(enough + 1);
        times_ms
    })
}

/// Generates the number of frames in flight besides the one to decide.
fn delays() -> std::ops::RangeInclusive<usize> {
    0..=2
}

/// Generates factors around 1, as likely below as above.
fn factors(most: f64) -> impl Strategy<Value = f64> {
    (-1.0f64..1.0).prop_map(move |x| most.powf(x))
}

/// Runs a controller on a load that steps from 1 to another value at frame 100, with predictions off by a factor.
fn step(times_ms: &[f64], load: f64, bias: f64, delay: usize, frames: usize) -> Run {
    let at = |frame: usize| if frame < 100 { 1.0 } else { load };
    Plant { delay, predicted_ms: Some(&|_, rung| bias * times_ms[rung]), ..Plant::new(times_ms, &at) }.run(frames)
}

#[test]
fn twice_the_load_is_back_in_the_band_within_10_frames_and_stays_without_a_change() {
    hold((ladders(), factors(2.0), delays()), |(times_ms, bias, delay)| {
        let run = step(&times_ms, 2.0, bias, delay, 400);
        assert_eq!(run.outside_from(110), None);
        assert_eq!(run.changes_from(150), 0);
    });
}

#[test]
fn any_step_ends_in_the_band_and_stays_without_a_change() {
    hold((ladders(), factors(2.5), factors(2.0), delays()), |(times_ms, load, bias, delay)| {
        let climbs = CLIMB_EVERY as usize * times_ms.len();
        let run = step(&times_ms, load, bias, delay, 400 + climbs);
        assert_eq!(run.outside_from(150 + climbs), None);
        assert_eq!(run.changes_from(150 + climbs), 0);
    });
}

#[test]
fn predictions_off_by_up_to_2_are_made_up_for_within_10_frames() {
    hold((ladders(), factors(2.0), delays()), |(times_ms, bias, delay)| {
        let run = step(&times_ms, 1.0, bias, delay, 100);
        let late = run.0.iter().skip(10).find(|s| s.mean_ms > HI_MS);
        assert!(late.is_none(), "{:?}", late.map(|s| s.mean_ms));
    });
}

#[test]
fn a_predictor_that_learns_by_itself_is_not_corrected_twice() {
    hold((ladders(), delays()), |(times_ms, delay)| {
        let load = |frame: usize| if frame < 100 { 1.0 } else { 2.0 };
        let learned = |frame: usize| load(frame.saturating_sub(delay + 2));
        let predicted_ms = |frame: usize, rung: usize| learned(frame) * times_ms[rung];
        let run = Plant { delay, predicted_ms: Some(&predicted_ms), ..Plant::new(&times_ms, &load) }.run(300);
        assert_eq!(run.outside_from(110), None);
    });
}

#[test]
fn a_ramp_is_followed_with_a_tenth_over_the_band_at_most() {
    hold((ladders(), delays()), |(times_ms, delay)| {
        let load = |frame: usize| 1.01f64.powi((frame as i32 - 100).clamp(0, 90));
        let run = Plant { delay, ..Plant::new(&times_ms, &load) }.run(500);
        let worst_ms = run.0.iter().map(|s| s.mean_ms).fold(0.0, f64::max);
        assert!(worst_ms < 1.1 * HI_MS, "{worst_ms}");
        assert!(run.0.iter().all(|s| s.mean_ms >= LO_MS));
        let late = run.share_from(100, |s| s.mean_ms > HI_MS);
        assert!(late < 0.15, "{late} of the frames were late");
        assert_eq!(run.outside_from(200), None);
        // The controller took the ramp for scatter. Once that margin decays, it may change the rung once more.
        assert!(run.changes_from(250) <= 1);
    });
}

/// Bounds the fraction of late frames and the changes per 1,000 frames under noise. The maxima in 10,000 cases were 3
/// and 49 changes.
fn noise_holds(noise: f64, late_max: f64, changes_max: usize) {
    let most = AtomicUsize::new(0);
    hold((ladders(), any::<u64>(), factors(2.0), delays()), |(times_ms, seed, bias, delay)| {
        let predicted_ms = |_, rung: usize| bias * times_ms[rung];
        let run = Plant { noise, seed, delay, predicted_ms: Some(&predicted_ms), ..Plant::new(&times_ms, &|_| 1.0) }
            .run(1200);
        let changes = run.changes_from(200);
        most.fetch_max(changes, Ordering::Relaxed);
        assert!(changes <= changes_max, "{changes} changes in 1000 frames");
        let late = run.share_from(200, |s| s.ms > HI_MS);
        assert!(late <= late_max, "{late} of the frames were late");
        let off = run.share_from(200, |s| !(LO_MS..=HI_MS).contains(&s.mean_ms));
        // The maximum in 40,000 cases was 0.058.
        assert!(off <= 0.08, "{off} of the frames were planned outside the band");
    });
    println!("noise of {noise}: at most {} changes in 1000 frames", most.into_inner());
}

#[test]
fn noise_of_5_percent_moves_little() {
    noise_holds(0.05, 0.1, 8);
}

#[test]
fn noise_of_15_percent_moves_little() {
    noise_holds(0.15, 0.12, 62);
}

#[test]
fn a_frame_that_takes_10_times_as_long_changes_nothing() {
    hold((ladders(), 100usize..200, delays()), |(times_ms, at, delay)| {
        let load = |frame: usize| if frame == at { 10.0 } else { 1.0 };
        let plant = Plant { delay, ..Plant::new(&times_ms, &load) };
        assert_eq!(plant.run(300).changes_from(50), 0);
    });
}

#[test]
fn a_spike_among_noise_leads_to_one_drop_at_most_and_10_frames_later_the_band_is_kept() {
    hold((ladders(), any::<u64>(), delays()), |(times_ms, seed, delay)| {
        let run = |spike: f64| {
            let load = |frame: usize| if frame == 300 { spike } else { 1.0 };
            Plant { noise: 0.05, seed, delay, ..Plant::new(&times_ms, &load) }.run(400)
        };
        let (with, without) = (run(10.0), run(1.0));
        let rungs = |run: &Run| -> Vec<usize> { run.0[299..340].iter().map(|s| s.decision.rung).collect() };
        let drops = |run: &Run| rungs(run).windows(2).filter(|pair| pair[1] < pair[0]).count();
        assert!(drops(&with) <= drops(&without) + 1, "{:?}, {:?}", rungs(&with), rungs(&without));
        assert_eq!(with.outside_from(310), None);
    });
}

#[test]
fn without_a_rung_that_fits_the_floor_is_held_and_said() {
    hold((ladders(), 1.2f64..4.0, delays()), |(times_ms, over, delay)| {
        let heavy = over * HI_MS / times_ms[0];
        let load = |frame: usize| if (100..200).contains(&frame) { heavy } else { 1.0 };
        let run = Plant { delay, ..Plant::new(&times_ms, &load) }.run(1000);
        assert!(run.0[110..200].iter().all(|s| s.decision.rung == 0 && !s.decision.fits));
        assert!(run.0[..100].iter().chain(&run.0[210..]).all(|s| s.decision.fits));
        assert_eq!(run.outside_from(300 + CLIMB_EVERY as usize * times_ms.len()), None);
    });
}

#[test]
fn climbs_are_apart_and_within_the_band_by_one_rung_and_drops_need_not_be() {
    hold((ladders(), any::<u64>(), delays()), |(times_ms, seed, delay)| {
        let load = |frame: usize| [1.0, 2.5, 0.4][frame / 150 % 3];
        let plant = Plant { noise: 0.1, seed, delay, ..Plant::new(&times_ms, &load) };
        let steps = plant.run(900).0;
        let rungs: Vec<usize> = steps.iter().map(|s| s.decision.rung).collect();
        let (mut changed_at, mut largest_drop) = (0, 0);
        for (frame, pair) in rungs.windows(2).enumerate() {
            if pair[1] > pair[0] {
                let expected_ms = steps[frame + 1].decision.expected_ms;
                assert!(expected_ms <= HI_MS / 1.03, "{expected_ms}");
                // Allow for rounding.
                let is_below = expected_ms * times_ms[pair[0]] / times_ms[pair[1]] < LO_MS * 1.000_001;
                assert!(is_below || pair[1] == pair[0] + 1, "{pair:?}");
                let wait = if is_below { CLIMB_BACK_AFTER } else { CLIMB_EVERY };
                assert!(frame + 1 - changed_at >= wait as usize, "{changed_at} and {}", frame + 1);
            }
            if pair[1] != pair[0] {
                changed_at = frame + 1;
                largest_drop = largest_drop.max(pair[0].saturating_sub(pair[1]));
            }
        }
        assert!(largest_drop > 1);
    });
}

/// The rungs take 14 and 39 ms in a budget of 25 to 45. The expensive one fits, whatever the cheap one costs, and is
/// chosen again after a load under which it did not fit.
#[test]
fn a_gap_in_the_ladder_is_crossed_to_the_rung_within_the_band() {
    let most = AtomicUsize::new(0);
    let case = (0.0f64..0.12, any::<bool>(), any::<u64>(), factors(2.0), delays());
    hold(case, |(noise, has_middle, seed, bias, delay)| {
        // With another rung in the band, the noise is reduced, so that scatter stays below a step.
        let (times_ms, noise) =
            if has_middle { (&[14.0, 26.0, 39.0][..], noise / 3.0) } else { (&[14.0, 39.0][..], noise) };
        let load = |frame: usize| if (100..140).contains(&frame) { 3.0 } else { 1.0 };
        let predicted_ms = |_, rung: usize| bias * times_ms[rung];
        let plant = Plant { noise, seed, delay, predicted_ms: Some(&predicted_ms), ..Plant::new(times_ms, &load) };
        let run = plant.run_with(Controller::new(&plant::ladder(times_ms), Budget::new(25.0, 45.0).unwrap()), 1140);
        let within = |from: usize| run.share_from(from, |s| s.mean_ms == 39.0);
        assert!(run.0[120..140].iter().all(|s| s.decision.rung == 0), "three times the load fits at the floor alone");
        assert!(within(190) > 0.95, "noise {noise}: {}", within(190));
        most.fetch_max(run.changes_from(190), Ordering::Relaxed);
        assert!(run.changes_from(190) <= 20, "noise {noise}: {} changes", run.changes_from(190));
    });
    println!("over a gap: at most {} changes in 950 frames", most.into_inner());
}

#[test]
fn the_dearest_rung_that_stays_inside_the_band_is_taken() {
    let dearest = |times_ms: &[f64], [lo_ms, hi_ms]: [f64; 2], load: &dyn Fn(usize) -> f64| {
        let plant = Plant::new(times_ms, load);
        let controller = Controller::new(&plant::ladder(times_ms), Budget::new(lo_ms, hi_ms).unwrap());
        let run = plant.run_with(controller, 200);
        assert_eq!(run.changes_from(150), 0);
        times_ms[run.0[199].decision.rung]
    };
    let calm = |_: usize| 1.0;
    // The rung is reached from the start, and from below after a temporary load.
    for load in [&calm as &dyn Fn(usize) -> f64, &|frame| if frame < 50 { 2.5 } else { 1.0 }] {
        assert_eq!(dearest(&[14.0, 39.0], [25.0, 45.0], load), 39.0);
        assert_eq!(dearest(&[14.0, 26.0, 30.0, 39.0, 44.9], [25.0, 45.0], load), 39.0);
        assert_eq!(dearest(&[14.0, 26.0, 42.0], [25.0, 45.0], load), 42.0);
        // A rung close to the upper end of the band is better than one below the band. A rung above it is not.
        assert_eq!(dearest(&[14.0, 43.0], [25.0, 45.0], load), 43.0);
        assert_eq!(dearest(&[14.0, 46.0], [25.0, 45.0], load), 14.0);
    }
}

#[test]
fn a_rung_that_the_predictor_flatters_is_tried_ever_less() {
    hold((ladders(), 1.3f64..2.0, delays()), |(mut times_ms, flattery, delay)| {
        let told_ms = times_ms.clone();
        let fits = times_ms.iter().rposition(|ms| *ms < 16.0).unwrap();
        times_ms[fits + 1..].iter_mut().for_each(|ms| *ms *= flattery);
        let load = |frame: usize| if frame < 30 { 1.3 } else { 1.0 };
        let run =
            Plant { delay, predicted_ms: Some(&|_, rung| told_ms[rung]), ..Plant::new(&times_ms, &load) }.run(4000);
        let changes = run.changes_from(50);
        assert!(changes <= 4000 / 32, "{changes} changes");
        assert!(run.share_from(2000, |s| s.mean_ms > HI_MS) < 0.01);
    });
}

#[test]
fn lost_devices_are_planned_for_at_once_by_a_predictor_that_knows() {
    hold((ladders(), factors(2.0)), |(times_ms, bias)| {
        let mut controller = Controller::new(&plant::ladder(&times_ms), Budget::new(LO_MS, HI_MS).unwrap());
        for _ in 0..100 {
            let rung = controller.next(&|rung: usize| bias * times_ms[rung]).rung;
            controller.observe(rung, times_ms[rung]);
        }
        controller.devices_changed();
        let rung = controller.next(&|rung: usize| 2.0 * bias * times_ms[rung]).rung;
        assert!(2.0 * times_ms[rung] <= HI_MS, "{}", 2.0 * times_ms[rung]);
    });
}

#[test]
fn nonsense_from_clocks_and_predictors_keeps_the_rung_on_the_ladder() {
    let odd = prop_oneof![any::<f64>(), Just(0.0), Just(f64::NAN), Just(f64::INFINITY), 1.0f64..100.0];
    let event = (odd.clone(), odd, 0usize..100);
    hold((ladders(), prop::collection::vec(event, 0..200)), |(times_ms, events)| {
        let mut controller = Controller::new(&plant::ladder(&times_ms), Budget::new(LO_MS, HI_MS).unwrap());
        for (ms, predicted_ms, rung) in events {
            controller.observe(rung, ms);
            let decision = controller.next(&|_: usize| predicted_ms);
            assert!(decision.rung < times_ms.len());
            assert!(!decision.expected_ms.is_nan(), "{decision:?}");
        }
        // Everything that was learned is forgotten in time.
        let run = Plant::new(&times_ms, &|_| 1.0).run_with(controller, 1000);
        assert_eq!(run.outside_from(60 + CLIMB_EVERY as usize * times_ms.len()), None);
    });
}
