//! One rank's view of a renderer's devices on all ranks. Each rank has the channels of all devices. The channels of its
//! own devices lead to workers. The channels of other ranks' devices lead to [`RendererDevices`], which forwards their
//! messages.

use std::time::Duration;

use crossbeam::channel::{Select, Sender, TryRecvError};

use super::packet::Packet;
use crate::exec::channels::{RendererChannels, WorkerChannels};
use crate::exec::messages::{Message, Order, Reply};
use crate::exec::watchdog::LifeSign;

pub struct RendererDevices {
    number: u32,
    /// Senders to the workers of all devices, on any rank.
    inboxes: Vec<Sender<Message>>,
    /// Sender to the renderer, if it is on this rank.
    replies: Sender<Reply>,
    /// Channels that give orders to this rank's workers, if the renderer is on another rank.
    commander: Option<RendererChannels>,
    own: Vec<usize>,
    others: Vec<Other>,
    /// Renderer's time origin, in milliseconds since the node's epoch.
    pub origin_ms: f64,
}

/// A device of another rank.
struct Other {
    device: usize,
    rank: usize,
    end: WorkerChannels,
    is_closed: bool,
}

impl RendererDevices {
    /// Creates the view that rank `here` has of a renderer's devices. Also returns the channel ends for this rank's
    /// workers. `ends` holds the worker's end for every device, and `ranks` the rank of each. `commander` is `None` on
    /// the renderer's rank.
    pub fn new(
        number: u32,
        (here, ranks): (usize, &[usize]),
        ends: Vec<WorkerChannels>,
        commander: Option<RendererChannels>,
        origin_ms: f64,
    ) -> (Self, Vec<WorkerChannels>) {
        let (inboxes, replies) = ends.first().map(WorkerChannels::senders).unwrap_or_else(|| {
            let (replies, _) = crossbeam::channel::unbounded();
            (Vec::new(), replies)
        });
        let (mut own, mut own_ends, mut others) = (Vec::new(), Vec::new(), Vec::new());
        for (device, (end, &rank)) in ends.into_iter().zip(ranks).enumerate() {
            if rank == here {
                own.push(device);
                own_ends.push(end);
            } else {
                others.push(Other { device, rank, end, is_closed: false });
            }
        }
        (Self { number, inboxes, replies, commander, own, others, origin_ms }, own_ends)
    }

    /// Passes all pending orders, messages and replies for other ranks to `send`, each with the number of the
    /// receiving rank. Returns true if there were any.
    pub fn pass_on(&mut self, send: &mut impl FnMut(usize, Packet)) -> bool {
        let renderer = self.number;
        let mut any = false;
        for other in &mut self.others {
            let (orders, inbox) = other.end.receivers();
            let device = other.device;
            let mut packets = Vec::new();
            while !other.is_closed {
                match orders.try_recv() {
                    Ok(order) => packets.push(Packet::Order { renderer, device, order: Box::new(order) }),
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => {
                        other.is_closed = true;
                        packets.push(Packet::Close { renderer, device });
                    }
                }
            }
            packets.extend(inbox.try_iter().map(|message| Packet::Message { renderer, device, message }));
            any |= !packets.is_empty();
            packets.into_iter().for_each(|packet| send(other.rank, packet));
        }
        if let Some(commander) = &self.commander {
            for reply in commander.replies().try_iter() {
                any = true;
                send(0, Packet::Reply { renderer, reply: Box::new(reply) });
            }
        }
        any
    }

    /// Makes `select` wake up for everything that [`Self::pass_on`] forwards.
    pub fn watch<'a>(&'a self, select: &mut Select<'a>) {
        for other in &self.others {
            let (orders, inbox) = other.end.receivers();
            if !other.is_closed {
                select.recv(orders);
            }
            select.recv(inbox);
        }
        if let Some(commander) = &self.commander {
            select.recv(commander.replies());
        }
    }

    pub fn order(&self, device: usize, order: Order) {
        if let Some(commander) = self.commander.as_ref().filter(|_| self.own.contains(&device)) {
            commander.order(device, order);
        }
    }

    pub fn close(&mut self, device: usize) {
        if let Some(commander) = self.commander.as_mut().filter(|_| self.own.contains(&device)) {
            commander.close(device);
        }
    }

    /// Delivers a message to a worker on this rank.
    pub fn message(&self, device: usize, message: Message) {
        if self.own.contains(&device) {
            // A worker that has ended needs no message.
            let _ = self.inboxes[device].send(message);
        }
    }

    pub fn reply(&self, reply: Reply) {
        // The receiver is gone if the run has ended.
        let _ = self.replies.send(reply);
    }

    /// Returns the signs of life of this rank's workers, each with its device number and `None` if the worker has
    /// ended. Returns `None` if the renderer is on this rank.
    pub fn signs(&self) -> Option<Vec<(usize, Option<LifeSign>)>> {
        let commander = self.commander.as_ref()?;
        let signs = commander.signs();
        let of = |&device: &usize| (device, (!commander.ends(device, Duration::ZERO)).then(|| signs[device]));
        Some(self.own.iter().map(of).collect())
    }

    pub fn take_signs(&mut self, signs: &[(usize, Option<LifeSign>)]) {
        for (device, sign) in signs {
            match sign {
                Some(sign) => {
                    let other = self.others.iter().find(|other| other.device == *device);
                    other.into_iter().for_each(|other| other.end.heartbeat().show(*sign));
                }
                None => self.others.retain(|other| other.device != *device),
            }
        }
    }

    /// Removes the workers of a lost rank.
    pub fn lose(&mut self, rank: usize) {
        self.others.retain(|other| other.rank != rank);
    }
}
