//! Frames: images as arrays, and the row of `run.json`.

use std::path::PathBuf;
use std::time::Instant;

use numpy::{PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use super::arrays::{self, Pixels, Planes};
use super::failure::exception;
use crate::failure::Failure;
use crate::output;
use crate::report::run::FrameRow;
use diptych::exec::{ExecError, FrameReport, PerView, Renderer};
use diptych::image::display::{DisplayImage, encode_png, tonemap};
use diptych::image::exr::Tags;
use diptych::image::tone::ToneCurve;
use diptych::image::{Extent, RgbImage, stereo};
use diptych::passes::Aov;
use diptych::scene::rig::Rig;
use diptych::scene::shot::Shot;

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
    tags: PerView<Tags>,
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
    pub linear: PerView<RgbImage>,
    pub aovs: Vec<(Aov, PerView<Values>)>,
    /// Metadata of both eyes' files.
    pub tags: PerView<Tags>,
}

impl Images {
    /// Reads the images of the last frame.
    pub fn read(renderer: &mut Renderer, aovs: &[Aov], tags: PerView<Tags>) -> Result<Self, ExecError> {
        let linear = renderer.read_linear()?;
        let read = |(i, &aov): (usize, &Aov)| Ok((aov, renderer.read_aov_pixels(i)?));
        let aovs: Result<_, ExecError> = aovs.iter().enumerate().map(read).collect();
        Ok(Self { linear, aovs: aovs?, tags })
    }
}

impl Frame {
    /// Makes a frame of images that were rendered since `begin`. `report` is in JSON.
    pub fn new(py: Python<'_>, images: Images, look: Look, report: String, begin: Instant) -> PyResult<Self> {
        let library_ms = begin.elapsed().as_secs_f64() * 1e3;
        let extent = images.linear.left().extent;
        let array = |aov: Aov, values: Values| arrays::array(py, extent, aov.channels().len(), values);
        let eyes = |(aov, values): (Aov, PerView<Values>)| {
            let [left, right] = values.into_outer();
            Ok((aov, [array(aov, left)?, array(aov, right)?]))
        };
        let aovs: PyResult<_> = images.aovs.into_iter().map(eyes).collect();
        let [left, right] = arrays::of_stereo(py, images.linear)?;
        let Look { exposure_ev, tone } = look;
        Ok(Self { left, right, exposure_ev, library_ms, tone, aovs: aovs?, tags: images.tags, report })
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

/// Returns the metadata of a frame's files.
pub fn tags(rig: &Rig, look: Look, frame: &FrameReport, extent: Extent, time_s: f64) -> PerView<Tags> {
    let tags = |tags: Tags| Tags { pixel_centre: Some(frame.pixel_centre), ..tags };
    output::tags(rig, look.exposure_ev, extent, time_s, frame.index).map(tags)
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

    /// Names of the channels of an auxiliary image.
    fn channels(&self, name: &str) -> PyResult<Vec<&'static str>> {
        Ok(self.find(name)?.0.channels().to_vec())
    }

    /// Auxiliary image of the left and the right eye, float32 of the shape (height, width, channels).
    fn aov(&self, py: Python<'_>, name: &str) -> PyResult<[Pixels<f32>; 2]> {
        let (_, eyes) = self.find(name)?;
        Ok(eyes.each_ref().map(|eye| eye.clone_ref(py)))
    }

    /// Pictures of the left and the right eye, tonemapped, uint8 of the shape (height, width, 3).
    fn display(&self, py: Python<'_>) -> PyResult<[Pixels<u8>; 2]> {
        let [left, right] = self.pictures(py)?;
        arrays::of_stereo(py, PerView::both(left, right))
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

    /// Writes an image of the left (0) or the right (1) eye as EXR, with the metadata of the frame. `name` is that of an
    /// auxiliary image or `disparity`; without it, the image is light.
    #[pyo3(signature = (path, eye, image, name=None))]
    fn write_exr(
        &self,
        py: Python<'_>,
        path: PathBuf,
        eye: usize,
        image: PyReadonlyArrayDyn<'_, f32>,
        name: Option<&str>,
    ) -> PyResult<()> {
        let channels: &[&str] = match name {
            None => &["R", "G", "B"],
            Some("disparity") => &["Y"],
            Some(name) => self.find(name)?.0.channels(),
        };
        let tags = if eye == 0 { self.tags.left() } else { self.tags.right() };
        let tags = match name {
            None => Tags { pixel_centre: None, ..tags.clone() },
            Some(_) => Tags { exposure_ev: None, ..tags.clone() },
        };
        let planes = Planes::of(&image, channels)?;
        py.detach(|| planes.write(&path, &tags).map_err(exception))
    }

    /// Returns the frame with other light of the same size.
    fn with_light(
        &self,
        py: Python<'_>,
        left: PyReadonlyArrayDyn<'_, f32>,
        right: PyReadonlyArrayDyn<'_, f32>,
    ) -> PyResult<Self> {
        let (left, right) = (arrays::image(&left)?, arrays::image(&right)?);
        let extent = self.extent(py);
        if [left.extent, right.extent] != [extent; 2] {
            let what = format!("the eyes' images are {} and {}, not {extent}", left.extent, right.extent);
            return Err(PyValueError::new_err(what));
        }
        let [left, right] = arrays::of_stereo(py, PerView::both(left, right))?;
        let aovs = self.aovs.iter().map(|(aov, eyes)| (*aov, eyes.each_ref().map(|eye| eye.clone_ref(py)))).collect();
        let (tags, report) = (self.tags.clone(), self.report.clone());
        Ok(Self { left, right, aovs, tags, report, ..*self })
    }

    /// Width and height of each eye's image in pixels.
    #[getter]
    fn size(&self, py: Python<'_>) -> (usize, usize) {
        let Extent { width, height } = self.extent(py);
        (width as usize, height as usize)
    }
}

impl Frame {
    fn find(&self, name: &str) -> PyResult<&(Aov, [Pixels<f32>; 2])> {
        self.aovs.iter().find(|(aov, _)| aov.name() == name).ok_or_else(|| {
            let rendered = self.aovs().join(", ");
            let rendered = if rendered.is_empty() { "none" } else { &rendered };
            let what = format!("the frame has no auxiliary image '{name}', but {rendered}: give aov to the renderer");
            PyKeyError::new_err(what)
        })
    }

    fn extent(&self, py: Python<'_>) -> Extent {
        let shape = self.left.bind(py).shape();
        Extent::new(shape[1] as u32, shape[0] as u32)
    }
}
