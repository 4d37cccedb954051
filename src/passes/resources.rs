//! Resources that several passes share, apart from those of the G-buffer.

use glam::{UVec4, Vec4};

use super::FrameSpec;
use crate::graph::{Grid, Resource};
use crate::image::Extent;

/// Uniform buffer with the views (cameras) and sampling constants of the previous frame. The host writes it.
pub const PREVIOUS: Resource = Resource::constants("previous frame", "Previous", 288).bound_as("previous");

/// Demodulated illumination. If specular radiance is filtered separately, diffuse and specular illumination, each
/// demodulated by its own albedo.
pub const RADIANCE: Resource = Resource::image::<UVec4>("radiance").bound_as("radiance_image");

/// Compacted list of the pixels to path trace.
pub const HOLES: Resource = Resource::list("holes");
/// The same, without the holes that a view shares with its partner.
pub const UNSHARED: Resource = Resource::list("unshared");

/// The finished polar image: as scene-referred RGB, and encoded for display. No pass reads the encoded image.
pub const POLAR: Resource = Resource::image::<Vec4>("polar");
pub const POLAR_DISPLAY: Resource = Resource::image::<u32>("polar_display");

/// The finished rectified image: as scene-referred RGB, and encoded for display. No pass reads the encoded image.
pub const RECTIFIED: Resource = Resource::image::<Vec4>("rectified");
pub const RECTIFIED_DISPLAY: Resource = Resource::image::<u32>("rectified_display");

/// The displayed image as scene-referred RGB.
pub const LINEAR: Resource = Resource::image::<Vec4>("linear").output();
/// The displayed image, encoded as RGBA8.
pub const DISPLAY: Resource = Resource::image::<u32>("display").output();

/// Returns the image that holds the position and the packed shading normal of each pixel's surface in the previous
/// frame. In a static scene, the image is a 1×1 dummy.
pub fn last_surface(spec: &FrameSpec) -> Resource {
    let image = Resource::image::<UVec4>("last_surface");
    let nothing = Grid::Fixed(Extent::new(1, 1));
    if spec.moving.is_some() { image } else { image.on(nothing) }
}
