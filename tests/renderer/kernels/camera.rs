//! Frame constants for kernels without a scene, and the pinhole camera.

use diptych::layout::{self, Camera, Display, Frame, History, Previous, Sampling, View};
use diptych::samples::PixelSamples;
use glam::{DQuat, DVec2, DVec3, Vec2, Vec3, Vec4};

/// A pinhole. Its numbers are f32, as on the device; derived values are computed in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    pub origin: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    pub tan_half: Vec2,
}

impl Eye {
    /// Creates a pinhole that looks along -z.
    pub fn at_origin(tan_half: Vec2) -> Self {
        Self { origin: Vec3::ZERO, right: Vec3::X, up: Vec3::Y, forward: -Vec3::Z, tan_half }
    }

    /// Returns the eye moved, and rotated about its own axes.
    pub fn moved(&self, way: DVec3, yaw: f64, pitch: f64) -> Self {
        let (up, right) = (self.up.as_dvec3().normalize(), self.right.as_dvec3().normalize());
        let turn = DQuat::from_axis_angle(up, yaw) * DQuat::from_axis_angle(right, pitch);
        let turned = |axis: Vec3| (turn * axis.as_dvec3()).as_vec3();
        Self {
            origin: (self.origin.as_dvec3() + way).as_vec3(),
            right: turned(self.right),
            up: turned(self.up),
            forward: turned(self.forward),
            tan_half: self.tan_half,
        }
    }

    /// Returns the unit direction through an image point, in pixels from the top left corner.
    pub fn ray(&self, at: DVec2, size: DVec2) -> DVec3 {
        let x = (2.0 * at.x / size.x - 1.0) * f64::from(self.tan_half.x);
        let y = (1.0 - 2.0 * at.y / size.y) * f64::from(self.tan_half.y);
        (self.forward.as_dvec3() + self.right.as_dvec3() * x + self.up.as_dvec3() * y).normalize()
    }

    /// Returns the image point of `p`, and its distance along the view direction; none behind the eye.
    pub fn seen_at(&self, p: DVec3, size: DVec2) -> Option<(DVec2, f64)> {
        let v = p - self.origin.as_dvec3();
        let z = v.dot(self.forward.as_dvec3());
        let x = v.dot(self.right.as_dvec3()) / (z * f64::from(self.tan_half.x));
        let y = v.dot(self.up.as_dvec3()) / (z * f64::from(self.tan_half.y));
        (z > 0.0).then(|| (DVec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y) * size, z))
    }

    pub fn view(&self) -> View {
        View {
            origin: self.origin,
            tan_half_x: self.tan_half.x,
            right: self.right,
            tan_half_y: self.tan_half.y,
            up: self.up,
            forward: self.forward,
            ..View::default()
        }
    }
}

/// Factor from radiance to stored light, a power of two. It is far from the tests' exposures, so that kernels that take
/// one for the other fail, and so do filters that apply it to light that they read or write.
pub const STORAGE_SCALE: f32 = 4.0;

/// Constants of a frame.
#[derive(Clone, Debug)]
pub struct Constants {
    pub eyes: [Eye; 2],
    pub width: u32,
    pub height: u32,
    /// Frame number.
    pub index: u32,
    pub spp: u32,
    pub exposure: f32,
    /// Maximum vertical motion of history in rows; none without history.
    pub history_rows: Option<u32>,
    pub centre: Vec2,
    pub foveation: Foveation,
}

/// Constants of the sampling mask and of the layers' filter iterations.
#[derive(Clone, Debug)]
pub struct Foveation {
    /// True if there are layers; the kernel gets an override constant for that.
    pub layers: bool,
    pub mask_turn: u32,
    pub radii: Vec2,
    pub gaze: [Vec2; 2],
    pub layer_iterations: [u32; 3],
    pub unsampled_fraction: f32,
    pub sampled_fraction: f32,
}

impl Constants {
    pub fn new(width: u32, height: u32) -> Self {
        let middle = Vec2::new(width as f32, height as f32) * 0.5;
        // All parameters of the eyes differ, so that a mix-up of the two is noticed.
        let left = Eye::at_origin(Vec2::new(0.55, 0.5)).moved(DVec3::new(-0.1, 0.2, 0.3), 0.15, -0.1);
        let right = Eye::at_origin(Vec2::new(0.53, 0.52)).moved(DVec3::new(0.25, 0.19, 0.33), 0.16, -0.09);
        Self {
            eyes: [left, right],
            width,
            height,
            index: 0,
            spp: 1,
            exposure: 1.0,
            history_rows: None,
            centre: Vec2::splat(0.5),
            foveation: Foveation {
                layers: false,
                mask_turn: 0,
                radii: Vec2::new(0.2, 0.4) * width as f32,
                gaze: [middle + Vec2::new(-2.3, 1.2), middle + Vec2::new(1.4, -0.7)],
                layer_iterations: [5; 3],
                unsampled_fraction: 0.5,
                sampled_fraction: 1.0,
            },
        }
    }

    pub fn size(&self) -> DVec2 {
        DVec2::new(self.width.into(), self.height.into())
    }

    pub fn area(&self) -> usize {
        (self.width * self.height) as usize
    }

    pub fn index(&self, x: u32, y: u32) -> usize {
        (y * self.width + x) as usize
    }

    /// Returns the image point through which a pixel's ray goes.
    pub fn through(&self, x: u32, y: u32) -> DVec2 {
        DVec2::new(x.into(), y.into()) + self.centre.as_dvec2()
    }

    /// Returns the pixel at an offset from (x, y), if it is within the image's columns and within `rows`.
    pub fn tap(&self, (x, y): (u32, u32), (dx, dy): (i32, i32), rows: &std::ops::Range<u32>) -> Option<usize> {
        let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
        (x < self.width && rows.contains(&y)).then(|| self.index(x, y))
    }

    /// Returns the constants of this frame as the next frame's previous ones.
    pub fn as_previous(&self) -> [Previous; 1] {
        [Previous::from(&self.frame())]
    }

    /// Returns the contents of the uniform buffer of group 0.
    pub fn frame(&self) -> Frame {
        let Foveation { mask_turn, radii, gaze, layer_iterations, unsampled_fraction, sampled_fraction, .. } =
            self.foveation;
        Frame {
            camera: Camera {
                views: self.eyes.map(|eye| eye.view()),
                centre: self.centre,
                width: self.width,
                height: self.height,
                ..Default::default()
            },
            sampling: Sampling {
                index: self.index,
                samples: PixelSamples { least: self.spp, ..Default::default() },
                mask_turn,
                sampled_fraction,
                ..Default::default()
            },
            foveation: layout::Foveation {
                gaze: Vec4::new(gaze[0].x, gaze[0].y, gaze[1].x, gaze[1].y),
                layer_iterations: layer_iterations.into(),
                unsampled_fraction,
                radii,
                ..Default::default()
            },
            history: History::new(self.history_rows, 0..0),
            display: Display { exposure: self.exposure, storage_scale: STORAGE_SCALE, ..Default::default() },
            ..Frame::default()
        }
    }
}
