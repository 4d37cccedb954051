//! Tests that need no device: the control loop on simulated renderers, a model of the workers' protocol, and the
//! reference path tracer by itself.

mod bsdf;
mod control;
#[path = "../common/effort.rs"]
mod effort;
mod imports;
mod protocol;
#[path = "../reference/mod.rs"]
mod reference;
mod reference_selftest;
mod results;
