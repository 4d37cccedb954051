//! Tests each compute kernel in isolation: a kernel transforms small images, and a twin in plain Rust computes the
//! expected ones.
//!
//! A twin follows the published method and computes in f64, on values that [`pack`] has unpacked. It differs from the
//! shader only by the rounding of floats and half floats, for which comparisons have tolerances. Inputs are random with
//! a fixed seed and cover every branch, which the tests assert.
//!
//! Rows that a kernel must not read hold values that are not finite, so that a read shows in the result. The
//! [`harness`] asserts that rows outside the stripe are not written.
//!
//! To test a new kernel, add a file with a twin, inputs, and a call of [`harness::Kernel::run`] that names the shader's
//! bindings. For a kernel that reads a scene, use [`harness::Kernel::with_scene`].

mod accumulate;
mod atrous;
mod bmfr_accumulate;
mod camera;
mod compose;
mod edges;
mod eyes;
mod filters;
mod fit;
mod foveation;
mod gradient;
mod gradient_smooth;
pub mod harness;
mod import;
mod inputs;
mod log_polar;
mod moving;
mod over_frames;
mod pack;
mod packed_on_device;
mod radiance_cache;
mod reproject;
mod taa;
mod seam_filter;
mod mask_compaction;
mod svgf;
mod tally;
mod tonemap;
mod unfinished;
mod variance;
mod visual_polar;
