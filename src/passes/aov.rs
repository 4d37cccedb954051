//! Kinds of auxiliary images.

/// Declares [`Aov`] with the names and descriptions of its variants.
macro_rules! aovs {
    ($(#[doc = $help:literal] $variant:ident = $name:literal,)+) => {
        /// An auxiliary image (AOV): a property of the surface at the pixel's centre, or of how the pixel was rendered.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
        #[serde(rename_all = "snake_case")]
        #[repr(u32)]
        pub enum Aov {
            $(#[doc = $help] $variant,)+
        }

        impl Aov {
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];

            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }

            pub fn help(self) -> &'static str {
                match self {
                    $(Self::$variant => $help.trim_ascii(),)+
                }
            }
        }
    };
}

aovs! {
    /// Albedo that demodulates radiance, linear RGB
    Albedo = "albedo",
    /// Shading normal towards the eye, world space
    Normal = "normal",
    /// Position, world space, scene units
    Position = "position",
    /// Position of the surface in the previous frame, world space, scene units
    LastPosition = "last_position",
    /// Distance along the ray, scene units; 0 for the sky
    Depth = "depth",
    /// Motion vector to the previous frame, pixels
    Motion = "motion",
    /// Perceptual roughness, 0 to 1
    Roughness = "roughness",
    /// Hole reason, 1 to 6; 0 if none; 7 if left to the denoiser
    Holes = "holes",
    /// Samples per pixel; 0 if left to the denoiser
    Spp = "spp",
    /// Index of the device that finished the pixel
    Stripes = "stripes",
    /// Base colour, linear RGB; 0 without a surface
    BaseColor = "base_color",
    /// Albedo of the Lambertian lobe, linear RGB
    DiffuseAlbedo = "diffuse_albedo",
    /// Directional albedo of all microfacet lobes, linear RGB
    SpecularAlbedo = "specular_albedo",
    /// Position of the surface that mirrors and clear glass show, world space, scene units
    ShownPosition = "shown_position",
    /// Shading normal of that surface, world space
    ShownNormal = "shown_normal",
    /// Position of its image, on the pixel's ray, world space, scene units; approximate in curved mirrors and lenses
    VirtualPosition = "virtual_position",
    /// Light that is not denoised, linear RGB: emission, and direct light with hard shadows
    Emission = "emission",
    /// Frames that the denoiser accumulated: 1 without history, 0 without light
    History = "history",
}

impl Aov {
    /// Returns true if the image holds small integers, for which a false-colour picture of both eyes is useful.
    pub fn counts(self) -> bool {
        matches!(self, Self::Holes | Self::Spp | Self::Stripes | Self::History)
    }

    /// Returns the names of the channels in use.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Albedo | Self::BaseColor | Self::DiffuseAlbedo | Self::SpecularAlbedo | Self::Emission => {
                &["R", "G", "B"]
            }
            Self::Normal
            | Self::Position
            | Self::LastPosition
            | Self::ShownPosition
            | Self::ShownNormal
            | Self::VirtualPosition => &["X", "Y", "Z"],
            Self::Motion => &["X", "Y"],
            Self::Depth => &["Z"],
            Self::Roughness | Self::Holes | Self::Spp | Self::Stripes | Self::History => &["Y"],
        }
    }
}
