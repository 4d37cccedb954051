//! What needs no device: the control loop on simulated renderers, the workers' protocol as a model, and the reference
//! path tracer by itself; and the record of sessions that last for hours.

mod bsdf;
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
