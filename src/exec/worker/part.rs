//! A device's part of a frame: its recorded and submitted commands, and its readbacks.

use std::collections::HashMap;
use std::sync::Arc;

use super::device::WorkerDevice;
use super::script::{Script, Step};
use crate::device::DeviceFailure;
use crate::exec::late_latching::SampledPose;
use crate::exec::messages::{Bytes, FrameJob, FrameReply, TaskTime};
use crate::exec::output::Output;
use crate::exec::planner::Graphs;
use crate::exec::staging::{ReadBack, Recorded};
use crate::graph::{FrameGraph, Task, TaskKind};
use crate::passes::LATE_PARTITION;
use crate::schedule::parts;

/// State of a frame on a worker until it is answered. Task numbers are indices among the device's tasks.
pub struct Part {
    job: FrameJob,
    graph: Arc<FrameGraph>,
    device: usize,
    /// Time at which the worker began the frame, and time at which it saw that the frame's last submission had ended,
    /// in milliseconds since the origin.
    begin_ms: f64,
    end_ms: f64,
    /// Time of the frame's first submission on this device, in milliseconds since the origin.
    submitted_ms: Option<f64>,
    encoder: Option<wgpu::CommandEncoder>,
    /// Commands of the finished encoder that have not been submitted.
    commands: Option<wgpu::CommandBuffer>,
    /// Copies that are recorded but not submitted: rows for other devices, each with task and transfer number, and the
    /// timestamps.
    copies: Vec<(usize, u32, Recorded)>,
    stamps_copy: Option<Recorded>,
    /// Submitted copies of rows for other devices, by transfer number, each with its task.
    outgoing: HashMap<u32, (usize, ReadBack)>,
    stamps: Option<ReadBack>,
    last: Option<wgpu::SubmissionIndex>,
    times: Vec<TaskTime>,
    /// Task, index of the pair of timestamps and number of submissions of each dispatch.
    stamped: Vec<(usize, u32, u32)>,
    /// Readbacks of images in progress.
    images: Vec<[ReadBack; 2]>,
    shown_from: Option<Box<SampledPose>>,
}

impl Part {
    pub fn new(job: FrameJob, graphs: &Graphs, device: &WorkerDevice) -> Self {
        Self {
            begin_ms: device.now_ms(),
            graph: graphs.of(&job.plan),
            job,
            device: device.gpu.info.index,
            end_ms: 0.0,
            submitted_ms: None,
            encoder: None,
            commands: None,
            copies: Vec::new(),
            stamps_copy: None,
            outgoing: HashMap::new(),
            stamps: None,
            last: None,
            times: Vec::new(),
            stamped: Vec::new(),
            images: Vec::new(),
            shown_from: None,
        }
    }

    /// Returns the frame's number in the run.
    pub fn frame(&self) -> u32 {
        self.job.constants.sampling.index
    }

    /// Returns the operations that the worker runs for the frame.
    pub fn script(&self, ticket: u64) -> Script {
        let is_cut = |number: usize| self.job.cuts.iter().any(|cut| cut.task == number);
        let shows = |task: &Task| self.graph.pass(task).is_some_and(|linked| linked.pass.partition == LATE_PARTITION);
        let is_late = |task: &Task| self.job.late.is_some() && shows(task);
        let step = |(i, task): (usize, &Task)| step(task, is_cut(i), is_late(task));
        let steps = |tasks: &[Task]| tasks.iter().enumerate().map(step).collect::<Vec<_>>();
        let (own, stitch) = self.graph.parts_of(self.device);
        Script::new(ticket, &steps(own), &steps(stitch), self.job.injected)
    }

    pub fn begin(&self, device: &mut WorkerDevice) {
        device.begin(&self.job, &self.graph.program);
    }

    /// Records a dispatch or a copy of rows. Submits all parts of a split dispatch except the last.
    pub fn record(&mut self, device: &mut WorkerDevice, task: usize) {
        let graph = Arc::clone(&self.graph);
        let work = &graph.tasks_of(self.device)[task];
        if let TaskKind::Download { image, transfer, .. } = work.kind {
            let encoder = self.encoder.get_or_insert_with(|| device.encoder());
            let copy = device.record_copy(encoder, work, &graph.program.images()[image], self.job.place);
            self.copies.push((task, transfer, copy));
            return;
        }
        let (mut pair, mut submissions) = (None, 0);
        for (i, part) in parts(&self.job.cuts, task, &work.rows).into_iter().enumerate() {
            if i > 0 {
                self.submit(device);
            }
            if part.start < part.end {
                let encoder = self.encoder.get_or_insert_with(|| device.encoder());
                pair = device.record(encoder, work, part, self.job.runs);
                submissions += 1;
            }
        }
        self.stamped.extend(pair.map(|pair| (task, pair, submissions)));
    }

    pub fn record_stamps(&mut self, device: &mut WorkerDevice) {
        let encoder = self.encoder.get_or_insert_with(|| device.encoder());
        self.stamps_copy = device.record_stamps(encoder);
    }

    /// Ends the encoder. Only then does wgpu encode the recorded commands for the driver.
    pub fn close(&mut self) {
        let _span = tracing::info_span!("encode").entered();
        self.commands = self.encoder.take().map(wgpu::CommandEncoder::finish);
    }

    /// Waits until the device has completed all submissions, then asks for the late-latched pose, which the next
    /// submission uses.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device failed or took too long.
    pub fn ask(&mut self, device: &WorkerDevice) -> Result<(), DeviceFailure> {
        let Some(late) = &self.job.late else { return Ok(()) };
        if let Some(last) = &self.last {
            device.has_ended(last, true, self.frame())?;
        }
        if let Some((pose, shown)) = late.ask(device.now_ms()) {
            device.show(&shown);
            self.shown_from = Some(Box::new(pose));
        }
        Ok(())
    }

    /// Submits the recorded commands.
    pub fn submit(&mut self, device: &WorkerDevice) {
        if self.encoder.is_some() {
            self.close();
        }
        let Some(commands) = self.commands.take() else { return };
        let _span = tracing::info_span!("submit").entered();
        self.submitted_ms.get_or_insert_with(|| device.now_ms());
        let submission = device.gpu.queue.submit([commands]);
        for (task, transfer, copy) in self.copies.drain(..) {
            self.outgoing.insert(transfer, (task, copy.submitted(submission.clone())));
        }
        if let Some(copy) = self.stamps_copy.take() {
            self.stamps = Some(copy.submitted(submission.clone()));
        }
        self.last = Some(submission);
    }

    /// Makes an empty submission, so that the device executes uploads that no further commands follow.
    pub fn submit_uploads(&mut self, device: &WorkerDevice) {
        self.last = Some(device.gpu.queue.submit([]));
    }

    /// Waits for the copy of a transfer's rows, maps it and passes it to `send`.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device failed or took too long.
    pub fn send(
        &mut self,
        device: &mut WorkerDevice,
        transfer: u32,
        beat: impl FnOnce(),
        send: impl FnOnce(Bytes),
    ) -> Result<(), DeviceFailure> {
        let Some((task, back)) = self.outgoing.remove(&transfer) else { return Ok(()) };
        {
            let _span = tracing::info_span!("wait for own rows").entered();
            device.gpu.wait(Some(back.submission()))?;
        }
        beat();
        let begin_ms = device.now_ms();
        let rows = device.finish(back)?;
        let bytes = Some(rows.len() as u64);
        // The upload may begin and end before `send` returns.
        self.times.push(TaskTime { task, begin_ms, end_ms: device.now_ms(), bytes, submissions: 1 });
        send(Bytes::Mapped(rows));
        Ok(())
    }

    /// Writes received rows to the device.
    ///
    /// # Errors
    /// [`DeviceFailure`] if `rows` does not have the size of the task's rows.
    pub fn write(&mut self, device: &WorkerDevice, task: usize, rows: Bytes) -> Result<(), DeviceFailure> {
        let begin_ms = device.now_ms();
        let work = &self.graph.tasks_of(self.device)[task];
        let TaskKind::Upload { image, .. } = work.kind else { return Ok(()) };
        let bytes = Some(device.write(work, &self.graph.program.images()[image], self.job.place, &rows)?);
        self.times.push(TaskTime { task, begin_ms, end_ms: device.now_ms(), bytes, submissions: 1 });
        Ok(())
    }

    /// Returns true if the last submission has completed; with `waits`, waits until it has. If it has completed, reads
    /// the timestamps and, on the primary, requests images.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device failed or took too long.
    pub fn end(&mut self, device: &mut WorkerDevice, waits: bool) -> Result<bool, DeviceFailure> {
        if let Some(last) = &self.last
            && !device.has_ended(last, waits, self.frame())?
        {
            return Ok(false);
        }
        self.end_ms = device.now_ms();
        if let Some(back) = self.stamps.take() {
            let stamped = std::mem::take(&mut self.stamped);
            let pairs: Vec<u32> = stamped.iter().map(|(_, pair, _)| *pair).collect();
            let bracket_ms = self.submitted_ms.unwrap_or(self.begin_ms)..self.end_ms;
            let times = device.times(back, &pairs, &bracket_ms)?;
            for ((task, _, submissions), [begin_ms, end_ms]) in stamped.into_iter().zip(times) {
                self.times.push(TaskTime { task, begin_ms, end_ms, bytes: None, submissions });
            }
        }
        if self.device == self.graph.primary {
            self.images = device.request(&Output::of_frame(&self.graph.program, &self.job.reads), self.job.place)?;
        }
        Ok(true)
    }

    /// Returns the reply to the renderer if the frame's images have reached the host, otherwise `None`. With `waits`,
    /// waits for the images.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device failed or took too long.
    pub fn take_images(&mut self, device: &mut WorkerDevice, waits: bool) -> Result<Option<FrameReply>, DeviceFailure> {
        if let Some([_, last]) = self.images.last()
            && !device.has_ended(&last.submission(), waits, self.frame())?
        {
            return Ok(None);
        }
        let images = self.images.drain(..).map(|back| device.take(back)).collect::<Result<_, _>>()?;
        let times = std::mem::take(&mut self.times);
        let clock_residual_us = device.clock_residual_us();
        let (begin_ms, end_ms, shown_from) = (self.begin_ms, self.end_ms, self.shown_from.take());
        let is_primary = self.device == self.graph.primary;
        let buffers = if is_primary { device.buffers(&self.graph.program, self.job.place) } else { Vec::new() };
        Ok(Some(FrameReply { times, clock_residual_us, begin_ms, end_ms, images, shown_from, buffers }))
    }
}

/// Returns the properties of a task that determine the order of the worker's operations.
fn step(task: &Task, is_cut: bool, is_late: bool) -> Step {
    match task.kind {
        TaskKind::Dispatch { .. } if is_late => Step::LateDispatch { is_cut },
        TaskKind::Dispatch { .. } if is_cut => Step::CutDispatch,
        TaskKind::Dispatch { .. } => Step::Dispatch,
        TaskKind::Download { transfer, to, .. } => Step::Download { transfer, to },
        TaskKind::Upload { transfer, .. } => Step::Upload { transfer },
        TaskKind::Stitch => Step::Stitch,
    }
}
