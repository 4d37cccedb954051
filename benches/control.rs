//! Measures the host time of a decision of the control loop: on a steady load, under noise, and on a load that sends it
//! from the floor to the top and back.
//!
//! `cargo bench --bench control -- [--reps N] [--rungs N]`

use std::hint::black_box;
use std::time::Instant;

use diptych::control::{Budget, Control, Controller, Ladder, Origin, Rung};
use diptych::quality::Quality;

fn options() -> (usize, usize) {
    let (mut reps, mut rungs) = (20_000, 64);
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(arg) = args.next() {
        let value = args.next().and_then(|v| v.parse().ok()).unwrap_or_else(|| panic!("{arg} takes a number"));
        match arg.as_str() {
            "--reps" => reps = value,
            "--rungs" => rungs = value,
            _ => panic!("{arg} is no option of this benchmark"),
        }
    }
    (reps, rungs)
}

/// Returns rungs 5 % apart, the first at 1 ms.
fn ladder(rungs: usize) -> Ladder {
    let rung = |i: usize| Rung {
        time_ms: 1.05f64.powi(i as i32),
        error: 1.0 / (i + 1) as f64,
        flip: None,
        flicker: None,
        relmse: None,
        is_estimated: false,
        quality: Quality { filter: None, ..Quality::default() },
        stage_ms: Default::default(),
        rays: Default::default(),
    };
    let (shot, size, devices, version, measure) = Default::default();
    let origin = Origin { shot, size, exposure_ev: 0.0, measure, devices, version };
    Ladder::new(origin, (0..rungs).map(rung).collect()).expect("rungs in order")
}

/// Returns the time of each decision in microseconds, for a load per frame.
fn decisions(ladder: &Ladder, budget: Budget, reps: usize, load: impl Fn(usize) -> f64) -> Vec<f64> {
    let times_ms: Vec<f64> = ladder.rungs().iter().map(|r| r.time_ms).collect();
    let mut controller = Controller::new(ladder, budget);
    let decide = |frame: usize| {
        let begin = Instant::now();
        let decision = black_box(controller.next(&|rung: usize| times_ms[rung]));
        let took_us = begin.elapsed().as_secs_f64() * 1e6;
        controller.observe(decision.rung, times_ms[decision.rung] * load(frame));
        took_us
    };
    (0..reps).map(decide).collect()
}

fn main() {
    let (reps, rungs) = options();
    let ladder = ladder(rungs);
    let top_ms = ladder.rungs()[rungs - 1].time_ms;
    // The band is low on the ladder, so that many rungs lie above it.
    let budget = Budget::new(1.5, 2.5).expect("a band");
    println!("µs per decision, {reps} decisions, {rungs} rungs: median, 99th percentile, most");
    let cases: [(&str, &dyn Fn(usize) -> f64); 3] = [
        ("steady", &|_| 1.0),
        ("noise", &|frame| 1.0 + 0.05 * (frame as f64).sin()),
        ("up and down", &|frame| if frame / 400 % 2 == 0 { 1.0 / top_ms } else { top_ms }),
    ];
    for (name, load) in cases {
        let mut took_us = decisions(&ladder, budget, reps, load);
        took_us.sort_by(f64::total_cmp);
        let [median, most_of, most] = [reps / 2, reps * 99 / 100, reps - 1].map(|i| took_us[i]);
        println!("  {name:<12} {median:.2}, {most_of:.2}, {most:.2}");
    }
}
