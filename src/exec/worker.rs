//! The thread that drives one device: it executes the actions of [`Protocol`].

pub mod action;
pub mod device;
mod part;
mod speeds;
pub mod protocol;

use std::collections::HashMap;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use tracing::span::EnteredSpan;

use super::channels::WorkerChannels;
use super::messages::{Answer, Bytes, Message, Order, Reply, Stop, Work};
use super::output::Output;
use super::planner::Graphs;
use crate::device::{DeviceFailure, GpuDevice, WAIT_SLICES, panic_text};
use crate::plan::Outgoing;
use crate::stages::Place;
use action::{Action, Ordered, Outcome};
use device::WorkerDevice;
use part::Part;
use protocol::Protocol;

pub struct Worker {
    device: WorkerDevice,
    graphs: Arc<Graphs>,
    channels: WorkerChannels,
    protocol: Protocol<Bytes>,
    /// Frames that have not been answered, by ticket.
    parts: HashMap<u64, Part>,
    /// Image to read next.
    read: Option<(Output, Place)>,
    /// Answer that has not been sent yet.
    done: Option<Answer>,
    /// Failure after which the device can no longer be used.
    failure: Option<DeviceFailure>,
}

impl Worker {
    pub fn new(device: WorkerDevice, graphs: Arc<Graphs>, channels: WorkerChannels) -> Self {
        let protocol = Protocol::new(device.gpu.quirks.submit_blocks);
        let parts = HashMap::new();
        Self { device, graphs, channels, protocol, parts, read: None, done: None, failure: None }
    }

    /// Starts a thread that runs the worker. When the worker ends, the thread returns the worker's device, or `None` if
    /// the device has failed.
    ///
    /// # Errors
    /// An I/O error if the thread cannot be started.
    pub fn start(self) -> io::Result<JoinHandle<Option<GpuDevice>>> {
        let name = format!("device {}", self.device.gpu.info.index);
        thread::Builder::new().name(name).spawn(move || self.run())
    }

    /// Executes orders until the renderer closes the order channel; returns the device if it has not failed.
    fn run(mut self) -> Option<GpuDevice> {
        let mut spans = Spans::default();
        loop {
            self.channels.heartbeat().beat();
            while let Some(message) = self.channels.message(Duration::ZERO) {
                self.protocol.message(message);
            }
            let action = self.protocol.next_action();
            self.follow(&action, &mut spans);
            // A panic is a bug, but report it as a device failure, so that other workers stop waiting for this device.
            let done = catch_unwind(AssertUnwindSafe(|| self.perform(action)))
                .unwrap_or_else(|panic| Err(format!("its worker panicked: {}", panic_text(&*panic)).into()));
            match done {
                Ok(true) => {}
                Ok(false) => break,
                Err(failure) => {
                    self.failure = Some(failure);
                    self.protocol.fail();
                }
            }
        }
        (self.failure.is_none() && self.device.gpu.failure().is_none()).then_some(self.device.gpu)
    }

    /// Opens and closes the trace spans that last longer than an action.
    fn follow(&self, action: &Action<Bytes>, spans: &mut Spans) {
        let frame = |ticket: &u64| self.parts.get(ticket).map(Part::frame);
        match action {
            // The first command begins the frame.
            Action::Execute { ticket, at: 0 } => {
                spans.frame = Some(tracing::info_span!("device frame", frame = frame(ticket)).entered())
            }
            Action::Receive { ticket, transfer } => {
                let span = tracing::info_span!("wait for rows of others", frame = frame(ticket), ticket, transfer);
                spans.rows = Some(span.entered());
            }
            Action::Write { .. } | Action::Answer { .. } => spans.rows = None,
            Action::TakeOrder { .. } => *spans = Spans::default(),
            _ => {}
        }
    }

    /// Executes an action; returns false if the worker must end.
    fn perform(&mut self, action: Action<Bytes>) -> Result<bool, DeviceFailure> {
        let Self { device, channels, protocol, parts, .. } = self;
        match action {
            Action::TakeOrder { waits } => match channels.order(waits) {
                Some(order) => self.obey(order),
                None if waits => return Ok(false),
                None => protocol.no_order(),
            },
            Action::Execute { ticket, at } => {
                part_of(parts, ticket)?.execute(device, at, || channels.heartbeat().beat())?;
            }
            Action::Inject { kind } => device.inject(kind),
            Action::Send(Outgoing { ticket, transfer, to }) => {
                let part = part_of(parts, ticket)?;
                let _span = tracing::info_span!("send rows", frame = part.frame(), ticket, transfer).entered();
                let send = |rows| channels.send(to, Message::Rows { ticket, transfer, rows });
                part.send(device, transfer, || channels.heartbeat().beat(), send)?;
            }
            Action::Receive { .. } => {}
            Action::AwaitMessage => {
                let slice = device.gpu.patience / WAIT_SLICES;
                match channels.heartbeat().depending(|| channels.message(slice)) {
                    Some(message) => protocol.message(message),
                    None => protocol.timed_out(),
                }
            }
            Action::Write { ticket, at, rows } => part_of(parts, ticket)?.write(device, at, rows)?,
            Action::End { ticket, waits } => protocol.ended(part_of(parts, ticket)?.end(device, waits)?),
            Action::TakeImages { ticket, waits } => {
                self.done = part_of(parts, ticket)?.take_images(device, waits)?.map(Answer::Frame);
                protocol.ended(self.done.is_some());
            }
            Action::Read { .. } => {
                let (image, place) = self.read.take().ok_or_else(|| "its worker has no image to read".to_owned())?;
                for back in device.request(&[image], place)? {
                    self.done = Some(Answer::Pixels(device.take(back)?));
                }
            }
            Action::CallOff { ticket } => channels.call_off(ticket),
            Action::Answer { ticket, outcome } => self.answer(ticket, outcome),
        }
        Ok(true)
    }

    fn obey(&mut self, Order { ticket, limit, work }: Order) {
        let Self { device, protocol, parts, .. } = self;
        device.gpu.patience = limit;
        protocol.order(ticket, || match work {
            Work::Frame(job) => {
                let part = Part::new(ticket, *job, &self.graphs, device);
                let commands = Arc::clone(part.commands());
                parts.insert(ticket, part);
                Ordered::Frame(commands)
            }
            Work::Read { image, place, injected } => {
                self.read = Some((image, place));
                Ordered::Read { injected }
            }
        });
    }

    fn answer(&mut self, ticket: u64, outcome: Outcome) {
        self.parts.remove(&ticket);
        let done = self.done.take().filter(|_| outcome == Outcome::Done);
        let failure = self.failure.clone().filter(|_| outcome == Outcome::Failed);
        let answer = done.ok_or_else(|| failure.map_or(Stop::Aborted, Stop::Device));
        self.channels.answer(Reply { ticket, device: self.device.gpu.info.index, answer });
    }
}

fn part_of(parts: &mut HashMap<u64, Part>, ticket: u64) -> Result<&mut Part, DeviceFailure> {
    parts.get_mut(&ticket).ok_or_else(|| format!("its worker has no frame with the ticket {ticket}").into())
}

/// Trace spans that last longer than an action.
#[derive(Default)]
struct Spans {
    // Nested in `frame`, so it is dropped first.
    rows: Option<EnteredSpan>,
    frame: Option<EnteredSpan>,
}
