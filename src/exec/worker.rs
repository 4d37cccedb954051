//! The thread that drives one device.

use std::any::Any;
use std::collections::{HashMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;

use crossbeam::channel::{Receiver, Sender};

use super::staging::{Pool, ReadBack, Recorded};
use super::{ExecError, TaskTiming, TimedTask, resource_name};
use crate::device::{DeviceInfo, GpuClock, GpuDevice};
use crate::graph::{FrameGraph, PhysicalImage, Resource, Stage, Task, TaskKind};
use crate::scene::rig::Eye;
use crate::stages::{DeviceStages, RowTally, SceneTables, StageSettings, StageTask, Stamps, layout};

/// What the renderer tells a worker.
pub enum Command {
    Frame(Box<FrameJob>),
    /// Sends both eyes' image back.
    Read(PhysicalImage),
    Quit,
}

pub struct FrameJob {
    pub graph: Arc<FrameGraph>,
    pub constants: layout::Frame,
    pub previous: [layout::View; 2],
}

/// What a worker answers.
pub enum Reply {
    Frame(FrameReply),
    Failed { device: usize, what: String, is_cause: bool },
    Pixels([Vec<u8>; 2]),
}

/// A device's part of a frame, done.
pub struct FrameReply {
    pub tasks: Vec<TaskTiming>,
    /// Of the whole frame; the primary has them.
    pub row_tallies: Option<[Vec<RowTally>; 2]>,
    /// When the device was done, milliseconds since the origin.
    pub end_ms: f64,
}

/// What workers send one another.
pub enum Parcel {
    Rows {
        frame: u32,
        transfer: u32,
        bytes: Vec<u8>,
    },
    /// The sender cannot go on with this frame, so nobody who waits for it can.
    Abort {
        frame: u32,
    },
}

pub struct Worker {
    gpu: GpuDevice,
    stages: DeviceStages,
    stamps: Stamps,
    stamp_buffer: wgpu::Buffer,
    clock: GpuClock,
    pool: Pool,
    inbox: Receiver<Parcel>,
    outboxes: Vec<Sender<Parcel>>,
    replies: Sender<Reply>,
    /// Parcels that came before they were asked for.
    early: HashMap<(u32, u32), Vec<u8>>,
    /// Frames that another worker has given up.
    aborted: Option<u32>,
    origin: Instant,
    /// Lavapipe's queue takes no second submission while the first one runs, but holds its caller up. Rows that others
    /// wait for are sent before that happens, at the price of a short gap; hardware queues need no gap.
    submit_blocks: bool,
}

/// Rows whose copy has been submitted, in order of submission.
struct Outgoing {
    back: ReadBack,
    to: usize,
    transfer: u32,
    timing: TaskTiming,
}

/// State of a frame in the making.
#[derive(Default)]
struct Progress {
    encoder: Option<wgpu::CommandEncoder>,
    copies: Vec<(Recorded, Task)>,
    outgoing: VecDeque<Outgoing>,
    timings: Vec<TaskTiming>,
    /// Stage tasks with their pairs of timestamps.
    stamped: Vec<(u32, Task, Stage)>,
}

enum Stop {
    Device(String),
    Aborted,
}

impl From<String> for Stop {
    fn from(what: String) -> Self {
        Self::Device(what)
    }
}

impl Worker {
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        mut gpu: GpuDevice,
        settings: &StageSettings,
        tables: &SceneTables,
        stages: &[Stage],
        inbox: Receiver<Parcel>,
        outboxes: Vec<Sender<Parcel>>,
        replies: Sender<Reply>,
        origin: Instant,
    ) -> Result<Self, ExecError> {
        let device = gpu.info.index;
        let failed = |what| ExecError::Device { device, what };
        let clock = GpuClock::calibrate(&gpu, origin).map_err(failed)?;
        gpu.info.clock_residual_us = clock.residual_us;
        let mut stages = DeviceStages::new(&gpu, settings.clone(), tables, stages)?;
        let mut stamps = Stamps::new(&gpu.device);
        stages.warm_up(&gpu, &mut stamps);
        gpu.wait(None).map_err(failed)?;
        let stamp_buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("stamps"),
            size: u64::from(2 * Stamps::CAPACITY) * 8,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let submit_blocks = gpu.info.threads.is_some();
        let (pool, early) = (Pool::default(), HashMap::new());
        Ok(Self {
            gpu,
            stages,
            stamps,
            stamp_buffer,
            clock,
            pool,
            inbox,
            outboxes,
            replies,
            early,
            aborted: None,
            origin,
            submit_blocks,
        })
    }

    pub fn info(&self) -> &DeviceInfo {
        &self.gpu.info
    }

    /// Carries out commands until told to quit.
    pub fn run(mut self, commands: Receiver<Command>) {
        let device = self.gpu.info.index;
        while let Ok(command) = commands.recv() {
            let reply = match command {
                Command::Frame(job) => self.frame(&job),
                Command::Read(image) => match self.read(image) {
                    Ok(pixels) => Reply::Pixels(pixels),
                    Err(what) => Reply::Failed { device, what, is_cause: true },
                },
                Command::Quit => break,
            };
            if self.replies.send(reply).is_err() {
                break;
            }
        }
    }

    fn now_ms(&self) -> f64 {
        self.origin.elapsed().as_secs_f64() * 1e3
    }

    fn frame(&mut self, job: &FrameJob) -> Reply {
        let device = self.gpu.info.index;
        let frame = job.constants.index;
        // A panic is a bug; those who wait for this device's rows must hear of it all the same.
        let outcome = catch_unwind(AssertUnwindSafe(|| self.try_frame(job)))
            .unwrap_or_else(|panic| Err(Stop::Device(format!("its worker panicked: {}", panic_text(&*panic)))));
        match outcome {
            Ok(reply) => reply,
            Err(stop) => {
                self.early.clear();
                if let Stop::Device(what) = stop {
                    for (_, outbox) in self.outboxes.iter().enumerate().filter(|(i, _)| *i != device) {
                        // A worker that is gone waits for nothing.
                        let _ = outbox.send(Parcel::Abort { frame });
                    }
                    return Reply::Failed { device, what, is_cause: true };
                }
                Reply::Failed { device, what: "another device failed".into(), is_cause: false }
            }
        }
    }

    fn try_frame(&mut self, job: &FrameJob) -> Result<Reply, Stop> {
        let device = self.gpu.info.index;
        let frame = job.constants.index;
        let _span = tracing::info_span!("device frame", frame).entered();
        self.early.retain(|(f, _), _| *f == frame);
        self.stamps.reset();
        self.stages.set_frame(&self.gpu, &job.constants, &job.previous);
        let mut progress = Progress::default();
        for task in job.graph.tasks_of(device) {
            // Copies leave together, as soon as the last of a run of them is recorded.
            if !progress.copies.is_empty() && !matches!(task.kind, TaskKind::Download { .. }) {
                self.flush(&mut progress, frame)?;
            }
            match &task.kind {
                TaskKind::Dispatch { .. } => self.dispatch(&mut progress, task),
                TaskKind::Download { resource, .. } => self.download(&mut progress, *resource, task),
                TaskKind::Upload { resource, transfer, .. } => {
                    self.flush(&mut progress, frame)?;
                    self.upload(&mut progress, frame, *resource, *transfer, task)?;
                }
                TaskKind::Stitch => {}
            }
        }
        self.flush(&mut progress, frame)?;
        while self.send_oldest(&mut progress, frame)? {}
        {
            let _span = tracing::info_span!("wait for device", frame).entered();
            // Uploads that no dispatch follows, as those of the stitch, are carried out by an empty submission.
            self.gpu.queue.submit([]);
            self.gpu.wait(None)?;
        }
        let end_ms = self.now_ms();
        let mut tasks = self.read_stamps(&progress)?;
        tasks.append(&mut progress.timings);
        let row_tallies = if device == 0 { Some(self.read_tallies()?) } else { None };
        Ok(Reply::Frame(FrameReply { tasks, row_tallies, end_ms }))
    }

    fn dispatch(&mut self, progress: &mut Progress, task: &Task) {
        let TaskKind::Dispatch { stage, index, valid, filter } = &task.kind else { return };
        let stage_task = StageTask {
            stage: *stage,
            view: task.view,
            index: *index,
            rows: task.rows.clone(),
            valid: valid.clone(),
            filter: *filter,
        };
        let encoder =
            progress.encoder.get_or_insert_with(|| self.gpu.device.create_command_encoder(&Default::default()));
        if let Some(pair) = self.stages.record(&self.gpu, encoder, &mut self.stamps, &stage_task) {
            progress.stamped.push((pair, task.clone(), *stage));
        }
    }

    fn download(&mut self, progress: &mut Progress, resource: Resource, task: &Task) {
        let image = resource.physical();
        let (offset, size) = self.stages.images.span(image, &task.rows);
        let encoder =
            progress.encoder.get_or_insert_with(|| self.gpu.device.create_command_encoder(&Default::default()));
        let source = self.stages.images.buffer(image, task.view);
        let copy = self.pool.record(&self.gpu, encoder, source, offset, size);
        progress.copies.push((copy, task.clone()));
    }

    /// Submits what is recorded.
    fn flush(&mut self, progress: &mut Progress, frame: u32) -> Result<(), Stop> {
        let Some(encoder) = progress.encoder.take() else { return Ok(()) };
        if self.submit_blocks {
            while self.send_oldest(progress, frame)? {}
        }
        let _span = tracing::info_span!("submit").entered();
        let submission = self.gpu.queue.submit([encoder.finish()]);
        for (copy, task) in progress.copies.drain(..) {
            let TaskKind::Download { resource, transfer, to } = task.kind else { continue };
            let timing = transfer_timing(&task, TimedTask::Download, resource, transfer);
            progress.outgoing.push_back(Outgoing { back: copy.submitted(submission.clone()), to, transfer, timing });
        }
        Ok(())
    }

    /// Hands on the copy that was submitted first, if there is one.
    fn send_oldest(&mut self, progress: &mut Progress, frame: u32) -> Result<bool, Stop> {
        let Some(mut out) = progress.outgoing.pop_front() else { return Ok(false) };
        {
            let _span = tracing::info_span!("wait for own rows", frame).entered();
            self.gpu.wait(Some(out.back.submission()))?;
        }
        out.timing.begin_ms = self.now_ms();
        let bytes = self.pool.finish(&self.gpu, out.back)?;
        out.timing.bytes = Some(bytes.len() as u64);
        let parcel = Parcel::Rows { frame, transfer: out.transfer, bytes };
        self.outboxes[out.to].send(parcel).map_err(|_| Stop::Aborted)?;
        out.timing.end_ms = self.now_ms();
        progress.timings.push(out.timing);
        Ok(true)
    }

    fn upload(
        &mut self,
        progress: &mut Progress,
        frame: u32,
        resource: Resource,
        transfer: u32,
        task: &Task,
    ) -> Result<(), Stop> {
        let bytes = self.receive(progress, frame, transfer)?;
        let mut timing = transfer_timing(task, TimedTask::Upload, resource, transfer);
        timing.begin_ms = self.now_ms();
        let image = resource.physical();
        let (offset, size) = self.stages.images.span(image, &task.rows);
        if bytes.len() as u64 != size {
            return Err(Stop::Device(format!("transfer {transfer} brought {} bytes of {size}", bytes.len())));
        }
        self.gpu.queue.write_buffer(self.stages.images.buffer(image, task.view), offset, &bytes);
        timing.bytes = Some(size);
        timing.end_ms = self.now_ms();
        progress.timings.push(timing);
        Ok(())
    }

    /// Waits for a parcel; keeps others for later. Rows that others wait for go out first: all of them stand before this
    /// upload in the common order, so whoever waits for them cannot be waited for here.
    fn receive(&mut self, progress: &mut Progress, frame: u32, transfer: u32) -> Result<Vec<u8>, Stop> {
        let _span = tracing::info_span!("wait for rows of others", frame, transfer).entered();
        loop {
            while let Ok(parcel) = self.inbox.try_recv() {
                self.take_in(parcel);
            }
            if self.aborted == Some(frame) {
                return Err(Stop::Aborted);
            }
            if let Some(bytes) = self.early.remove(&(frame, transfer)) {
                return Ok(bytes);
            }
            if !self.send_oldest(progress, frame)? {
                let parcel = self.inbox.recv().map_err(|_| Stop::Aborted)?;
                self.take_in(parcel);
            }
        }
    }

    fn take_in(&mut self, parcel: Parcel) {
        match parcel {
            Parcel::Rows { frame, transfer, bytes } => {
                self.early.insert((frame, transfer), bytes);
            }
            Parcel::Abort { frame } => self.aborted = Some(frame),
        }
    }

    fn read_back(&mut self, source: &wgpu::Buffer, offset: u64, size: u64) -> Result<Vec<u8>, String> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let copy = self.pool.record(&self.gpu, &mut encoder, source, offset, size);
        let submission = self.gpu.queue.submit([encoder.finish()]);
        self.pool.finish(&self.gpu, copy.submitted(submission))
    }

    /// Times of the frame's stage tasks, on the host's clock.
    fn read_stamps(&mut self, progress: &Progress) -> Result<Vec<TaskTiming>, String> {
        let written = self.stamps.written();
        if written == 0 {
            return Ok(Vec::new());
        }
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        encoder.resolve_query_set(&self.stamps.queries, 0..written, &self.stamp_buffer, 0);
        self.gpu.queue.submit([encoder.finish()]);
        let buffer = self.stamp_buffer.clone();
        let bytes = self.read_back(&buffer, 0, u64::from(written) * 8)?;
        let ticks = bytemuck::pod_collect_to_vec::<u8, u64>(&bytes);
        let timing = |(pair, task, stage): &(u32, Task, Stage)| TaskTiming {
            stage: stage.name(),
            kind: TimedTask::Gpu(*stage),
            view: task.view,
            device: task.device,
            rows: task.rows.clone(),
            begin_ms: self.clock.host_ms(ticks[2 * *pair as usize]),
            end_ms: self.clock.host_ms(ticks[2 * *pair as usize + 1]),
            bytes: None,
            transfer: None,
        };
        Ok(progress.stamped.iter().map(timing).collect())
    }

    fn read_tallies(&mut self) -> Result<[Vec<RowTally>; 2], String> {
        Ok(self.read(PhysicalImage::RowTally)?.map(|bytes| bytemuck::pod_collect_to_vec(&bytes)))
    }

    fn read(&mut self, image: PhysicalImage) -> Result<[Vec<u8>; 2], String> {
        let rows = 0..self.stages.extent().height;
        let (offset, size) = self.stages.images.span(image, &rows);
        let [left, right] = Eye::ALL.map(|eye| self.stages.images.buffer(image, eye).clone());
        Ok([self.read_back(&left, offset, size)?, self.read_back(&right, offset, size)?])
    }
}

fn panic_text(panic: &(dyn Any + Send)) -> &str {
    panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied()).unwrap_or("no message")
}

fn transfer_timing(task: &Task, kind: TimedTask, resource: Resource, transfer: u32) -> TaskTiming {
    TaskTiming {
        stage: resource_name(resource),
        kind,
        view: task.view,
        device: task.device,
        rows: task.rows.clone(),
        begin_ms: 0.0,
        end_ms: 0.0,
        bytes: None,
        transfer: Some(transfer),
    }
}
