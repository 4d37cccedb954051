//! Kinds of auxiliary images.

/// An auxiliary image (AOV): a property of the surface at the pixel's centre, or of how the pixel was rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum), value(rename_all = "snake_case"))]
#[repr(u32)]
pub enum Aov {
    /// Albedo that demodulates radiance, linear RGB
    Albedo,
    /// Shading normal towards the eye, world space
    Normal,
    /// Position, world space, scene units
    Position,
    /// Position of the surface in the previous frame, world space, scene units
    LastPosition,
    /// Distance along the ray, scene units; 0 for the sky
    Depth,
    /// Motion vector to the previous frame, pixels
    Motion,
    /// Perceptual roughness, 0 to 1
    Roughness,
    /// Hole reason, 1 to 6; 0 if none; 7 if left to the denoiser
    Holes,
    /// Samples per pixel; 0 if left to the denoiser
    Spp,
    /// Index of the device that finished the pixel
    Stripes,
    /// Base colour, linear RGB; 0 without a surface
    BaseColor,
    /// Albedo of the Lambertian lobe, linear RGB
    DiffuseAlbedo,
    /// Directional albedo of all microfacet lobes, linear RGB
    SpecularAlbedo,
    /// Position of the surface that mirrors and clear glass show, world space, scene units
    ShownPosition,
    /// Shading normal of that surface, world space
    ShownNormal,
    /// Position of its image, on the pixel's ray, world space, scene units; approximate in curved mirrors and lenses
    VirtualPosition,
}

impl Aov {
    /// Returns true if the image holds small integers, for which a false-colour picture of both eyes is useful.
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
            Self::ShownPosition => "shown_position",
            Self::ShownNormal => "shown_normal",
            Self::VirtualPosition => "virtual_position",
        }
    }

    /// Returns the names of the channels in use.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Albedo | Self::BaseColor | Self::DiffuseAlbedo | Self::SpecularAlbedo => &["R", "G", "B"],
            Self::Normal
            | Self::Position
            | Self::LastPosition
            | Self::ShownPosition
            | Self::ShownNormal
            | Self::VirtualPosition => &["X", "Y", "Z"],
            Self::Motion => &["X", "Y"],
            Self::Depth => &["Z"],
            Self::Roughness | Self::Holes | Self::Spp | Self::Stripes => &["Y"],
        }
    }
}
