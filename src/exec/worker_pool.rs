//! The renderer's view of its workers: sends orders, and waits for answers within time limits.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::ExecError;
use super::channels::{RendererChannels, channels};
use super::ledger::Ledger;
use super::messages::{Answer, Order, Stop, Work};
use super::planner::Graphs;
use super::ranks::{Devices, Others, RankError};
use super::stopping::{CHECK_INTERVAL, StopFlag};
use super::watchdog::Watchdog;
use super::worker::Worker;
use super::worker::device::WorkerDevice;
use crate::device::{DeviceFailure, DeviceInfo, FailureKind, GpuDevice};
use crate::frame::RunConfig;
use crate::schedule::Network;
use crate::tables::SceneTables;

/// Time that a worker may take to end once its order channel is closed.
pub const END_LIMIT: Duration = Duration::from_secs(5);

/// The workers: one per device, including devices that were dropped.
pub struct WorkerPool {
    channels: RendererChannels,
    members: Vec<Member>,
    ledger: Ledger<Result<Answer, Stop>>,
    /// The devices of other ranks.
    others: Option<Others>,
}

struct Member {
    /// `None` if the worker is on another rank.
    thread: Option<JoinHandle<Option<GpuDevice>>>,
    is_left: bool,
    /// True if nothing waits for the worker any more.
    is_hung: bool,
}

impl WorkerPool {
    /// Warms up every device and starts its worker; also returns the info of the devices. All reported times count from
    /// `origin`.
    ///
    /// # Errors
    /// [`ExecError`] if a device fails during warm-up, has too little memory or cannot compile a stage, a thread cannot
    /// be started, `stop` is set, or another rank cannot take part.
    pub fn start(
        devices: Devices,
        config: &RunConfig,
        tables: &Arc<SceneTables>,
        graphs: &Arc<Graphs>,
        origin: Instant,
        stop: &StopFlag,
    ) -> Result<(Self, Vec<DeviceInfo>), ExecError> {
        let programs = graphs.programs();
        let (gpus, mut others) = devices.split();
        let count = others.as_ref().map_or(gpus.len(), Others::devices);
        let asked = others.as_ref().map(|others| others.start(config, tables));
        let (own_config, own_tables) = (config.clone(), Arc::clone(tables));
        let begun = stop.unless_set("start devices", move || {
            let gpus = gpus.into_iter().map(|gpu| WorkerDevice::new(gpu, &own_config, &own_tables, &programs, origin));
            let mut gpus = gpus.collect::<Result<Vec<_>, _>>()?;
            gpus.iter_mut().try_for_each(WorkerDevice::calibrate)?;
            Ok::<_, ExecError>(gpus)
        })?;
        let gpus = begun.ok_or(ExecError::Stopped)??;
        let mut infos: Vec<DeviceInfo> = gpus.iter().map(|device| device.gpu.info.clone()).collect();
        let (channels, mut ends) = channels(count);
        if let Some((others, asked)) = others.as_mut().zip(asked) {
            let (of_others, own_ends) = others.join(asked, ends, origin)?;
            infos.extend(of_others);
            ends = own_ends;
        }
        let mut members = Vec::new();
        for (device, end) in gpus.into_iter().zip(ends) {
            let worker = Worker::new(device, Arc::clone(graphs), end);
            members.push(Member::of(Some(worker.start()?)));
        }
        members.resize_with(count, || Member::of(None));
        Ok((Self { channels, members, ledger: Ledger::default(), others }, infos))
    }

    /// Returns the network between devices of different ranks.
    pub fn network(&self) -> Network {
        self.others.as_ref().map(Others::network).unwrap_or_default()
    }

    /// Returns the error of a lost rank, if there is one.
    pub fn lost(&self) -> Option<RankError> {
        self.others.as_ref().and_then(Others::lost)
    }

    /// Returns the devices that were not dropped.
    pub fn left(&self) -> Vec<usize> {
        (0..self.members.len()).filter(|&d| self.members[d].is_left).collect()
    }

    /// Drops a device: it gets no more orders, and its worker ends unless it hangs.
    pub fn drop_device(&mut self, device: usize) {
        self.members[device].is_left = false;
        self.channels.close(device);
    }

    /// Sends each order to its device. All orders get one new ticket, which is returned. `limit` is the
    /// device's time limit for each operation that its worker waits for.
    pub fn ask(&mut self, orders: Vec<(usize, Work)>, limit: Duration) -> u64 {
        let ticket = self.ledger.ask(orders.iter().map(|(device, _)| *device).collect());
        for (device, work) in orders {
            if !self.channels.order(device, Order { ticket, limit, work }) {
                self.answer_for(device, gone());
            }
        }
        ticket
    }

    /// Tells the workers to stop waiting for rows of this ticket.
    pub fn call_off(&self, ticket: u64) {
        self.channels.call_off(ticket);
    }

    /// Waits for the answers to the orders under this ticket, each with its device. If a worker shows no sign of life for
    /// longer than `limit`, the pool records a failure as its answer and tells the other workers to stop waiting for its
    /// rows.
    pub fn answers(&mut self, ticket: u64, limit: Duration) -> Vec<(usize, Result<Answer, Stop>)> {
        self.answers_while(ticket, limit, || true).unwrap_or_default()
    }

    /// Waits like [`Self::answers`], but returns `None` once `goes_on`, which is called repeatedly, returns false. The
    /// missing answers then never come, and nothing waits for these workers any more.
    pub fn answers_while(
        &mut self,
        ticket: u64,
        limit: Duration,
        mut goes_on: impl FnMut() -> bool,
    ) -> Option<Vec<(usize, Result<Answer, Stop>)>> {
        let mut watchdog = Watchdog::new(limit, &self.channels.signs());
        loop {
            if let Some(answers) = self.ledger.take(ticket) {
                return Some(answers);
            }
            if !goes_on() {
                self.ledger.awaited(ticket).iter().for_each(|&device| self.members[device].is_hung = true);
                return None;
            }
            match self.channels.reply(watchdog.until_look().min(CHECK_INTERVAL)) {
                Some(reply) => self.ledger.answer(reply.ticket, reply.device, reply.answer),
                None => {
                    for device in self.ledger.awaited(ticket).to_vec() {
                        if self.channels.ends(device, Duration::ZERO) {
                            self.answer_for(device, gone());
                        }
                    }
                }
            }
            // A worker that has just answered does not hang.
            for device in watchdog.silent(&self.channels.signs()) {
                if self.ledger.awaited(ticket).contains(&device) {
                    self.members[device].is_hung = true;
                    let what = format!("its worker gave no sign of life for more than {} ms", limit.as_millis());
                    self.answer_for(device, DeviceFailure { kind: FailureKind::Hang, what });
                }
            }
        }
    }

    /// Ends all workers; returns the devices that have not failed.
    pub fn end(&mut self) -> Devices {
        (0..self.members.len()).for_each(|device| self.channels.close(device));
        let members = std::mem::take(&mut self.members).into_iter().enumerate();
        let own = members.filter_map(|(device, m)| Some((device, m.is_hung, m.thread?)));
        let ended = own.filter(|(device, is_hung, _)| !is_hung && self.channels.ends(*device, END_LIMIT));
        let gpus: Vec<GpuDevice> = ended.filter_map(|(.., thread)| thread.join().ok().flatten()).collect();
        match self.others.take() {
            None => gpus.into(),
            Some(others) => others.end(gpus),
        }
    }

    /// Answers all open orders of a device with this failure.
    fn answer_for(&mut self, device: usize, failure: DeviceFailure) {
        for ticket in self.ledger.answer_for(device, || Err(Stop::Device(failure.clone()))) {
            self.channels.call_off(ticket);
        }
    }
}

impl Member {
    fn of(thread: Option<JoinHandle<Option<GpuDevice>>>) -> Self {
        Self { thread, is_left: true, is_hung: false }
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
