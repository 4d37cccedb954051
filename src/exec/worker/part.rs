//! A device's part of a frame: its recorded and submitted commands, and its readbacks.

mod probing;

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

use super::device::WorkerDevice;
use crate::device::DeviceFailure;
use crate::device::staging::{ReadBack, Recorded};
use crate::exec::late_latching::SampledPose;
use crate::exec::messages::{Bytes, FrameJob, FrameReply, TaskTime};
use crate::exec::output::Output;
use crate::exec::planner::Graphs;
use crate::graph::FrameGraph;
use crate::plan::{Command, Commands, Share, Timed};
use crate::stages::{DeviceStages, Recording};

/// State of a frame on a worker until it is answered. Task numbers are indices among the device's tasks.
pub struct Part {
    ticket: u64,
    job: FrameJob,
    graph: Arc<FrameGraph>,
    commands: Arc<Commands>,
    device: usize,
    /// Time at which the worker began the frame, and time at which it saw that the frame's last submission had ended,
    /// in milliseconds since the origin.
    begin_ms: f64,
    end_ms: f64,
    /// Time of the frame's first submission on this device, in milliseconds since the origin.
    submitted_ms: Option<f64>,
    encoder: Option<wgpu::CommandEncoder>,
    /// Commands of the finished encoder that have not been submitted.
    recorded: Option<wgpu::CommandBuffer>,
    /// Copies that are recorded but not submitted: rows for other devices, each with task and transfer number, and the
    /// timestamps.
    copies: Vec<(usize, u32, Recorded)>,
    stamps_copy: Option<Recorded>,
    /// Submitted copies of rows for other devices, by transfer number, each with its task.
    outgoing: HashMap<u32, (usize, ReadBack)>,
    stamps: Option<ReadBack>,
    last: Option<wgpu::SubmissionIndex>,
    times: Vec<TaskTime>,
    probing: Probing,
    /// Readbacks of images in progress.
    images: Vec<Vec<ReadBack>>,
    shown_from: Option<Box<SampledPose>>,
}

/// State of the tasks that a device divides itself.
#[derive(Default)]
struct Probing {
    /// Number of submissions of each task.
    submissions: HashMap<usize, u32>,
    /// Estimated cost of the work that is done.
    done: f64,
    /// Instant from which tasks end early.
    ending: Option<Instant>,
    /// Samples of the task that has ended with the fewest, of those that count.
    least: Option<u32>,
}

impl Part {
    pub fn new(ticket: u64, job: FrameJob, graphs: &Graphs, device: &WorkerDevice) -> Self {
        let (begin_ms, graph, index) = (device.now_ms(), graphs.of(&job.plan), device.gpu.info.index);
        Self {
            ticket,
            begin_ms,
            commands: Arc::new(Commands::new(&graph, &share_of(&job, ticket, index))),
            graph,
            job,
            device: index,
            end_ms: 0.0,
            submitted_ms: None,
            encoder: None,
            recorded: None,
            copies: Vec::new(),
            stamps_copy: None,
            outgoing: HashMap::new(),
            stamps: None,
            last: None,
            times: Vec::new(),
            probing: Probing::default(),
            images: Vec::new(),
            shown_from: None,
        }
    }

    /// Returns the frame's number in the run.
    pub fn frame(&self) -> u32 {
        self.job.constants.sampling.index
    }

    /// Returns the commands of the device's share of the frame.
    pub fn commands(&self) -> &Arc<Commands> {
        &self.commands
    }

    /// Executes the command with this index. A [`Command::CopyIn`] is executed by [`Self::write`]. Calls `beat` between
    /// waits for the device.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device failed or took too long.
    pub fn execute(&mut self, device: &mut WorkerDevice, at: usize, beat: impl Fn()) -> Result<(), DeviceFailure> {
        let commands = Arc::clone(&self.commands);
        match &commands.list[at] {
            &Command::Probe { task, stamps } => self.probe(device, task, stamps, beat),
            command => self.perform(device, command),
        }
    }

    fn perform(&mut self, device: &mut WorkerDevice, command: &Command) -> Result<(), DeviceFailure> {
        match command {
            Command::Begin => device.begin(&self.job),
            Command::Clear(image) => self.record(device, |stages, to| stages.clear(to, image)),
            Command::Dispatch { pass, launches, begins, ends } => {
                self.record(device, |stages, to| stages.dispatch(to, *pass, launches, [*begins, *ends]));
            }
            Command::Build { pass, ends } => self.record(device, |stages, to| stages.build(to, *pass, *ends)),
            Command::Save { binding, image } => self.record(device, |stages, to| stages.save(to, *binding, image)),
            Command::Restore { binding, image } => {
                self.record(device, |stages, to| stages.restore(to, *binding, image));
            }
            Command::CopyOut { transfer, rows } => {
                let place = self.job.place;
                let copy = device.record_copy(self.encoder.get_or_insert_with(|| device.encoder()), rows, place);
                self.copies.push((rows.task, *transfer, copy));
            }
            Command::CopyIn { .. } | Command::Probe { .. } => {}
            Command::Stamps => {
                let encoder = self.encoder.get_or_insert_with(|| device.encoder());
                self.stamps_copy = Some(device.record_stamps(encoder, self.commands.timed.len()));
            }
            Command::Ask => self.ask(device)?,
            Command::Close => self.close(),
            Command::Submit(_) => self.submit(device),
            Command::Inject(kind) => device.inject(*kind),
        }
        Ok(())
    }

    fn record(&mut self, device: &mut WorkerDevice, record: impl FnOnce(&mut DeviceStages, &mut Recording<'_>)) {
        let encoder = self.encoder.get_or_insert_with(|| device.encoder());
        let (stages, mut to) = device.recording(encoder, &self.graph.program, self.job.place);
        record(stages, &mut to);
    }

    /// Ends the encoder. Only then does wgpu encode the recorded commands for the driver.
    fn close(&mut self) {
        let _span = tracing::info_span!("encode").entered();
        self.recorded = self.encoder.take().map(wgpu::CommandEncoder::finish);
    }

    /// Waits until the device has completed all submissions, then asks for the late-latched pose, which the next
    /// submission uses.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device failed or took too long.
    fn ask(&mut self, device: &WorkerDevice) -> Result<(), DeviceFailure> {
        let Some(late) = &self.job.late else { return Ok(()) };
        if let Some(last) = &self.last {
            device.has_ended(last, true, self.frame())?;
        }
        if let Some((pose, shown)) = late.ask(device.now_ms()) {
            device.stages.show(&device.gpu, &shown);
            self.shown_from = Some(Box::new(pose));
        }
        Ok(())
    }

    /// Submits the recorded commands. If there are none, the device only executes pending writes.
    fn submit(&mut self, device: &WorkerDevice) {
        let _span = tracing::info_span!("submit").entered();
        self.submitted_ms.get_or_insert_with(|| device.now_ms());
        let submission = device.gpu.queue.submit(self.recorded.take());
        for (task, transfer, copy) in self.copies.drain(..) {
            self.outgoing.insert(transfer, (task, copy.submitted(submission.clone())));
        }
        if let Some(copy) = self.stamps_copy.take() {
            self.stamps = Some(copy.submitted(submission.clone()));
        }
        self.last = Some(submission);
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
            device.gpu.wait(Some(back.submission.clone()))?;
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

    /// Executes the [`Command::CopyIn`] with this index: writes received rows to the device.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the number of bytes is not that of the rows.
    pub fn write(&mut self, device: &WorkerDevice, at: usize, bytes: Bytes) -> Result<(), DeviceFailure> {
        let begin_ms = device.now_ms();
        let Command::CopyIn { rows, .. } = &self.commands.list[at] else { return Ok(()) };
        let bytes = Some(device.write(rows, self.job.place, &bytes)?);
        self.times.push(TaskTime { task: rows.task, begin_ms, end_ms: device.now_ms(), bytes, submissions: 1 });
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
            let bracket_ms = self.submitted_ms.unwrap_or(self.begin_ms)..self.end_ms;
            let times = device.times(back, &bracket_ms)?;
            for (&Timed { task, submissions }, [begin_ms, end_ms]) in self.commands.timed.iter().zip(times) {
                let submissions = self.probing.submissions.get(&task).copied().unwrap_or(submissions);
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
        if let Some(last) = self.images.last().and_then(|views| views.last())
            && !device.has_ended(&last.submission, waits, self.frame())?
        {
            return Ok(None);
        }
        let images = self.images.drain(..).map(|back| device.take(back)).collect::<Result<_, _>>()?;
        let times = std::mem::take(&mut self.times);
        let clock_residual_us = device.clock.residual_us;
        let (begin_ms, end_ms, shown_from) = (self.begin_ms, self.end_ms, self.shown_from.take());
        let is_primary = self.device == self.graph.primary;
        let buffers = if is_primary { device.buffers(&self.graph.program, self.job.place) } else { Vec::new() };
        let spp_done = self.probing.ending.and(self.probing.least);
        Ok(Some(FrameReply { times, clock_residual_us, begin_ms, end_ms, images, shown_from, buffers, spp_done }))
    }
}

/// Returns what a device contributes to a frame.
fn share_of(job: &FrameJob, ticket: u64, device: usize) -> Share<'_> {
    Share {
        ticket,
        device,
        samples: job.constants.sampling.samples,
        splits: &job.splits,
        repeats: job.runs,
        injected: job.injected,
        asks: job.late.is_some(),
    }
}
