//! The control loop keeps its budget on simulated renderers with random ladders: under any load, with wrong
//! predictions, and when frame times arrive one to three frames late. On recorded costs it is compared with others.
//!
//! `DIPTYCH_CONTROL_CASES` sets the number of cases of each test.

mod compare;
mod ladder;
mod plant;
mod recorded;
mod replay;

use std::fmt::Debug;
use std::sync::atomic::{AtomicUsize, Ordering};

use diptych::control::{Budget, Control, Controller, LATE, QUIET};
use plant::{HI_MS, LO_MS, Plant, times};
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

/// Largest factor between the times of two neighbouring rungs.
const LARGEST_STEP: f64 = 1.3;

/// Generates the times of ladders from at most 4 ms to at least 80 ms, so that some rung fits any load up to 4 and none
/// is the best under any load from 1/3 on.
fn ladders() -> impl Strategy<Value = Vec<f64>> {
    let steps = prop::collection::vec(1.03f64..LARGEST_STEP, 150);
    (1.5f64..4.0, steps).prop_map(|(floor_ms, steps)| {
        let mut times_ms = times(floor_ms, &steps);
        let enough = times_ms.iter().position(|ms| *ms > 80.0).unwrap_or(150);
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

fn controller(times_ms: &[f64]) -> Controller {
    Controller::new(&plant::ladder(times_ms), Budget::new(LO_MS, HI_MS).unwrap())
}

fn is_late(step: &plant::Step) -> bool {
    step.ms > HI_MS
}

#[test]
fn controller_follows_a_load_step_in_a_few_frames() {
    hold((ladders(), factors(4.0), factors(2.0), delays()), |(times_ms, load, bias, delay)| {
        let believed_ms: Vec<f64> = times_ms.iter().map(|ms| bias * ms).collect();
        let at = |frame: usize| if frame < 100 { 1.0 } else { load.max(0.34) };
        let plant = Plant { delay, believed_ms: Some(&believed_ms), ..Plant::new(&times_ms, &at) };
        let run = plant.run(300);
        let late: Vec<usize> = (20..300).filter(|&frame| is_late(&run.0[frame])).collect();
        assert!(late.iter().all(|frame| (100..104 + 2 * delay).contains(frame)), "late frames {late:?}");
        for frame in [99, 299] {
            let ms = run.0[frame].mean_ms;
            assert!(ms > HI_MS / 1.5 / LARGEST_STEP, "frame {frame} takes {ms} ms");
        }
        assert!(run.changes_from(150) <= 5, "{} changes", run.changes_from(150));
    });
}

/// Runs with noise; bounds the changes per 1,000 frames.
fn noise_holds(noise: f64, changes_max: usize) {
    const FRAMES: usize = 6000;
    let most = AtomicUsize::new(0);
    hold((ladders(), any::<u64>(), delays()), |(times_ms, seed, delay)| {
        let run = Plant { noise, seed, delay, ..Plant::new(&times_ms, &|_| 1.0) }.run(FRAMES);
        let changes = run.changes_from(1000) * 1000 / (FRAMES - 1000);
        most.fetch_max(changes, Ordering::Relaxed);
        assert!(changes <= changes_max, "{changes} changes in 1000 frames");
        let late = run.share_from(1000, is_late);
        assert!(late <= 1.25 * LATE, "{late} of the frames were late");
        let mean_ms = run.0[1000..].iter().map(|s| s.mean_ms).sum::<f64>() / (FRAMES - 1000) as f64;
        let headroom = (2.06 * noise).exp();
        assert!(mean_ms * headroom * 1.1 * LARGEST_STEP > HI_MS, "{mean_ms} ms on average");
    });
    println!("scatter of {noise}: at most {} changes in 1000 frames", most.into_inner());
}

#[test]
fn few_frames_are_late_with_noise_of_5_percent() {
    noise_holds(0.05, 60);
}

#[test]
fn few_frames_are_late_with_noise_of_20_percent() {
    noise_holds(0.2, 160);
}

#[test]
fn single_slow_frame_costs_at_most_a_tenth_of_time() {
    hold((ladders(), 200usize..300, delays()), |(times_ms, at, delay)| {
        let load = |frame: usize| if frame == at { 10.0 } else { 1.0 };
        let run = Plant { delay, ..Plant::new(&times_ms, &load) }.run(400);
        let before_ms = run.0[at].mean_ms / 10.0;
        for step in &run.0[at + 1..] {
            assert!(step.mean_ms * 1.1 * LARGEST_STEP > before_ms, "{} after {before_ms}", step.mean_ms);
        }
        assert!(run.0[at + 1..].iter().all(|step| !is_late(step)));
    });
}

#[test]
fn controller_holds_the_floor_if_no_rung_fits() {
    hold((ladders(), 1.2f64..4.0, delays()), |(times_ms, over, delay)| {
        let heavy = over * HI_MS / times_ms[0];
        let load = |frame: usize| if (100..200).contains(&frame) { heavy } else { 1.0 };
        let run = Plant { delay, ..Plant::new(&times_ms, &load) }.run(1000);
        assert!(run.0[110..200].iter().all(|s| s.decision.rung == 0 && !s.decision.fits));
        assert!(run.0[5..100].iter().chain(&run.0[210..]).all(|s| s.decision.fits));
        // The frames that no rung could render in time have raised the headroom to its maximum.
        assert!(run.0[990].mean_ms > HI_MS / 2.1 / LARGEST_STEP, "{}", run.0[990].mean_ms);
    });
}

#[test]
fn controller_climbs_only_after_frames_in_time() {
    hold((ladders(), any::<u64>(), delays()), |(times_ms, seed, delay)| {
        let load = |frame: usize| [1.0, 2.5, 0.4][frame / 150 % 3];
        let steps = Plant { noise: 0.1, seed, delay, ..Plant::new(&times_ms, &load) }.run(900).0;
        for frame in QUIET + delay..steps.len() {
            let [before, now] = [frame - 1, frame].map(|frame| steps[frame].decision.rung);
            if now > before {
                let seen = &steps[frame - delay - QUIET..frame - delay];
                assert!(seen.iter().all(|s| s.decision.rung == before && !is_late(s)), "climb at {frame}");
            }
        }
        let drops = steps.windows(2).map(|pair| pair[0].decision.rung.saturating_sub(pair[1].decision.rung));
        assert!(drops.max() > Some(1));
    });
}

#[test]
fn underestimated_rung_is_tried_seldom() {
    hold((ladders(), 1.3f64..2.0, delays()), |(mut times_ms, flattery, delay)| {
        let believed_ms = times_ms.clone();
        let fits = times_ms.iter().rposition(|ms| *ms < 14.0).unwrap();
        times_ms[fits + 1..].iter_mut().for_each(|ms| *ms *= flattery);
        let run = Plant { delay, believed_ms: Some(&believed_ms), ..Plant::new(&times_ms, &|_| 1.0) }.run(4000);
        let late = run.share_from(1000, is_late);
        assert!(late <= 1.5 * LATE, "{late} of the frames were late");
    });
}

#[test]
fn controller_drops_at_once_after_a_device_loss() {
    hold(ladders(), |times_ms| {
        let mut controller = controller(&times_ms);
        for _ in 0..100 {
            let rung = controller.next(&|rung: usize| times_ms[rung]).rung;
            controller.observe(rung, times_ms[rung]);
        }
        controller.devices_changed();
        let headroom = controller.headroom();
        let rung = controller.next(&|rung: usize| 2.0 * times_ms[rung]).rung;
        assert!(2.0 * times_ms[rung] <= HI_MS, "{}", 2.0 * times_ms[rung]);
        controller.observe(rung, 2.0 * HI_MS);
        assert_eq!(controller.headroom(), headroom, "a frame after a loss must not change the headroom");
    });
}

#[test]
fn new_budget_applies_from_the_next_frame() {
    hold((ladders(), 0.4f64..1.0), |(times_ms, factor)| {
        let mut controller = controller(&times_ms);
        let play = |frames: usize, controller: &mut Controller| {
            let mut rung = 0;
            for _ in 0..frames {
                rung = controller.next(&|rung: usize| times_ms[rung]).rung;
                controller.observe(rung, times_ms[rung]);
            }
            times_ms[rung]
        };
        play(50, &mut controller);
        controller.set_budget(Budget::new(1.0, factor * HI_MS).unwrap());
        let ms = play(1, &mut controller);
        assert!(ms <= factor * HI_MS && ms > factor * HI_MS / 1.4 / LARGEST_STEP, "{ms}");
        controller.set_budget(Budget::new(1.0, HI_MS).unwrap());
        let ms = play(50, &mut controller);
        assert!(ms <= HI_MS && ms > HI_MS / 1.4 / LARGEST_STEP, "{ms}");
    });
}

#[test]
fn controller_survives_invalid_times_and_predictions() {
    let odd = prop_oneof![any::<f64>(), Just(0.0), Just(f64::NAN), Just(f64::INFINITY), 1.0f64..100.0];
    let event = (odd.clone(), odd, 0usize..100);
    hold((ladders(), prop::collection::vec(event, 0..200)), |(times_ms, events)| {
        let mut controller = controller(&times_ms);
        for (ms, predicted_ms, rung) in events {
            controller.observe(rung, ms);
            let decision = controller.next(&|_: usize| predicted_ms);
            assert!(decision.rung < times_ms.len());
            assert!(!decision.expected_ms.is_nan(), "{decision:?}");
        }
        // Whatever happened before, the controller recovers.
        let run = Plant::new(&times_ms, &|_| 1.0).run_with(controller, 1000);
        assert_eq!(run.share_from(100, is_late), 0.0);
        assert!(run.0[999].mean_ms > HI_MS / 2.1 / LARGEST_STEP, "{}", run.0[999].mean_ms);
    });
}
