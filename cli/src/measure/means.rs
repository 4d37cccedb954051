//! Scenes that `diptych info --check` renders, with the mean luminance of blocks of their images.

/// Columns and rows of blocks.
pub const BLOCKS: [u32; 2] = [4, 2];
/// Largest difference of a block's mean, relative to the image's.
pub const MOST_OFF: f64 = 0.05;

/// A built-in scene.
pub struct Measured {
    pub name: &'static str,
    /// Mean luminance of the left eye's blocks, from left to right and from top to bottom, at 160x90 pixels
    /// and 2,048 samples per pixel.
    pub means: [f64; 8],
}

pub const SCENES: [Measured; 4] = [
    Measured { name: "cornell", means: [0.0, 0.21052, 0.26165, 0.00510, 0.0, 0.04997, 0.05333, 0.00472] },
    Measured { name: "gallery", means: [0.40812, 0.35499, 0.47543, 0.19896, 0.20657, 0.28172, 0.31693, 0.29324] },
    Measured { name: "towers", means: [0.74402, 1.64436, 1.02948, 2.75266, 1.67453, 0.72480, 0.74067, 0.78505] },
    Measured { name: "atrium", means: [0.84164, 0.64220, 0.38424, 0.21147, 1.19972, 0.97748, 0.16688, 0.12445] },
];
