//! Resources that several passes share, apart from those of the G-buffer.

use super::FrameSpec;
use crate::graph::{Grid, Resource, Size};
use crate::image::Extent;

/// Uniform buffer with the views (cameras) and sampling constants of the previous frame. The host writes it.
pub const PREVIOUS: Resource = Resource::constants("previous frame", 240);

/// Demodulated illumination. If specular radiance is filtered separately, diffuse and specular illumination, each
/// demodulated by its own albedo.
pub const RADIANCE: Resource = Resource::image("radiance", 16);

/// Compacted list of the pixels to path trace.
pub const HOLES: Resource = Resource::list("holes");

/// The finished polar image: as scene-referred RGB, and encoded for display. No pass reads the encoded image.
pub const POLAR: Resource = Resource::image("polar", 16);
pub const POLAR_DISPLAY: Resource = Resource::image("polar_display", 4);

/// The finished rectified image: as scene-referred RGB, and encoded for display. No pass reads the encoded image.
pub const RECTIFIED: Resource = Resource::image("rectified", 16);
pub const RECTIFIED_DISPLAY: Resource = Resource::image("rectified_display", 4);

/// The displayed image as scene-referred RGB.
pub const LINEAR: Resource = Resource::image("linear", 16).output();
/// The displayed image, encoded as RGBA8.
pub const DISPLAY: Resource = Resource::image("display", 4).output();

/// Returns the image that holds the position and the packed shading normal of each pixel's surface in the previous
/// frame. In a static scene, the image is a 1×1 dummy.
pub fn last_surface(spec: &FrameSpec) -> Resource {
    let image = Resource::image("last_surface", 16);
    let nothing = Grid::table(Size::Fixed(Extent::new(1, 1)));
    if spec.moving.is_some() { image } else { image.on(nothing) }
}
