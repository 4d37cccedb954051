//! The scene as shaders read it: tables built once per scene, and their copy on a device.

mod acceleration;
mod albedo_table;
mod alias;
mod buffers;
mod color;
mod emitters;
pub mod limits;
mod moves;
mod scene_tables;
mod update;

pub use buffers::{SceneBuffers, changing_entry, layout_entries, scene_buffers};
pub use limits::{LimitExceeded, Remedy};
pub use scene_tables::{SceneTables, TableError};
pub use update::SceneUpdate;
