//! Runs the program as a user does: its commands, files, messages and exit statuses.

mod animation;

mod bench;
#[path = "../common/mod.rs"]
mod common;
mod faults;
mod files;
mod graph;
mod head_motion;
mod help;
mod host_trace;
mod image_files;
mod interface;
mod late_frames;
mod look;
mod memory;
mod measure;
mod metrics;
mod pictures;
mod play;
mod reference_mode;
mod refusals;
mod report;
mod rivalry;
mod runs;
mod scale;
mod scene_files;
mod schema;
mod sessions;
mod sheet;
mod shots;
mod signals;
mod streams;
mod studies;
mod tools;
mod trace_files;
mod viewer;
