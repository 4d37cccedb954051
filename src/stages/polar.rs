//! Polar images: traced and filtered around the gaze, and mapped to the screen at the end. Rows are rings around the
//! gaze, columns are directions from it. The density of rings follows visual acuity in visual-polar images, and falls
//! with the distance from the gaze in log-polar ones.

mod log;
mod place;
mod visual;

use super::layout::{self, View};
use crate::image::Extent;
use crate::quality::PolarSpace;
use crate::scene::rig::{self, Eye};
use crate::scene::shot::Gaze;

pub use place::PolarPoint;

/// Polar projection around a gaze that may move with every frame.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Polar {
    /// Gaze of the left and the right eye.
    pub gaze: [Gaze; 2],
    pub space: PolarSpace,
}

impl PolarSpace {
    /// Returns the size of the polar images for a screen of this size.
    pub fn grid(&self, screen: Extent) -> Extent {
        match self {
            Self::Visual => visual::grid(screen),
            Self::Log(map) => log::grid(&log::constants(map, screen)),
        }
    }

    /// Returns the shader constants of log-polar images for a screen of this size; all 0 for visual-polar ones.
    pub(crate) fn constants(&self, screen: Extent) -> layout::LogPolar {
        match self {
            Self::Visual => layout::LogPolar::default(),
            Self::Log(map) => log::constants(map, screen),
        }
    }

    /// Returns the number of pixels that an eye's polar image uses. The other pixels of [`Self::grid`] are unused.
    pub(super) fn pixels(&self, view: &View, screen: Extent) -> u64 {
        match self {
            Self::Visual => visual::pixels(view, visual::grid(screen)),
            Self::Log(map) => log::pixels(&log::constants(map, screen), view),
        }
    }
}

impl Polar {
    /// Returns the size of the polar images for a screen of this size.
    pub fn grid(&self, screen: Extent) -> Extent {
        self.space.grid(screen)
    }

    /// Returns an eye's view with its gaze at `time_s`.
    pub(crate) fn look(&self, eye: usize, time_s: f64, view: View, screen: Extent) -> View {
        self.look_at(self.gaze[eye].at(time_s), view, screen)
    }

    /// Returns an eye's view with this gaze, in fractions of its screen.
    pub(crate) fn look_at(&self, gaze: [f64; 2], view: View, screen: Extent) -> View {
        let [x, y] = gaze;
        let (across, up) = (2.0 * x as f32 - 1.0, 1.0 - 2.0 * y as f32);
        let at = view.forward + view.right * (across * view.tan_half_x) + view.up * (up * view.tan_half_y);
        let towards = at.normalize();
        let right = (view.right - towards * towards.dot(view.right)).normalize();
        let view = View { gaze: towards, gaze_right: right, ..view };
        match &self.space {
            PolarSpace::Visual => visual::look(view, visual::grid(screen).height),
            PolarSpace::Log(map) => log::look(&log::constants(map, screen), view, gaze),
        }
    }

    fn seen(&self, eye: Eye, time_s: f64, view: &rig::View, screen: Extent) -> View {
        let aspect = f64::from(screen.width) / f64::from(screen.height);
        self.look(eye as usize, time_s, View::new(view, aspect), screen)
    }

    /// Returns the number of pixels that an eye's polar image uses, divided by the number of pixels of its screen.
    pub fn share(&self, eye: Eye, time_s: f64, view: &rig::View, screen: Extent) -> f64 {
        self.space.pixels(&self.seen(eye, time_s, view, screen), screen) as f64 / screen.area() as f64
    }

    /// Returns the number of traced pixels of an eye's polar image, divided by the number of pixels of its screen.
    pub fn traced_fraction(&self, eye: Eye, time_s: f64, view: &rig::View, screen: Extent) -> f64 {
        let seen = self.seen(eye, time_s, view, screen);
        let pixels = match &self.space {
            PolarSpace::Visual => self.space.pixels(&seen, screen),
            PolarSpace::Log(map) => log::traced(&log::constants(map, screen), &seen),
        };
        pixels as f64 / screen.area() as f64
    }

    /// Returns, for each pixel of an eye's screen in row-major order, its position in the eye's polar image.
    pub fn places(&self, eye: Eye, time_s: f64, view: &rig::View, screen: Extent) -> Vec<PolarPoint> {
        let seen = self.seen(eye, time_s, view, screen);
        let width = screen.width as usize;
        let centre = |i: usize| [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
        match &self.space {
            PolarSpace::Visual => {
                let place = visual::place_of(&seen, screen);
                (0..screen.area()).map(|i| place(view.ray_direction(centre(i)[0], centre(i)[1], screen))).collect()
            }
            PolarSpace::Log(map) => {
                let constants = log::constants(map, screen);
                (0..screen.area()).map(|i| log::place(&constants, &seen, centre(i).into())).collect()
            }
        }
    }
}
