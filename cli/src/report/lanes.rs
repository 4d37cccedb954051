//! Draws swimlanes of frames for a page, with a lane per device and eye and a box per task, one frame at a time.

use std::borrow::Cow;

use std::collections::HashMap;

use serde::Serialize;

use super::html::live;
use diptych::exec::{FrameReport, TaskTiming, TimedTask};
use diptych::trace::frames::path;
use diptych::trace::summary::Step;
use diptych::trace::{FIRST_DEVICE_PID, Lane};

/// Maximum number of tasks in a page, where they take about 1.8 MB.
const TASKS_MAX: usize = 120_000;

/// A frame whose tasks the page can show.
pub struct LaneFrame<'a> {
    pub name: String,
    pub makespan_ms: f64,
    /// Start of the frame in milliseconds, on the clock of the tasks. The page shows times relative to it.
    pub begin_ms: f64,
    pub tasks: &'a [TaskTiming],
}

impl<'a> LaneFrame<'a> {
    pub fn new(name: String, frame: &'a FrameReport) -> Self {
        Self { name, makespan_ms: frame.makespan_ms, begin_ms: frame.begin_ms, tasks: &frame.tasks }
    }
}

/// Everything about a task except its times: stage, eye (0 is left), device, kind (0 device work, 1 download, 2
/// upload), the first row and the one after the last, and bytes of a transfer. Many frames share the same shapes.
type Shape = (usize, usize, usize, usize, u32, u32, u64);

#[derive(Default, Serialize)]
struct Data {
    /// Names of stages and of transferred images.
    names: Vec<Cow<'static, str>>,
    shapes: Vec<Shape>,
    frames: Vec<Frame>,
    /// Index of the frame to show when the page is opened.
    shown: usize,
    /// Lower and upper end of the budget in milliseconds, if the frames have one.
    budget: Option<[f64; 2]>,
    /// Interval in frames: the page keeps the tasks of every `stride`-th frame and of the frame `shown`.
    stride: usize,
}

#[derive(Serialize)]
struct Frame {
    name: String,
    ms: f64,
    /// Tasks in order, three numbers each: index into `shapes`, start relative to the previous task's start, and
    /// duration, microseconds.
    tasks: Vec<i64>,
    /// Critical path from the begin of the frame to its end, four numbers for each part: index into `names`, device,
    /// kind as in [`Shape`] or 3 for a wait, and duration, microseconds.
    path: Vec<i64>,
}

/// Returns the figure, which initially shows the frame with index `shown`. If there are too many tasks, it keeps only
/// those of this frame and of frames at regular intervals.
///
/// # Errors
/// Errors of [`live`].
pub fn lanes(frames: &[LaneFrame<'_>], shown: usize, budget: Option<[f64; 2]>) -> serde_json::Result<String> {
    live("lanes", &Data { budget, ..data(frames, shown, TASKS_MAX) })
}

fn data(frames: &[LaneFrame<'_>], shown: usize, tasks_max: usize) -> Data {
    let tasks: usize = frames.iter().map(|f| f.tasks.len()).sum();
    let stride = tasks.div_ceil(tasks_max).max(1);
    let mut data = Data { shown, stride, ..Data::default() };
    let mut places = HashMap::new();
    for (i, frame) in frames.iter().enumerate() {
        let is_kept = i % stride == 0 || i == shown;
        let kept = if is_kept { frame.tasks } else { &[] };
        let mut before_us = 0;
        let tasks = kept.iter().flat_map(|task| {
            let shape = data.shape(task);
            let place = *places.entry(shape).or_insert_with(|| {
                data.shapes.push(shape);
                data.shapes.len() - 1
            });
            let begin_us = micros(task.begin_ms - frame.begin_ms);
            let since_us = begin_us - std::mem::replace(&mut before_us, begin_us);
            [place as i64, since_us, micros(task.end_ms - task.begin_ms)]
        });
        let tasks = tasks.collect();
        let path = if is_kept { data.path(frame) } else { Vec::new() };
        data.frames.push(Frame { name: frame.name.clone(), ms: round(frame.makespan_ms), tasks, path });
    }
    data
}

impl Data {
    fn path(&mut self, frame: &LaneFrame<'_>) -> Vec<i64> {
        let step = |step: Step| {
            let kind = match step.lane {
                None => 3,
                Some(Lane::Download) => 1,
                Some(Lane::Upload) => 2,
                Some(_) => 0,
            };
            let name = self.name(Cow::Owned(step.what));
            [name as i64, i64::from(step.pid - FIRST_DEVICE_PID), kind, micros(step.time_ms)]
        };
        path(frame.tasks, frame.begin_ms, frame.makespan_ms).into_iter().flat_map(step).collect()
    }

    /// Returns the index of a name, which is added if it is new.
    fn name(&mut self, name: Cow<'static, str>) -> usize {
        self.names.iter().position(|known| *known == name).unwrap_or_else(|| {
            self.names.push(name);
            self.names.len() - 1
        })
    }

    fn shape(&mut self, task: &TaskTiming) -> Shape {
        let name = self.name(task.stage.clone());
        let kind = match task.kind {
            TimedTask::Gpu(_) => 0,
            TimedTask::Download => 1,
            TimedTask::Upload => 2,
        };
        let eye = task.view.index();
        (name, eye, task.device, kind, task.rows.start, task.rows.end, task.bytes.unwrap_or(0))
    }
}

fn micros(ms: f64) -> i64 {
    (ms * 1e3).round() as i64
}

/// Rounds to microseconds.
pub(super) fn round(ms: f64) -> f64 {
    (ms * 1e3).round() / 1e3
}

/// Returns the index of the frame whose makespan is nearest to the median, 0 without frames.
pub fn median_frame(makespans_ms: &[f64]) -> usize {
    let mut order: Vec<usize> = (0..makespans_ms.len()).collect();
    order.sort_by(|&a, &b| makespans_ms[a].total_cmp(&makespans_ms[b]));
    order.get(order.len() / 2).copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::graph::Stage;
    use diptych::scene::rig::Eye;

    fn task(begin_ms: f64, device: usize) -> TaskTiming {
        TaskTiming {
            stage: "gbuffer".into(),
            kind: TimedTask::Gpu(Stage("gbuffer")),
            view: Eye::RIGHT,
            device,
            rows: 4..9,
            begin_ms,
            end_ms: begin_ms + 0.5,
            bytes: None,
            predicted_ms: None,
            submissions: 1,
            transfer: None,
            number: 0,
            after: Vec::new(),
        }
    }

    #[test]
    fn lane_data_shares_equal_tasks() {
        let tasks = [task(10.0, 0), task(10.25, 1), task(11.0, 0)];
        let frame = |name: &str| LaneFrame { name: name.into(), makespan_ms: 1.5, begin_ms: 10.0, tasks: &tasks };
        let all = data(&[frame("a"), frame("b")], 1, 100);
        assert_eq!(all.shapes, [(0, 1, 0, 0, 4, 9, 0), (0, 1, 1, 0, 4, 9, 0)]);
        assert_eq!(all.frames[1].tasks, [0, 0, 500, 1, 250, 500, 0, 750, 500]);
        assert_eq!((all.shown, all.stride), (1, 1));
        let few = data(&[frame("a"), frame("b"), frame("c"), frame("d")], 1, 6);
        let kept: Vec<usize> = few.frames.iter().map(|f| f.tasks.len()).collect();
        assert_eq!((kept, few.stride), (vec![9, 9, 9, 0], 2));
    }

    #[test]
    fn median_frame_is_the_middle_by_time() {
        assert_eq!(median_frame(&[3.0, 1.0, 2.0, 9.0]), 0);
        assert_eq!(median_frame(&[3.0, 1.0, 2.0]), 2);
        assert_eq!(median_frame(&[]), 0);
    }
}
