//! Finds the critical path of a frame: the chain of tasks and waits that adds up to its makespan.
//!
//! The path is traced backwards from the task that ended last. The predecessor of a task is the candidate that ended
//! last. Candidates are the task's dependencies in the frame's graph and these earlier tasks of the same device: the
//! previous pass (for a pass) or transfer (for a transfer); for a pass, also the last upload; for a download, also the
//! last pass, because a download completes only after all passes submitted before it.
//!
//! Trace files of earlier versions lack the graph. For them, the candidates are the tasks of the same device that ended
//! before the task began and, for an upload, the download of the same transfer.
//!
//! The time between the end of the predecessor and the begin of the task is a wait, named after its cause.

use std::collections::{BTreeMap, HashMap};

use serde::{Deserialize, Serialize};

use super::Lane;
use super::work::{Frame, Order, Task};

/// Tolerance for comparing times of device work with times of transfers, microseconds. The two come from different
/// clocks, which agree to some tens of microseconds, so a task may seem to begin before its predecessor has ended.
const CLOCK_TOLERANCE_US: f64 = 100.0;

/// Reason for the wait between two tasks of the critical path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Wait {
    /// Time from the begin of the frame, with its planning, until the first task of the path begins.
    Start,
    /// Time until the next task of the same device begins.
    Queue,
    /// Time after a transfer until the device's next work is submitted and begins.
    Submission,
    /// Time until finished rows reach the host.
    ReadBack,
    /// Time until the worker starts the next transfer.
    Worker,
    /// Time until the other device's worker picks up the rows that were sent.
    HandOver,
    /// Time from the last task until the images are known to be complete.
    End,
}

impl Wait {
    pub fn name(self) -> &'static str {
        match self {
            Wait::Start => "start of frame",
            Wait::Queue => "queue",
            Wait::Submission => "submission",
            Wait::ReadBack => "read-back",
            Wait::Worker => "worker",
            Wait::HandOver => "hand-over",
            Wait::End => "end of frame",
        }
    }

    fn between(before: &Task, after: &Task) -> Wait {
        match (before.lane.is_transfer(), after.lane.is_transfer()) {
            _ if before.pid != after.pid => Wait::HandOver,
            (false, false) => Wait::Queue,
            (true, false) => Wait::Submission,
            (false, true) => Wait::ReadBack,
            (true, true) => Wait::Worker,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum What<'a> {
    Task(&'a Task),
    Wait(Wait),
}

/// A part of the path. Each part begins where the previous one ends; together they span the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch<'a> {
    pub what: What<'a>,
    /// Process of the device that works or waits.
    pub pid: u32,
    pub begin_us: f64,
    pub end_us: f64,
}

/// Returns the critical path in order of time; empty without tasks. Waits of zero length are omitted.
pub fn critical_path<'a>(frame: &Frame<'a>) -> Vec<Stretch<'a>> {
    let index = TaskIndex::of(&frame.tasks);
    let Some(mut current) = index.latest(0..frame.tasks.len()) else { return Vec::new() };
    let mut until_us = frame.time.end_us;
    let mut backwards = Backwards(Vec::new());
    let last = frame.tasks[current];
    backwards.push(What::Wait(Wait::End), last.pid, last.end_us, &mut until_us);
    loop {
        let task = frame.tasks[current];
        let before = index.predecessor(current);
        let earliest_us = before.map_or(frame.time.begin_us, |b| frame.tasks[b].end_us);
        backwards.push(What::Task(task), task.pid, task.begin_us.max(earliest_us), &mut until_us);
        let wait = before.map_or(Wait::Start, |b| Wait::between(frame.tasks[b], task));
        backwards.push(What::Wait(wait), task.pid, earliest_us, &mut until_us);
        match before {
            Some(before) => current = before,
            None => break,
        }
    }
    backwards.0.reverse();
    backwards.0
}

struct Backwards<'a>(Vec<Stretch<'a>>);

impl<'a> Backwards<'a> {
    /// Prepends a stretch that begins at `begin_us`, and moves `until_us` there.
    fn push(&mut self, what: What<'a>, pid: u32, begin_us: f64, until_us: &mut f64) {
        let begin_us = begin_us.min(*until_us);
        if begin_us < *until_us || matches!(what, What::Task(_)) {
            self.0.push(Stretch { what, pid, begin_us, end_us: *until_us });
        }
        *until_us = begin_us;
    }
}

/// Tasks of a frame, indexed for finding predecessors. Tasks are given by index in `tasks`, which is sorted by begin
/// time.
struct TaskIndex<'a> {
    tasks: &'a [&'a Task],
    /// Tasks of each device, in order of end.
    by_end: HashMap<u32, Vec<usize>>,
    downloads: HashMap<u64, usize>,
    /// Tasks by device process and number in the frame's graph.
    by_number: BTreeMap<(u32, u64), usize>,
}

impl<'a> TaskIndex<'a> {
    fn of(tasks: &'a [&'a Task]) -> Self {
        let mut by_end: HashMap<u32, Vec<usize>> = HashMap::new();
        let mut downloads = HashMap::new();
        let mut by_number = BTreeMap::new();
        for (i, task) in tasks.iter().enumerate() {
            if let Some(order) = &task.order {
                by_number.insert((task.pid, order.number), i);
            }
            by_end.entry(task.pid).or_default().push(i);
            if let (Lane::Download, Some(transfer)) = (task.lane, task.transfer) {
                downloads.insert(transfer, i);
            }
        }
        for device in by_end.values_mut() {
            device.sort_by(|&a, &b| tasks[a].end_us.total_cmp(&tasks[b].end_us));
        }
        Self { tasks, by_end, downloads, by_number }
    }

    fn predecessor(&self, after: usize) -> Option<usize> {
        let task = self.tasks[after];
        if let Some(order) = &task.order {
            return self.by_graph(task, order);
        }
        let is_before = |&before: &usize| {
            let other = self.tasks[before];
            let same_clock = other.lane.is_transfer() == task.lane.is_transfer();
            let tolerance_us = if same_clock { 0.0 } else { CLOCK_TOLERANCE_US };
            before < after && other.end_us <= task.begin_us + tolerance_us
        };
        let own = self.by_end.get(&task.pid)?;
        let latest = own.partition_point(|&b| self.tasks[b].end_us <= task.begin_us + CLOCK_TOLERANCE_US);
        let own = own[..latest].iter().rev().copied().find(is_before);
        let upload = task.transfer.filter(|_| task.lane == Lane::Upload);
        let sent = upload.and_then(|transfer| self.downloads.get(&transfer).copied()).filter(is_before);
        self.latest(own.into_iter().chain(sent))
    }

    /// Returns the predecessor of a task whose position in the frame's graph is recorded. In the graph, no task depends
    /// on a later task of its own device.
    fn by_graph(&self, task: &Task, order: &Order) -> Option<usize> {
        let before = self.by_number.range((task.pid, 0)..(task.pid, order.number)).rev().map(|(_, &i)| i);
        let last = |is: &dyn Fn(&Task) -> bool| before.clone().find(|&i| is(self.tasks[i]));
        let on_queue = last(&|t| t.lane.is_transfer() == task.lane.is_transfer());
        let written = last(&|t| t.lane == Lane::Upload).filter(|_| !task.lane.is_transfer());
        // A download completes only after all passes that were submitted before it.
        let submitted = last(&|t| !t.lane.is_transfer()).filter(|_| task.lane == Lane::Download);
        let needed = order.after.iter().filter_map(|place| self.by_number.get(place).copied());
        self.latest(on_queue.into_iter().chain(written).chain(submitted).chain(needed))
    }

    /// Returns the one of these tasks that ended last.
    fn latest(&self, tasks: impl Iterator<Item = usize>) -> Option<usize> {
        tasks.max_by(|&a, &b| self.tasks[a].end_us.total_cmp(&self.tasks[b].end_us))
    }
}

#[cfg(test)]
mod tests {
    use super::super::work::FrameTime;
    use super::*;

    fn task(pid: u32, lane: Lane, name: &str, [begin_ms, end_ms]: [f64; 2], transfer: Option<u64>) -> Task {
        let (begin_us, end_us) = (begin_ms * 1e3, end_ms * 1e3);
        let (name, frame) = (name.to_owned(), Some(0));
        let (rows, bytes, predicted_us, submissions, order) = (None, None, None, None, None);
        Task { pid, lane, name, begin_us, end_us, frame, rows, transfer, bytes, predicted_us, submissions, order }
    }

    /// Returns name, device, begin and end in milliseconds of each stretch.
    fn path(tasks: &mut [Task], [begin_ms, end_ms]: [f64; 2]) -> Vec<(String, u32, f64, f64)> {
        tasks.sort_by(|a, b| a.begin_us.total_cmp(&b.begin_us));
        let time = FrameTime { frame: 0, begin_us: begin_ms * 1e3, end_us: end_ms * 1e3, devices: None };
        let path = critical_path(&Frame { time, tasks: tasks.iter().collect() });
        for pair in path.windows(2) {
            assert_eq!(pair[0].end_us, pair[1].begin_us);
        }
        let name = |what| match what {
            What::Task(task) => task.name.clone(),
            What::Wait(wait) => format!("wait: {}", wait.name()),
        };
        path.iter().map(|s| (name(s.what), s.pid, s.begin_us / 1e3, s.end_us / 1e3)).collect()
    }

    fn named(parts: &[(&str, u32, f64, f64)]) -> Vec<(String, u32, f64, f64)> {
        parts
            .iter()
            .map(|&(name, pid, begin, end)| (name.to_owned(), pid, begin * 1e3 / 1e3, end * 1e3 / 1e3))
            .collect()
    }

    #[test]
    fn critical_path_crosses_devices_at_awaited_rows() {
        let mut tasks = [
            task(10, Lane::Left, "gbuffer", [5.0, 20.0], None),
            task(10, Lane::Left, "path_trace", [20.0, 50.0], None),
            task(10, Lane::Download, "guide", [52.0, 54.0], Some(0)),
            task(10, Lane::Right, "gbuffer", [54.0, 70.0], None),
            task(11, Lane::Left, "gbuffer", [5.0, 15.0], None),
            task(11, Lane::Left, "path_trace", [15.0, 40.0], None),
            task(11, Lane::Upload, "guide", [57.0, 58.0], Some(0)),
            task(11, Lane::Left, "atrous", [60.0, 80.0], None),
            task(11, Lane::Left, "tonemap", [80.5, 81.0], None),
            task(11, Lane::Download, "linear", [81.5, 82.0], Some(1)),
            task(11, Lane::Download, "display", [82.0, 82.5], Some(2)),
            task(10, Lane::Upload, "linear", [83.0, 85.0], Some(1)),
            task(10, Lane::Upload, "display", [86.0, 87.0], Some(2)),
        ];
        let expected = [
            ("wait: start of frame", 10, 0.0, 5.0),
            ("gbuffer", 10, 5.0, 20.0),
            ("path_trace", 10, 20.0, 50.0),
            ("wait: read-back", 10, 50.0, 52.0),
            ("guide", 10, 52.0, 54.0),
            ("wait: hand-over", 11, 54.0, 57.0),
            ("guide", 11, 57.0, 58.0),
            ("wait: submission", 11, 58.0, 60.0),
            ("atrous", 11, 60.0, 80.0),
            ("wait: queue", 11, 80.0, 80.5),
            ("tonemap", 11, 80.5, 81.0),
            ("wait: read-back", 11, 81.0, 81.5),
            ("linear", 11, 81.5, 82.0),
            ("wait: hand-over", 10, 82.0, 83.0),
            ("linear", 10, 83.0, 85.0),
            ("wait: worker", 10, 85.0, 86.0),
            ("display", 10, 86.0, 87.0),
            ("wait: end of frame", 10, 87.0, 90.0),
        ];
        assert_eq!(path(&mut tasks, [0.0, 90.0]), named(&expected));
    }

    #[test]
    fn rows_received_early_are_off_the_critical_path() {
        let mut tasks = [
            task(11, Lane::Left, "gbuffer", [0.0, 3.0], None),
            task(11, Lane::Download, "guide", [3.0, 4.0], Some(0)),
            task(10, Lane::Left, "path_trace", [0.0, 10.0], None),
            task(10, Lane::Upload, "guide", [5.0, 6.0], Some(0)),
            task(10, Lane::Left, "atrous", [10.0, 15.0], None),
        ];
        assert_eq!(path(&mut tasks, [0.0, 15.0]), named(&[("path_trace", 10, 0.0, 10.0), ("atrous", 10, 10.0, 15.0)]));
    }

    /// The download seems to begin and to end before the work that produces its rows has ended.
    #[test]
    fn small_clock_errors_keep_the_critical_path() {
        let mut tasks = [
            task(10, Lane::Left, "gbuffer", [0.0, 1.0], None),
            task(10, Lane::Left, "path_trace", [1.0, 9.0], None),
            task(10, Lane::Download, "guide", [8.95, 8.97], Some(0)),
            task(11, Lane::Upload, "guide", [9.5, 10.0], Some(0)),
        ];
        let expected = [
            ("gbuffer", 10, 0.0, 1.0),
            ("path_trace", 10, 1.0, 8.97),
            ("guide", 10, 8.97, 8.97),
            ("wait: hand-over", 11, 8.97, 9.5),
            ("guide", 11, 9.5, 10.0),
        ];
        assert_eq!(path(&mut tasks, [0.0, 10.0]), named(&expected));
    }

    /// Places a task in the frame's graph.
    fn placed(task: Task, number: u64, after: &[(u32, u64)]) -> Task {
        Task { order: Some(Order { number, after: after.to_vec() }), ..task }
    }

    /// The guide is ready early, but a pass submitted before its download takes longer.
    #[test]
    fn downloads_wait_for_earlier_submissions() {
        let mut tasks = [
            placed(task(10, Lane::Left, "gbuffer", [0.0, 2.0], None), 0, &[]),
            placed(task(10, Lane::Left, "path_trace", [2.0, 9.0], None), 1, &[(10, 0)]),
            placed(task(10, Lane::Download, "guide", [9.0, 9.5], Some(0)), 2, &[(10, 0)]),
        ];
        let expected = [("gbuffer", 10, 0.0, 2.0), ("path_trace", 10, 2.0, 9.0), ("guide", 10, 9.0, 9.5)];
        assert_eq!(path(&mut tasks, [0.0, 9.5]), named(&expected));
    }

    /// One device's clock is behind, so a pass seems to begin early. By times alone, it would have no predecessor.
    #[test]
    fn graph_edges_override_clock_errors() {
        let mut tasks = [
            placed(task(10, Lane::Left, "gbuffer", [1.0, 9.0], None), 0, &[]),
            placed(task(10, Lane::Download, "guide", [9.0, 9.5], Some(0)), 1, &[(10, 0)]),
            placed(task(11, Lane::Left, "gbuffer", [1.0, 4.0], None), 0, &[]),
            placed(task(11, Lane::Upload, "guide", [9.2, 9.6], Some(0)), 1, &[(10, 1)]),
            placed(task(11, Lane::Left, "atrous", [9.0, 12.0], None), 2, &[(11, 0), (11, 1)]),
        ];
        let expected = [
            ("wait: start of frame", 10, 0.0, 1.0),
            ("gbuffer", 10, 1.0, 9.0),
            ("guide", 10, 9.0, 9.5),
            ("guide", 11, 9.5, 9.6),
            ("atrous", 11, 9.6, 12.0),
        ];
        assert_eq!(path(&mut tasks, [0.0, 12.0]), named(&expected));
    }

    #[test]
    fn overlapping_work_of_one_clock_is_independent() {
        let mut tasks =
            [task(10, Lane::Left, "gbuffer", [0.0, 2.0], None), task(10, Lane::Right, "gbuffer", [1.95, 4.0], None)];
        assert_eq!(
            path(&mut tasks, [0.0, 4.0]),
            named(&[("wait: start of frame", 10, 0.0, 1.95), ("gbuffer", 10, 1.95, 4.0)])
        );
        assert!(path(&mut [], [0.0, 4.0]).is_empty());
    }
}
