//! What is shown is what was computed.

use crate::common::{Stage, Subject};
use diptych::exec::RenderSettings;
use diptych::image::display::tonemap;
use diptych::scene::rig::Eye;

/// The devices' encoding against the host's, in f64; rounding may move a value by one level.
#[test]
fn the_display_image_is_the_tonemapped_linear_image() {
    let subject = Subject::load("builtin:cornell");
    let settings = RenderSettings { exposure_ev: -0.7, ..subject.denoised(96, 54) };
    let mut stage = Stage::alone(&subject, &settings);
    let frame = stage.frame(0);
    let display = stage.display();
    for eye in Eye::ALL {
        let (linear, shown) = match eye {
            Eye::Left => (&frame.linear.left, &display.left),
            Eye::Right => (&frame.linear.right, &display.right),
        };
        let expected = tonemap(linear, -0.7);
        assert!(expected.pixels.iter().any(|p| p[0] > 200) && expected.pixels.iter().any(|p| p[0] == 0));
        for (i, (e, s)) in expected.pixels.iter().zip(&shown.pixels).enumerate() {
            let apart = (0..3).map(|c| e[c].abs_diff(s[c])).max();
            assert!(apart <= Some(1), "{eye} eye, pixel {i}: {s:?} instead of {e:?}");
        }
    }
}
