//! Tests the renderer on devices through the library: its images, on any number of devices.

#[path = "../common/mod.rs"]
mod common;
mod splits;
mod black;
mod budget;
mod denoise;
mod display;
mod energy;
mod eyes;
mod faults;
mod foveation;
mod gbuffer;
mod glass;
mod history_lengths;
mod instances;
mod kernels;
mod late;
mod lights;
mod loss;
mod mirrors;
mod moving;
mod passes;
mod pictures;
mod predictions;
mod radiance_cache;
mod ranks;
#[path = "../reference/mod.rs"]
mod reference;
mod same_bytes;
mod seams;
mod stereo;
mod stopping;
mod stress;
mod temporal;
mod textures;
mod traversal;
mod unbiased;
mod views;
mod watertight;
