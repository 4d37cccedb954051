//! Lists the steps of a device's share of a frame: commands as plain data, which follow from the graph of the frame.

pub mod commands;
mod list;
mod workgroups;

pub use commands::{Command, Commands, EyeImage, InjectedKind, Launched, Outgoing, Rows, Timed};
pub use list::{Builder, MOST_TIMED, Share, Work, launched};
pub use workgroups::{Groups, groups};

#[cfg(test)]
pub(crate) mod tests;
