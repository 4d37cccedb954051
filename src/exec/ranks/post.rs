//! The thread of a rank that carries packets. Only this thread uses the link, and no other thread waits for it.

use std::collections::HashMap;
use std::io::{self, Write};
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Select, Sender, TryRecvError};
use tracing::span::EnteredSpan;

use super::link::Link;
use super::packet::{Packet, RankMessage};
use super::peer::{Peer, Ping, TRIPS_TIME};
use super::renderer_devices::RendererDevices;
use super::shared::{Control, Shared};
use super::{RankError, Recorded};
use crate::exec::messages::Bytes;

/// Time without a packet after which a rank is lost. Rank 0 watches the others, and they watch rank 0.
const SILENCE: Duration = Duration::from_secs(5);
/// Maximum time that the timeouts advance between two checks. A suspension of this process thus uses up no more than
/// this much of them.
const STEP: Duration = Duration::from_millis(500);
/// Time that the rank's other threads have to end the run after a rank is lost, before the post aborts all processes.
const GRACE: Duration = Duration::from_secs(3);

/// Interval at which ranks other than 0 send the signs of life of their workers.
const SIGNS: Duration = Duration::from_millis(10);

/// Divisor that gives the sleep before the next poll for packets: the time since the last packet of a frame divided by
/// `REST_PART`, clamped to `SHORT_REST` ..= `LONG_REST`. Shorter sleeps would slow down devices on the same cores.
const REST_PART: u32 = 8;
const SHORT_REST: Duration = Duration::from_micros(50);
const LONG_REST: Duration = Duration::from_millis(1);

pub struct Post<L> {
    link: L,
    controls: Receiver<Control>,
    messages: Sender<(usize, RankMessage)>,
    shared: Arc<Shared>,
    renderers: HashMap<u32, RendererDevices>,
    peers: Vec<Peer>,
    /// Zero of this rank's clock.
    epoch: Instant,
    /// The rank that was called last, and the time of the call.
    called: (usize, Instant),
    /// Expected end of the sending of rows, and arrival of the newest rows, in milliseconds since the epoch.
    sends_until_ms: f64,
    rows_came_ms: f64,
    /// Time until which the thread polls without sleeping.
    alert: Instant,
    /// Time of the last poll that found no further packet.
    looked: Instant,
    /// Trace span of the time in which the post handles no packets except signs of life, pings and pongs.
    idle: Option<EnteredSpan>,
    signed: Instant,
    stepped: Instant,
    active: Instant,
    lost_for: Duration,
    on_interrupt: Box<dyn Fn(i32)>,
}

impl<L: Link> Post<L> {
    pub fn new(
        link: L,
        controls: Receiver<Control>,
        messages: Sender<(usize, RankMessage)>,
        shared: Arc<Shared>,
        epoch: Instant,
        on_interrupt: Box<dyn Fn(i32)>,
    ) -> Self {
        let peers = (0..link.ranks()).map(|_| Peer::default()).collect();
        let now = Instant::now();
        Self {
            link,
            controls,
            messages,
            shared,
            renderers: HashMap::new(),
            peers,
            epoch,
            called: (0, now),
            sends_until_ms: 0.0,
            rows_came_ms: 0.0,
            alert: now,
            looked: now,
            idle: None,
            signed: now,
            stepped: now,
            active: now,
            lost_for: Duration::ZERO,
            on_interrupt,
        }
    }

    pub fn run(mut self) {
        loop {
            let mut any = false;
            loop {
                match self.controls.try_recv() {
                    Ok(Control::Send { to, message }) => self.send(to, &Packet::RankMessage(message)),
                    Ok(Control::Attach { number, renderer }) => drop(self.renderers.insert(number, *renderer)),
                    Ok(Control::Detach { number }) => drop(self.renderers.remove(&number)),
                    Ok(Control::Abort { status }) => return self.link.abort(status),
                    Ok(Control::Leave) | Err(TryRecvError::Disconnected) => return self.leave(),
                    Err(TryRecvError::Empty) => break,
                }
                any = true;
            }
            any |= self.pass_on();
            while let Some((from, bytes)) = self.link.receive() {
                any |= self.take(from, bytes);
            }
            self.looked = Instant::now();
            // MPI makes progress only during calls, so poll more often while messages are unfinished. Do not do so
            // while there are renderers, since their devices may use the same cores.
            let is_under_way = !self.link.is_settled() && self.renderers.is_empty();
            self.send_heartbeats();
            if any || is_under_way {
                self.active = self.looked;
            }
            if !any {
                self.idle.get_or_insert_with(|| tracing::info_span!("idle").entered());
                self.rest();
            }
        }
    }

    fn send(&mut self, to: usize, packet: &Packet) {
        let mut outlet = Outlet { link: &mut self.link, idle: &mut self.idle };
        if let Err(what) = outlet.send(to, packet) {
            self.lose(to, &what);
        }
    }

    fn pass_on(&mut self) -> bool {
        let now_ms = self.now_ms();
        let Self { link, idle, renderers, shared, peers, sends_until_ms, .. } = self;
        let mut outlet = Outlet { link, idle };
        let mut failed = Vec::new();
        let mut send = |to: usize, packet: Packet| {
            let bytes = packet.rows().2.unwrap_or(0);
            *sends_until_ms = sends_until_ms.max(now_ms) + bytes as f64 * peers[to].clock.ms_per_byte.unwrap_or(0.0);
            shared.row_bytes.fetch_add(bytes as u64, Ordering::Relaxed);
            failed.extend(outlet.send(to, &packet).err().map(|what| (to, what)));
        };
        let any = renderers.values_mut().fold(false, |any, renderer| renderer.pass_on(&mut send) | any);
        failed.into_iter().for_each(|(to, what)| self.lose(to, &what));
        any
    }

    /// Handles a packet that has arrived. Drops packets for renderers that have ended. Returns true if more packets may
    /// follow soon, see [`Packet::is_sign`].
    fn take(&mut self, from: usize, bytes: Vec<u8>) -> bool {
        self.peers[from].silent = Duration::ZERO;
        let packet = match Packet::decode(bytes) {
            Ok(packet) => packet,
            Err(what) => {
                self.lose(from, &what);
                return false;
            }
        };
        let (is_sign, (ticket, transfer, bytes)) = (packet.is_sign(), packet.rows());
        let _span = (!is_sign).then(|| {
            self.idle = None;
            let rested_us = self.looked.elapsed().as_micros() as u64;
            tracing::info_span!("receive from rank", from, ticket, transfer, bytes, rested_us).entered()
        });
        if bytes.is_some() {
            self.rows_came_ms = self.now_ms();
        }
        match packet {
            Packet::Order { renderer, device, order } => {
                if let Some(renderer) = self.renderers.get(&renderer) {
                    renderer.order(device, *order);
                }
            }
            Packet::Close { renderer, device } => {
                self.renderers.get_mut(&renderer).into_iter().for_each(|c| c.close(device))
            }
            Packet::Message { renderer, device, message } => {
                if let Some(renderer) = self.renderers.get(&renderer) {
                    renderer.message(device, message);
                }
            }
            Packet::Reply { renderer, mut reply } => {
                if let Some(renderer) = self.renderers.get(&renderer) {
                    self.peers[from].clock.translate(&mut reply, renderer.origin_ms);
                    renderer.reply(*reply);
                }
            }
            Packet::Signs { renderer, signs } => {
                self.renderers.get_mut(&renderer).into_iter().for_each(|c| c.take_signs(&signs));
            }
            Packet::Ping { sent_ms, load, followed } => {
                let (here_ms, bytes) = (self.now_ms(), load.len());
                if followed {
                    self.alert = Instant::now() + TRIPS_TIME;
                }
                self.send(from, &Packet::Pong { sent_ms, here_ms, bytes });
            }
            Packet::Pong { sent_ms, here_ms, bytes } => self.learn(from, sent_ms, here_ms, bytes),
            Packet::RankMessage(RankMessage::Interrupted { signal }) => (self.on_interrupt)(signal),
            Packet::RankMessage(RankMessage::Spans { text, from_ms, to_ms }) => {
                self.keep(from, text.to_vec(), [from_ms, to_ms])
            }
            Packet::RankMessage(message) => {
                // The receiver is gone if the run has ended.
                let _ = self.messages.send((from, message));
            }
        }
        !is_sign
    }

    /// Stores the trace spans that a rank has recorded between two times of its clock.
    fn keep(&mut self, rank: usize, text: Vec<u8>, there_ms: [f64; 2]) {
        let (zero_ms, residual_us) = self.peers[rank].clock.zero_between(there_ms);
        let recorded = Recorded { rank, zero_ms, residual_us, text };
        self.shared.recorded.lock().unwrap_or_else(PoisonError::into_inner).push(recorded);
    }

    fn learn(&mut self, from: usize, sent_ms: f64, there_ms: f64, bytes: usize) {
        let now_ms = self.now_ms();
        let rows_came = self.rows_came_ms >= sent_ms;
        let next = self.peers[from].learn([sent_ms, now_ms], there_ms, bytes, rows_came);
        let mut links = self.shared.links.lock().unwrap_or_else(PoisonError::into_inner);
        links.resize(self.peers.len(), (0.0, 0.0));
        links[from] = self.peers[from].link();
        drop(links);
        self.ping(from, now_ms, next);
    }

    /// Sends the ping of `trip`, if there is one. Pings request a sign of life; those with a load measure the
    /// bandwidth.
    fn ping(&mut self, to: usize, sent_ms: f64, trip: Option<Ping>) {
        let Some(Ping { bytes, followed }) = trip else { return };
        if bytes == 0 {
            self.alert = Instant::now() + TRIPS_TIME;
        }
        self.send(to, &Packet::Ping { sent_ms, load: Bytes::Owned(vec![0; bytes]), followed });
    }

    /// Returns the milliseconds since the epoch.
    fn now_ms(&self) -> f64 {
        self.epoch.elapsed().as_secs_f64() * 1e3
    }

    /// If due, pings the next rank (on rank 0) or sends the workers' signs of life (on other ranks). Also detects ranks
    /// that have been silent for too long.
    fn send_heartbeats(&mut self) {
        let now = Instant::now();
        let is_first = self.link.rank() == 0;
        // Ranks are called one after the other, so that calls do not delay each other.
        let others = self.peers.len() as u32 - 1;
        if is_first && others > 0 {
            let (last, at) = self.called;
            let next = last % others as usize + 1;
            if now - at >= self.peers[next].pause() / others {
                self.called = (next, now);
                let now_ms = self.now_ms();
                let trip = self.peers[next].call(now_ms, now_ms < self.sends_until_ms);
                self.ping(next, now_ms, trip);
            }
        }
        if !is_first && now - self.signed >= SIGNS {
            self.signed = now;
            let signs: Vec<_> =
                self.renderers.iter().filter_map(|(&renderer, c)| Some((renderer, c.signs()?))).collect();
            signs.into_iter().for_each(|(renderer, signs)| self.send(0, &Packet::Signs { renderer, signs }));
        }
        let passed = (now - self.stepped).min(STEP);
        if passed < STEP / 5 {
            return;
        }
        self.stepped = now;
        if self.shared.lost().is_some() {
            self.lost_for += passed;
        }
        if self.lost_for > GRACE {
            if let Some(lost) = self.shared.lost() {
                // Standard error may be closed, too.
                let _ = writeln!(io::stderr(), "error: {lost}");
            }
            self.link.abort(1);
        }
        let watched = if is_first { 1..self.peers.len() } else { 0..1 };
        for rank in watched {
            self.peers[rank].silent += passed;
            if self.peers[rank].silent > SILENCE {
                self.lose(rank, &format!("it gave no sign of life for {} s", SILENCE.as_secs()));
            }
        }
    }

    fn lose(&mut self, rank: usize, what: &str) {
        let error = RankError::Lost { rank, host: self.shared.host(rank), what: what.to_owned() };
        self.shared.lost.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        self.renderers.values_mut().for_each(|renderer| renderer.lose(rank));
    }

    /// Waits until there is a packet to send, or it is time to poll for packets.
    fn rest(&self) {
        if Instant::now() < self.alert {
            return std::hint::spin_loop();
        }
        let mut select = Select::new();
        select.recv(&self.controls);
        self.renderers.values().for_each(|renderer| renderer.watch(&mut select));
        // Ignore the result: the next iteration of the loop checks all channels.
        let _ = select.ready_timeout((self.active.elapsed() / REST_PART).clamp(SHORT_REST, LONG_REST));
    }

    /// Leaves the other ranks once no packet is being sent or received, but after `GRACE` at the latest.
    fn leave(mut self) {
        let begin = Instant::now();
        self.idle = None;
        while !self.link.is_settled() && begin.elapsed() < GRACE {
            while self.link.receive().is_some() {}
            std::thread::sleep(SHORT_REST);
        }
        self.link.leave();
    }
}

/// Sending end of the link. Sending a packet ends the idle span, except for signs of life, pings and pongs.
struct Outlet<'a, L> {
    link: &'a mut L,
    idle: &'a mut Option<EnteredSpan>,
}

impl<L: Link> Outlet<'_, L> {
    /// # Errors
    /// A message if the packet cannot be encoded.
    fn send(&mut self, to: usize, packet: &Packet) -> Result<(), String> {
        let _span = (!packet.is_sign()).then(|| {
            *self.idle = None;
            let (ticket, transfer, bytes) = packet.rows();
            tracing::info_span!("send to rank", to, ticket, transfer, bytes).entered()
        });
        let bytes = packet.encode().map_err(|what| format!("a packet for it could not be encoded: {what}"))?;
        self.link.send(to, bytes, packet.way());
        Ok(())
    }
}
