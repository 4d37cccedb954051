//! The denoiser alone, for frames of any renderer.

use glam::Vec3;
use numpy::PyReadonlyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{self, Pixels, image};
use super::exclusive::Exclusive;
use super::failure::exception;
use crate::console;
use crate::environment::let_devices_set_environment;
use diptych::denoise::{FrameDenoiser as Inner, Given, Settings};
use diptych::device::Selection;
use diptych::image::{Extent, RgbImage};
use diptych::scene::rig::View;

/// Denoises frames of any renderer, and keeps their history.
#[pyclass(frozen, module = "diptych")]
pub struct FrameDenoiser {
    inner: Exclusive<Inner>,
}

type Array<'py> = PyReadonlyArrayDyn<'py, f32>;

/// A view of a frame: color, albedo, normal, position; emission and last position; then the camera's position, right, up
/// and forward axes, and the tangent of half its vertical field of view.
type GivenView<'py> = ([Array<'py>; 4], [Option<Array<'py>>; 2], [[f32; 3]; 4], f32);

/// A copy of a view that Python code cannot change.
struct Copied {
    camera: View,
    arrays: [RgbImage; 4],
    emission: Option<RgbImage>,
    last_position: Option<RgbImage>,
}

impl Copied {
    fn of((given, optional, axes, tan_half_yfov): &GivenView<'_>) -> PyResult<Self> {
        let [color, albedo, normal, position] = given;
        let arrays = [image(color)?, image(albedo)?, image(normal)?, image(position)?];
        let [emission, last] = optional;
        let [origin, right, up, forward] = axes.map(Vec3::from);
        let camera = View { origin, right, up, forward, tan_half_yfov: *tan_half_yfov, shift_x: 0.0 };
        let optional = |array: &Option<Array<'_>>| array.as_ref().map(image).transpose();
        Ok(Self { camera, arrays, emission: optional(emission)?, last_position: optional(last)? })
    }

    fn given(&self) -> Given<'_> {
        let [color, albedo, normal, position] = self.arrays.each_ref().map(|array| &array.pixels[..]);
        let [emission, last_position] =
            [&self.emission, &self.last_position].map(|array| array.as_ref().map(|array| &array.pixels[..]));
        Given { emission, last_position, ..Given::new(self.camera, color, albedo, normal, position) }
    }
}

#[pymethods]
impl FrameDenoiser {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn new(
        py: Python<'_>,
        width: u32,
        height: u32,
        views: usize,
        iterations: u32,
        spp: u32,
        animated: bool,
        exposure_ev: f32,
        adapter: Option<usize>,
    ) -> PyResult<Self> {
        // SAFETY: as for `Renderer`, the interpreter's lock keeps other Python code from accessing the environment.
        unsafe { let_devices_set_environment() };
        let extent = Extent::new(width, height);
        let settings = Settings { extent, views, iterations, spp, is_animated: animated, exposure_ev };
        let adapters = adapter.map(|number| vec![number]);
        let selection = Selection { adapters, pool: console::devices(), ..Selection::default() };
        let gpus = settings.check().map_err(exception).and_then(|()| Inner::open(&selection).map_err(exception))?;
        let inner = py.detach(|| Inner::on(gpus, &settings)).map_err(exception)?;
        Ok(Self { inner: Exclusive::new(inner) })
    }

    /// Denoises the views of a frame, the left one first; returns an array for each.
    fn denoise(&self, py: Python<'_>, views: Vec<GivenView<'_>>) -> PyResult<Vec<Pixels<f32>>> {
        let copied: Vec<Copied> = views.iter().map(Copied::of).collect::<PyResult<_>>()?;
        let denoised = py.detach(|| {
            let given: Vec<Given<'_>> = copied.iter().map(Copied::given).collect();
            self.inner.lock().map_err(exception)?.denoise(&given).map_err(exception)
        })?;
        denoised.into_iter().map(|image| arrays::of_image(py, image)).collect()
    }

    /// Discards the history.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| self.inner.lock().map(|mut inner| inner.reset())).map_err(exception)
    }
}
