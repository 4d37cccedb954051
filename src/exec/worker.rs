//! The thread that drives one device.

use std::any::Any;
use std::collections::{HashMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender};

use super::faults::InjectedKind;
use super::messages::{Answer, Command, FrameJob, FrameReply, Order, Parcel, Reply, Stop};
use super::staging::{Pool, ReadBack, Recorded};
use super::watchdog::{Pulse, SLICES};
use super::{ExecError, TaskTiming, TimedTask, resource_name};
use crate::device::{DeviceFailure, DeviceInfo, GpuClock, GpuDevice};
use crate::graph::{PhysicalImage, Resource, Stage, Task, TaskKind};
use crate::scene::rig::Eye;
use crate::stages::{DeviceStages, RowTally, SceneTables, StageSettings, StageTask, Stamps};

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
    early: HashMap<(u64, u32), Vec<u8>>,
    /// Of the command being carried out, and of the last attempt that was called off.
    ticket: u64,
    aborted: Option<u64>,
    pulse: Arc<Pulse>,
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

/// A worker waits for others for this many slices of a device's limit: longer than it takes to find out that one of
/// them is hung.
const DEPENDENT_SLICES: u32 = 32;

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
        let failed = |failure: DeviceFailure| ExecError::Device { device, what: failure.what };
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
            ticket: 0,
            aborted: None,
            pulse: Arc::default(),
            origin,
            submit_blocks,
        })
    }

    pub fn info(&self) -> &DeviceInfo {
        &self.gpu.info
    }

    pub fn pulse(&self) -> Arc<Pulse> {
        Arc::clone(&self.pulse)
    }

    /// Carries out commands until nobody can give any more.
    pub fn run(mut self, commands: Receiver<Command>) {
        let device = self.gpu.info.index;
        while let Ok(Command { ticket, limit, order }) = commands.recv() {
            self.pulse.beat();
            self.ticket = ticket;
            self.gpu.patience = limit;
            // A panic is a bug; those who wait for this device must hear of it all the same.
            let answer = catch_unwind(AssertUnwindSafe(|| match order {
                Order::Frame(job) => self.frame(&job).map(Answer::Frame),
                Order::Read(image, injected) => {
                    self.befall(injected);
                    Ok(Answer::Pixels(self.read(image)?))
                }
            }));
            let answer =
                answer.unwrap_or_else(|panic| Err(format!("its worker panicked: {}", panic_text(&*panic)).into()));
            if let Err(stop) = &answer {
                self.give_up(stop);
            }
            if self.replies.send(Reply { ticket, device, answer }).is_err() {
                break;
            }
        }
    }

    fn give_up(&mut self, stop: &Stop) {
        self.early.clear();
        if matches!(stop, Stop::Aborted) {
            return;
        }
        for (_, outbox) in self.outboxes.iter().enumerate().filter(|(i, _)| *i != self.gpu.info.index) {
            // A worker that is gone waits for nothing.
            let _ = outbox.send(Parcel::Abort { ticket: self.ticket });
        }
    }

    fn now_ms(&self) -> f64 {
        self.origin.elapsed().as_secs_f64() * 1e3
    }

    fn frame(&mut self, job: &FrameJob) -> Result<FrameReply, Stop> {
        let device = self.gpu.info.index;
        let frame = job.constants.index;
        let _span = tracing::info_span!("device frame", frame).entered();
        self.early.retain(|(ticket, _), _| *ticket == self.ticket);
        self.stamps.reset();
        self.stages.set_frame(&self.gpu, &job.constants, &job.previous);
        let mut progress = Progress::default();
        let tasks = job.graph.tasks_of(device);
        for (i, task) in tasks.iter().enumerate() {
            self.pulse.beat();
            if i == tasks.len() / 2 && job.injected.is_some() {
                self.flush(&mut progress, frame)?;
                self.befall(job.injected);
            }
            // Copies leave together, as soon as the last of a run of them is recorded.
            if !progress.copies.is_empty() && !matches!(task.kind, TaskKind::Download { .. }) {
                self.flush(&mut progress, frame)?;
            }
            match &task.kind {
                TaskKind::Dispatch { .. } => self.dispatch(&mut progress, task, job.runs),
                TaskKind::Download { resource, .. } => self.download(&mut progress, *resource, task),
                TaskKind::Upload { resource, transfer, .. } => {
                    self.flush(&mut progress, frame)?;
                    self.upload(&mut progress, frame, *resource, *transfer, task)?;
                }
                TaskKind::Stitch => {}
            }
        }
        if tasks.is_empty() {
            self.befall(job.injected);
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
        let mut timings = self.read_stamps(&progress)?;
        timings.append(&mut progress.timings);
        let row_tallies = if device == job.graph.primary { Some(self.read_tallies()?) } else { None };
        Ok(FrameReply { tasks: timings, row_tallies, end_ms })
    }

    /// What is to happen to the device, happens.
    fn befall(&self, injected: Option<InjectedKind>) {
        match injected {
            Some(InjectedKind::Loss) => self.gpu.device.destroy(),
            Some(InjectedKind::Hang) => loop {
                std::thread::park();
            },
            Some(InjectedKind::Oom) => {
                let size = self.gpu.device.limits().max_buffer_size.saturating_add(4) & !3;
                let usage = wgpu::BufferUsages::STORAGE;
                let label = Some("too large");
                let descriptor = wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false };
                drop(self.gpu.device.create_buffer(&descriptor));
            }
            // Comes as more runs of dispatches.
            Some(InjectedKind::Slow) | None => {}
        }
    }

    fn dispatch(&mut self, progress: &mut Progress, task: &Task, runs: u32) {
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
        if let Some(pair) = self.stages.record(&self.gpu, encoder, &mut self.stamps, &stage_task, runs) {
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
        self.pulse.beat();
        out.timing.begin_ms = self.now_ms();
        let bytes = self.pool.finish(&self.gpu, out.back)?;
        out.timing.bytes = Some(bytes.len() as u64);
        let parcel = Parcel::Rows { ticket: self.ticket, transfer: out.transfer, bytes };
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
            return Err(format!("transfer {transfer} brought {} bytes of {size}", bytes.len()).into());
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
        let slice = self.gpu.patience / SLICES;
        let mut slices = 0;
        loop {
            while let Ok(parcel) = self.inbox.try_recv() {
                self.take_in(parcel);
            }
            if self.aborted == Some(self.ticket) {
                return Err(Stop::Aborted);
            }
            if let Some(bytes) = self.early.remove(&(self.ticket, transfer)) {
                return Ok(bytes);
            }
            if self.send_oldest(progress, frame)? {
                continue;
            }
            match self.pulse.depending(|| self.inbox.recv_timeout(slice)) {
                Ok(parcel) => self.take_in(parcel),
                Err(RecvTimeoutError::Timeout) if slices < DEPENDENT_SLICES => slices += 1,
                Err(_) => return Err(Stop::Aborted),
            }
        }
    }

    fn take_in(&mut self, parcel: Parcel) {
        match parcel {
            // Rows of an attempt that was called off come late.
            Parcel::Rows { ticket, .. } if ticket < self.ticket => {}
            Parcel::Rows { ticket, transfer, bytes } => {
                self.early.insert((ticket, transfer), bytes);
            }
            Parcel::Abort { ticket } => self.aborted = self.aborted.max(Some(ticket)),
        }
    }

    fn read_back(&mut self, source: &wgpu::Buffer, offset: u64, size: u64) -> Result<Vec<u8>, DeviceFailure> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let copy = self.pool.record(&self.gpu, &mut encoder, source, offset, size);
        let submission = self.gpu.queue.submit([encoder.finish()]);
        self.pool.finish(&self.gpu, copy.submitted(submission))
    }

    /// Times of the frame's stage tasks, on the host's clock.
    fn read_stamps(&mut self, progress: &Progress) -> Result<Vec<TaskTiming>, DeviceFailure> {
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

    fn read_tallies(&mut self) -> Result<[Vec<RowTally>; 2], DeviceFailure> {
        Ok(self.read(PhysicalImage::RowTally)?.map(|bytes| bytemuck::pod_collect_to_vec(&bytes)))
    }

    fn read(&mut self, image: PhysicalImage) -> Result<[Vec<u8>; 2], DeviceFailure> {
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
