//! Frames: images as arrays, and the row of `run.json`.

use std::time::Instant;

use numpy::{PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use super::arrays::{self, Pixels};
use super::failure::exception;
use crate::cli::failure::Failure;
use crate::exec::{ExecError, Renderer, Stereo};
use crate::image::display::{DisplayImage, encode_png, tonemap};
use crate::image::tone::ToneCurve;
use crate::image::{Extent, RgbImage, stereo};
use crate::passes::Aov;
use crate::report::run::FrameRow;
use crate::scene::shot::Shot;

/// A rendered frame. Its arrays keep their values when further frames are rendered.
#[pyclass(frozen, module = "diptych")]
pub struct Frame {
    /// Left eye, scene-referred linear RGB, float32 of the shape (height, width, 3).
    #[pyo3(get)]
    left: Pixels<f32>,
    /// Right eye.
    #[pyo3(get)]
    right: Pixels<f32>,
    /// Exposure of pictures, in stops.
    #[pyo3(get)]
    exposure_ev: f32,
    /// Time in milliseconds that the library took to render and read the frame.
    #[pyo3(get)]
    library_ms: f64,
    tone: ToneCurve,
    aovs: Vec<(Aov, [Pixels<f32>; 2])>,
    /// Entry of `run.json` in JSON.
    report: String,
}

/// Exposure and tone curve of pictures.
#[derive(Clone, Copy)]
pub struct Look {
    pub exposure_ev: f32,
    pub tone: ToneCurve,
}

impl Look {
    /// Returns the look of a shot's pictures.
    pub fn of(shot: &Shot) -> Self {
        Self { exposure_ev: shot.exposure_ev, tone: shot.tone }
    }
}

/// Values of an auxiliary image: all channels of a pixel, then the next pixel.
type Values = Vec<f32>;

/// Images of a frame in host memory, before they become arrays.
pub struct Images {
    pub linear: Stereo<RgbImage>,
    pub aovs: Vec<(Aov, Stereo<Values>)>,
}

impl Images {
    /// Reads the images of the last frame.
    pub fn read(renderer: &mut Renderer, aovs: &[Aov]) -> Result<Self, ExecError> {
        let linear = renderer.read_linear()?;
        let read = |(i, &aov): (usize, &Aov)| {
            let planes = renderer.read_aov(i)?;
            Ok((aov, Stereo { left: interleaved(&planes.left), right: interleaved(&planes.right) }))
        };
        let aovs: Result<_, ExecError> = aovs.iter().enumerate().map(read).collect();
        Ok(Self { linear, aovs: aovs? })
    }
}

fn interleaved(planes: &[Vec<f32>]) -> Values {
    let pixels = planes.first().map_or(0, Vec::len);
    (0..pixels).flat_map(|pixel| planes.iter().map(move |plane| plane[pixel])).collect()
}

impl Frame {
    /// Makes a frame of images that were rendered since `begin`. `report` is in JSON.
    pub fn new(py: Python<'_>, images: Images, look: Look, report: String, begin: Instant) -> PyResult<Self> {
        let library_ms = begin.elapsed().as_secs_f64() * 1e3;
        let extent = images.linear.left.extent;
        let array = |aov: Aov, values: Values| arrays::array(py, extent, aov.channels().len(), values);
        let eyes =
            |(aov, values): (Aov, Stereo<Values>)| Ok((aov, [array(aov, values.left)?, array(aov, values.right)?]));
        let aovs: PyResult<_> = images.aovs.into_iter().map(eyes).collect();
        let [left, right] = arrays::of_stereo(py, images.linear)?;
        let Look { exposure_ev, tone } = look;
        Ok(Self { left, right, exposure_ev, library_ms, tone, aovs: aovs?, report })
    }

    /// Returns both eyes' pictures with 8 bits per channel.
    fn pictures(&self, py: Python<'_>) -> PyResult<[DisplayImage; 2]> {
        let picture = |eye: &Pixels<f32>| -> PyResult<DisplayImage> {
            let image = arrays::image(&eye.bind(py).to_dyn().try_readonly()?)?;
            Ok(py.detach(|| tonemap(&image, self.exposure_ev, self.tone)))
        };
        Ok([picture(&self.left)?, picture(&self.right)?])
    }
}

/// Serializes a row of `run.json`.
pub fn report(row: &FrameRow) -> Result<String, Failure> {
    Ok(serde_json::to_string(row).map_err(anyhow::Error::from)?)
}

#[pymethods]
impl Frame {
    /// Entry of the frame in run.json, in JSON.
    #[getter]
    fn report_json(&self) -> &str {
        &self.report
    }

    /// Names of the auxiliary images (AOVs).
    #[getter]
    fn aovs(&self) -> Vec<&'static str> {
        self.aovs.iter().map(|(aov, _)| aov.name()).collect()
    }

    /// Auxiliary image of the left and the right eye, float32 of the shape (height, width, channels).
    fn aov(&self, py: Python<'_>, name: &str) -> PyResult<[Pixels<f32>; 2]> {
        let found = self.aovs.iter().find(|(aov, _)| aov.name() == name);
        let Some((_, eyes)) = found else {
            let rendered = self.aovs().join(", ");
            let rendered = if rendered.is_empty() { "none" } else { &rendered };
            let what = format!("the frame has no auxiliary image '{name}', but {rendered}: give aov to the renderer");
            return Err(PyKeyError::new_err(what));
        };
        Ok(eyes.each_ref().map(|eye| eye.clone_ref(py)))
    }

    /// Pictures of the left and the right eye, tonemapped, uint8 of the shape (height, width, 3).
    fn display(&self, py: Python<'_>) -> PyResult<[Pixels<u8>; 2]> {
        let [left, right] = self.pictures(py)?;
        arrays::of_stereo(py, Stereo { left, right })
    }

    /// Both eyes side by side, as a PNG file.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let [left, right] = self.pictures(py)?;
        let png = py.detach(|| -> Result<Vec<u8>, Failure> {
            let both = stereo::side_by_side(&left, &right)?;
            let mut bytes = Vec::new();
            encode_png(&both, &mut bytes).map_err(anyhow::Error::from)?;
            Ok(bytes)
        });
        Ok(PyBytes::new(py, &png.map_err(exception)?))
    }

    /// Width and height of each eye's image in pixels.
    #[getter]
    fn size(&self, py: Python<'_>) -> (usize, usize) {
        let Extent { width, height } = self.extent(py);
        (width as usize, height as usize)
    }
}

impl Frame {
    fn extent(&self, py: Python<'_>) -> Extent {
        let shape = self.left.bind(py).shape();
        Extent::new(shape[1] as u32, shape[0] as u32)
    }
}
