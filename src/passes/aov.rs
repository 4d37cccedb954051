//! Auxiliary images.

use super::PREVIOUS_VIEWS;
use super::gbuffer::{ALBEDO, EMISSION, HIT, TALLY};
use super::tonemap::CUT;
use crate::graph::{Kernel, Pass, Resource, Stage, Use};
use crate::scene::rig::Eye;

/// The auxiliary images' own time is told from that of the frame by this.
pub const STAGE: Stage = Stage("aov");

/// The `index`th auxiliary image of a frame.
pub const fn image(index: u8) -> Resource {
    Resource::image("aov", 16).output().numbered(index)
}

/// The kinds that the shader tells apart by name.
const KERNEL: Kernel = Kernel::with_scene("aov").with(&[
    ("ALBEDO", Aov::Albedo as u32),
    ("NORMAL", Aov::Normal as u32),
    ("POSITION", Aov::Position as u32),
    ("DEPTH", Aov::Depth as u32),
    ("ROUGHNESS", Aov::Roughness as u32),
    ("HOLES", Aov::Holes as u32),
    ("SPP", Aov::Spp as u32),
    ("STRIPES", Aov::Stripes as u32),
    ("BASE_COLOR", Aov::BaseColor as u32),
    ("DIFFUSE_ALBEDO", Aov::DiffuseAlbedo as u32),
]);

pub fn pass(view: Eye, index: u8, aov: Aov) -> Pass {
    Pass::new(STAGE, view, CUT, KERNEL)
        .index(index.into())
        .uses([
            Use::read(HIT),
            Use::read(ALBEDO),
            Use::read(EMISSION),
            Use::read(TALLY),
            Use::write(image(index)),
            Use::read(PREVIOUS_VIEWS),
        ])
        .args([aov as u32, 0, 0])
}

/// An auxiliary image: the surface behind the pixel's centre, or how the pixel was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
#[repr(u32)]
pub enum Aov {
    /// What radiance is divided by before it is filtered: the share of even light from all around that the surface
    /// sends to the eye, by all its lobes, linear RGB; the mean over the pixel where it has several samples.
    Albedo,
    /// Shading normal, world space, towards the eye.
    Normal,
    /// World space, scene units.
    Position,
    /// Distance along the ray, scene units; 0 for the sky.
    Depth,
    /// Where the surface was in the previous frame minus where it is, pixels.
    Motion,
    /// Perceptual, 0 to 1.
    Roughness,
    /// Why a pixel of the right eye was traced: 0: it was reprojected, or there is no surface; 1: outside the left
    /// image; 2, 3, 4: the left eye saw a surface turned another way, at another depth, of another material; 5: several
    /// surfaces share it, antialiasing; 6: mirror, glass or gloss. 7, of either eye: left to the filter.
    Holes,
    /// Samples per pixel; 0 where it was left to the filter.
    Spp,
    /// Index of the device that finished the pixel.
    Stripes,
    /// Linear RGB: factor, texture and vertex colour, of unlit materials as well; 0 where there is no surface.
    BaseColor,
    /// Albedo of the Lambertian lobe, linear RGB: what of the base colour neither metal nor transmission takes; not yet
    /// dimmed by the layers above.
    DiffuseAlbedo,
    /// Share of even light from all around that is reflected to the eye by microfacets, the coat's included, linear RGB.
    SpecularAlbedo,
}

impl Aov {
    /// Whether it is one number, small and whole, for which a picture of both eyes is of use.
    pub fn counts(self) -> bool {
        matches!(self, Self::Holes | Self::Spp | Self::Stripes)
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Position => "position",
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

    /// Channels that carry something.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Albedo | Self::BaseColor | Self::DiffuseAlbedo | Self::SpecularAlbedo => &["R", "G", "B"],
            Self::Normal | Self::Position => &["X", "Y", "Z"],
            Self::Motion => &["X", "Y"],
            Self::Depth => &["Z"],
            Self::Roughness | Self::Holes | Self::Spp | Self::Stripes => &["Y"],
        }
    }
}
