//! Tests that need no device: the control loop on simulated renderers, a model of the workers' protocol, the reference
//! path tracer by itself, and the record of hour-long sessions.

mod bsdf;
mod circles;
mod control;
#[path = "../common/effort.rs"]
mod effort;
mod imports;
mod memory;
mod protocol;
#[path = "../reference/mod.rs"]
mod reference;
mod reference_selftest;
mod results;
mod sessions;
