//! The scene as shaders read it: tables built once per scene, and their copy on a device.

mod acceleration;
mod buffers;
mod moves;
mod tables;
mod update;

pub use buffers::{SceneBuffers, changing_entries, layout_entries, scene_buffers};
pub use tables::{SceneTables, TableError};
pub use update::SceneUpdate;
