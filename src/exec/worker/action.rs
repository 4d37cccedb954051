//! Ordered work, outcomes and actions of a worker: the input and output of `Protocol`.

use std::sync::Arc;

use super::script::{Outgoing, Script};
use crate::exec::InjectedKind;

/// Work of an order, reduced to what determines the sequence of the actions.
#[derive(Clone, Debug)]
pub enum Ordered {
    Frame(Arc<Script>),
    Read { injected: Option<InjectedKind> },
}

/// Outcome of an attempt at a frame, or of reading an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Outcome {
    Done,
    /// The device failed.
    Failed,
    /// Another device failed.
    Aborted,
}

/// Next action of a worker. `B` holds the bytes of rows.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Action<B> {
    /// Take an order if there is one, and wait for it if `waits`; then call `Protocol::order` or
    /// `Protocol::no_order`. The worker ends if it waits and there will be no more orders.
    TakeOrder {
        waits: bool,
    },
    /// Begin a new frame.
    Begin {
        ticket: u64,
    },
    /// Record a dispatch or a copy of rows.
    Record {
        ticket: u64,
        task: usize,
    },
    /// Record a copy of the timestamps.
    RecordTimestamps {
        ticket: u64,
    },
    /// Wait until the device has completed all submissions, then ask for the late-latched pose.
    Ask {
        ticket: u64,
    },
    /// End the command encoder. This takes host time, since wgpu encodes only now.
    Close {
        ticket: u64,
    },
    /// Submit the recorded commands.
    Submit {
        ticket: u64,
    },
    /// Make an empty submission, so that the device executes pending writes.
    SubmitUploads {
        ticket: u64,
    },
    Inject {
        kind: InjectedKind,
    },
    /// Wait for the copy of these rows, map it and send it.
    Send(Outgoing),
    /// Begin to wait for rows. Other actions may follow before the rows arrive and [`Action::Write`] writes them.
    Receive {
        ticket: u64,
        transfer: u32,
    },
    /// Wait for a message for at most one slice of the time limit; then call `Protocol::message` or
    /// `Protocol::timed_out`.
    AwaitMessage,
    /// Write rows to the device.
    Write {
        ticket: u64,
        task: usize,
        rows: B,
    },
    /// Check whether the frame's last submission has completed; with `waits`, wait until it has. If it has completed,
    /// read the timestamps and request the frame's images. Then call `Protocol::ended` with the result of the check.
    End {
        ticket: u64,
        waits: bool,
    },
    /// Check whether the frame's images have arrived on the host; with `waits`, wait until they have. If they have
    /// arrived, take them. Then call `Protocol::ended` with the result of the check.
    TakeImages {
        ticket: u64,
        waits: bool,
    },
    /// Read an image of the last frame.
    Read {
        ticket: u64,
    },
    /// Tell all other workers that this one sends nothing more for this attempt.
    CallOff {
        ticket: u64,
    },
    /// Send the answer to the renderer, and discard the state of the attempt or readback.
    Answer {
        ticket: u64,
        outcome: Outcome,
    },
}
