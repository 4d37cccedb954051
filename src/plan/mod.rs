//! What a device does for a frame, as plain data: a list of commands, which is derived from the frame's graph.

pub mod commands;
mod list;
mod workgroups;

pub use commands::{Command, Commands, EyeImage, InjectedKind, Launched, Outgoing, Rows, Timed};
pub use list::{Builder, MOST_TIMED, Share, launched};
pub use workgroups::{Groups, groups};

#[cfg(test)]
pub(crate) mod tests;
