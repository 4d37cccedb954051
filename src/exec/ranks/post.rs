//! The thread of a rank that carries packets. It is the only one that has the link, and nobody waits for it.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Select, Sender, TryRecvError};

use super::RankError;
use super::clock::RankClock;
use super::link::Link;
use super::packet::{Letter, Packet};
use super::transport::Crew;
use crate::exec::messages::{Bytes, Message};

/// What the rank's other threads have the post do.
pub enum Control {
    Send {
        to: usize,
        letter: Letter,
    },
    Attach {
        number: u32,
        crew: Box<Crew>,
    },
    Detach {
        number: u32,
    },
    /// Leave the other ranks, and end.
    Leave,
    /// End the processes of all ranks.
    Abort {
        status: u8,
    },
}

/// What the post tells the rank's other threads.
#[derive(Default)]
pub struct Shared {
    /// A rank that is gone.
    pub lost: Mutex<Option<RankError>>,
    /// By rank.
    pub hosts: Mutex<Vec<String>>,
    /// Bytes of rows that have left for other ranks.
    pub row_bytes: AtomicU64,
    /// By rank, what a packet takes to it, milliseconds, and each byte of a large one; rank 0 knows it.
    pub links: Mutex<Vec<(f64, f64)>>,
}

impl Shared {
    pub fn lost(&self) -> Option<RankError> {
        self.lost.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn host(&self, rank: usize) -> String {
        let hosts = self.hosts.lock().unwrap_or_else(PoisonError::into_inner);
        hosts.get(rank).cloned().unwrap_or_default()
    }
}

/// After so long without a packet from rank 0, or from another rank there, it is lost. Time is counted in steps, so that
/// a process that was stopped loses one at most.
const SILENCE: Duration = Duration::from_secs(5);
const STEP: Duration = Duration::from_millis(500);
/// How long the rank's other threads have to end a run whose rank is lost.
const GRACE: Duration = Duration::from_secs(3);

const PINGS: Duration = Duration::from_millis(200);
/// Round trips that follow one another at the start, to align clocks.
const FIRST_PINGS: u32 = 16;
/// One of so many has a load, of so many bytes.
const LOADED: u32 = 24;
const LOAD_BYTES: usize = 1 << 20;
const SIGNS: Duration = Duration::from_millis(10);

/// How long it rests before it looks for packets: this part of the time since a frame's last one, as far as that is
/// between the two. Devices on the same cores would pay for more haste.
const REST_PART: u32 = 8;
const SHORT_REST: Duration = Duration::from_micros(50);
const LONG_REST: Duration = Duration::from_millis(1);

/// What is known of another rank.
#[derive(Default)]
struct Peer {
    clock: RankClock,
    pings: u32,
    silent: Duration,
}

pub struct Post<L> {
    link: L,
    controls: Receiver<Control>,
    letters: Sender<(usize, Letter)>,
    shared: Arc<Shared>,
    crews: HashMap<u32, Crew>,
    peers: Vec<Peer>,
    /// Its clock's zero.
    epoch: Instant,
    pinged: Instant,
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
        letters: Sender<(usize, Letter)>,
        shared: Arc<Shared>,
        epoch: Instant,
        on_interrupt: Box<dyn Fn(i32)>,
    ) -> Self {
        let peers = (0..link.ranks()).map(|_| Peer::default()).collect();
        let now = Instant::now();
        let (pinged, signed, stepped, active) = (now, now, now, now);
        let (crews, lost_for) = (HashMap::new(), Duration::ZERO);
        Self {
            link,
            controls,
            letters,
            shared,
            crews,
            peers,
            epoch,
            pinged,
            signed,
            stepped,
            active,
            lost_for,
            on_interrupt,
        }
    }

    pub fn run(mut self) {
        loop {
            let mut any = false;
            loop {
                match self.controls.try_recv() {
                    Ok(Control::Send { to, letter }) => self.send(to, &Packet::Letter(letter)),
                    Ok(Control::Attach { number, crew }) => drop(self.crews.insert(number, *crew)),
                    Ok(Control::Detach { number }) => drop(self.crews.remove(&number)),
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
            self.link.is_sent();
            self.keep_in_touch();
            if any {
                self.active = Instant::now();
            } else {
                self.rest();
            }
        }
    }

    fn send(&mut self, to: usize, packet: &Packet) {
        match packet.encode() {
            Ok(bytes) => self.link.send(to, bytes),
            Err(what) => self.lose(to, &format!("a packet for it could not be made: {what}")),
        }
    }

    fn pass_on(&mut self) -> bool {
        let Self { link, crews, shared, .. } = self;
        let mut failed = Vec::new();
        let mut send = |to: usize, packet: Packet| {
            if let Packet::Message { message: Message::Rows { rows, .. }, .. } = &packet {
                shared.row_bytes.fetch_add(rows.len() as u64, Ordering::Relaxed);
            }
            match packet.encode() {
                Ok(bytes) => link.send(to, bytes),
                Err(what) => failed.push((to, what)),
            }
        };
        let any = crews.values_mut().fold(false, |any, crew| crew.pass_on(&mut send) | any);
        for (to, what) in failed {
            self.lose(to, &format!("a packet for it could not be made: {what}"));
        }
        any
    }

    /// A packet has come. Those of crews that have ended are dropped. Returns whether it is one of many that may follow
    /// one another closely.
    fn take(&mut self, from: usize, bytes: Vec<u8>) -> bool {
        self.peers[from].silent = Duration::ZERO;
        let packet = match Packet::decode(bytes) {
            Ok(packet) => packet,
            Err(what) => {
                self.lose(from, &what);
                return false;
            }
        };
        let is_lone = matches!(packet, Packet::Signs { .. } | Packet::Ping { .. } | Packet::Pong { .. });
        match packet {
            Packet::Command { crew, device, command } => {
                if let Some(crew) = self.crews.get(&crew) {
                    crew.command(device, *command);
                }
            }
            Packet::Close { crew, device } => self.crews.get_mut(&crew).into_iter().for_each(|c| c.close(device)),
            Packet::Message { crew, device, message } => {
                if let Some(crew) = self.crews.get(&crew) {
                    crew.message(device, message);
                }
            }
            Packet::Reply { crew, mut reply } => {
                if let Some(crew) = self.crews.get(&crew) {
                    self.peers[from].clock.translate(&mut reply, crew.origin_ms);
                    crew.reply(*reply);
                }
            }
            Packet::Signs { crew, signs } => {
                self.crews.get_mut(&crew).into_iter().for_each(|c| c.take_signs(&signs));
            }
            Packet::Ping { sent_ms, load } => {
                let (here_ms, bytes) = (self.now_ms(), load.len());
                self.send(from, &Packet::Pong { sent_ms, here_ms, bytes });
            }
            Packet::Pong { sent_ms, here_ms, bytes } => self.learn(from, sent_ms, here_ms, bytes),
            Packet::Letter(Letter::Interrupted { signal }) => (self.on_interrupt)(signal),
            Packet::Letter(letter) => {
                // Nobody reads them any more if the run has ended.
                let _ = self.letters.send((from, letter));
            }
        }
        !is_lone
    }

    fn learn(&mut self, from: usize, sent_ms: f64, there_ms: f64, bytes: usize) {
        let now_ms = self.now_ms();
        let peer = &mut self.peers[from];
        peer.clock.learn(sent_ms..now_ms, there_ms, bytes);
        let RankClock { round_trip_ms, ms_per_byte, .. } = peer.clock;
        let mut links = self.shared.links.lock().unwrap_or_else(PoisonError::into_inner);
        links.resize(self.peers.len(), (0.0, 0.0));
        links[from] = (0.5 * round_trip_ms.unwrap_or(0.0), ms_per_byte.unwrap_or(0.0));
        drop(links);
        if self.peers[from].pings < FIRST_PINGS {
            self.ping(from);
        }
    }

    /// Asks for a sign of life, now and then with a load, by which it is seen how long large packets take.
    fn ping(&mut self, to: usize) {
        let peer = &mut self.peers[to];
        peer.pings += 1;
        let bytes = if peer.pings % LOADED == LOADED / 2 { LOAD_BYTES } else { 0 };
        let sent_ms = self.now_ms();
        self.send(to, &Packet::Ping { sent_ms, load: Bytes::Owned(vec![0; bytes]) });
    }

    /// Milliseconds since its begin.
    fn now_ms(&self) -> f64 {
        self.epoch.elapsed().as_secs_f64() * 1e3
    }

    /// Asks for signs of life, gives them, and sees who gives none.
    fn keep_in_touch(&mut self) {
        let now = Instant::now();
        let is_first = self.link.rank() == 0;
        if is_first && now - self.pinged >= PINGS {
            self.pinged = now;
            (1..self.peers.len()).for_each(|rank| self.ping(rank));
        }
        if !is_first && now - self.signed >= SIGNS {
            self.signed = now;
            let signs: Vec<_> = self.crews.iter().filter_map(|(&crew, c)| Some((crew, c.signs()?))).collect();
            signs.into_iter().for_each(|(crew, signs)| self.send(0, &Packet::Signs { crew, signs }));
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
                eprintln!("error: {lost}");
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
        self.crews.values_mut().for_each(|crew| crew.lose(rank));
    }

    /// Until there is something to pass on, or it is time to look for packets.
    fn rest(&self) {
        let mut select = Select::new();
        select.recv(&self.controls);
        self.crews.values().for_each(|crew| crew.watch(&mut select));
        // What is ready is found at the next turn.
        let _ = select.ready_timeout((self.active.elapsed() / REST_PART).clamp(SHORT_REST, LONG_REST));
    }

    /// Ends once all is sent.
    fn leave(mut self) {
        let begin = Instant::now();
        while !self.link.is_sent() && begin.elapsed() < GRACE {
            while self.link.receive().is_some() {}
            std::thread::sleep(SHORT_REST);
        }
        self.link.leave();
    }
}
