//! A view of a frame that another renderer gives to the denoiser.

use super::{Array, DenoiseError, Settings};
use crate::scene::rig::View;

/// A view whose arrays are on the host, with three values per pixel, row after row from the top left.
pub type Given<'a> = Inputs<&'a [[f32; 3]]>;

/// A view whose arrays are buffers of the denoiser's device, with four `f32` per pixel: see [`Array`].
pub type GivenBuffers<'a> = Inputs<&'a wgpu::Buffer>;

/// A view of a frame: its camera and its arrays.
///
/// A pixel with the normal 0 or a position that is not finite shows no surface. It is not filtered, and so are channels
/// whose albedo is 0, such as those of a black lamp.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<A> {
    /// Camera of the view. Its axes are orthonormal, and pixels are square.
    pub camera: View,
    /// Radiance in linear RGB: all light, emission included. Negative values count as 0.
    pub color: A,
    /// The part of the radiance that the surface or the sky emits. It is not filtered. `None` stands for 0: bright lamps
    /// then blur over their surroundings, unless their albedo is 0.
    pub emission: Option<A>,
    /// Fraction of uniform light that the surface reflects, in linear RGB.
    pub albedo: A,
    /// Shading normal in world space, of any length.
    pub normal: A,
    /// Position in world space, in the unit of the camera's position.
    pub position: A,
    /// Position of the surface in the previous frame, in world space; not finite if the surface is new. `None` stands for
    /// [`Self::position`].
    pub last_position: Option<A>,
}

impl<A> Inputs<A> {
    /// Creates a view whose surfaces emit no light and have not moved since the previous frame.
    pub fn new(camera: View, color: A, albedo: A, normal: A, position: A) -> Self {
        Self { camera, color, albedo, normal, position, emission: None, last_position: None }
    }
}

/// Checks the views of a frame.
pub(super) fn check(settings: &Settings, views: &[Inputs<impl Array>]) -> Result<(), DenoiseError> {
    let given = |text: String| Err(DenoiseError::Given(text));
    if views.len() != settings.views {
        return given(format!("the frame has {} views, not {}", views.len(), settings.views));
    }
    for (number, view) in views.iter().enumerate() {
        if view.last_position.is_some() && !settings.is_animated {
            return given("last_position needs a denoiser of animated scenes".to_owned());
        }
        let last = view.last_position.unwrap_or(view.position);
        let arrays = [
            ("color", view.color, true),
            ("emission", view.emission.unwrap_or(view.color), true),
            ("albedo", view.albedo, true),
            ("normal", view.normal, true),
            ("position", view.position, false),
            ("last_position", last, false),
        ];
        for (name, array, is_finite) in arrays {
            let checked = array.check(settings.extent, is_finite);
            checked.or_else(|wrong| given(format!("{name} of view {number} {wrong}")))?;
        }
        let View { origin, right, up, forward, tan_half_yfov, shift_x } = view.camera;
        let is_finite = [origin, right, up, forward].iter().all(|axis| axis.is_finite());
        if !(is_finite && tan_half_yfov.is_finite() && tan_half_yfov > 0.0 && shift_x.is_finite()) {
            return given(format!("the camera of view {number} has values that are not finite, or no field of view"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Extent;
    use glam::Vec3;

    const CAMERA: View = View {
        origin: Vec3::ZERO,
        right: Vec3::X,
        up: Vec3::Y,
        forward: Vec3::NEG_Z,
        tan_half_yfov: 1.0,
        shift_x: 0.0,
    };

    #[test]
    fn rejects_frames_that_do_not_fit_their_settings() {
        let settings = Settings { views: 1, ..Settings::new(Extent::new(2, 1)) };
        let (one, two, holes) = ([[1.0; 3]], [[1.0; 3]; 2], [[1.0; 3], [0.0, f32::NAN, f32::INFINITY]]);
        let view = Given::new(CAMERA, &two, &two, &two, &two);
        let animated = Settings { is_animated: true, ..settings.clone() };
        let text = |settings: &Settings, views: &[Given<'_>]| match check(settings, views) {
            Err(DenoiseError::Given(text)) => text,
            other => format!("{other:?}"),
        };
        assert_eq!(text(&settings, &[view]), "Ok(())");
        assert_eq!(text(&settings, &[Given { position: &holes, ..view }]), "Ok(())");
        assert_eq!(text(&settings, &[view, view]), "the frame has 2 views, not 1");
        let small = Given { normal: &one, ..view };
        assert_eq!(text(&settings, &[small]), "normal of view 0 has 1 pixels, which are not 2x1");
        let broken = Given { color: &holes, ..view };
        assert_eq!(text(&settings, &[broken]), "color of view 0 has 2 values that are not finite");
        let moved = Given { last_position: Some(&holes), ..view };
        assert_eq!(text(&animated, &[moved]), "Ok(())");
        assert!(text(&settings, &[moved]).starts_with("last_position needs"));
        let blind = Given { camera: View { tan_half_yfov: f32::NAN, ..CAMERA }, ..view };
        assert!(text(&settings, &[blind]).contains("no field of view"));
    }
}
