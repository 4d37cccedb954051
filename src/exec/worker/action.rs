//! Ordered work, outcomes and actions of a worker: the input and output of `Protocol`.

use std::sync::Arc;

use crate::plan::{Commands, InjectedKind, Outgoing};

/// Work of an order, reduced to the parts that determine the sequence of the actions.
#[derive(Clone, Debug)]
pub enum Ordered {
    Frame(Arc<Commands>),
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
    /// Execute the frame's command with the index `at`, which is no [`Command::CopyIn`](crate::plan::Command::CopyIn).
    Execute {
        ticket: u64,
        at: usize,
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
    /// Write rows to the device, as the [`Command::CopyIn`](crate::plan::Command::CopyIn) with the index `at` demands.
    Write {
        ticket: u64,
        at: usize,
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
