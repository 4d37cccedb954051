//! Main loop of ranks other than 0: opens devices, loads scenes and starts workers on request of rank 0.

use std::collections::HashMap;
use std::error::Error;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::RankError;
use super::agree::DeviceCard;
use super::node::Node;
use super::packet::{Load, RankMessage, Request, Response, Start};
use super::renderer_devices::RendererDevices;
use crate::device::{GpuDevice, RankName};
use crate::exec::channels::channels;
use crate::exec::messages::Bytes;
use crate::exec::planner::Graphs;
use crate::exec::worker::Worker;
use crate::exec::worker::device::WorkerDevice;
use crate::exec::worker_pool::END_LIMIT;
use crate::passes::Declarations;
use crate::tables::SceneTables;

/// Environment of a rank: opens its devices, loads scenes and records trace spans.
pub trait Host {
    /// Opens `virtual_devices` virtual devices on each selected adapter.
    ///
    /// # Errors
    /// A one-line message.
    fn open(&mut self, virtual_devices: usize) -> Result<Vec<GpuDevice>, String>;

    /// # Errors
    /// A one-line message.
    fn load(&mut self, what: &Load) -> Result<Arc<SceneTables>, String>;

    /// Begins to record trace spans of this process's threads. Times count from `zero`.
    ///
    /// # Errors
    /// A one-line message.
    fn record(&mut self, zero: Instant) -> Result<(), String>;

    /// Takes the trace spans recorded since the last call; empty if nothing is being recorded.
    fn recorded(&mut self) -> Vec<u8>;

    /// Returns the declarations of passes. Rank 0 does not send its declarations, so these must be the same.
    fn passes(&self) -> Declarations {
        Declarations::default()
    }

    /// Formats an error of a worker on one line, for rank 0.
    fn describe(&self, error: &(dyn Error + 'static)) -> String {
        error.to_string()
    }

    /// Returns the number of the signal that told this rank to end, if one has arrived.
    fn interrupted(&self) -> Option<i32>;
}

/// Interval at which a wait for messages checks for signals.
const SLICE: Duration = Duration::from_millis(20);

/// Interval at which recorded spans are sent.
const RECORDS: Duration = Duration::from_millis(250);

/// Number of cached scenes; a run may alternate between several.
const SCENES: usize = 2;

type Thread = JoinHandle<Option<GpuDevice>>;

/// The workers of a renderer on this rank, by device number, and the set of their devices.
struct Working {
    set: u32,
    threads: Vec<(usize, Thread)>,
}

struct Server<'a> {
    node: &'a Arc<Node>,
    host: &'a mut dyn Host,
    sets: HashMap<u32, Vec<GpuDevice>>,
    renderers: HashMap<u32, Working>,
    /// Cached scenes with their fingerprints, the latest last.
    scenes: Vec<(u64, Arc<SceneTables>)>,
    /// Time up to which recorded spans have been sent.
    recorded_ms: f64,
}

/// Serves rank 0 until rank 0 ends the run; returns the exit status that it sent.
///
/// # Errors
/// [`RankError::Lost`] if rank 0 is lost.
pub fn serve(node: &Arc<Node>, host: &mut dyn Host) -> Result<u8, RankError> {
    let (sets, renderers) = (HashMap::new(), HashMap::new());
    let mut server = Server { node, host, sets, renderers, scenes: Vec::new(), recorded_ms: 0.0 };
    let (mut is_told, mut recorded) = (false, Instant::now());
    loop {
        match node.message(SLICE) {
            Some((0, RankMessage::Request { number, request })) => {
                let response = server.answer(*request);
                node.tell(0, RankMessage::Response { number, response });
            }
            Some((0, RankMessage::End { status })) => return Ok(status),
            _ => {}
        }
        if recorded.elapsed() > RECORDS {
            recorded = Instant::now();
            server.send_recorded();
        }
        if let Some(signal) = server.host.interrupted().filter(|_| !is_told) {
            is_told = true;
            node.tell(0, RankMessage::Interrupted { signal });
        }
        if let Some(lost) = node.lost() {
            return Err(lost);
        }
    }
}

impl Server<'_> {
    fn answer(&mut self, request: Request) -> Result<Response, String> {
        match request {
            Request::Open { set, virtual_devices } => {
                let gpus = self.host.open(virtual_devices)?;
                let cards = gpus.iter().map(|gpu| self.card(gpu)).collect();
                self.sets.insert(set, gpus);
                Ok(Response::Devices(cards))
            }
            Request::Close { set } => {
                self.sets.remove(&set);
                Ok(Response::Done)
            }
            Request::Load(what) => {
                let tables = self.host.load(&what)?;
                let fingerprint = tables.fingerprint();
                self.scenes.retain(|(other, _)| *other != fingerprint);
                self.scenes.push((fingerprint, tables));
                if self.scenes.len() > SCENES {
                    self.scenes.remove(0);
                }
                Ok(Response::Loaded(fingerprint))
            }
            Request::Record => self.host.record(self.node.epoch).map(|()| Response::Done),
            Request::Recorded => {
                self.send_recorded();
                Ok(Response::Done)
            }
            Request::Start(start) => self.start(*start),
            Request::End { renderer } => Ok(Response::Left(self.end(renderer))),
        }
    }

    fn send_recorded(&mut self) {
        let to_ms = self.node.epoch.elapsed().as_secs_f64() * 1e3;
        let from_ms = std::mem::replace(&mut self.recorded_ms, to_ms);
        let text = self.host.recorded();
        if !text.is_empty() {
            self.node.tell(0, RankMessage::Spans { text: Bytes::Owned(text), from_ms, to_ms });
        }
    }

    fn card(&self, gpu: &GpuDevice) -> DeviceCard {
        let (number, host) = (self.node.rank(), self.node.host(self.node.rank()));
        let mut info = gpu.info.clone();
        info.rank = Some(RankName { number, host });
        DeviceCard { info, max_dispatch_ms: gpu.quirks.max_dispatch_ms }
    }

    fn start(&mut self, start: Start) -> Result<Response, String> {
        let Start { renderer: number, set, ranks, mut config, scene } = start;
        config.buffers.declarations = self.host.passes();
        let tables = self.scenes.iter().find(|(fingerprint, _)| *fingerprint == scene);
        let tables = Arc::clone(&tables.ok_or("its scene is not that of rank 0")?.1);
        let graphs = Graphs::of_config(&config, ranks.len(), tables.has_surfaces());
        let graphs = Arc::new(graphs.map_err(|e| e.to_string())?);
        let programs = graphs.programs();
        let here = self.node.rank();
        let (commander, ends) = channels(ranks.len());
        let (renderer, own_ends) = RendererDevices::new(number, (here, &ranks), ends, Some(commander), 0.0);
        let own: Vec<usize> = (0..ranks.len()).filter(|&device| ranks[device] == here).collect();
        let gpus = self.sets.get_mut(&set).ok_or("its devices have been closed")?;
        if gpus.len() < own.len() {
            return Err(format!("it has only {} of {} needed devices left", gpus.len(), own.len()));
        }
        let gpus: Vec<GpuDevice> = gpus.drain(..own.len()).collect();
        let (mut cards, mut workers) = (Vec::new(), Vec::new());
        for ((device, mut gpu), end) in own.iter().zip(gpus).zip(own_ends) {
            gpu.info.index = *device;
            let made = WorkerDevice::new(gpu, &config, &tables, &programs, self.node.epoch);
            let made = made.and_then(|mut device| device.calibrate().map(|()| device));
            let made = made.map_err(|e| self.host.describe(&e))?;
            cards.push(self.card(&made.gpu));
            workers.push(Worker::new(made, Arc::clone(&graphs), end));
        }
        let start = |(device, worker): (usize, Worker)| {
            worker.start().map(|thread| (device, thread)).map_err(|e| e.to_string())
        };
        let threads = own.into_iter().zip(workers).map(start).collect::<Result<_, _>>()?;
        self.renderers.insert(number, Working { set, threads });
        self.node.attach(number, renderer);
        Ok(Response::Devices(cards))
    }

    /// Ends the workers of a renderer; returns the numbers of the devices that have not failed.
    fn end(&mut self, renderer: u32) -> Vec<usize> {
        self.node.detach(renderer);
        let Some(Working { set, threads }) = self.renderers.remove(&renderer) else { return Vec::new() };
        let begin = Instant::now();
        let (mut left, mut gpus) = (Vec::new(), Vec::new());
        for (device, thread) in threads {
            while !thread.is_finished() && begin.elapsed() < END_LIMIT {
                std::thread::sleep(Duration::from_millis(1));
            }
            // The thread of a worker that hangs is not joined, and its device is dropped from the set.
            if let Some(gpu) = thread.is_finished().then(|| thread.join().ok().flatten()).flatten() {
                left.push(device);
                gpus.push(gpu);
            }
        }
        // Renderers use the first devices of a set, so return these to the front.
        if let Some(rest) = self.sets.get_mut(&set) {
            gpus.append(rest);
            *rest = gpus;
        }
        left
    }
}
