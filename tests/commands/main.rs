//! The program as a user runs it: its commands, files, messages and exit statuses.

mod bad_input;
mod bench;
#[path = "../common/mod.rs"]
mod common;
mod export;
mod files;
mod host_trace;
mod metrics;
mod play;
mod reference_mode;
mod report;
mod scale;
mod schema;
mod stale;
mod studies;
mod tools;
mod trace_files;
