//! diptych renders stereo frames for virtual reality by path tracing, image-parallel over several GPUs: the rows of
//! both eyes' images are divided into stripes, one for each device, and the images are the same, byte for byte, on any
//! number of devices of one kind.
//!
//! # The flow of a frame
//!
//! The modules are declared in the order in which a frame flows through them, and a module uses only those above it.
//!
//! 1. [`LoadedScene::load`] reads a shot: a [`scene::Scene`] and the stereo camera, a [`scene::rig::Rig`].
//!    [`accel::Accel`] builds the acceleration structure, and [`tables::SceneTables`] lays out the scene and the
//!    acceleration structure for shaders.
//! 2. [`passes::declare`] declares the passes of a frame as plain data: a [`graph::Pass`] names its shader and the
//!    images that it reads and writes.
//! 3. A [`schedule::Policy`] divides the rows among the devices. [`graph::FrameGraph`] is the resulting DAG of tasks
//!    and transfers.
//! 4. [`exec::Renderer`] executes the graph on the devices that [`device::open`] opened, and reads back the images.
//! 5. [`schedule::CostModel`] learns from the measured times of the frame. [`control::Controller`] may choose the
//!    [`quality::Quality`] of the next frame, to keep its time within a budget.
//!
//! [`denoise::FrameDenoiser`] runs the denoiser alone, on frames of other renderers.
//!
//! [`metrics`] compares images, [`accumulation`] renders reference images, and [`trace`] records where time is spent.
//! The package `diptych-cli` has the commands of the program, with their tables, charts and pages.
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
//!     exr::write_rgb("left.exr".as_ref(), renderer.read_linear()?.left())?;
//!     Ok(())
//! }
//! ```
//!
//! The folder `examples` contains a similar program and one with a custom pass, and `cli/examples` programs that add a
//! custom scheduling policy or a custom denoiser to all commands.

pub mod image;
pub mod scene;
pub mod wgsl;
pub mod projection;
pub mod samples;
pub mod accel;
pub mod graph;
pub mod passes;
pub mod quality;
pub mod schedule;
pub mod control;
pub mod plan;
pub mod device;
pub mod layout;
pub mod tables;
pub mod frame;
pub mod stages;
pub mod denoise;
pub mod loaded;
pub mod exec;
pub mod metrics;
pub mod session;
#[cfg(feature = "xr")]
pub mod headset;
pub mod accumulation;
pub mod trace;

pub use control::{Budget, Controller, Ladder};
pub use device::Selection;
pub use exec::{FrameReport, PerView, Renderer};
pub use frame::RunConfig;
pub use image::Extent;
pub use loaded::{LoadError, LoadedScene};
pub use quality::{Denoiser, Quality};
pub use scene::Scene;
pub use scene::rig::Rig;
pub use schedule::{CostModel, Policy};
pub use session::Session;

/// Markdown documents whose example programs are compiled as doctests.
#[cfg(doctest)]
mod documents {
    #[doc = include_str!("../README.md")]
    struct Readme;
    #[doc = include_str!("../docs/guide/library.md")]
    struct Library;
    #[doc = include_str!("../docs/guide/denoiser.md")]
    struct Denoiser;
}
