//! Sums per-pixel counts over each image row.

use bytemuck::{Pod, Zeroable};

use super::gbuffer::TALLY;
use super::tonemap::PARTITION;
use crate::graph::{Dispatch, Grid, Kernel, Pass, Resource, Stage, Use};
use crate::scene::rig::Eye;
use crate::wgsl::{Texel, constants};

/// The [`RowTally`] of each row.
pub const ROW_TALLY: Resource = Resource::image::<RowTally>("row_tally").on(Grid::FrameRows).output();

/// Number of pixels that one invocation sums.
const SEGMENT: u32 = 64;

/// Number of counters in a [`RowTally`].
const COUNTS: u32 = size_of::<RowTally>() as u32 / 4;

const KERNEL: Kernel = Kernel::new("tally").with(constants![SEGMENT, COUNTS]);

pub fn pass(view: Eye) -> Pass {
    Pass::new(Stage("tally"), view, PARTITION, KERNEL)
        .uses([Use::read(TALLY), Use::write_then_read(ROW_TALLY).cleared()])
        .dispatch(Dispatch::Invocations([SEGMENT, 1]))
}

/// Counts of one image row, in the order in which the shader stores them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct RowTally {
    pub rays: u32,
    pub nonfinite: u32,
    /// Number of holes for each [`HoleReason`].
    pub holes: [u32; 6],
    /// Number of pixels that were not sampled and are left to the denoiser.
    pub unsampled: u32,
    /// Pixels whose radiance was clamped to the largest half float. Only counted if specular and diffuse radiance are
    /// stored separately.
    pub clipped: u32,
}

/// Invocations add to counters concurrently.
impl Texel for RowTally {
    const ELEMENT: &'static str = "atomic<u32>";
}

/// Code stored instead of a [`HoleReason`] if a pixel is left to the denoiser.
pub const SKIPPED: u32 = HoleReason::ALL.len() as u32 + 1;

/// Reason that a pixel of the right eye could not be reprojected, in the order of [`RowTally::holes`]. Pixels store the
/// reason's number + 1; 0 means no hole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HoleReason {
    /// The surface is outside the left eye's image, or the pixel is in the right eye's fovea and the left eye did not
    /// sample the surface.
    Outside,
    /// The left eye saw a surface with another normal.
    Normal,
    /// The left eye saw a surface at another depth.
    Distance,
    /// The left eye saw a surface of another material, or none.
    Material,
    /// Several surfaces share the pixel.
    Mixed,
    /// The appearance depends on the view: polished metal, glass, gloss at grazing angles.
    View,
}

impl HoleReason {
    pub const ALL: [Self; 6] = [Self::Outside, Self::Normal, Self::Distance, Self::Material, Self::Mixed, Self::View];

    pub fn name(self) -> &'static str {
        match self {
            Self::Outside => "outside",
            Self::Normal => "normal",
            Self::Distance => "distance",
            Self::Material => "material",
            Self::Mixed => "mixed",
            Self::View => "view",
        }
    }
}
