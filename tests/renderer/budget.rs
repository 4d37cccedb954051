//! Sessions inside a frame budget.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use diptych::control::{Budget, Control, Decision, relative_costs};
use diptych::{LoadedScene, Renderer, Session};

/// Predictions for the first rung, and observed times.
#[derive(Clone, Default)]
struct Seen(Arc<Mutex<(Vec<f64>, Vec<f64>)>>);

impl Control for Seen {
    fn next(&mut self, predict: &dyn Fn(usize) -> f64) -> Decision {
        let predicted_ms = predict(0);
        self.0.lock().unwrap().0.push(predicted_ms);
        Decision { rung: 0, expected_ms: predicted_ms, fits: true }
    }

    fn observe(&mut self, _rung: usize, frame_ms: f64) {
        self.0.lock().unwrap().1.push(frame_ms);
    }

    fn set_budget(&mut self, _budget: Budget) {}
}

/// The time outside the makespan is in predictions and in observed times, and not in the expected makespan.
#[test]
fn controllers_count_the_whole_time_of_frames() {
    let scene = LoadedScene::load("builtin:checker").unwrap();
    let mut session = Session::start(Renderer::builder(&scene).size(48, 28), "11..20".parse().unwrap()).unwrap();
    let seen = Seen::default();
    session.set_controller(Box::new(seen.clone()));
    let frames: Vec<_> = (0..8).map(|i| session.render_next(&scene.shot.rig, 0.0, i).unwrap().report).collect();
    let relative_cost = relative_costs(session.ladder().rungs()).swap_remove(0);
    let quality = *session.quality(0);
    let makespan_ms = session.renderer.predicted_ms(&quality, &relative_cost).unwrap();
    let expected_ms = session.decide().decision.expected_ms;
    let (predicted, observed) = seen.0.lock().unwrap().clone();
    let outside: Vec<f64> = observed.iter().zip(&frames).map(|(ms, frame)| ms - frame.makespan_ms).collect();
    assert!(outside.len() == 8 && outside.iter().all(|ms| *ms > 0.0), "{outside:?}");
    let (least, most) = outside.iter().fold((f64::INFINITY, 0.0), |(low, high), &ms| (low.min(ms), f64::max(high, ms)));
    let added = predicted.last().unwrap() - makespan_ms;
    assert!((least..=most).contains(&added), "{added} ms of {outside:?}");
    assert!((expected_ms / makespan_ms - 1.0).abs() < 1e-9, "{expected_ms} instead of {makespan_ms}");
}

/// A frame whose images are read takes longer by that time, which is not in the expected makespan.
#[test]
fn controllers_count_the_time_to_read_images() {
    const SLEEP_MS: f64 = 400.0;
    let scene = LoadedScene::load("builtin:checker").unwrap();
    let mut session = Session::start(Renderer::builder(&scene).size(48, 28), "11..20".parse().unwrap()).unwrap();
    let seen = Seen::default();
    session.set_controller(Box::new(seen.clone()));
    let mut most_ms = 0.0f64;
    for index in 0..4 {
        let frame = session.render_next(&scene.shot.rig, 0.0, index).unwrap();
        let begin = Instant::now();
        session
            .read(|renderer| {
                std::thread::sleep(Duration::from_secs_f64(SLEEP_MS / 1e3));
                renderer.read_display()
            })
            .unwrap();
        most_ms = most_ms.max(begin.elapsed().as_secs_f64() * 1e3);
        let expected_ms = frame.decision.expected_ms;
        assert!(expected_ms.is_nan() || expected_ms < SLEEP_MS, "{expected_ms}");
    }
    let (predicted, observed) = seen.0.lock().unwrap().clone();
    assert!(predicted[3] >= SLEEP_MS && observed[3] >= SLEEP_MS, "{predicted:?}, {observed:?}");
    let read_ms = predicted[3] - session.decide().decision.expected_ms;
    assert!(read_ms < most_ms + SLEEP_MS, "{read_ms} ms are added, the longest read took {most_ms}");
    assert!(predicted[0].is_nan() || predicted[0] < SLEEP_MS, "{predicted:?}");
}
