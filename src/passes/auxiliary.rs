//! Passes of auxiliary images.

use glam::Vec4;

use super::display_resampling::LATE_PARTITION;
use super::gbuffer::{ALBEDO, EMISSION, HIT, TALLY};
use super::history_length::{self, Counted};
use super::tonemap::PARTITION;
use super::{Aov, Display, FrameSpec, ImageChain, PREVIOUS};
use crate::graph::{Grid, Kernel, Pass, Reach, Resource, Stage, Use};
use crate::image::Extent;
use crate::scene::rig::Eye;
use crate::wgsl::arguments;

/// Stages of auxiliary images: the images themselves, their mapping from polar images to the screen, and their display
/// resampling. Their time does not count as frame time.
pub const STAGES: [Stage; 4] = [Stage("aov"), Stage("aov_to_screen"), Stage("aov_to_eye"), Stage("aov_to_later_eye")];

/// Auxiliary images in polar and rectified projection, before they are resampled.
const POLAR: Resource = Resource::image::<Vec4>("polar_aov").bound_as("polar");
const RECTIFIED: Resource = Resource::image::<Vec4>("rectified_aov").bound_as("rectified");

/// Returns the `index`th auxiliary image of a frame.
pub const fn image(index: u8) -> Resource {
    Resource::image::<Vec4>("aov").output().numbered(index)
}

/// Kernel with a constant for each kind of auxiliary image that the shader names.
const KERNEL: Kernel = Kernel::new("aov").reading_scene().with(&[
    ("ALBEDO", Aov::Albedo as u32),
    ("NORMAL", Aov::Normal as u32),
    ("POSITION", Aov::Position as u32),
    ("LAST_POSITION", Aov::LastPosition as u32),
    ("DEPTH", Aov::Depth as u32),
    ("ROUGHNESS", Aov::Roughness as u32),
    ("HOLES", Aov::Holes as u32),
    ("SPP", Aov::Spp as u32),
    ("STRIPES", Aov::Stripes as u32),
    ("BASE_COLOR", Aov::BaseColor as u32),
    ("DIFFUSE_ALBEDO", Aov::DiffuseAlbedo as u32),
    ("SHOWN_POSITION", Aov::ShownPosition as u32),
    ("SHOWN_NORMAL", Aov::ShownNormal as u32),
    ("VIRTUAL_POSITION", Aov::VirtualPosition as u32),
    ("EMISSION", Aov::Emission as u32),
    ("HISTORY", Aov::History as u32),
]);

arguments! {
    struct AovArguments {
        /// Number of the [`Aov`].
        pub kind: u32,
        /// Size of the screen image, pixels.
        pub width: u32,
        pub height: u32,
    }
}

arguments! {
    struct ToEyeArguments {
        /// Size of the shared projection, pixels.
        pub width: u32,
        pub height: u32,
        /// 1 if the image holds motion, which is mapped as well.
        pub is_motion: u32,
    }
}

/// Returns the passes of an auxiliary image. `counted` has the images of the denoiser's history, if it counts its frames.
pub fn passes(spec: &FrameSpec, view: Eye, index: u8, aov: Aov, counted: Option<Counted>) -> Vec<Pass> {
    let [polar, rectified, last] = [POLAR.numbered(index), RECTIFIED.numbered(index), image(index)];
    let ImageChain { polar: space, display, displayed } = spec.chain;
    let screen_size = spec.chain.screen();
    let map = |stage: Stage, from: Resource, to: Resource| {
        let kernel = if stage == STAGES[3] { "aov_late_reprojection" } else { stage.name() };
        Pass::new(stage, view, PARTITION, Kernel::new(kernel))
            .index(index.into())
            .on(to.grid)
            .uses([Use::read(from).reaching(Reach::All), Use::write(to).named("aov")])
    };
    let to_screen = |to: Resource| space.map(|_| map(STAGES[1], polar, to.on(Grid::Fixed(screen_size))));
    let first = |target: Resource| match counted.filter(|_| aov == Aov::History) {
        Some(counted) => history_length::bind(spec, begun(view, index), counted, target),
        None => of_surface(begun(view, index), aov, target, screen_size),
    };
    let Display::Resampled { is_late, .. } = display else {
        let target = if space.is_some() { polar } else { last };
        return std::iter::once(first(target)).chain(to_screen(last)).collect();
    };
    let target = if space.is_some() { polar } else { rectified };
    let (from, to) = (rectified.on(Grid::Fixed(screen_size)), last.on(Grid::Fixed(displayed)));
    let Extent { width, height } = screen_size;
    let to_eye_arguments = ToEyeArguments { width, height, is_motion: (aov == Aov::Motion).into() };
    let to_eye = match is_late {
        false => map(STAGES[2], from, to),
        true => {
            let late = Pass { partition: LATE_PARTITION, ..map(STAGES[3], from, to) };
            late.uses([Use::read(EMISSION).reaching(Reach::All)])
        }
    };
    std::iter::once(first(target)).chain(to_screen(rectified)).chain([to_eye.with([to_eye_arguments])]).collect()
}

/// Returns the pass of an auxiliary image without bindings.
fn begun(view: Eye, index: u8) -> Pass {
    Pass::new(STAGES[0], view, PARTITION, KERNEL).index(index.into())
}

/// Makes `pass` write an auxiliary image of the surface at the pixel's centre.
fn of_surface(pass: Pass, aov: Aov, target: Resource, screen: Extent) -> Pass {
    pass.uses([
        Use::read(HIT),
        Use::read(ALBEDO),
        Use::read(EMISSION),
        Use::read(TALLY),
        Use::write(target).named("aov"),
        Use::read(PREVIOUS),
    ])
    .with([AovArguments { kind: aov as u32, width: screen.width, height: screen.height }])
}
