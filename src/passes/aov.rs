//! Auxiliary images.

use super::gbuffer::{ALBEDO, EMISSION, HIT, TALLY};
use super::polar::screen;
use super::shown::{self, LATE_CUT};
use super::tonemap::CUT;
use super::{FrameSpec, PREVIOUS};
use crate::graph::{Kernel, Pass, Reach, Resource, Stage, Use};
use crate::image::Extent;
use crate::scene::rig::Eye;

/// Stages of auxiliary images: the images themselves, their mapping from polar images to the screen, and their display
/// resampling. Their time does not count as frame time.
pub const STAGES: [Stage; 4] = [Stage("aov"), Stage("aov_to_screen"), Stage("aov_to_eye"), Stage("aov_to_later_eye")];

/// Auxiliary images in polar and rectified projection, before they are resampled.
const POLAR: Resource = Resource::image("polar_aov", 16);
const RECTIFIED: Resource = Resource::image("rectified_aov", 16);

/// Returns the `index`th auxiliary image of a frame.
pub const fn image(index: u8) -> Resource {
    Resource::image("aov", 16).output().numbered(index)
}

/// Kernel with constants for the kinds that the shader names.
const KERNEL: Kernel = Kernel::with_scene("aov").with(&[
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
]);

/// Returns the passes of an auxiliary image.
pub fn passes(spec: &FrameSpec, view: Eye, index: u8, aov: Aov) -> Vec<Pass> {
    let [polar, rectified, last] = [POLAR.numbered(index), RECTIFIED.numbered(index), image(index)];
    let rectified_size = shown::rectified(spec);
    let map = |stage: Stage, from: Resource, to: Resource| {
        Pass::new(stage, view, CUT, Kernel::new(stage.name()))
            .index(index.into())
            .on(to.grid)
            .uses([Use::read(from).reaching(Reach::All), Use::write(to)])
    };
    let to_screen = |to: Resource| spec.screen.map(|size| map(STAGES[1], polar, to.on(screen(size))));
    let Some(shown) = spec.shown else {
        let first = if spec.screen.is_some() { polar } else { last };
        return std::iter::once(pass(view, index, aov, first, rectified_size)).chain(to_screen(last)).collect();
    };
    let first = if spec.screen.is_some() { polar } else { rectified };
    let (from, to) = (rectified.on(screen(rectified_size)), last.on(screen(shown)));
    let args = [rectified_size.width, rectified_size.height, u32::from(aov == Aov::Motion)];
    let to_eye = match spec.is_late {
        false => map(STAGES[2], from, to),
        true => {
            let late = Pass { cut_group: LATE_CUT, ..map(STAGES[3], from, to) };
            late.uses([Use::read(EMISSION).reaching(Reach::All)])
        }
    };
    let first = pass(view, index, aov, first, rectified_size);
    std::iter::once(first).chain(to_screen(rectified)).chain([to_eye.args(args)]).collect()
}

fn pass(view: Eye, index: u8, aov: Aov, target: Resource, screen: Extent) -> Pass {
    Pass::new(STAGES[0], view, CUT, KERNEL)
        .index(index.into())
        .uses([
            Use::read(HIT),
            Use::read(ALBEDO),
            Use::read(EMISSION),
            Use::read(TALLY),
            Use::write(target),
            Use::read(PREVIOUS),
        ])
        .args([aov as u32, screen.width, screen.height])
}

/// An auxiliary image (AOV): a property of the surface at the pixel's centre, or of how the pixel was rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum), value(rename_all = "snake_case"))]
#[repr(u32)]
pub enum Aov {
    /// The albedo by which radiance is divided before it is filtered, linear RGB: the share of uniform light from all
    /// around that all lobes of the surface send to the eye. It is the mean over the pixel where that has several
    /// samples.
    Albedo,
    /// Shading normal, world space, towards the eye.
    Normal,
    /// World space, scene units.
    Position,
    /// Position of the surface in the previous frame, world space, scene units.
    LastPosition,
    /// Distance along the ray, scene units; 0 for the sky.
    Depth,
    /// Position of the surface in the previous frame minus the current one, pixels.
    Motion,
    /// Perceptual, 0 to 1.
    Roughness,
    /// Why a pixel of the right eye was traced. 0: it was reprojected, or there is no surface. 1: it is outside the
    /// left image. 2, 3, 4: the left eye saw a surface turned another way, at another depth, or of another material. 5:
    /// several surfaces share it (antialiasing). 6: it shows a mirror, glass or gloss. 7, of either eye: it was left to
    /// the filter.
    Holes,
    /// Samples per pixel; 0 where it was left to the filter.
    Spp,
    /// Index of the device that finished the pixel.
    Stripes,
    /// Product of factor, texture and vertex colour, of unlit materials as well, linear RGB. It is 0 where there is no
    /// surface.
    BaseColor,
    /// Albedo of the Lambertian lobe, linear RGB: the part of the base colour that neither metal nor transmission
    /// takes, before the layers above dim it.
    DiffuseAlbedo,
    /// Share of uniform light from all around that microfacets reflect to the eye, those of the coat included, linear
    /// RGB.
    SpecularAlbedo,
}

impl Aov {
    /// Whether it holds small integers, for which a picture of both eyes is useful.
    pub fn counts(self) -> bool {
        matches!(self, Self::Holes | Self::Spp | Self::Stripes)
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Position => "position",
            Self::LastPosition => "last_position",
            Self::Depth => "depth",
            Self::Motion => "motion",
            Self::Roughness => "roughness",
            Self::Holes => "holes",
            Self::Spp => "spp",
            Self::Stripes => "stripes",
            Self::BaseColor => "base_color",
            Self::DiffuseAlbedo => "diffuse_albedo",
            Self::SpecularAlbedo => "specular_albedo",
        }
    }

    /// Returns the names of the channels in use.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Albedo | Self::BaseColor | Self::DiffuseAlbedo | Self::SpecularAlbedo => &["R", "G", "B"],
            Self::Normal | Self::Position | Self::LastPosition => &["X", "Y", "Z"],
            Self::Motion => &["X", "Y"],
            Self::Depth => &["Z"],
            Self::Roughness | Self::Holes | Self::Spp | Self::Stripes => &["Y"],
        }
    }
}
