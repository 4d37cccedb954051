//! Polar images of an eye around its gaze.

use glam::DVec2;

use super::PolarSpace;
use super::method::PolarPoint;
use super::view::View;
use crate::image::Extent;
use crate::scene::rig;

/// Gazes are in fractions of an eye's screen.
impl PolarSpace {
    /// Returns an eye's view with its gaze.
    pub(crate) fn look(self, gaze: [f64; 2], view: View, screen: Extent) -> View {
        let [x, y] = gaze;
        let (across, up) = (2.0 * x as f32 - 1.0, 1.0 - 2.0 * y as f32);
        let at = view.forward + view.right * (across * view.tan_half_x) + view.up * (up * view.tan_half_y);
        let towards = at.normalize();
        let right = (view.right - towards * towards.dot(view.right)).normalize();
        let view = View { gaze: towards, gaze_right: right, ..view };
        self.method().look(view, gaze, screen)
    }

    pub(super) fn seen(self, gaze: [f64; 2], view: &rig::View, screen: Extent) -> View {
        let aspect = f64::from(screen.width) / f64::from(screen.height);
        self.look(gaze, View::new(view, aspect), screen)
    }

    /// Returns the number of pixels that an eye's polar image uses, divided by the number of pixels of its screen.
    pub fn share(self, gaze: [f64; 2], view: &rig::View, screen: Extent) -> f64 {
        self.method().pixels(&self.seen(gaze, view, screen), screen) as f64 / screen.area() as f64
    }

    /// Returns the number of traced pixels of an eye's polar image, divided by the number of pixels of its screen.
    pub fn traced_fraction(self, gaze: [f64; 2], view: &rig::View, screen: Extent) -> f64 {
        self.method().traced(&self.seen(gaze, view, screen), screen) as f64 / screen.area() as f64
    }

    /// Returns, for each pixel of an eye's screen in row-major order, its position in the eye's polar image.
    pub fn places(self, gaze: [f64; 2], view: &rig::View, screen: Extent) -> Vec<PolarPoint> {
        let place = self.method().places(self.seen(gaze, view, screen), screen);
        let width = screen.width as usize;
        let centre = |i: usize| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let ray = |at: DVec2| view.ray_direction(at.x, at.y, screen);
        (0..screen.area()).map(centre).map(|at| place(at, ray(at))).collect()
    }
}
