//! diptych renders stereo frames for virtual reality by path tracing, image-parallel over several GPUs: the rows of
//! both eyes' images are divided into stripes, one for each device, and the images are the same, byte for byte, on any
//! number of devices of one kind.
//!
//! # The flow of a frame
//!
//! The modules stand in the order in which a frame flows through them, and a module uses only those above it.
//!
//! 1. [`LoadedScene::load`] reads a shot: a [`scene::Scene`] and the [`scene::rig::Rig`] that sees it. [`accel::Accel`]
//!    builds the tree that rays walk, and [`stages::SceneTables`] lays both out for shaders.
//! 2. [`passes::declare`] says which passes a frame has, as plain data: a [`graph::Pass`] names its shader and the
//!    images that it reads and writes.
//! 3. A [`schedule::Policy`] divides the rows among the devices, and [`graph::FrameGraph`] is the DAG of tasks and
//!    transfers that follows.
//! 4. [`exec::Renderer`] runs it on the devices that [`device::open`] opened, and reads the images.
//! 5. [`schedule::CostModel`] learns from the times of the frame. [`control::Controller`] may pick the
//!    [`quality::Quality`] of the next one, so that it stays within a budget.
//!
//! [`metrics`] compares images, [`accumulation`] makes references, and [`trace`] says where time went. The feature
//! `cli`, on by default, adds the commands of the program as the module `cli`, and their tables and charts as `report`.
//!
//! # Render a frame
//!
//! ```no_run
//! use diptych::image::exr;
//! use diptych::{LoadedScene, Renderer};
//!
//! fn main() -> Result<(), Box<dyn std::error::Error>> {
//!     let scene = LoadedScene::load("builtin:cornell")?;
//!     let mut renderer = Renderer::builder(&scene).size(640, 360).devices(2).build()?;
//!     let report = renderer.render(&renderer.frame(&scene.shot.rig, 0.0, 0))?;
//!     println!("{:.1} ms", report.makespan_ms);
//!     exr::write_rgb("left.exr".as_ref(), &renderer.read_linear()?.left)?;
//!     Ok(())
//! }
//! ```
//!
//! The folder `examples/` has this as a program, a pass of your own, and a policy of your own in all commands.

pub mod image;
pub mod scene;
pub mod wgsl;
pub mod accel;
pub mod graph;
pub mod passes;
pub mod quality;
pub mod schedule;
pub mod control;
pub mod device;
pub mod stages;
pub mod loaded;
pub mod exec;
pub mod session;
#[cfg(feature = "xr")]
pub mod headset;
pub mod metrics;
pub mod accumulation;
pub mod trace;
#[cfg(feature = "cli")]
pub mod report;
#[cfg(feature = "cli")]
pub mod cli;

pub use control::{Budget, Controller, Ladder};
pub use device::Selection;
pub use exec::{FrameReport, Renderer, Stereo};
pub use image::Extent;
pub use loaded::{LoadError, LoadedScene};
pub use quality::{Denoiser, Quality};
pub use scene::Scene;
pub use scene::rig::Rig;
pub use schedule::{CostModel, Policy};
pub use session::Session;
pub use stages::RunConfig;

/// Programs in documents, which are compiled with those of the documentation.
#[cfg(doctest)]
mod documents {
    #[doc = include_str!("../README.md")]
    struct Readme;
    #[doc = include_str!("../docs/library.md")]
    struct Library;
}
