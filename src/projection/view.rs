//! The struct of an eye's view, which projections and shaders share.

use glam::Vec3;

use crate::scene::rig;
use crate::wgsl::shared_structs;

shared_structs! {
    /// An eye: a pinhole camera, and its gaze if its image is polar. Axes have unit length.
    pub struct View {
        /// Position relative to the origin of the scene's tables, scene units.
        pub origin: Vec3,
        /// Tangent of half the horizontal field of view.
        pub tan_half_x: f32,
        pub right: Vec3,
        /// Tangent of half the vertical field of view.
        pub tan_half_y: f32,
        pub up: Vec3,
        /// Number of rows of a polar image. The first `fovea_rows` of them belong to the fovea (visual-polar) or to the
        /// square of pixels around the gaze (log-polar; 0 without a square).
        pub rows: f32,
        pub forward: Vec3,
        pub fovea_rows: f32,
        /// Direction of the gaze. `gaze_right` is perpendicular to it, and points from the gaze towards column 0 of a
        /// polar image.
        pub gaze: Vec3,
        /// Position of the gaze on the screen, pixels; only set for log-polar images.
        pub gaze_x: f32,
        pub gaze_right: Vec3,
        pub gaze_y: f32,
        /// Tangent of the angle by which the middle of an off-axis image is to the right of `forward`.
        pub shift_x: f32,
        pub pad0: u32,
        pub pad1: u32,
        pub pad2: u32,
    }
}

impl View {
    pub fn new(view: &rig::View, aspect: f64) -> Self {
        Self {
            origin: view.origin,
            tan_half_x: (f64::from(view.tan_half_yfov) * aspect) as f32,
            right: view.right,
            tan_half_y: view.tan_half_yfov,
            up: view.up,
            forward: view.forward,
            shift_x: view.shift_x,
            ..Self::default()
        }
    }
}
