//! The workers as the renderer sees them: one is asked, its answer awaited, and no longer than it may take.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, unbounded};

use super::ExecError;
use super::mailbox::Mailbox;
use super::messages::{Answer, Command, Message, Order, Reply, Stop};
use super::planner::Graphs;
use super::watchdog::{Heartbeat, Watchdog};
use super::worker::Worker;
use crate::device::{DeviceFailure, DeviceInfo, FailureKind, GpuDevice};
use crate::stages::{SceneTables, StageSettings};

/// How long a worker's end is waited for, when all has been said.
const END_LIMIT: Duration = Duration::from_secs(5);

/// One worker per device, those that were taken out included.
pub struct WorkerPool {
    members: Vec<Member>,
    replies: Receiver<Reply>,
    /// Of the workers, to call a frame off.
    inboxes: Vec<Sender<Message>>,
    /// Oldest first.
    asked: Vec<Asked>,
    ticket: u64,
}

struct Member {
    /// None: it was taken out.
    commands: Option<Sender<Command>>,
    thread: JoinHandle<Option<GpuDevice>>,
    /// Disconnected once the worker has done its last.
    ended: Receiver<()>,
    heartbeat: Arc<Heartbeat>,
    is_hung: bool,
}

impl Member {
    fn start(worker: Worker) -> Result<Self, ExecError> {
        let (commands, orders) = unbounded();
        let (here, ended) = unbounded();
        let heartbeat = worker.heartbeat();
        let name = format!("device {}", worker.info().index);
        let thread = std::thread::Builder::new().name(name).spawn(move || {
            let _here: Sender<()> = here;
            worker.run(orders)
        })?;
        Ok(Self { commands: Some(commands), thread, ended, heartbeat, is_hung: false })
    }
}

/// What came of what was asked, by device.
pub type Answers = Vec<(usize, Result<Answer, Stop>)>;

/// Orders under one ticket, and what has come of them.
struct Asked {
    ticket: u64,
    awaited: Vec<usize>,
    answers: Answers,
}

impl WorkerPool {
    /// Warms every device up and starts its worker; also returns what is known of the devices. Times are counted from
    /// `origin`.
    ///
    /// # Errors
    /// A device that fails at once, has too little memory or cannot compile a stage, and threads that cannot be started.
    pub fn start(
        gpus: Vec<GpuDevice>,
        settings: &StageSettings,
        tables: &SceneTables,
        graphs: &Arc<Graphs>,
        origin: Instant,
    ) -> Result<(Self, Vec<DeviceInfo>), ExecError> {
        let programs = graphs.programs();
        let (reply, replies) = unbounded();
        let (inboxes, receivers): (Vec<_>, Vec<_>) = gpus.iter().map(|_| unbounded()).unzip();
        let mut workers = Vec::new();
        for (gpu, inbox) in gpus.into_iter().zip(receivers) {
            let mailbox = Mailbox::new(gpu.info.index, inbox, inboxes.clone());
            let graphs = Arc::clone(graphs);
            workers.push(Worker::new(gpu, settings, tables, &programs, graphs, mailbox, reply.clone(), origin)?);
        }
        let devices = workers.iter().map(|w| w.info().clone()).collect();
        let members = workers.into_iter().map(Member::start).collect::<Result<_, _>>()?;
        Ok((Self { members, replies, inboxes, asked: Vec::new(), ticket: 0 }, devices))
    }

    /// The devices that were not taken out.
    pub fn left(&self) -> Vec<usize> {
        (0..self.members.len()).filter(|&d| self.members[d].commands.is_some()).collect()
    }

    /// Asks nothing more of a device. Its worker ends by itself, if it can.
    pub fn take_out(&mut self, device: usize) {
        self.members[device].commands = None;
    }

    /// Has the orders carried out, under a ticket of their own; `limit` is what a device may take for each thing that is
    /// waited for.
    pub fn ask(&mut self, orders: Vec<(usize, Order)>, limit: Duration) -> u64 {
        self.ticket += 1;
        let ticket = self.ticket;
        let mut gone_devices = Vec::new();
        let mut asked = Asked { ticket, awaited: Vec::new(), answers: Answers::new() };
        for (device, order) in orders {
            let command = Command { ticket, limit, order };
            asked.awaited.push(device);
            match &self.members[device].commands {
                Some(commands) if commands.send(command).is_ok() => {}
                _ => gone_devices.push(device),
            }
        }
        self.asked.push(asked);
        gone_devices.into_iter().for_each(|d| self.answer_for(d, gone()));
        ticket
    }

    /// Tells the workers not to wait for rows of this ticket.
    pub fn call_off(&self, ticket: u64) {
        for inbox in &self.inboxes {
            // Who is gone waits for nothing.
            let _ = inbox.send(Message::Abort { ticket });
        }
    }

    /// Waits for the answers to what was asked under this ticket. A device that shows no sign of life for longer than
    /// `limit` is answered for, and the others are told not to wait for it.
    pub fn answers(&mut self, ticket: u64, limit: Duration) -> Answers {
        let heartbeats: Vec<_> = self.members.iter().map(|m| Arc::clone(&m.heartbeat)).collect();
        let heartbeats: Vec<&Heartbeat> = heartbeats.iter().map(|p| &**p).collect();
        let mut watchdog = Watchdog::new(limit, &heartbeats);
        loop {
            let Some(place) = self.asked.iter().position(|a| a.ticket == ticket) else { return Answers::new() };
            if self.asked[place].awaited.is_empty() {
                return self.asked.remove(place).answers;
            }
            let awaited = self.asked[place].awaited.clone();
            match self.replies.recv_timeout(watchdog.slice()) {
                Ok(reply) => self.take_in(reply),
                Err(RecvTimeoutError::Timeout) => {
                    let ended: Vec<_> =
                        awaited.iter().filter(|&&d| self.members[d].thread.is_finished()).copied().collect();
                    ended.into_iter().for_each(|d| self.answer_for(d, gone()));
                }
                Err(RecvTimeoutError::Disconnected) => awaited.iter().for_each(|&d| self.answer_for(d, gone())),
            }
            // Who has answered just now is not hung.
            let awaited = self.asked[place].awaited.clone();
            for device in watchdog.silent(&heartbeats).into_iter().filter(|d| awaited.contains(d)) {
                self.members[device].is_hung = true;
                let what = format!("its worker gave no sign of life for more than {} ms", limit.as_millis());
                self.answer_for(device, DeviceFailure { kind: FailureKind::Hang, what });
            }
        }
    }

    /// Ends all workers; returns the devices that have not failed.
    pub fn end(&mut self) -> Vec<GpuDevice> {
        self.members.iter_mut().for_each(|m| m.commands = None);
        let has_ended = |m: &Member| m.ended.recv_timeout(END_LIMIT) == Err(RecvTimeoutError::Disconnected);
        let ended = self.members.drain(..).filter(|m| !m.is_hung && has_ended(m));
        ended.filter_map(|m| m.thread.join().ok().flatten()).collect()
    }

    /// Devices that were answered for may answer after all, too late.
    fn take_in(&mut self, Reply { ticket, device, answer }: Reply) {
        let is_awaited = |a: &&mut Asked| a.ticket == ticket && a.awaited.contains(&device);
        if let Some(asked) = self.asked.iter_mut().find(is_awaited) {
            asked.awaited.retain(|d| *d != device);
            asked.answers.push((device, answer));
        }
    }

    /// Answers all that a device was asked.
    fn answer_for(&mut self, device: usize, failure: DeviceFailure) {
        let mut called_off = Vec::new();
        for asked in self.asked.iter_mut().filter(|a| a.awaited.contains(&device)) {
            asked.awaited.retain(|d| *d != device);
            asked.answers.push((device, Err(Stop::Device(failure.clone()))));
            called_off.push(asked.ticket);
        }
        called_off.into_iter().for_each(|ticket| self.call_off(ticket));
    }
}

fn gone() -> DeviceFailure {
    "its worker has ended".to_owned().into()
}

impl Drop for WorkerPool {
    fn drop(&mut self) {
        self.end();
    }
}
