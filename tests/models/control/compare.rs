//! Compares the controller with others and with an oracle on recorded costs.

use std::fmt::Write;

use diptych::control::{Budget, Control, ControllerKind, Decision, LATE};

use crate::effort::{is_thorough, sampled};

use super::recorded::Recording;
use super::replay::{Disturbance, Replay, Schedule, Step, budget, disturbed};

const FRAMES: usize = 3000;
/// Number of consecutive frames in time that end a transient.
const CALM: usize = 5;
/// Budgets, as fractions of the way from the cheapest rung's median time to the most expensive one's, in logarithms.
const BUDGETS: [f64; 2] = [0.4, 0.75];

/// A disturbance every 500 frames, and back.
const DISTURBANCES: [(usize, Disturbance); 5] = [
    (500, Disturbance::View(4.0)),
    (1000, Disturbance::None),
    (1500, Disturbance::Lost(1.6)),
    (2000, Disturbance::None),
    (2500, Disturbance::Budget(0.6)),
];

/// The scores of a run.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    /// Missed periods over periods, without transients and without frames that no rung fits.
    steady: f64,
    /// The largest number of missed periods in a transient; of several runs, the median.
    transient: usize,
    error: f64,
    changes: usize,
    /// Median relative error of predictions, of frames on the rung of the frame before and of others.
    off: [f64; 2],
    /// Median of the logarithm of measured over predicted time, of frames on another rung than the frame before.
    bias: f64,
}

impl Score {
    /// `fits` tells for each frame whether some rung fits.
    fn of(steps: &[Step], schedule: Schedule<'_>, fits: &[bool]) -> Self {
        let (mut in_transient, mut calm, mut missed) = (false, 0, 0);
        let mut steady = (0, 0);
        let mut score = Self::default();
        for (frame, step) in steps.iter().enumerate() {
            if frame == 0 || schedule.iter().any(|(at, _)| *at == frame) {
                (in_transient, calm, missed) = (true, 0, 0);
            }
            if in_transient {
                missed += if fits[frame] { step.missed() } else { 0 };
                // The first frames are cold, and not the controller's fault.
                score.transient = score.transient.max(if frame < 100 { 0 } else { missed });
                calm = if step.missed() == 0 { calm + 1 } else { 0 };
                in_transient = calm < CALM;
            } else if fits[frame] {
                steady = (steady.0 + step.missed(), steady.1 + 1);
            }
        }
        score.steady = steady.0 as f64 / steady.1.max(1) as f64;
        score.error = steps.iter().map(|s| s.error).sum::<f64>() / steps.len() as f64;
        let deviations = |is_change: bool| {
            let pairs = steps.windows(2).filter(|pair| (pair[0].rung != pair[1].rung) == is_change);
            pairs.map(|pair| (pair[1].ms / pair[1].predicted_ms).ln()).filter(|x| x.is_finite()).collect::<Vec<_>>()
        };
        score.off = [false, true].map(|is_change| median(deviations(is_change).iter().map(|x| x.abs()).collect()));
        score.bias = median(deviations(true));
        score.changes = steps.windows(2).filter(|pair| pair[0].rung != pair[1].rung).count();
        score
    }

    fn mean(scores: &[Self]) -> Self {
        let count = scores.len().max(1);
        let mut transients: Vec<usize> = scores.iter().map(|s| s.transient).collect();
        transients.sort_unstable();
        Self {
            steady: scores.iter().map(|s| s.steady).sum::<f64>() / count as f64,
            transient: transients[count / 2],
            error: scores.iter().map(|s| s.error).sum::<f64>() / count as f64,
            changes: scores.iter().map(|s| s.changes).sum::<usize>() / count,
            off: [0, 1].map(|i| median(scores.iter().map(|s| s.off[i]).collect())),
            bias: median(scores.iter().map(|s| s.bias).collect()),
        }
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Knows the median cost of each rung under each disturbance, but not the scatter of single frames. Its rungs are
/// planned in advance: the best one of which a fraction [`LATE`] of frames is late.
struct Oracle {
    plan: Vec<usize>,
    frame: usize,
}

/// Returns the quantile of the frame times of a rung under a disturbance.
fn quantile_ms(recording: &Recording, rung: usize, disturbance: Disturbance, quantile: f64) -> f64 {
    let all = (0..recording.repeats()).flat_map(|repeat| (0..recording.frames()).map(move |frame| (repeat, frame)));
    let mut times_ms: Vec<f64> =
        all.map(|(repeat, frame)| disturbed(recording.sample(repeat, frame, rung), disturbance).ms()).collect();
    times_ms.sort_by(f64::total_cmp);
    times_ms[((times_ms.len() - 1) as f64 * quantile).round() as usize]
}

/// Returns the oracle's rung for each frame, and whether it fits.
fn plan(recording: &Recording, budget_ms: f64, schedule: Schedule<'_>) -> (Vec<usize>, Vec<bool>) {
    let best = |disturbance: Disturbance| {
        let factor = if let Disturbance::Budget(factor) = disturbance { factor } else { 1.0 };
        let fits = |rung: usize| quantile_ms(recording, rung, disturbance, 1.0 - LATE) <= budget_ms * factor;
        let rung = (0..recording.ladder.rungs().len()).rev().find(|&rung| fits(rung));
        (rung.unwrap_or(0), rung.is_some())
    };
    let mut now = best(Disturbance::None);
    let of_frame = |frame: usize| {
        if let Some((_, disturbance)) = schedule.iter().find(|(at, _)| *at == frame) {
            now = best(*disturbance);
        }
        now
    };
    (0..FRAMES).map(of_frame).unzip()
}

impl Control for Oracle {
    fn next(&mut self, _predict: &dyn Fn(usize) -> f64) -> Decision {
        self.frame += 1;
        Decision { rung: self.plan[self.frame - 1], expected_ms: f64::NAN, fits: true }
    }

    fn observe(&mut self, _rung: usize, _makespan_ms: f64) {}

    fn set_budget(&mut self, _budget: Budget) {}
}

/// Returns the mean scores of each controller over budgets and seeds, by name; pinned rungs by number.
fn compare(recording: &Recording, schedule: Schedule<'_>, seeds: u64) -> Vec<(String, Score)> {
    let rungs = recording.ladder.rungs().len();
    let mut kinds: Vec<ControllerKind> =
        ["diptych", "vlachos", "unreal", "pid", "turns:3"].map(|n| n.parse().unwrap()).to_vec();
    kinds.extend((0..rungs).map(ControllerKind::Pinned));
    let names: Vec<String> = kinds.iter().map(ToString::to_string).chain(["oracle".to_owned()]).collect();
    let mut scores: Vec<Vec<Score>> = vec![Vec::new(); names.len()];
    let [least, most] = [0, rungs - 1].map(|rung| quantile_ms(recording, rung, Disturbance::None, 0.5));
    for at in BUDGETS {
        let budget_ms = least * (most / least).powf(at);
        let (plan, fits) = plan(recording, budget_ms, schedule);
        for seed in 0..seeds {
            let replay = Replay { recording, schedule, budget_ms, seed };
            let start = |kind: &ControllerKind| kind.start(&recording.ladder, budget(budget_ms));
            let mut controllers: Vec<Box<dyn Control>> = kinds.iter().map(start).collect();
            controllers.push(Box::new(Oracle { plan: plan.clone(), frame: 0 }));
            for (controller, scores) in controllers.iter_mut().zip(&mut scores) {
                scores.push(Score::of(&replay.run(controller.as_mut(), FRAMES), schedule, &fits));
            }
        }
    }
    names.into_iter().zip(scores.iter().map(|scores| Score::mean(scores))).collect()
}

fn table(recording: &Recording, scores: &[(String, Score)]) -> String {
    let mut text = format!(
        "{}\n| controller | steady misses | transient | error | changes | prediction off by |\n",
        recording.name
    );
    text += "| --- | --- | --- | --- | --- | --- |\n";
    for (name, Score { steady, transient, error, changes, off: [usual, changed], bias }) in scores {
        let row = format!("| {name} | {:.2} % | {transient} | {error:.4} | {changes} |", 100.0 * steady);
        let [usual, changed, bias] = [usual, changed, bias].map(|x| 100.0 * x);
        writeln!(text, "{row} {usual:.1} %, {changed:.1} % after a change, {bias:+.1} % on average |").unwrap();
    }
    text
}

#[test]
fn controller_meets_budget_nearly_as_well_as_oracle() {
    let recordings = Recording::all();
    assert!(!recordings.is_empty());
    let schedules = [(&[][..], "undisturbed"), (&DISTURBANCES[..], "disturbed")];
    let pairs = recordings.iter().flat_map(|recording| schedules.map(|schedule| (recording, schedule)));
    for (recording, (schedule, name)) in sampled(pairs, 3) {
        let scores = compare(recording, schedule, if is_thorough() { 2 } else { 1 });
        println!("{name}: {}", table(recording, &scores));
        let of = |name: &str| scores.iter().find(|(n, _)| n == name).unwrap().1;
        let (ours, oracle) = (of("diptych"), of("oracle"));
        assert!(ours.transient <= 5, "{}: {ours:?}", recording.name);
        assert!(ours.steady <= 0.03, "{}: {ours:?}", recording.name);
        assert!(ours.error <= 1.1 * oracle.error, "{}: {ours:?}, oracle {oracle:?}", recording.name);
        // Its changes do not depend on the scatter of frames.
        let turns = of("turns:3:1");
        assert!(turns.off[1] <= 1.5 * turns.off[0] && turns.bias.abs() < 0.03, "{}: {turns:?}", recording.name);
    }
}
