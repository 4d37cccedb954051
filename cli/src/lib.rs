//! The commands of the program `diptych`. Your own program can run the same commands and extend them
//! through a [`Program`].
//!
//! Exit status: 0 done, 1 the run failed, 2 the command line or an input file is wrong, 129 SIGHUP ended the run, 130
//! Ctrl-C did, 143 SIGTERM did.

/// Prints a line like `println!` to the console of the command, but does not panic: [`console::finish`] reports errors.
macro_rules! say {
    ($($arg:tt)*) => {
        $crate::console::print(format_args!("{}\n", format_args!($($arg)*)))
    };
}

/// Prints a line like `eprintln!` to the console of the command, but ignores errors.
macro_rules! log {
    ($($arg:tt)*) => {
        $crate::console::log(format_args!($($arg)*))
    };
}

mod bench;
mod commands;
mod compare;
mod console;
mod core_time;
mod disturbances;
mod environment;
mod export;
mod export_args;
mod failure;
mod faults;
mod given;
mod graph;
mod headings;
mod hints;
mod info;
mod interrupt;
mod kinds;
mod manual;
mod measure;
mod metering;
mod node;
mod options;
mod others;
mod output;
mod page;
mod pictures;
mod play;
mod preview;
mod program;
mod progress;
#[cfg(feature = "python")]
mod python;
mod quilt;
mod ranks;
mod reference;
mod registry;
mod render;
pub mod report;
mod scale;
mod scene_loading;
mod setting_flags;
mod settings;
mod setup;
mod sheet;
mod shot;
mod signals;
mod simulate;
mod study;
mod tev;
mod trace;
mod units;
#[cfg_attr(not(feature = "view"), path = "no_view.rs")]
mod view;

use std::process::ExitCode;

pub use commands::run_from;
pub use console::Console;
pub use core_time::CoreTime;
pub use environment::prepare_environment;
pub use program::Program;

/// Runs the command that this process was started with, without extensions. Call [`prepare_environment`] before.
pub fn run() -> ExitCode {
    Program::new().run()
}
