//! The renderer's passes on one device: their images, their pipelines, and the scene as shaders read it.
//!
//! [`DeviceStages`] creates the resources that passes bind, and records commands with them. It knows of no other devices.

mod albedo_table;
mod alias;
mod bindings;
mod color;
mod compile;
mod config;
mod dead_code;
mod emitters;
mod foveation;
pub(crate) mod frame_constants;
mod images;
mod kernels;
pub mod layout;
mod limits;
mod params;
mod pipeline;
mod reflect;
mod scene_tables;
pub(crate) mod search_range;
mod shader;
mod shader_files;
mod specialization;

pub use compile::StageError;
pub use config::{Buffers, Execution, RunConfig, Sampler};
pub use foveation::Foveation;
pub use images::{Images, Place};
pub use limits::{LimitExceeded, Remedy};
pub use params::FrameParams;
pub use pipeline::{DeviceStages, Recording};
pub use reflect::{Mismatch, verify};
#[doc(hidden)] // For benchmarks.
pub use scene_tables::{SceneBuffers, layout_entries as scene_layout_entries};
pub use scene_tables::{SceneTables, SceneUpdate, TableError};
pub use shader::{ShaderVariant, all_shader_text, check_shaders, override_names, shader_text, shader_text_of};
pub use shader_files::ShaderError;
pub(crate) use shader_files::folder as shader_folder;
#[doc(hidden)] // For tests and benchmarks of single kernels.
pub use specialization::Specialization;

#[cfg(test)]
mod dead_code_tests;
#[cfg(test)]
mod history_tests;
#[cfg(test)]
mod light_density_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod variant_tests;
