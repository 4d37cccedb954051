//! The devices of a run: those of this process, and those of other ranks.

use std::sync::Arc;
use std::time::Instant;

use super::RankError;
use super::agree::{DeviceCard, check_devices};
use super::node::{Asked, Node};
use super::packet::{Load, Request, Response, Start};
use super::renderer_devices::RendererDevices;
use crate::device::{DeviceInfo, GpuDevice, MAX_DEVICES, RankName};
use crate::exec::channels::WorkerChannels;
use crate::frame::RunConfig;
use crate::schedule::Network;
use crate::tables::SceneTables;

/// Open devices that no renderer uses at the moment. Devices of this process come first, then those of the other ranks
/// in order of rank.
#[derive(Default)]
pub struct Devices {
    own: Vec<GpuDevice>,
    others: Option<Set>,
}

/// Devices of other ranks, which are closed when this is dropped.
struct Set {
    node: Arc<Node>,
    number: u32,
    /// Rank and description of each device.
    cards: Vec<(usize, DeviceCard)>,
}

impl Drop for Set {
    fn drop(&mut self) {
        // The response is not needed.
        drop(self.node.ask(&Request::Close { set: self.number }));
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
    /// Asks the other ranks to open `virtual_devices` virtual devices on each of their adapters. Returns at once, so
    /// that this rank can open its own devices meanwhile.
    pub fn open(node: &Arc<Node>, virtual_devices: usize) -> Opening {
        let set = Set { node: Arc::clone(node), number: node.number(), cards: Vec::new() };
        Opening { asked: node.ask(&Request::Open { set: set.number, virtual_devices }), set }
    }

    pub fn len(&self) -> usize {
        self.own.len() + self.cards().len()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Keeps the first `count` devices.
    pub fn truncate(&mut self, count: usize) {
        let own = self.own.len().min(count);
        self.own.truncate(own);
        if let Some(set) = &mut self.others {
            set.cards.truncate(count - own);
        }
        self.others.take_if(|set| set.cards.is_empty());
    }

    /// Returns some of these devices for another renderer, by their index: those for which `keeps` is true. They share
    /// compiled pipelines with these. Only one of the renderers may have frames in flight at a time. Returns `None` if
    /// there are devices of other ranks.
    pub fn shared(&self, keeps: impl Fn(usize) -> bool) -> Option<Self> {
        let kept = self.own.iter().enumerate().filter(|(index, _)| keeps(*index));
        let mut own: Vec<GpuDevice> = kept.map(|(_, gpu)| gpu.shared()).collect();
        own.iter_mut().enumerate().for_each(|(index, gpu)| gpu.info.index = index);
        self.others.is_none().then_some(Self { own, others: None })
    }

    fn cards(&self) -> &[(usize, DeviceCard)] {
        self.others.as_ref().map_or(&[], |set| &set.cards)
    }

    /// Returns the info of all devices: this process's first, then those of other ranks.
    pub fn infos(&self) -> Vec<DeviceInfo> {
        let own = self.own.iter().map(|gpu| gpu.info.clone());
        let others = self.cards().iter().map(|(_, card)| card.info.clone());
        own.chain(others).enumerate().map(|(index, info)| DeviceInfo { index, ..info }).collect()
    }

    /// Returns the maximum predicted time of a submission on each device, see
    /// [`crate::device::Quirks::max_dispatch_ms`].
    pub(crate) fn max_dispatch_ms(&self) -> Vec<Option<f64>> {
        let own = self.own.iter().map(|gpu| gpu.quirks.max_dispatch_ms);
        own.chain(self.cards().iter().map(|(_, card)| card.max_dispatch_ms)).collect()
    }

    /// Returns the devices of this process.
    pub fn into_own(self) -> Vec<GpuDevice> {
        self.own
    }

    /// Splits into the devices of this process and a handle to the devices of other ranks.
    pub(crate) fn split(mut self) -> (Vec<GpuDevice>, Option<Others>) {
        let own = std::mem::take(&mut self.own);
        let others = self.others.take().map(|set| Others::new(set, own.len()));
        (own, others)
    }
}

impl Opening {
    /// Waits for the devices of the other ranks, and combines them with this rank's devices `own`.
    ///
    /// # Errors
    /// [`RankError`] if another rank could not open its devices, if their adapters, drivers or ray traversal differ
    /// from this rank's, or if there are more devices than a run can drive.
    pub fn with(mut self, mut own: Vec<GpuDevice>) -> Result<Devices, RankError> {
        let node = Arc::clone(&self.set.node);
        for (rank, response) in (1..).zip(self.asked.wait()?) {
            let Response::Devices(cards) = response else { continue };
            if let Some(first) = own.first() {
                let differ = |mismatch| RankError::Devices { rank, host: node.host(rank), mismatch };
                check_devices(&first.info, &cards).map_err(differ)?;
            }
            self.set.cards.extend(cards.into_iter().map(|card| (rank, card)));
        }
        let name = RankName { number: 0, host: node.host(0) };
        own.iter_mut().for_each(|gpu| gpu.info.rank = Some(name.clone()));
        let devices = Devices { own, others: Some(self.set) };
        if devices.len() > MAX_DEVICES { Err(RankError::TooMany(devices.len())) } else { Ok(devices) }
    }
}

/// A request to the other ranks to load a scene.
pub struct Loading(Arc<Node>, Asked);

impl Loading {
    pub fn begin(node: &Arc<Node>, what: Load) -> Self {
        Self(Arc::clone(node), node.ask(&Request::Load(what)))
    }

    /// Waits until the other ranks have loaded the scene, and checks that their tables match `here`, the tables of this
    /// rank.
    ///
    /// # Errors
    /// [`RankError`] if another rank could not load the scene, or has loaded a different one.
    pub fn check(self, here: &SceneTables) -> Result<(), RankError> {
        let here = here.fingerprint();
        for (rank, response) in (1..).zip(self.1.wait()?) {
            if response != Response::Loaded(here) {
                return Err(self.0.refusal(rank, "its scene is not that of rank 0: the files differ".to_owned()));
            }
        }
        Ok(())
    }
}

/// Devices of other ranks that a renderer uses.
pub(crate) struct Others {
    set: Set,
    /// Number that identifies the renderer, and its [`RendererDevices`], on all ranks.
    renderer: u32,
    own: usize,
}

impl Others {
    fn new(set: Set, own: usize) -> Self {
        Self { renderer: set.node.number(), set, own }
    }

    /// Returns the number of devices, including those of this process.
    pub fn devices(&self) -> usize {
        self.own + self.set.cards.len()
    }

    /// Returns the rank of each device.
    fn ranks(&self) -> Vec<usize> {
        std::iter::repeat_n(0, self.own).chain(self.set.cards.iter().map(|(rank, _)| *rank)).collect()
    }

    /// Asks the other ranks to start their workers.
    pub fn start(&self, config: &RunConfig, tables: &SceneTables) -> Asked {
        let (ranks, scene) = (self.ranks(), tables.fingerprint());
        let start = Start { renderer: self.renderer, set: self.set.number, ranks, config: config.clone(), scene };
        self.set.node.ask(&Request::Start(Box::new(start)))
    }

    /// Waits until the other ranks have started their workers, and connects their channels with those of this process.
    /// `ends` holds the channel ends for the workers of all devices. Returns the info of the other ranks' devices, and
    /// the channel ends for this process's workers. The renderer's times count from `origin`.
    ///
    /// # Errors
    /// [`RankError`] if a rank could not start its workers.
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
        let (renderer, own) = RendererDevices::new(self.renderer, (0, &ranks), ends, None, before_ms - after_ms);
        node.attach(self.renderer, renderer);
        Ok((infos, own))
    }

    /// Returns the model of the network between ranks: its latency and its time per byte.
    pub fn network(&self) -> Network {
        self.set.node.network(self.ranks())
    }

    /// Returns the error of a lost rank, if there is one.
    pub fn lost(&self) -> Option<RankError> {
        self.set.node.lost()
    }

    /// Ends the workers of the other ranks, whose order channels must be closed already. Returns this process's
    /// devices `own`, followed by the devices of other ranks, without those that have failed.
    pub fn end(mut self, own: Vec<GpuDevice>) -> Devices {
        let ended = self.set.node.ask(&Request::End { renderer: self.renderer }).wait();
        self.set.node.detach(self.renderer);
        // Ignore a lost rank here: it ends the run at the next frame.
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
