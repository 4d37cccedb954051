//! diptych renders stereo frames for virtual reality by path tracing, image-parallel over several GPUs.
//!
//! The modules stand in the order in which a frame flows through them; a module uses only those above it.

pub mod image;
pub mod scene;
pub mod quality;
pub mod wgsl;
pub mod accel;
pub mod graph;
pub mod passes;
pub mod schedule;
pub mod control;
pub mod device;
pub mod stages;
pub mod exec;
pub mod metrics;
pub mod accumulation;
pub mod trace;
pub mod report;
