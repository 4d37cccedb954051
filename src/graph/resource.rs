//! What stages leave for one another, a row-major image per view each.

/// A resource as the graph sees it. `Filtered(i)` is the radiance after i filter passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Resource {
    /// Triangle, barycentrics, material and flags behind a pixel's centre.
    Hit,
    /// Position and packed shading normal.
    Guide,
    /// Albedo and roughness; where gloss is filtered apart, also the matte part of albedo.
    Albedo,
    /// Emitted radiance and depth.
    Emission,
    /// Reflected light over albedo; where gloss is filtered apart, matte light and gloss, each over its own.
    Radiance,
    Filtered(u8),
    /// Of the light accumulated over frames: mean and variance, how much of it there is, material.
    Moments,
    /// Accumulated light after the filter's first iteration.
    History,
    /// Antialiased over frames, scene-referred RGB.
    Resolved,
    /// What the frame before left of these.
    LastGuide,
    LastMoments,
    LastHistory,
    LastResolved,
    /// Rays, dropped samples and hole reason, packed.
    Tally,
    /// Pixels to trace; lives and dies on its device.
    Holes,
    /// `Tally`, summed by rows.
    RowTally,
    /// Scene-referred RGB.
    Linear,
    /// Encoded RGBA8.
    Display,
    /// The i-th auxiliary image asked for.
    Aov(u8),
}

/// The buffer a resource lives in. Filter passes alternate between two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PhysicalImage {
    Hit,
    Guide,
    Albedo,
    Emission,
    Radiance,
    Ping,
    Pong,
    Moments,
    History,
    Resolved,
    LastGuide,
    LastMoments,
    LastHistory,
    LastResolved,
    Tally,
    Holes,
    RowTally,
    Linear,
    Display,
    Aov(u8),
}

impl Resource {
    /// What the next frame knows this as, if it is kept for it.
    pub fn next_frames(self) -> Option<Self> {
        match self {
            Self::Guide => Some(Self::LastGuide),
            Self::Moments => Some(Self::LastMoments),
            Self::History => Some(Self::LastHistory),
            Self::Resolved => Some(Self::LastResolved),
            _ => None,
        }
    }

    pub fn physical(self) -> PhysicalImage {
        match self {
            Self::Hit => PhysicalImage::Hit,
            Self::Guide => PhysicalImage::Guide,
            Self::Albedo => PhysicalImage::Albedo,
            Self::Emission => PhysicalImage::Emission,
            Self::Radiance => PhysicalImage::Radiance,
            Self::Filtered(0) => PhysicalImage::Radiance,
            Self::Filtered(i) if i % 2 == 1 => PhysicalImage::Ping,
            Self::Filtered(_) => PhysicalImage::Pong,
            Self::Moments => PhysicalImage::Moments,
            Self::History => PhysicalImage::History,
            Self::Resolved => PhysicalImage::Resolved,
            Self::LastResolved => PhysicalImage::LastResolved,
            Self::LastGuide => PhysicalImage::LastGuide,
            Self::LastMoments => PhysicalImage::LastMoments,
            Self::LastHistory => PhysicalImage::LastHistory,
            Self::Tally => PhysicalImage::Tally,
            Self::Holes => PhysicalImage::Holes,
            Self::RowTally => PhysicalImage::RowTally,
            Self::Linear => PhysicalImage::Linear,
            Self::Display => PhysicalImage::Display,
            Self::Aov(i) => PhysicalImage::Aov(i),
        }
    }
}

impl PhysicalImage {
    /// Bytes of one row of an image `width` pixels wide.
    pub fn row_bytes(self, width: u32) -> u64 {
        let per_pixel = match self {
            Self::Tally | Self::Display | Self::Holes => 4,
            Self::RowTally => return 36,
            _ => 16,
        };
        per_pixel * u64::from(width)
    }

    /// Whether it leaves the frame. Frames in flight have such images each for itself; all others they follow one
    /// another in.
    pub fn is_output(self) -> bool {
        matches!(self, Self::RowTally | Self::Linear | Self::Display | Self::Aov(_))
    }

    /// Bytes before the first row.
    pub fn header_bytes(self) -> u64 {
        if self == Self::Holes { 16 } else { 0 }
    }
}
