//! The thread that drives one device.

mod part;

use std::any::Any;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;

use crossbeam::channel::{Receiver, Sender};

use super::ExecError;
use super::faults::InjectedKind;
use super::mailbox::Mailbox;
use super::messages::{Answer, Command, Order, Pixels, Reply, Stop};
use super::planner::Graphs;
use super::staging::{Pool, ReadBack};
use super::watchdog::Heartbeat;
use crate::device::{DeviceFailure, DeviceInfo, GpuClock, GpuDevice};
use crate::graph::{Bound, Program, Resource};
use crate::scene::rig::Eye;
use crate::stages::{DeviceStages, Place, SceneTables, StageSettings, Stamps};
use part::{Outgoing, Part};

pub struct Worker {
    gpu: GpuDevice,
    stages: DeviceStages,
    stamps: Stamps,
    stamp_buffer: wgpu::Buffer,
    clock: GpuClock,
    pool: Pool,
    graphs: Arc<Graphs>,
    mailbox: Mailbox,
    replies: Sender<Reply>,
    /// Attempts that are not answered for, oldest first.
    unanswered: Vec<u64>,
    /// Frames of these. All but the last one are submitted.
    open: VecDeque<Part>,
    /// Rows whose copy has been submitted, of all these frames, in order of submission.
    outgoing: VecDeque<Outgoing>,
    /// Why the device can no longer be used.
    failure: Option<DeviceFailure>,
    heartbeat: Arc<Heartbeat>,
    origin: Instant,
    /// Lavapipe's queue takes no second submission while the first one runs, but holds its caller up. Rows that others
    /// wait for are sent before that happens, at the price of a short gap; hardware queues need no gap.
    submit_blocks: bool,
}

impl Worker {
    pub fn new(
        mut gpu: GpuDevice,
        settings: &StageSettings,
        tables: &SceneTables,
        programs: &[Program],
        graphs: Arc<Graphs>,
        mailbox: Mailbox,
        replies: Sender<Reply>,
        origin: Instant,
    ) -> Result<Self, ExecError> {
        gpu.patience = GpuDevice::START_PATIENCE;
        let device = gpu.info.index;
        let failed = |failure: DeviceFailure| ExecError::Device { device, what: failure.what };
        let clock = GpuClock::calibrate(&gpu, origin).map_err(failed)?;
        gpu.info.clock_residual_us = clock.residual_us;
        let mut stages = DeviceStages::new(&mut gpu, settings.clone(), tables, programs)?;
        let mut stamps = Stamps::new(&gpu.device);
        stages.warm_up(&gpu, &mut stamps, programs.to_vec());
        gpu.wait(None).map_err(failed)?;
        let stamp_buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("stamps"),
            size: u64::from(2 * Stamps::CAPACITY) * 8,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let submit_blocks = gpu.info.threads.is_some();
        Ok(Self {
            gpu,
            stages,
            stamps,
            stamp_buffer,
            clock,
            pool: Pool::default(),
            graphs,
            mailbox,
            replies,
            unanswered: Vec::new(),
            open: VecDeque::new(),
            outgoing: VecDeque::new(),
            failure: None,
            heartbeat: Arc::default(),
            origin,
            submit_blocks,
        })
    }

    pub fn info(&self) -> &DeviceInfo {
        &self.gpu.info
    }

    pub fn heartbeat(&self) -> Arc<Heartbeat> {
        Arc::clone(&self.heartbeat)
    }

    /// Carries out commands until nobody can give any more; returns the device, if it has not failed. A new frame goes
    /// before what is left of older ones: the device has something to do while the host waits for their rows.
    pub fn run(mut self, commands: Receiver<Command>) -> Option<GpuDevice> {
        loop {
            let oldest = self.open.front().map(|p| p.ticket);
            let command = match oldest {
                None => commands.recv().ok(),
                Some(_) => commands.try_recv().ok(),
            };
            self.heartbeat.beat();
            match (command, oldest) {
                (Some(command), _) => {
                    self.unanswered.push(command.ticket);
                    self.attempt(command.ticket, |worker| worker.obey(command));
                }
                (None, Some(ticket)) => self.attempt(ticket, |worker| worker.advance(true).map(drop)),
                (None, None) => break,
            }
        }
        (self.failure.is_none() && self.gpu.failure().is_none()).then_some(self.gpu)
    }

    /// Does something for the attempt with this ticket, and answers that it came to nothing if it does.
    fn attempt(&mut self, ticket: u64, what: impl FnOnce(&mut Self) -> Result<(), Stop>) {
        let done = match self.failure.clone() {
            Some(failure) => Err(failure.into()),
            // A panic is a bug; those who wait for this device must hear of it all the same.
            None => catch_unwind(AssertUnwindSafe(|| what(self)))
                .unwrap_or_else(|panic| Err(format!("its worker panicked: {}", panic_text(&*panic)).into())),
        };
        if let Err(stop) = done {
            self.give_up(ticket, stop);
        }
    }

    /// Nothing comes of this attempt; nor of any other, if it is the device that failed.
    fn give_up(&mut self, ticket: u64, stop: Stop) {
        let mut lost = vec![ticket];
        if let Stop::Device(failure) = &stop {
            self.failure = Some(failure.clone());
            // Not those of `open`, which lacks a frame that was being worked at when the worker panicked.
            lost = self.unanswered.clone();
            lost.iter().for_each(|t| self.mailbox.call_off(*t));
        }
        self.open.retain(|p| !lost.contains(&p.ticket));
        self.outgoing.retain(|o| !lost.contains(&o.ticket));
        lost.into_iter().for_each(|t| self.answer(t, Err(stop.clone())));
    }

    fn answer(&mut self, ticket: u64, answer: Result<Answer, Stop>) {
        self.unanswered.retain(|t| *t != ticket);
        // Nobody listens any more if the run has ended.
        let _ = self.replies.send(Reply { ticket, device: self.gpu.info.index, answer });
    }

    fn obey(&mut self, Command { ticket, limit, order }: Command) -> Result<(), Stop> {
        self.gpu.patience = limit;
        self.mailbox.forget_below(self.open.front().map_or(ticket, |p| p.ticket));
        match order {
            Order::Frame(job) => {
                let begin_ms = self.now_ms();
                self.open.push_back(Part::new(ticket, *job, &self.graphs, begin_ms));
                self.carry_out()
            }
            Order::Read { image, place, injected } => {
                self.inject(injected);
                let pixels = self.read(image, place)?;
                self.answer(ticket, Ok(Answer::Pixels(pixels)));
                Ok(())
            }
        }
    }

    fn now_ms(&self) -> f64 {
        self.origin.elapsed().as_secs_f64() * 1e3
    }

    /// What is to happen to the device, happens.
    fn inject(&self, injected: Option<InjectedKind>) {
        match injected {
            Some(InjectedKind::Loss) => self.gpu.device.destroy(),
            Some(InjectedKind::Hang) => loop {
                std::thread::park();
            },
            Some(InjectedKind::Oom) => self.gpu.report_out_of_memory(),
            // Comes as more runs of dispatches.
            Some(InjectedKind::Slow) | None => {}
        }
    }

    /// Asks for an image, both eyes.
    fn request(&mut self, resource: Resource, place: Place) -> [ReadBack; 2] {
        let bound = Bound { resource, buffer: 0, is_before: false };
        let (offset, size) = self.stages.images.whole(&resource);
        Eye::ALL.map(|eye| {
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            let source = self.stages.images.buffer(&bound, eye, place);
            let copy = self.pool.record(&self.gpu, &mut encoder, source, offset, size);
            copy.submitted(self.gpu.queue.submit([encoder.finish()]))
        })
    }

    fn finish(&mut self, [left, right]: [ReadBack; 2]) -> Result<Pixels, DeviceFailure> {
        Ok([self.pool.finish(&self.gpu, left)?, self.pool.finish(&self.gpu, right)?])
    }

    fn read(&mut self, image: Resource, place: Place) -> Result<Pixels, DeviceFailure> {
        let backs = self.request(image, place);
        self.finish(backs)
    }
}

fn panic_text(panic: &(dyn Any + Send)) -> &str {
    panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied()).unwrap_or("no message")
}
