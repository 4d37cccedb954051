//! Times of frames by device and stage.

use std::collections::BTreeMap;

use crate::report::median_of;
use crate::report::statistics::mean_of_some;
use diptych::exec::FrameReport;
use diptych::graph::FrameGraph;
use diptych::schedule::Prediction;
use diptych::trace::summary::median;

/// Names under which transfers from and to a device count as its stages.
pub const TRANSFERS: [&str; 2] = ["download", "upload"];

/// Times of a frame, ms.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTimes {
    pub makespan_ms: f64,
    /// Time of each stage on each device, for both eyes; `download` and `upload` are its transfers.
    pub devices: Vec<BTreeMap<String, f64>>,
}

impl FrameTimes {
    pub fn measured(frame: &FrameReport) -> Self {
        let times = frame.tasks.iter().map(|task| (task.device, task.kind.name(), task.end_ms - task.begin_ms));
        Self::new(frame.makespan_ms, frame.assignment.devices(), times)
    }

    /// Returns the predicted times of a frame with this graph.
    pub fn simulated(graph: &FrameGraph, prediction: &Prediction) -> Self {
        let tasks = (0..graph.devices()).flat_map(|device| graph.tasks_of(device));
        let times = tasks.zip(prediction.tasks_ms.iter().flatten());
        let times = times.filter_map(|(task, ms)| Some((task.device, graph.timed(task)?.name(), *ms)));
        Self::new(prediction.makespan_ms, graph.devices(), times)
    }

    /// Sums up the `times` of tasks, each with its device and stage.
    pub fn new<'a>(makespan_ms: f64, count: usize, times: impl Iterator<Item = (usize, &'a str, f64)>) -> Self {
        let mut devices = vec![BTreeMap::new(); count];
        for (device, stage, time_ms) in times {
            *devices[device].entry(stage.to_owned()).or_default() += time_ms;
        }
        Self { makespan_ms, devices }
    }

    /// Returns the time of `stages`, averaged over the devices that ran any of them.
    pub fn mean_ms(&self, stages: &[&str]) -> Option<f64> {
        let sum = |ms: &BTreeMap<String, f64>| stages.iter().filter_map(|stage| ms.get(*stage)).sum::<f64>();
        mean_of_some(self.devices.iter().map(sum).filter(|ms| *ms > 0.0))
    }

    /// Returns the busy fraction, that is, time in stages without transfers over the makespan: of the primary, and the
    /// mean of the other devices.
    pub fn busy(&self) -> [Option<f64>; 2] {
        let is_own = |stage: &str| !TRANSFERS.contains(&stage);
        let own_ms = |(stage, ms): (&String, &f64)| if is_own(stage) { *ms } else { 0.0 };
        let share = |ms: &BTreeMap<String, f64>| ms.iter().map(own_ms).sum::<f64>() / self.makespan_ms;
        [self.devices.first().map(share), mean_of_some(self.devices.iter().skip(1).map(share))]
    }
}

/// Returns the time of each stage and of [`TRANSFERS`], summed over devices: the median over the frames that ran it.
pub fn stage_ms(frames: &[FrameTimes]) -> BTreeMap<String, f64> {
    let mut all: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for frame in frames {
        let mut sums: BTreeMap<_, f64> = BTreeMap::new();
        for (stage, ms) in frame.devices.iter().flatten() {
            *sums.entry(stage).or_default() += ms;
        }
        sums.into_iter().for_each(|(stage, ms)| all.entry(stage.clone()).or_default().push(ms));
    }
    all.into_iter().map(|(stage, ms)| (stage, median_of(ms))).collect()
}

/// Returns the median over frames of a value that some frames have.
pub fn median_over(frames: &[FrameTimes], value: impl Fn(&FrameTimes) -> Option<f64>) -> Option<f64> {
    median(frames.iter().filter_map(value).collect())
}
