//! A device's part of a frame: recorded, submitted, and brought to its end.

use std::sync::Arc;

use super::Worker;
use crate::device::WAIT_SLICES;
use crate::exec::messages::{Answer, FrameJob, FrameReply, Stop};
use crate::exec::planner::Graphs;
use crate::exec::staging::{ReadBack, Recorded};
use crate::exec::{TaskTiming, TimedTask};
use crate::graph::{Bound, FrameGraph, Resource, Stage, Task, TaskKind};
use crate::passes::ROW_TALLY;
use crate::stages::StageTask;

/// What a worker knows of a frame until it has answered.
pub struct Part {
    pub ticket: u64,
    job: FrameJob,
    graph: Arc<FrameGraph>,
    begin_ms: f64,
    encoder: Option<wgpu::CommandEncoder>,
    /// In the encoder: rows for others, and the timestamps.
    copies: Vec<(Recorded, Task)>,
    stamps_copy: Option<Recorded>,
    last: Option<wgpu::SubmissionIndex>,
    timings: Vec<TaskTiming>,
    /// Stage tasks with their pairs of timestamps.
    stamped: Vec<(u32, Task, Stage)>,
    stamps: Option<ReadBack>,
    state: State,
}

/// How far a part has come.
enum State {
    /// Its own tasks are submitted, or are about to be; not those of the stitch.
    Own,
    /// All tasks are submitted, the last ones here.
    Submitted(wgpu::SubmissionIndex),
    /// They have ended, and images are on their way to the host.
    Read { end_ms: f64, backs: Vec<(Resource, [ReadBack; 2])> },
}

/// Rows whose copy has been submitted.
pub struct Outgoing {
    pub ticket: u64,
    back: ReadBack,
    to: usize,
    transfer: u32,
    timing: TaskTiming,
}

/// A worker waits for others for this many slices of a device's limit: longer than it takes to find out that one of
/// them is hung.
const DEPENDENT_SLICES: u32 = 32;

impl Part {
    pub fn new(ticket: u64, job: FrameJob, graphs: &Graphs, begin_ms: f64) -> Self {
        Self {
            ticket,
            graph: graphs.of(&job.plan),
            job,
            begin_ms,
            encoder: None,
            copies: Vec::new(),
            stamps_copy: None,
            last: None,
            timings: Vec::new(),
            stamped: Vec::new(),
            stamps: None,
            state: State::Own,
        }
    }

    fn encoder(&mut self, device: &wgpu::Device) -> &mut wgpu::CommandEncoder {
        self.encoder.get_or_insert_with(|| device.create_command_encoder(&Default::default()))
    }

    fn frame(&self) -> u32 {
        self.job.constants.index
    }
}

/// Of the newest frame: its own tasks.
impl Worker {
    /// Submits the newest frame's own tasks.
    pub fn carry_out(&mut self) -> Result<(), Stop> {
        let Some(mut part) = self.open.pop_back() else { return Ok(()) };
        let done = self.submit_tasks(&mut part);
        self.open.push_back(part);
        done
    }

    fn submit_tasks(&mut self, part: &mut Part) -> Result<(), Stop> {
        let _span = tracing::info_span!("device frame", frame = part.frame()).entered();
        let graph = Arc::clone(&part.graph);
        let (tasks, _) = graph.parts_of(self.gpu.info.index);
        self.stamps.reset();
        self.stages.set_frame(&self.gpu, &part.graph.program, &part.job.constants, &part.job.previous, part.job.place);
        for (i, task) in tasks.iter().enumerate() {
            self.heartbeat.beat();
            if i == tasks.len() / 2 && part.job.injected.is_some() {
                self.flush(part)?;
                self.inject(part.job.injected);
            }
            // Copies leave together, as soon as the last of a run of them is recorded.
            if !part.copies.is_empty() && !matches!(task.kind, TaskKind::Download { .. }) {
                self.flush(part)?;
            }
            match &task.kind {
                TaskKind::Dispatch { .. } => self.dispatch(part, task),
                TaskKind::Download { image, .. } => self.download(part, *image, task),
                TaskKind::Upload { image, transfer } => {
                    self.flush(part)?;
                    self.upload(part, *image, *transfer, task)?;
                }
                TaskKind::Stitch => {}
            }
        }
        if tasks.is_empty() {
            self.inject(part.job.injected);
        }
        self.copy_stamps(part);
        self.flush(part)
    }

    fn dispatch(&mut self, part: &mut Part, task: &Task) {
        let TaskKind::Dispatch { pass, valid } = &task.kind else { return };
        let stage_task = StageTask { pass: *pass, rows: task.rows.clone(), valid: valid.clone() };
        let stage = part.graph.program.passes()[*pass].pass.stage;
        let runs = part.job.runs;
        let encoder = part.encoder(&self.gpu.device);
        if let Some(pair) = self.stages.record(&self.gpu, encoder, &mut self.stamps, &stage_task, runs) {
            part.stamped.push((pair, task.clone(), stage));
        }
    }

    fn download(&mut self, part: &mut Part, image: usize, task: &Task) {
        let bound = part.graph.program.images()[image];
        let (offset, size) = self.stages.images.span(&bound.resource, &task.rows);
        let source = self.stages.images.buffer(&bound, task.view, part.job.place);
        let copy = self.pool.record(&self.gpu, part.encoder(&self.gpu.device), source, offset, size);
        part.copies.push((copy, task.clone()));
    }

    /// The next frame's timestamps take the places of this one's.
    fn copy_stamps(&mut self, part: &mut Part) {
        let written = self.stamps.written();
        if written > 0 {
            let encoder = part.encoder(&self.gpu.device);
            encoder.resolve_query_set(&self.stamps.queries, 0..written, &self.stamp_buffer, 0);
            let size = u64::from(written) * 8;
            part.stamps_copy = Some(self.pool.record(&self.gpu, encoder, &self.stamp_buffer, 0, size));
        }
    }

    /// Submits what is recorded, and whatever older frames wait with.
    fn flush(&mut self, part: &mut Part) -> Result<(), Stop> {
        let Some(encoder) = part.encoder.take() else { return Ok(()) };
        if self.submit_blocks {
            while self.send_oldest(Some(part))? {}
        }
        {
            let _span = tracing::info_span!("submit").entered();
            let submission = self.gpu.queue.submit([encoder.finish()]);
            for (copy, task) in part.copies.drain(..) {
                let TaskKind::Download { image, transfer, to } = task.kind else { continue };
                let bound = &part.graph.program.images()[image];
                let timing = transfer_timing(&task, TimedTask::Download, bound, transfer);
                let back = copy.submitted(submission.clone());
                self.outgoing.push_back(Outgoing { ticket: part.ticket, back, to, transfer, timing });
            }
            part.stamps = part.stamps_copy.take().map(|copy| copy.submitted(submission.clone()));
            part.last = Some(submission);
        }
        while let Some(ticket) = self.open.front().map(|p| p.ticket) {
            match self.advance(false) {
                Ok(true) => {}
                Ok(false) => break,
                Err(Stop::Aborted) => self.give_up(ticket, Stop::Aborted),
                Err(failed) => return Err(failed),
            }
        }
        Ok(())
    }

    fn upload(&mut self, part: &mut Part, image: usize, transfer: u32, task: &Task) -> Result<(), Stop> {
        let bytes = self.receive(part, transfer)?;
        let bound = part.graph.program.images()[image];
        let mut timing = transfer_timing(task, TimedTask::Upload, &bound, transfer);
        timing.begin_ms = self.now_ms();
        let (offset, size) = self.stages.images.span(&bound.resource, &task.rows);
        if bytes.len() as u64 != size {
            return Err(format!("transfer {transfer} brought {} bytes of {size}", bytes.len()).into());
        }
        let target = self.stages.images.buffer(&bound, task.view, part.job.place);
        self.gpu.queue.write_buffer(target, offset, &bytes);
        timing.bytes = Some(size);
        timing.end_ms = self.now_ms();
        part.timings.push(timing);
        Ok(())
    }

    /// Waits for rows. Those that others wait for go out first: all of them stand before this upload in the common
    /// order, so whoever waits for them cannot be waited for here.
    fn receive(&mut self, part: &mut Part, transfer: u32) -> Result<Vec<u8>, Stop> {
        let _span = tracing::info_span!("wait for rows of others", frame = part.frame(), transfer).entered();
        let slice = self.gpu.patience / WAIT_SLICES;
        let mut slices = 0;
        loop {
            self.mailbox.look(part.ticket)?;
            if let Some(bytes) = self.mailbox.take(part.ticket, transfer) {
                return Ok(bytes);
            }
            if self.send_oldest(Some(part))? {
                continue;
            }
            let mailbox = &mut self.mailbox;
            match self.heartbeat.depending(|| mailbox.wait(slice))? {
                true => {}
                false if slices < DEPENDENT_SLICES => slices += 1,
                false => return Err(Stop::Aborted),
            }
        }
    }

    /// Hands on the copy that was submitted first, if there is one. `part` is the frame that is not among the open
    /// ones.
    fn send_oldest(&mut self, part: Option<&mut Part>) -> Result<bool, Stop> {
        let Some(mut out) = self.outgoing.pop_front() else { return Ok(false) };
        {
            let _span = tracing::info_span!("wait for own rows").entered();
            self.gpu.wait(Some(out.back.submission()))?;
        }
        self.heartbeat.beat();
        out.timing.begin_ms = self.now_ms();
        let bytes = self.pool.finish(&self.gpu, out.back)?;
        out.timing.bytes = Some(bytes.len() as u64);
        self.mailbox.send(out.to, out.ticket, out.transfer, bytes)?;
        out.timing.end_ms = self.now_ms();
        let mut parts = self.open.iter_mut().chain(part);
        if let Some(part) = parts.find(|p| p.ticket == out.ticket) {
            part.timings.push(out.timing);
        }
        Ok(true)
    }
}

/// Of the oldest frame: what is left once its own tasks are submitted.
impl Worker {
    /// Takes the oldest frame a step closer to its answer; without `wait`, only if nothing must be waited for. Returns
    /// whether that was so.
    pub fn advance(&mut self, wait: bool) -> Result<bool, Stop> {
        let Some(mut part) = self.open.pop_front() else { return Ok(false) };
        let moved = match part.state {
            State::Own => self.stitch(&mut part, wait),
            State::Submitted(_) => self.end(&mut part, wait),
            State::Read { .. } => match self.conclude(&mut part, wait) {
                Ok(Some(reply)) => {
                    self.mailbox.forget_below(part.ticket + 1);
                    self.answer(part.ticket, Ok(Answer::Frame(reply)));
                    return Ok(true);
                }
                Ok(None) => Ok(false),
                Err(stop) => Err(stop),
            },
        };
        self.open.push_front(part);
        moved
    }

    /// Sends what others wait for, and takes in what the whole images lack.
    fn stitch(&mut self, part: &mut Part, wait: bool) -> Result<bool, Stop> {
        let graph = Arc::clone(&part.graph);
        let uploads: Vec<_> = graph.parts_of(self.gpu.info.index).1.iter().filter_map(as_upload).collect();
        if wait {
            while self.outgoing.front().is_some_and(|o| o.ticket == part.ticket) {
                self.send_oldest(Some(part))?;
            }
        }
        self.mailbox.look(part.ticket)?;
        let is_here = |(_, _, transfer): &(_, _, u32)| self.mailbox.has(part.ticket, *transfer);
        let has_sent = self.outgoing.front().is_none_or(|o| o.ticket != part.ticket);
        let need_not_wait = has_sent && uploads.iter().all(is_here);
        if !(wait || need_not_wait) {
            return Ok(false);
        }
        for (task, image, transfer) in &uploads {
            self.upload(part, *image, *transfer, task)?;
        }
        let last = part.last.take().filter(|_| uploads.is_empty());
        // Uploads that no dispatch follows are carried out by an empty submission.
        part.state = State::Submitted(last.unwrap_or_else(|| self.gpu.queue.submit([])));
        Ok(true)
    }

    fn end(&mut self, part: &mut Part, wait: bool) -> Result<bool, Stop> {
        let State::Submitted(last) = &part.state else { return Ok(false) };
        if !self.has_ended(last, wait, part.frame())? {
            return Ok(false);
        }
        let end_ms = self.now_ms();
        if let Some(back) = part.stamps.take() {
            let ticks = bytemuck::pod_collect_to_vec::<u8, u64>(&self.pool.finish(&self.gpu, back)?);
            let timing = |(pair, task, stage): &(u32, Task, Stage)| TaskTiming {
                stage: stage.name().into(),
                kind: TimedTask::Gpu(*stage),
                view: task.view,
                device: task.device,
                rows: task.rows.clone(),
                begin_ms: self.clock.host_ms(ticks[2 * *pair as usize]),
                end_ms: self.clock.host_ms(ticks[2 * *pair as usize + 1]),
                bytes: None,
                transfer: None,
            };
            part.timings.extend(part.stamped.iter().map(timing));
        }
        let mut backs = Vec::new();
        if self.gpu.info.index == part.graph.primary {
            for image in [ROW_TALLY].into_iter().chain(part.job.reads.iter().copied()) {
                if self.stages.images.has(&image) {
                    backs.push((image, self.request(image, part.job.place)));
                }
            }
        }
        part.state = State::Read { end_ms, backs };
        Ok(true)
    }

    fn conclude(&mut self, part: &mut Part, wait: bool) -> Result<Option<FrameReply>, Stop> {
        let State::Read { end_ms, backs } = &mut part.state else { return Ok(None) };
        if let Some((_, [_, last])) = backs.last() {
            let last = last.submission();
            if !self.has_ended(&last, wait, part.job.constants.index)? {
                return Ok(None);
            }
        }
        let mut images = Vec::new();
        for (image, backs) in std::mem::take(backs) {
            images.push((image, self.finish(backs)?));
        }
        let (begin_ms, end_ms) = (part.begin_ms, *end_ms);
        Ok(Some(FrameReply { tasks: std::mem::take(&mut part.timings), begin_ms, end_ms, images }))
    }

    fn has_ended(&self, submission: &wgpu::SubmissionIndex, wait: bool, frame: u32) -> Result<bool, Stop> {
        if wait {
            let _span = tracing::info_span!("wait for device", frame).entered();
            self.gpu.wait(Some(submission.clone()))?;
            return Ok(true);
        }
        Ok(self.gpu.has_ended(submission)?)
    }
}

fn as_upload(task: &Task) -> Option<(&Task, usize, u32)> {
    match task.kind {
        TaskKind::Upload { image, transfer } => Some((task, image, transfer)),
        _ => None,
    }
}

fn transfer_timing(task: &Task, kind: TimedTask, bound: &Bound, transfer: u32) -> TaskTiming {
    TaskTiming {
        stage: bound.name(),
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
