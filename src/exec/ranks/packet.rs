//! Packets between ranks, and their encoding as bytes.

use serde::{Deserialize, Serialize};

use super::agree::{DeviceCard, Identity};
use super::link::Way;
use crate::exec::messages::{Bytes, Message, Order, Reply};
use crate::exec::watchdog::LifeSign;
use crate::exec::wire;
use crate::frame::RunConfig;
use crate::scene::folder::Files;

/// Data that one rank sends to another. `renderer` is the number of a renderer, and `device` the number of one of this
/// renderer's devices.
#[derive(Debug, Serialize, Deserialize)]
pub enum Packet {
    /// Order from rank 0 to the rank of the device.
    Order { renderer: u32, device: usize, order: Box<Order> },
    /// No more orders follow for this device.
    Close { renderer: u32, device: usize },
    /// Message from a worker or the renderer to the worker of this device.
    Message { renderer: u32, device: usize, message: Message },
    /// Answer from a worker to the renderer, which is on rank 0.
    Reply { renderer: u32, reply: Box<Reply> },
    /// Signs of life of the sending rank's workers, each with its device number; `None` if a worker has ended.
    Signs { renderer: u32, signs: Vec<(usize, Option<LifeSign>)> },
    /// Request for a pong, which must be sent at once. `sent_ms` is the time on the sender's clock, in milliseconds
    /// since its epoch. A ping with a non-empty `load` measures the bandwidth. If `followed`, another ping follows as
    /// soon as the pong has arrived.
    Ping { sent_ms: f64, load: Bytes, followed: bool },
    /// Answer to a ping: the ping's `sent_ms`, the time on the answering rank's clock, and the size of the ping's load.
    Pong { sent_ms: f64, here_ms: f64, bytes: usize },
    /// Message that belongs to no frame.
    RankMessage(RankMessage),
}

/// Message between ranks that belongs to no frame.
#[derive(Debug, Serialize, Deserialize)]
pub enum RankMessage {
    /// Identity of the sender.
    Hello(Identity),
    /// Request from rank 0. The response has the same number.
    Request {
        number: u64,
        request: Box<Request>,
    },
    Response {
        number: u64,
        response: Result<Response, String>,
    },
    /// This signal told the sender to end.
    Interrupted {
        signal: i32,
    },
    /// Trace spans of the sender's threads between two times of its clock, for rank 0, in the format of
    /// [`super::Recorded`].
    Spans {
        text: Bytes,
        from_ms: f64,
        to_ms: f64,
    },
    /// Rank 0 ends, with this exit status.
    End {
        status: u8,
    },
}

/// A shot to be loaded.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Load {
    pub shot: String,
    /// Time in seconds at which the shot's cameras are evaluated.
    pub time_s: f64,
    /// Contents of the shot's files; `None` if each rank reads them itself.
    pub files: Option<Files>,
}

/// Request from rank 0 to another rank.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Request {
    /// Open `virtual_devices` virtual devices on each adapter that the rank's command line selects. They form the set
    /// with the number `set`.
    Open {
        set: u32,
        virtual_devices: usize,
    },
    /// Close those devices of a set that no renderer uses.
    Close {
        set: u32,
    },
    Load(Load),
    /// Record trace spans of the rank's threads, and send them regularly.
    Record,
    /// Send the recorded spans before the response.
    Recorded,
    /// Start the workers of a renderer, on the first devices of a set.
    Start(Box<Start>),
    /// End the workers of a renderer, and return their devices to the set.
    End {
        renderer: u32,
    },
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Start {
    pub renderer: u32,
    pub set: u32,
    /// The rank of each device of the renderer.
    pub ranks: Vec<usize>,
    #[serde(with = "wire::as_text")]
    pub config: RunConfig,
    /// Fingerprint of the scene to render, see [`crate::tables::SceneTables::fingerprint`].
    pub scene: u64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Response {
    Done,
    /// The devices that were opened or started.
    Devices(Vec<DeviceCard>),
    /// The fingerprint of a scene.
    Loaded(u64),
    /// The rank's devices that have not failed, by their numbers in the renderer that has ended.
    Left(Vec<usize>),
}

/// Values of a packet's last byte. `ROWS`: rows of an image come first, then their header. `OTHER`: any other packet.
const ROWS: u8 = 1;
const OTHER: u8 = 2;

/// Size of the header of rows in bytes: renderer, device, ticket, transfer.
const HEADER_BYTES: usize = 4 + 4 + 8 + 4;

impl Packet {
    /// Returns the ticket, transfer and size in bytes of the rows in the packet, as fields of a trace span.
    pub fn rows(&self) -> (Option<u64>, Option<u32>, Option<usize>) {
        let Self::Message { message: Message::Rows { ticket, transfer, rows }, .. } = self else {
            return Default::default();
        };
        (Some(*ticket), Some(*transfer), Some(rows.len()))
    }

    /// Returns true for signs of life, pings and pongs. Unlike other packets, they do not mean that more packets will
    /// follow soon.
    pub fn is_sign(&self) -> bool {
        matches!(self, Self::Signs { .. } | Self::Ping { .. } | Self::Pong { .. })
    }

    pub fn way(&self) -> Way {
        if matches!(self, Self::Ping { .. } | Self::Pong { .. }) { Way::RoundTrip } else { Way::Other }
    }

    pub fn encode(&self) -> Result<Vec<u8>, String> {
        if let Self::Message { renderer, device, message: Message::Rows { ticket, transfer, rows } } = self {
            let mut bytes = Vec::with_capacity(rows.len() + HEADER_BYTES + 1);
            bytes.extend_from_slice(rows);
            bytes.extend_from_slice(&renderer.to_le_bytes());
            bytes.extend_from_slice(&(*device as u32).to_le_bytes());
            bytes.extend_from_slice(&ticket.to_le_bytes());
            bytes.extend_from_slice(&transfer.to_le_bytes());
            bytes.push(ROWS);
            return Ok(bytes);
        }
        let mut bytes = postcard::to_stdvec(self).map_err(|e| e.to_string())?;
        bytes.push(OTHER);
        Ok(bytes)
    }

    /// # Errors
    /// A message if the bytes are not a packet of this version.
    pub fn decode(mut bytes: Vec<u8>) -> Result<Self, String> {
        let no_packet = || "it sent a packet that this version cannot decode".to_owned();
        match bytes.pop() {
            Some(ROWS) => {
                let at = bytes.len().checked_sub(HEADER_BYTES).ok_or_else(no_packet)?;
                let header = bytes.split_off(at);
                let number = |from: usize| header[from..from + 4].iter().rev().fold(0, |n, b| n << 8 | u32::from(*b));
                let ticket = u64::from(number(12)) << 32 | u64::from(number(8));
                let message = Message::Rows { ticket, transfer: number(16), rows: Bytes::Owned(bytes) };
                Ok(Self::Message { renderer: number(0), device: number(4) as usize, message })
            }
            Some(OTHER) => postcard::from_bytes(&bytes).map_err(|_| no_packet()),
            _ => Err(no_packet()),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::device::{DeviceFailure, FailureKind};
    use crate::exec::InjectedKind;
    use crate::exec::messages::{Answer, FrameJob, FrameReply, Stop, TaskTime, Work};
    use crate::exec::plan::{History, Plan};
    use crate::graph::{Assignment, HaloPlan, Seam, Stripes};
    use crate::layout;
    use crate::passes::path_trace::PARTITION;
    use crate::passes::tonemap::{DISPLAY, LINEAR};
    use crate::passes::{ROW_TALLY, aov_image};
    use crate::scene::rig::Eye;
    use crate::schedule::{Position, Split, Splits};
    use crate::stages::Place;
    use crate::tables::SceneUpdate;

    fn job(seam: Seam, history: Option<History>) -> FrameJob {
        let mut assignment = Assignment::uniform(Stripes::even(90, 3));
        assignment.set(PARTITION, Eye::RIGHT, Stripes::from_edges(90, &[10, 70]));
        // Device 0 was dropped.
        let assignment = assignment.renumbered(&[1, 2, 3], 4);
        let mut constants = layout::Frame::default();
        constants.sampling.index = 7;
        constants.environment.rotation = f32::NEG_INFINITY;
        FrameJob {
            plan: Plan { seam, iterations: 5, assignment, history, outputs: Some(vec![LINEAR.into()]) },
            constants,
            previous: layout::Previous {
                views: [layout::View { tan_half_x: 0.3, ..Default::default() }; 2],
                sampling: layout::Sampling { reflections: 3, ..Default::default() },
            },
            views: vec![[layout::View { shift_x: 0.1, ..Default::default() }; 2]; 3],
            update: SceneUpdate { rows: vec![(7, vec![1; 16])], pose: vec![[0.5; 4]], left_out: 3 },
            place: Place { slot: 2, turn: 1 },
            reads: vec![LINEAR.into(), DISPLAY.into(), aov_image(3).into()],
            splits: Splits {
                ends: vec![Split { task: 4, at: Position { run: 1, row: 16 } }],
                probes: vec![6],
                bound_ms: 200.0,
            },
            late: None,
            runs: 2,
            injected: Some(InjectedKind::Hang),
            watch: None,
        }
    }

    /// Returns orders of every kind.
    fn orders() -> Vec<Order> {
        let limit = Duration::from_micros(10_000_001);
        let order = |work| Order { ticket: u64::MAX, limit, work };
        let frame = |seam, history| order(Work::Frame(Box::new(job(seam, history))));
        let halos = (0..3).flat_map(HaloPlan::all).chain([HaloPlan::RECOMPUTE, HaloPlan::EXCHANGE]);
        let seams = [Seam::None, Seam::Filter].into_iter().chain(halos.map(Seam::Halo));
        let mut orders: Vec<_> = seams.map(|seam| frame(seam, None)).collect();
        let before = Assignment::uniform(Stripes::even(90, 4));
        orders.push(frame(Seam::None, Some(History { before, rows: 12, lost: vec![1] })));
        let place = Place { slot: 0, turn: 1 };
        orders.push(order(Work::Read { image: ROW_TALLY.into(), place, injected: None }));
        orders
    }

    /// Returns replies of every kind.
    fn replies() -> Vec<Reply> {
        let reply = |answer| Reply { ticket: 3, device: 63, answer };
        let times = vec![TaskTime { task: 4, begin_ms: 0.1, end_ms: 1e9 + 0.3, bytes: Some(1 << 40), submissions: 3 }];
        let images = vec![vec![vec![0, 255], vec![7]], vec![vec![], vec![1]]];
        let (shown_from, buffers) = (None, Vec::new());
        let (clock_residual_us, begin_ms, end_ms, spp_done) = (0.2, -0.0, 0.7, Some(12));
        let done = FrameReply { times, clock_residual_us, begin_ms, end_ms, images, shown_from, buffers, spp_done };
        let done = [Answer::Frame(done), Answer::Pixels(vec![vec![1, 2], vec![3, 4]])];
        let kinds = [FailureKind::Loss, FailureKind::Hang, FailureKind::Oom, FailureKind::Error];
        let failure = |kind| Stop::Device(DeviceFailure { kind, what: "it \"fell\"\n".to_owned() });
        let stops = kinds.map(failure).into_iter().chain([Stop::Aborted]);
        done.map(|answer| reply(Ok(answer))).into_iter().chain(stops.map(|stop| reply(Err(stop)))).collect()
    }

    fn assert_comes_back(packet: Packet) {
        let bytes = packet.encode().unwrap();
        let back = Packet::decode(bytes.clone()).unwrap();
        assert_eq!((format!("{back:?}"), back.encode()), (format!("{packet:?}"), Ok(bytes)));
    }

    #[test]
    fn packets_round_trip_through_bytes() {
        for order in orders() {
            assert_comes_back(Packet::Order { renderer: 3, device: 63, order: Box::new(order) });
        }
        for reply in replies() {
            assert_comes_back(Packet::Reply { renderer: u32::MAX, reply: Box::new(reply) });
        }
        let rows = |n: usize| Bytes::Owned((0..n).map(|i| i as u8).collect());
        for (ticket, rows) in [(0, rows(0)), (u64::MAX, rows(1)), (0x0123_4567_89ab_cdef, rows(70_000))] {
            let message = Message::Rows { ticket, transfer: 0x0102_0304, rows };
            assert_comes_back(Packet::Message { renderer: 0x0506_0708, device: 42, message });
        }
        assert_comes_back(Packet::Message { renderer: 1, device: 2, message: Message::Abort { ticket: 7 } });
        assert_comes_back(Packet::Signs { renderer: 1, signs: vec![(4, Some(LifeSign::default())), (5, None)] });
        assert_comes_back(Packet::RankMessage(RankMessage::Response { number: 1, response: Err("no".to_owned()) }));
    }

    #[test]
    fn rejects_invalid_packets() {
        for bytes in [&[][..], &[ROWS], &[0; 20], &[7, 7, OTHER], &[0, 1, 2, 3, 9]] {
            assert!(Packet::decode(bytes.to_vec()).is_err(), "{bytes:?}");
        }
    }
}
