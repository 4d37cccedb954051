//! The workers as the renderer sees them: one is asked, its answer awaited, and no longer than it may take.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, unbounded};

use super::ExecError;
use super::messages::{Answer, Command, Order, Parcel, Reply, Stop};
use super::watchdog::{Pulse, Vigil};
use super::worker::Worker;
use crate::device::{DeviceFailure, FailureKind};

/// How long a worker's end is waited for, when all has been said.
const END_LIMIT: Duration = Duration::from_secs(5);

/// One worker per device, those that were taken out included.
pub struct Crew {
    members: Vec<Member>,
    replies: Receiver<Reply>,
    /// Of the workers, to call a frame off.
    inboxes: Vec<Sender<Parcel>>,
    ticket: u64,
}

struct Member {
    /// None: it was taken out.
    commands: Option<Sender<Command>>,
    thread: JoinHandle<()>,
    /// Disconnected once the worker has let go of its device.
    ended: Receiver<()>,
    pulse: Arc<Pulse>,
    is_hung: bool,
}

impl Member {
    fn start(worker: Worker) -> Result<Self, ExecError> {
        let (commands, orders) = unbounded();
        let (here, ended) = unbounded();
        let pulse = worker.pulse();
        let name = format!("device {}", worker.info().index);
        let thread = std::thread::Builder::new().name(name).spawn(move || {
            let _here: Sender<()> = here;
            worker.run(orders);
        })?;
        Ok(Self { commands: Some(commands), thread, ended, pulse, is_hung: false })
    }
}

/// What came of what was asked, by device.
pub type Answers = Vec<(usize, Result<Answer, Stop>)>;

impl Crew {
    pub fn start(
        workers: Vec<Worker>,
        replies: Receiver<Reply>,
        inboxes: Vec<Sender<Parcel>>,
    ) -> Result<Self, ExecError> {
        let members = workers.into_iter().map(Member::start).collect::<Result<_, _>>()?;
        Ok(Self { members, replies, inboxes, ticket: 0 })
    }

    /// The devices that were not taken out.
    pub fn left(&self) -> Vec<usize> {
        (0..self.members.len()).filter(|&d| self.members[d].commands.is_some()).collect()
    }

    /// Asks nothing more of a device. Its worker ends by itself, if it can.
    pub fn take_out(&mut self, device: usize) {
        self.members[device].commands = None;
    }

    /// Has the orders carried out, under a ticket of their own, and waits for an answer to each. A device that shows no
    /// sign of life for longer than `limit` is answered for, and the others are told not to wait for it.
    pub fn ask(&mut self, orders: Vec<(usize, Order)>, limit: Duration) -> Answers {
        self.ticket += 1;
        let mut answers = Answers::new();
        let mut awaited = Vec::new();
        for (device, order) in orders {
            let command = Command { ticket: self.ticket, limit, order };
            if self.members[device].commands.as_ref().is_some_and(|c| c.send(command).is_ok()) {
                awaited.push(device);
            } else {
                self.answer_for(device, gone(), &mut answers);
            }
        }
        let pulses: Vec<_> = self.members.iter().map(|m| Arc::clone(&m.pulse)).collect();
        let pulses: Vec<&Pulse> = pulses.iter().map(|p| &**p).collect();
        let mut vigil = Vigil::new(limit, &pulses);
        while !awaited.is_empty() {
            let mut missing = Vec::new();
            match self.replies.recv_timeout(vigil.slice()) {
                // Devices that were answered for may answer after all, too late.
                Ok(reply) if reply.ticket == self.ticket && awaited.contains(&reply.device) => {
                    awaited.retain(|d| *d != reply.device);
                    answers.push((reply.device, reply.answer));
                }
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => {
                    missing.extend(
                        awaited.iter().filter(|&&d| self.members[d].thread.is_finished()).map(|&d| (d, gone())),
                    );
                }
                Err(RecvTimeoutError::Disconnected) => missing.extend(awaited.iter().map(|&d| (d, gone()))),
            }
            for device in vigil.silent(&pulses).into_iter().filter(|d| awaited.contains(d)) {
                self.members[device].is_hung = true;
                let what = format!("its worker gave no sign of life for more than {} ms", limit.as_millis());
                missing.push((device, DeviceFailure { kind: FailureKind::Hang, what }));
            }
            for (device, failure) in missing {
                awaited.retain(|d| *d != device);
                self.answer_for(device, failure, &mut answers);
            }
        }
        answers
    }

    fn answer_for(&self, device: usize, failure: DeviceFailure, answers: &mut Answers) {
        if answers.iter().any(|(d, _)| *d == device) {
            return;
        }
        for inbox in &self.inboxes {
            // Who is gone waits for nothing.
            let _ = inbox.send(Parcel::Abort { ticket: self.ticket });
        }
        answers.push((device, Err(Stop::Device(failure))));
    }
}

fn gone() -> DeviceFailure {
    "its worker has ended".to_owned().into()
}

impl Drop for Crew {
    fn drop(&mut self) {
        self.members.iter_mut().for_each(|m| m.commands = None);
        for member in self.members.drain(..).filter(|m| !m.is_hung) {
            if member.ended.recv_timeout(END_LIMIT) == Err(RecvTimeoutError::Disconnected) {
                let _ = member.thread.join();
            }
        }
    }
}
