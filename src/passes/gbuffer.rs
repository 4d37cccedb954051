//! Primary visibility of one view.

use glam::{UVec4, Vec4};

use super::FrameSpec;
use crate::graph::{Kernel, Launch, Partition, Pass, Resource, Stage, Use};
use crate::scene::rig::Eye;
use crate::wgsl::{Words, arguments};

pub const STAGE: Stage = Stage("gbuffer");
pub const PARTITION: Partition = Partition("gbuffer");

/// Triangle, barycentrics, material and flags at a pixel's centre. If mirrors are followed, this and all images below
/// describe the surface that the mirror shows.
pub const HIT: Resource = Resource::image::<UVec4>("hit").bound_as("hit_image");
/// Position and packed shading normal.
pub const GUIDE: Resource = Resource::image::<UVec4>("guide").bound_as("guide_image");
/// Albedo and roughness. If specular radiance is filtered separately, also the diffuse part of the albedo.
pub const ALBEDO: Resource = Resource::image::<UVec4>("albedo").bound_as("albedo_image");
/// Radiance that no pass filters, and depth. The radiance is emission and, if the denoiser leaves it out, direct light
/// with hard shadows.
pub const EMISSION: Resource = Resource::image::<Vec4>("emission").bound_as("emission_image");
/// Number of rays, number of dropped samples, hole reason and a flag for clipped radiance, packed.
pub const TALLY: Resource = Resource::image::<u32>("tally").bound_as("tally_image");

/// Primary rays per pixel in one launch.
const RAYS_PER_LAUNCH: u32 = 64;

arguments! {
    /// The first launch, whose arguments are 0, finds the surfaces at pixels' centres.
    struct MeanArguments {
        /// The samples of a launch: the first, and the one after the last.
        pub first_sample: u32,
        pub end_sample: u32,
        /// 1 to skip the pixels that path tracing samples. For these, path tracing writes the mean albedo and emission
        /// over the samples.
        pub unsampled_only: u32,
    }
}

const KERNEL: Kernel = Kernel::tracing_rays("gbuffer");

pub fn pass(spec: &FrameSpec, view: Eye) -> Pass {
    // In jittered frames, albedo and emission are averaged over the samples of a pixel. Path tracing writes these means
    // for the pixels that it samples. This pass writes them for all other pixels, and for a whole reprojected view.
    let reprojected = spec.source(view).is_some();
    let means = Launch::Samples { most: RAYS_PER_LAUNCH, third: (!reprojected).into(), only_jittered: true };
    let means = (reprojected || spec.sparse).then_some(means);
    let images = [HIT, ALBEDO, EMISSION, TALLY, GUIDE];
    Pass::new(STAGE, view, PARTITION, KERNEL)
        .uses(images.map(Use::write_then_read))
        .launches(std::iter::once(Launch::Once(Words::default())).chain(means).collect())
        .taking::<MeanArguments>()
}
