//! The renderer's passes on one device: their images and their pipelines.
//!
//! [`DeviceStages`] creates the resources that passes bind, and records commands with them. It knows of no other devices.

mod bindings;
mod compile;
mod dead_code;
mod images;
mod kernels;
mod pipeline;
mod reflect;
mod shader;
mod shader_files;
mod specialization;

pub use compile::StageError;
pub use images::{Images, Place};
pub use pipeline::{DeviceStages, Recording};
pub use reflect::{Mismatch, verify};
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
