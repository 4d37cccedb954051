//! The devices of a run: those of this process, and those of other ranks.

use std::sync::Arc;
use std::time::Instant;

use super::RankError;
use super::agree::{check_devices, check_scene};
use super::node::{Asked, Node};
use super::packet::{DeviceCard, Load, Request, Response, Start};
use super::transport::Crew;
use crate::device::{DeviceInfo, GpuDevice, MAX_DEVICES, RankName};
use crate::exec::RenderSettings;
use crate::exec::channels::WorkerChannels;
use crate::schedule::Network;
use crate::stages::SceneTables;

/// Devices that no renderer has at the moment: this process's first, then those of the other ranks in their order.
#[derive(Default)]
pub struct Devices {
    own: Vec<GpuDevice>,
    others: Option<Set>,
}

/// Devices of other ranks, which are closed when this is dropped.
struct Set {
    node: Arc<Node>,
    number: u32,
    /// With their ranks.
    cards: Vec<(usize, DeviceCard)>,
}

impl Drop for Set {
    fn drop(&mut self) {
        let number = self.number;
        // Nobody waits for it.
        drop(self.node.ask(|_| Request::Close { set: number }));
    }
}

/// Devices that other ranks are opening.
pub struct Opening {
    set: Set,
    asked: Asked,
}

impl From<Vec<GpuDevice>> for Devices {
    fn from(own: Vec<GpuDevice>) -> Self {
        Self { own, others: None }
    }
}

impl Devices {
    /// Has the other ranks open devices, so many on each of their adapters, while this one opens its own.
    pub fn open(node: &Arc<Node>, virtual_devices: usize) -> Opening {
        let set = Set { node: Arc::clone(node), number: node.number(), cards: Vec::new() };
        let number = set.number;
        Opening { asked: node.ask(|_| Request::Open { set: number, virtual_devices }), set }
    }

    pub fn len(&self) -> usize {
        self.own.len() + self.cards().len()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Keeps the first ones.
    pub fn truncate(&mut self, count: usize) {
        let own = self.own.len().min(count);
        self.own.truncate(own);
        if let Some(set) = &mut self.others {
            set.cards.truncate(count - own);
        }
        self.others.take_if(|set| set.cards.is_empty());
    }

    fn cards(&self) -> &[(usize, DeviceCard)] {
        self.others.as_ref().map_or(&[], |set| &set.cards)
    }

    /// What is known of each, in their order.
    pub fn infos(&self) -> Vec<DeviceInfo> {
        let own = self.own.iter().map(|gpu| gpu.info.clone());
        let others = self.cards().iter().map(|(_, card)| card.info.clone());
        own.chain(others).enumerate().map(|(index, info)| DeviceInfo { index, ..info }).collect()
    }

    /// How long a submission of each may take before the system resets it.
    pub(crate) fn max_dispatch_ms(&self) -> Vec<Option<f64>> {
        let own = self.own.iter().map(|gpu| gpu.quirks.max_dispatch_ms);
        own.chain(self.cards().iter().map(|(_, card)| card.max_dispatch_ms)).collect()
    }

    /// Those of this process.
    pub fn into_own(self) -> Vec<GpuDevice> {
        self.own
    }

    /// Those of this process, and of the others what leads to them.
    pub(crate) fn split(mut self) -> (Vec<GpuDevice>, Option<Others>) {
        let own = std::mem::take(&mut self.own);
        let others = self.others.take().map(|set| Others::new(set, own.len()));
        (own, others)
    }
}

impl Opening {
    /// # Errors
    /// That another rank could not open devices, or has others than this one.
    pub fn with(mut self, mut own: Vec<GpuDevice>) -> Result<Devices, RankError> {
        let node = Arc::clone(&self.set.node);
        for (rank, response) in (1..).zip(self.asked.wait()?) {
            let Response::Devices(cards) = response else { continue };
            if let Some(first) = own.first() {
                check_devices(&first.info, &cards).map_err(|what| node.refusal(rank, what))?;
            }
            self.set.cards.extend(cards.into_iter().map(|card| (rank, card)));
        }
        let name = RankName { number: 0, host: node.host(0) };
        own.iter_mut().for_each(|gpu| gpu.info.rank = Some(name.clone()));
        let devices = Devices { own, others: Some(self.set) };
        if devices.len() > MAX_DEVICES { Err(RankError::TooMany(devices.len())) } else { Ok(devices) }
    }
}

/// Has the other ranks load a scene.
pub struct Loading(Arc<Node>, Asked);

impl Loading {
    pub fn begin(node: &Arc<Node>, what: &Load) -> Self {
        Self(Arc::clone(node), node.ask(|_| Request::Load(what.clone())))
    }

    /// # Errors
    /// That another rank could not load it, or has found another scene than this one.
    pub fn check(self, here: &SceneTables) -> Result<(), RankError> {
        let here = here.fingerprint();
        for (rank, response) in (1..).zip(self.1.wait()?) {
            if let Response::Loaded(there) = response {
                check_scene(here, there).map_err(|what| self.0.refusal(rank, what))?;
            }
        }
        Ok(())
    }
}

/// Devices of other ranks in a renderer.
pub(crate) struct Others {
    set: Set,
    /// The number of the crew.
    crew: u32,
    own: usize,
}

impl Others {
    fn new(set: Set, own: usize) -> Self {
        Self { crew: set.node.number(), set, own }
    }

    /// How many devices there are, with those of this process.
    pub fn devices(&self) -> usize {
        self.own + self.set.cards.len()
    }

    /// The rank of each device.
    fn ranks(&self) -> Vec<usize> {
        std::iter::repeat_n(0, self.own).chain(self.set.cards.iter().map(|(rank, _)| *rank)).collect()
    }

    /// Has the other ranks start their workers.
    pub fn start(&self, settings: &RenderSettings, tables: &SceneTables) -> Asked {
        let (ranks, scene) = (self.ranks(), tables.fingerprint());
        let start = Start { crew: self.crew, set: self.set.number, ranks, settings: settings.clone(), scene };
        self.set.node.ask(|_| Request::Start(Box::new(start.clone())))
    }

    /// Once they have, joins their channels with those of this process; returns what is known of the devices, and the
    /// ends of this process's workers. Times of the renderer are counted from `origin`.
    ///
    /// # Errors
    /// That a rank could not start its workers.
    pub fn join(
        &mut self,
        asked: Asked,
        ends: Vec<WorkerChannels>,
        origin: Instant,
    ) -> Result<(Vec<DeviceInfo>, Vec<WorkerChannels>), RankError> {
        let node = &self.set.node;
        let responses = asked.wait()?.into_iter();
        let cards = responses.flat_map(|r| if let Response::Devices(cards) = r { cards } else { Vec::new() });
        let infos = cards.map(|card| card.info).collect();
        let before_ms = origin.saturating_duration_since(node.epoch).as_secs_f64() * 1e3;
        let after_ms = node.epoch.saturating_duration_since(origin).as_secs_f64() * 1e3;
        let ranks = self.ranks();
        let (crew, own) = Crew::new(self.crew, (0, &ranks), ends, None, before_ms - after_ms);
        node.attach(self.crew, crew);
        Ok((infos, own))
    }

    /// What rows take between devices of different ranks.
    pub fn network(&self) -> Network {
        self.set.node.network(self.ranks())
    }

    /// A rank that is gone.
    pub fn lost(&self) -> Option<RankError> {
        self.set.node.lost()
    }

    /// Ends the workers, whose commands have ended, and joins what is left with this process's devices.
    pub fn end(mut self, own: Vec<GpuDevice>) -> Devices {
        let crew = self.crew;
        let ended = self.set.node.ask(|_| Request::End { crew }).wait();
        self.set.node.detach(crew);
        // A rank that is lost ends the run at the next frame.
        let left: Vec<usize> = ended.into_iter().flatten().flat_map(left_of).collect();
        let mut device = self.own;
        self.set.cards.retain(|_| {
            device += 1;
            left.contains(&(device - 1))
        });
        Devices { own, others: Some(self.set) }
    }
}

fn left_of(response: Response) -> Vec<usize> {
    if let Response::Left(left) = response { left } else { Vec::new() }
}
