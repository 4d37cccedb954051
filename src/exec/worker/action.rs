//! What a worker is told, and what it does: the input and output of [`Protocol`].

use std::sync::Arc;

#[cfg(doc)]
use super::protocol::Protocol;
use super::script::{Outgoing, Script};
use crate::exec::InjectedKind;

/// What a worker is told to do, as far as the order of its actions depends on it.
#[derive(Clone, Debug)]
pub enum Command {
    Frame(Arc<Script>),
    Read { injected: Option<InjectedKind> },
}

/// What came of an attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Outcome {
    Done,
    /// The device failed.
    Failed,
    /// Another device failed.
    Aborted,
}

/// What to do next. `B` is what the bytes of rows are in.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Action<B> {
    /// Take a command if there is one, and wait for it if `waits`; then [`Protocol::command`] or
    /// [`Protocol::no_command`]. The worker ends if it waits and there will be none any more.
    TakeCommand {
        waits: bool,
    },
    /// Turn to a new frame.
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
    /// Wait until the device has done what was submitted, and ask for the pose that the frame is shown from.
    Ask {
        ticket: u64,
    },
    /// End the command encoder, which is what takes the host's time.
    Close {
        ticket: u64,
    },
    /// Submit what is recorded.
    Submit {
        ticket: u64,
    },
    /// Submit nothing, so that what was written to the device is carried out.
    SubmitUploads {
        ticket: u64,
    },
    Inject {
        kind: InjectedKind,
    },
    /// Wait for the copy of these rows, map it and send it.
    Send(Outgoing),
    /// A wait for rows begins; more actions may belong to it until they are written.
    Receive {
        ticket: u64,
        transfer: u32,
    },
    /// Wait for a message for a slice of the limit; then [`Protocol::message`] or [`Protocol::timed_out`].
    AwaitMessage,
    /// Write rows to the device.
    Write {
        ticket: u64,
        task: usize,
        rows: B,
    },
    /// See whether the frame's last submission has ended, and wait for that if `waits`; if so, ask for its images. Then
    /// [`Protocol::ended`].
    End {
        ticket: u64,
        waits: bool,
    },
    /// The same for its images; if they are there, take them.
    TakeImages {
        ticket: u64,
        waits: bool,
    },
    /// Read an image of the last frame.
    Read {
        ticket: u64,
    },
    /// Tell all other workers that nothing more of this attempt comes from here.
    CallOff {
        ticket: u64,
    },
    /// Answer, and forget the attempt.
    Answer {
        ticket: u64,
        outcome: Outcome,
    },
}
