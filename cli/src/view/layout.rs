//! Layout of the eyes' images in the window.

use diptych::image::Extent;

/// Gap between the eyes side by side, pixels.
const GAP: f64 = 4.0;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layout {
    #[default]
    SideBySide,
    Anaglyph,
    Left,
    Right,
}

/// Image that a part of the window shows. The discriminant of an eye is its layer in the texture array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shows {
    Left = 0,
    Right = 1,
    Anaglyph = 2,
}

/// Part of the window that shows an image; the position of its top left corner is in window pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    pub shows: Shows,
    pub x: f64,
    pub y: f64,
    /// Window pixels per image pixel.
    pub scale: f64,
    pub eye: Extent,
}

impl Layout {
    pub fn next(self) -> Self {
        match self {
            Self::SideBySide => Self::Anaglyph,
            Self::Anaglyph => Self::Left,
            Self::Left => Self::Right,
            Self::Right => Self::SideBySide,
        }
    }

    /// Returns where each image of this layout is drawn in a window of this size in pixels. The images are centred and
    /// as large as possible. `eye` is the size of an eye's image.
    pub fn placements(self, [width, height]: [u32; 2], eye: Extent) -> Vec<Placement> {
        let (shows, gap): (&[Shows], f64) = match self {
            Self::SideBySide => (&[Shows::Left, Shows::Right], GAP),
            Self::Anaglyph => (&[Shows::Anaglyph], 0.0),
            Self::Left => (&[Shows::Left], 0.0),
            Self::Right => (&[Shows::Right], 0.0),
        };
        let (width, height) = (f64::from(width), f64::from(height));
        let columns = shows.len() as f64 * f64::from(eye.width);
        let scale = ((width - gap).max(1.0) / columns).min(height / f64::from(eye.height));
        let [shown_width, shown_height] = [eye.width, eye.height].map(|n| (scale * f64::from(n)).floor());
        let x = ((width - columns * scale - gap) / 2.0).floor().max(0.0);
        let y = ((height - shown_height) / 2.0).floor();
        let at = |(i, shows): (usize, &Shows)| Placement {
            shows: *shows,
            x: x + i as f64 * (shown_width + gap),
            y,
            scale,
            eye,
        };
        shows.iter().enumerate().map(at).collect()
    }
}

impl Placement {
    pub fn width(&self) -> f64 {
        (self.scale * f64::from(self.eye.width)).floor()
    }

    pub fn height(&self) -> f64 {
        (self.scale * f64::from(self.eye.height)).floor()
    }

    /// Maps a point of the window into the image, as fractions from the top left; `None` outside.
    pub fn within(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let at = [(x - self.x) / self.width(), (y - self.y) / self.height()];
        at.iter().all(|c| (0.0..=1.0).contains(c)).then_some(at)
    }

    /// Returns the index of the eye whose foveal layers are drawn on this part: the left one for an anaglyph.
    pub fn eye_index(&self) -> usize {
        usize::from(self.shows == Shows::Right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EYE: Extent = Extent::new(160, 90);

    #[test]
    fn images_keep_their_shape_in_any_window() {
        for layout in [Layout::SideBySide, Layout::Anaglyph, Layout::Left, Layout::Right] {
            for window in [[1284, 360], [324, 90], [300, 900], [2000, 50], [7, 5], [1, 1]] {
                let [width, height] = window.map(f64::from);
                let all = layout.placements(window, EYE);
                assert_eq!(all.len(), if layout == Layout::SideBySide { 2 } else { 1 });
                for p in &all {
                    assert!(p.x >= 0.0 && p.y >= 0.0, "{layout:?} {window:?}: {p:?}");
                    assert!(
                        p.y + p.height() <= height && (width < 8.0 || p.x + p.width() <= width),
                        "{window:?}: {p:?}"
                    );
                }
                assert!(all.windows(2).all(|pair| pair[0].x + pair[0].width() < pair[1].x));
            }
        }
        let [left, right] = Layout::SideBySide.placements([324, 90], EYE)[..] else { panic!() };
        assert_eq!((left.x, left.scale, right.x, left.y), (0.0, 1.0, 164.0, 0.0));
    }

    #[test]
    fn gaze_follows_the_mouse_in_its_eye() {
        let [left, right] = Layout::SideBySide.placements([648, 400], EYE)[..] else { panic!() };
        assert_eq!((left.y, left.height()), (109.0, 181.0_f64.floor()));
        assert_eq!(right.within([right.x, right.y]), Some([0.0, 0.0]));
        assert_eq!(right.within([right.x + right.width() / 2.0, right.y + right.height()]), Some([0.5, 1.0]));
        assert_eq!(left.within([right.x, right.y]), None);
        assert_eq!(left.within([10.0, 5.0]), None);
    }

    #[test]
    fn layouts_cycle_back_to_the_first() {
        let mut layout = Layout::default();
        for _ in 0..4 {
            layout = layout.next();
        }
        assert_eq!(layout, Layout::default());
    }
}
