//! What the renderer and the workers tell one another: plain data, which could also go from one process to another.

use std::fmt;
use std::ops::Deref;
use std::time::Duration;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::faults::InjectedKind;
use super::late::{Late, SampledPose};
use super::output::Output;
use super::planner::Plan;
use super::staging::Mapped;
use super::wire;
use crate::device::DeviceFailure;
use crate::schedule::Cut;
use crate::stages::{Place, SceneUpdate, layout};

/// What the renderer tells a worker.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct Command {
    /// Comes back with the answer; no two commands of a run have the same but those of one attempt at a frame.
    pub ticket: u64,
    /// How long the device may take for one thing that is waited for.
    pub limit: Duration,
    pub order: Order,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub enum Order {
    Frame(Box<FrameJob>),
    /// Send both eyes' image in this place back; a fault may be injected before.
    Read {
        image: Output,
        place: Place,
        injected: Option<InjectedKind>,
    },
}

/// A frame, of which each worker does the tasks of its device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameJob {
    /// With what all frames of a run have in common, it determines the graph.
    pub plan: Plan,
    #[serde(with = "wire::pod")]
    pub constants: layout::Frame,
    /// Constants of the frame before.
    #[serde(with = "wire::pod")]
    pub previous: layout::Previous,
    /// What it changes in the scene.
    pub update: SceneUpdate,
    /// Where it leaves its images.
    pub place: Place,
    /// The images that the primary sends back with its answer, beside the row tallies.
    pub reads: Vec<Output>,
    /// Where submissions of this device end, beside those that transfers end.
    pub cuts: Vec<Cut>,
    /// Where the primary asks for the pose that it is shown from. It is not sent to other ranks.
    #[serde(skip)]
    pub late: Option<Late>,
    /// How often dispatches run; more than once only to simulate slow devices.
    pub runs: u32,
    /// The fault that is injected half-way.
    pub injected: Option<InjectedKind>,
}

/// What a worker answers.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct Reply {
    pub ticket: u64,
    pub device: usize,
    pub answer: Result<Answer, Stop>,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub enum Answer {
    Frame(FrameReply),
    Pixels(Pixels),
}

/// An image of both eyes, as it lies on the device.
pub type Pixels = [Vec<u8>; 2];

/// Why a worker did not do what it was told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Stop {
    /// Its own device failed.
    Device(DeviceFailure),
    /// Another's did.
    Aborted,
}

/// A device's part of a frame, done.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameReply {
    pub times: Vec<TaskTime>,
    /// How wrong times of the device have been at most, so far.
    pub clock_residual_us: f64,
    /// When the device turned to the frame, and when it was done; milliseconds since the origin.
    pub begin_ms: f64,
    pub end_ms: f64,
    /// From the primary: the row tallies of the whole frame, then what was to be read.
    pub images: Vec<Pixels>,
    /// From the primary: the pose that it asked for. Those of other ranks ask for none.
    #[serde(skip)]
    pub shown_from: Option<Box<SampledPose>>,
    /// From the primary: where it has each output of the frame. Those of other ranks are out of reach.
    #[serde(skip)]
    pub buffers: Vec<(Output, [wgpu::Buffer; 2])>,
}

/// When a task ran.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TaskTime {
    /// Its number among the tasks of its device.
    pub task: usize,
    /// Milliseconds since the origin.
    pub begin_ms: f64,
    pub end_ms: f64,
    /// Of a transfer.
    pub bytes: Option<u64>,
    /// How many it was spread over.
    pub submissions: u32,
}

/// What workers send one another. `B` is what the bytes of rows are in.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Message<B = Bytes> {
    Rows {
        ticket: u64,
        transfer: u32,
        rows: B,
    },
    /// A device cannot go on with this attempt, so nobody who waits for it can.
    Abort {
        ticket: u64,
    },
}

/// Bytes of rows: in memory that is mapped from the device they come from, or, from another process, in our own.
pub enum Bytes {
    Mapped(Mapped),
    Owned(Vec<u8>),
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Mapped(mapped) => mapped,
            Self::Owned(bytes) => bytes,
        }
    }
}

impl PartialEq for Bytes {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl fmt::Debug for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes", self.len())
    }
}

impl Serialize for Bytes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(self)
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Vec::deserialize(deserializer).map(Self::Owned)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use serde::de::DeserializeOwned;

    use super::*;
    use crate::device::FailureKind;
    use crate::exec::planner::History;
    use crate::graph::{Assignment, HaloPlan, Seam, Stripes};
    use crate::passes::path_trace::CUT;
    use crate::passes::tonemap::{DISPLAY, LINEAR};
    use crate::passes::{ROW_TALLY, aov_image};
    use crate::scene::rig::Eye;
    use crate::schedule::Position;

    fn round_trip<T: Serialize + DeserializeOwned + PartialEq + fmt::Debug>(message: &T) {
        let text = serde_json::to_string(message).unwrap();
        assert_eq!(serde_json::from_str::<T>(&text).unwrap(), *message, "{text}");
    }

    fn job(seam: Seam, history: Option<History>) -> FrameJob {
        let mut assignment = Assignment::uniform(Stripes::even(90, 3));
        assignment.set(CUT, Eye::Right, Stripes::from_edges(90, &[10, 70]));
        // Device 0 has been taken out.
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
            update: SceneUpdate { rows: vec![(7, vec![1; 16])], pose: vec![[0.5; 4]], left_out: 3 },
            place: Place { slot: 2, turn: 1 },
            reads: vec![LINEAR.into(), DISPLAY.into(), aov_image(3).into()],
            cuts: vec![Cut { task: 4, at: Position { run: 1, row: 16 } }],
            late: None,
            runs: 2,
            injected: Some(InjectedKind::Hang),
        }
    }

    /// Of every kind.
    pub fn commands() -> Vec<Command> {
        let limit = Duration::from_micros(10_000_001);
        let command = |order| Command { ticket: u64::MAX, limit, order };
        let frame = |seam, history| command(Order::Frame(Box::new(job(seam, history))));
        let halos = (0..3).flat_map(HaloPlan::all).chain([HaloPlan::RECOMPUTE, HaloPlan::EXCHANGE]);
        let seams = [Seam::None, Seam::Filter].into_iter().chain(halos.map(Seam::Halo));
        let mut commands: Vec<_> = seams.map(|seam| frame(seam, None)).collect();
        let before = Assignment::uniform(Stripes::even(90, 4));
        commands.push(frame(Seam::None, Some(History { before, rows: 12, lost: vec![1] })));
        let place = Place { slot: 0, turn: 1 };
        commands.push(command(Order::Read { image: ROW_TALLY.into(), place, injected: None }));
        commands
    }

    /// Of every kind.
    pub fn replies() -> Vec<Reply> {
        let reply = |answer| Reply { ticket: 3, device: 63, answer };
        let times = vec![TaskTime { task: 4, begin_ms: 0.1, end_ms: 1e9 + 0.3, bytes: Some(1 << 40), submissions: 3 }];
        let images = vec![[vec![0, 255], vec![7]], [vec![], vec![1]]];
        let (shown_from, buffers) = (None, Vec::new());
        let done =
            FrameReply { times, clock_residual_us: 0.2, begin_ms: -0.0, end_ms: 0.7, images, shown_from, buffers };
        let done = [Answer::Frame(done), Answer::Pixels([vec![1, 2], vec![3, 4]])];
        let kinds = [FailureKind::Loss, FailureKind::Hang, FailureKind::Oom, FailureKind::Error];
        let failure = |kind| Stop::Device(DeviceFailure { kind, what: "it \"fell\"\n".to_owned() });
        let stops = kinds.map(failure).into_iter().chain([Stop::Aborted]);
        done.map(|answer| reply(Ok(answer))).into_iter().chain(stops.map(|stop| reply(Err(stop)))).collect()
    }

    #[test]
    fn messages_come_out_of_their_text_as_they_went_in() {
        commands().iter().for_each(round_trip);
        replies().iter().for_each(round_trip);
        round_trip(&Message::Rows { ticket: 1, transfer: u32::MAX, rows: Bytes::Owned((0..=255).collect()) });
        round_trip(&Message::<Bytes>::Abort { ticket: 9 });
    }
}
