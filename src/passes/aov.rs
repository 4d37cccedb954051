//! Kinds of auxiliary images.

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
