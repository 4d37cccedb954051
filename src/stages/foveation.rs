//! Foveation by three layers around the gaze, as the frame's constants say it to shaders.

use glam::{Vec2, Vec4};

use super::layout;
use crate::image::Extent;
use crate::scene::shot::Gaze;

/// Sampling and filtering that follow the gaze (Peres, sections 4.2 and 4.4). The gaze may move with every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Foveation {
    /// Of the left and the right eye.
    pub gaze: [Gaze; 2],
    /// Where the inner and the middle layer end, as fractions of the image's width; they rise. A frame may have others.
    pub radii: [f64; 2],
    /// Share of the outer layer's pixels that are not sampled, 0 to 1; it falls to 0 towards the inner layer.
    pub unsampled_share: f64,
    /// Filter iterations that pixels of the inner, middle and outer layer take part in: those with the smallest steps.
    /// A frame may have others.
    pub iterations: [u32; 3],
}

impl Foveation {
    /// Of Peres, section 5.1.
    pub const RADII: [f64; 2] = [0.15, 0.30];

    /// Radii and share of Peres, sections 4.2 and 5.1.
    pub fn new(gaze: [Gaze; 2], iterations: [u32; 3]) -> Self {
        Self { gaze, radii: Self::RADII, unsampled_share: 0.5, iterations }
    }

    /// Radii and gaze of an eye at `time_s` in an image of this size, pixels.
    pub fn circles(&self, eye: usize, time_s: f64, width: u32, height: u32) -> ([f64; 2], [f64; 2]) {
        self.circles_of(self.radii, eye, time_s, width, height)
    }

    /// ... with the radii of a frame.
    pub fn circles_of(
        &self,
        radii: [f64; 2],
        eye: usize,
        time_s: f64,
        width: u32,
        height: u32,
    ) -> ([f64; 2], [f64; 2]) {
        let [x, y] = self.gaze[eye].at(time_s);
        (radii.map(|r| r * f64::from(width)), [x * f64::from(width), y * f64::from(height)])
    }

    /// The constants of a frame of so many pixels, but for the iterations. Without radii all of it is the inner layer.
    pub(crate) fn describe(&self, extent: Extent, time_s: f64, radii: Option<[f64; 2]>) -> layout::Foveation {
        let radii = radii.unwrap_or(EVERYWHERE);
        let circles = |eye| self.circles_of(radii, eye, time_s, extent.width, extent.height);
        let [(radii, left), (_, right)] = [0, 1].map(circles);
        layout::Foveation {
            gaze: Vec4::from([left[0], left[1], right[0], right[1]].map(|c| c as f32)),
            unsampled_share: self.unsampled_share as f32,
            radii: Vec2::from(radii.map(|r| r as f32)),
            ..Default::default()
        }
    }
}

/// Radii beyond any image.
const EVERYWHERE: [f64; 2] = [1e6, 2e6];
