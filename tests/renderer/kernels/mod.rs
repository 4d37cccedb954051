//! Each compute kernel alone: small images go in, images come out, and a twin in plain Rust says what they should be.
//!
//! A twin is written from the method and computes in f64, on values that [`pack`] has unpacked. It is exact but for
//! the rounding of the shader's floats and half floats, which the tolerances of the comparisons allow for. Inputs are
//! random, from a fixed seed, and made so that every branch is taken; the tests assert that it is.
//!
//! Rows that a kernel must not read hold values that are not finite, so that reading one shows in the result. The
//! [`harness`] asserts that rows outside the stripe are not written.
//!
//! The test of a new kernel is one more file: a twin, inputs, and a call of [`harness::Kernel::run`] that names the
//! shader's bindings. [`harness::Kernel::with_scene`] makes a kernel that reads a scene.

mod accumulate;
mod atrous;
mod bmfr_accumulate;
mod camera;
mod compose;
mod edges;
mod eyes;
mod fit;
mod foveation;
mod gradient;
mod gradient_smooth;
mod harness;
mod inputs;
mod log_polar;
mod moving;
mod over_frames;
mod pack;
mod packed_on_device;
mod reproject;
mod resolve;
mod seam_filter;
mod select;
mod svgf;
mod tally;
mod tonemap;
mod variance;
mod visual_polar;
