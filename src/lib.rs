//! diptych renders stereo frames for virtual reality by path tracing, image-parallel over several GPUs: the rows of both
//! eyes' images are divided into stripes, one for each device, and the images are the same, byte for byte, on any number
//! of devices of one kind.
//!
//! # The flow of a frame
//!
//! The modules stand in the order in which a frame flows through them, and a module uses only those above it.
//!
//! 1. [`scene::load::load_shot`] reads a shot: a [`scene::Scene`] and the [`scene::rig::Rig`] that sees it.
//!    [`accel::Accel`] builds the tree that rays walk, and [`stages::SceneTables`] lays both out for shaders.
//! 2. [`passes::declare`] says which passes a frame has, as plain data: a [`graph::Pass`] names its shader and the images
//!    that it reads and writes.
//! 3. A [`schedule::Policy`] divides the rows among the devices, and [`graph::FrameGraph`] is the DAG of tasks and
//!    transfers that follows.
//! 4. [`exec::Renderer`] runs it on the devices that [`device::open`] opened, and reads the images.
//! 5. [`schedule::CostModel`] learns from the times of the frame. [`control::Controller`] may pick the
//!    [`quality::Quality`] of the next one, so that it stays within a budget.
//!
//! [`metrics`] compares images, [`accumulation`] makes references, [`trace`] and [`report`] say where time went.
//!
//! # Render a frame
//!
//! ```no_run
//! use std::{path::Path, sync::Arc, time::Instant};
//!
//! use diptych::accel::Accel;
//! use diptych::device::{self, Selection};
//! use diptych::exec::{RenderSettings, Renderer};
//! use diptych::image::{Extent, exr};
//! use diptych::scene::load::load_shot;
//! use diptych::schedule::Measured;
//! use diptych::stages::SceneTables;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let (shot, scene) = load_shot("builtin:cornell")?;
//! let tables = Arc::new(SceneTables::new(&scene, Accel::build(&scene)?)?);
//! let extent = Extent::new(640, 360);
//! let settings = RenderSettings::new(extent, &scene, &tables);
//!
//! let devices = device::open(&Selection { virtual_devices: 2, ..Selection::default() })?;
//! let policy = Box::new(Measured::new(extent.height, devices.len()));
//! let mut renderer = Renderer::new(devices, tables, settings, policy, Instant::now())?;
//!
//! let report = renderer.render(&shot.rig, 0.0, 0)?;
//! println!("{:.1} ms", report.makespan_ms);
//! exr::write_rgb(Path::new("left.exr"), &renderer.read_linear()?.left)?;
//! # Ok(())
//! # }
//! ```
//!
//! The folder `examples/` has this as a program, a policy and a pass of one's own.

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
#[cfg(feature = "xr")]
pub mod headset;
pub mod metrics;
pub mod accumulation;
pub mod trace;
pub mod report;
