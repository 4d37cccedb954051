//! Selects frames to show on a page, for a run of any length in bounded memory.

use super::frame_row::{ControlRow, DeadlineRow, FrameRow};
use diptych::exec::TaskTiming;
use diptych::quality::FrameQuality;

/// Maximum number of frames and of their tasks, which take about 50 MB.
const FRAMES_MAX: usize = 4096;
const TASKS_MAX: usize = 240_000;

/// A frame with a control decision, and its tasks. Times of tasks are relative to the start of the frame.
#[derive(Clone, Debug)]
pub struct SampledFrame {
    pub index: u32,
    pub makespan_ms: f64,
    pub quality: FrameQuality,
    pub control: ControlRow,
    pub deadline: Option<DeadlineRow>,
    /// Number of rows of the left eye that each device path traced.
    pub stripes: Vec<u32>,
    pub tasks: Vec<TaskTiming>,
}

/// Sampled frames of a run. A short run keeps all frames. A long run keeps the slowest of every `stride` consecutive
/// frames, so that the slow frames remain visible.
#[derive(Clone, Debug)]
pub struct FrameSamples {
    frames: Vec<SampledFrame>,
    /// Number of frames that a sample stands for.
    stride: usize,
    /// Number of frames that the last sample stands for so far.
    in_last: usize,
    tasks: usize,
}

impl Default for FrameSamples {
    fn default() -> Self {
        Self { frames: Vec::new(), stride: 1, in_last: 1, tasks: 0 }
    }
}

impl FrameSamples {
    /// Adds a frame. Ignores it if it has no control decision.
    pub fn add(&mut self, row: &FrameRow, tasks: Vec<TaskTiming>) {
        let Some(control) = row.control else { return };
        let &FrameRow { index, makespan_ms, quality, ref stripes, .. } = row;
        self.tasks += tasks.len();
        let (stripes, deadline) = (stripes.clone(), row.deadline.clone());
        let frame = SampledFrame { index, makespan_ms, quality, control, deadline, stripes, tasks };
        match self.frames.last_mut().filter(|_| self.in_last < self.stride) {
            Some(last) => {
                self.in_last += 1;
                let (kept, dropped) = slower(last.clone(), frame);
                self.tasks -= dropped.tasks.len();
                *last = kept;
            }
            None => {
                self.in_last = 1;
                self.frames.push(frame);
            }
        }
        while self.frames.len() > FRAMES_MAX || (self.tasks > TASKS_MAX && self.frames.len() > 1) {
            self.halve();
        }
    }

    fn halve(&mut self) {
        if self.frames.len().is_multiple_of(2) {
            self.in_last += self.stride;
        }
        self.stride *= 2;
        let mut frames = std::mem::take(&mut self.frames).into_iter();
        while let Some(first) = frames.next() {
            let kept = match frames.next() {
                None => first,
                Some(second) => {
                    let (kept, dropped) = slower(first, second);
                    self.tasks -= dropped.tasks.len();
                    kept
                }
            };
            self.frames.push(kept);
        }
    }

    pub fn frames(&self) -> &[SampledFrame] {
        &self.frames
    }

    /// Returns the number of consecutive frames that each sample stands for.
    pub fn stride(&self) -> usize {
        self.stride
    }
}

/// Returns the slower frame, or the first if both are equally slow, and then the other frame.
fn slower(first: SampledFrame, second: SampledFrame) -> (SampledFrame, SampledFrame) {
    if second.makespan_ms > first.makespan_ms { (second, first) } else { (first, second) }
}
