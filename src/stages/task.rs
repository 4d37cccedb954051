//! Units of work that are recorded on a device: a pass on some rows, and the timestamps around it.

use std::cmp::Ordering;
use std::ops::Range;

use crate::schedule::Position;

/// A pass of a program on consecutive rows, or a part of that work. `valid` are the rows that the pass may read, and
/// `part` is the part of the work that is recorded.
#[derive(Clone, Debug)]
pub struct StageTask {
    /// Index of the pass in its program.
    pub pass: usize,
    pub rows: Range<u32>,
    pub valid: Range<u32>,
    pub part: Range<Position>,
}

impl StageTask {
    /// Creates a task that is not split.
    pub fn new(pass: usize, rows: Range<u32>, valid: Range<u32>) -> Self {
        let part = Position::start(&rows)..Position::END;
        Self { pass, rows, valid, part }
    }

    pub fn begins(&self) -> bool {
        self.part.start == Position::start(&self.rows)
    }

    pub fn ends(&self) -> bool {
        self.part.end == Position::END
    }

    /// Returns the rows that this task covers in the kernel run with the index `run`.
    pub fn rows_of(&self, run: u32) -> Range<u32> {
        let Range { start, end } = &self.part;
        let begin = match run.cmp(&start.run) {
            Ordering::Less => self.rows.end,
            Ordering::Equal => start.row,
            Ordering::Greater => self.rows.start,
        };
        let end = match run.cmp(&end.run) {
            Ordering::Less => self.rows.end,
            Ordering::Equal => end.row,
            Ordering::Greater => self.rows.start,
        };
        begin..end
    }
}

/// Timestamp queries around a frame's tasks: a pair for each task, at its begin and its end.
pub struct Stamps {
    pub queries: wgpu::QuerySet,
    used: u32,
    /// Index of the pair of the task that was begun last; `None` if no pair was left for it.
    current: Option<u32>,
}

impl Stamps {
    /// Maximum number of timed tasks in a frame.
    pub const CAPACITY: u32 = 256;

    pub fn new(device: &wgpu::Device) -> Self {
        let queries = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("stamps"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * Self::CAPACITY,
        });
        Self { queries, used: 0, current: None }
    }

    pub fn reset(&mut self) {
        self.used = 0;
    }

    /// Returns the number of queries written since the reset.
    pub fn written(&self) -> u32 {
        2 * self.used
    }

    /// Begins the next task and returns the index of its pair of timestamps; `None` if all pairs are in use.
    pub fn begin(&mut self) -> Option<u32> {
        self.current = (self.used < Self::CAPACITY).then_some(self.used);
        self.used += u32::from(self.current.is_some());
        self.current
    }

    /// Returns the index of the pair of the task that was begun last, as [`Self::begin`] returned it.
    pub fn current(&self) -> Option<u32> {
        self.current
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_all_rows_of_all_runs_once() {
        let at = |run, row| Position { run, row };
        let ends = [at(0, 5), at(0, 8), at(2, 6), at(2, 9), at(3, 5), Position::END];
        let mut seen = vec![Vec::new(); 5];
        for pair in ends.windows(2) {
            let task = StageTask { part: pair[0]..pair[1], ..StageTask::new(0, 5..9, 5..9) };
            assert_eq!((task.begins(), task.ends()), (pair[0] == ends[0], pair[1] == Position::END));
            (0..5).for_each(|run| seen[run as usize].extend(task.rows_of(run)));
        }
        assert_eq!(seen, vec![vec![5, 6, 7, 8]; 5]);
    }
}
