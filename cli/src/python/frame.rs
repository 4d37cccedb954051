//! Frames: images as arrays, and the row of `run.json`.

use std::path::PathBuf;
use std::time::Instant;

use numpy::{PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyKeyError, PyValueError};
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
use diptych::image::{Extent, RgbImage, sheet};
use diptych::passes::Aov;
use diptych::scene::rig::Rig;
use diptych::scene::shot::Shot;

/// A rendered frame. Its arrays keep their values when further frames are rendered.
#[pyclass(frozen, module = "diptych")]
pub struct Frame {
    /// Views from left to right, scene-referred linear RGB, float32 of the shape (height, width, 3).
    #[pyo3(get)]
    views: Vec<Pixels<f32>>,
    /// Exposure of pictures, in stops.
    #[pyo3(get)]
    exposure_ev: f32,
    /// Time in milliseconds that the library took to render and read the frame.
    #[pyo3(get)]
    library_ms: f64,
    tone: ToneCurve,
    aovs: Vec<(Aov, Vec<Pixels<f32>>)>,
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
    /// Metadata of the views' files.
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
        let of_views = |(aov, values): (Aov, PerView<Values>)| {
            Ok((aov, values.into_iter().map(|values| array(aov, values)).collect::<PyResult<_>>()?))
        };
        let aovs: PyResult<_> = images.aovs.into_iter().map(of_views).collect();
        let views: PyResult<_> = images.linear.into_iter().map(|image| arrays::of_image(py, image)).collect();
        let Look { exposure_ev, tone } = look;
        Ok(Self { views: views?, exposure_ev, library_ms, tone, aovs: aovs?, tags: images.tags, report })
    }

    /// Returns the views' pictures with 8 bits per channel.
    fn pictures(&self, py: Python<'_>) -> PyResult<Vec<DisplayImage>> {
        let picture = |view: &Pixels<f32>| -> PyResult<DisplayImage> {
            let image = arrays::image(&view.bind(py).to_dyn().try_readonly()?)?;
            Ok(py.detach(|| tonemap(&image, self.exposure_ev, self.tone)))
        };
        self.views.iter().map(picture).collect()
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

    /// Auxiliary image of each view, float32 of the shape (height, width, channels).
    fn aov(&self, py: Python<'_>, name: &str) -> PyResult<Vec<Pixels<f32>>> {
        let (_, views) = self.find(name)?;
        Ok(views.iter().map(|view| view.clone_ref(py)).collect())
    }

    /// Picture of each view, tonemapped, uint8 of the shape (height, width, 3).
    fn display(&self, py: Python<'_>) -> PyResult<Vec<Pixels<u8>>> {
        self.pictures(py)?.into_iter().map(|picture| arrays::of_image(py, picture)).collect()
    }

    /// All views in one picture, as a PNG file.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let pictures = self.pictures(py)?;
        let png = py.detach(|| -> Result<Vec<u8>, Failure> {
            let mut bytes = Vec::new();
            encode_png(&sheet::of_views(&pictures)?, &mut bytes).map_err(anyhow::Error::from)?;
            Ok(bytes)
        });
        Ok(PyBytes::new(py, &png.map_err(exception)?))
    }

    /// Writes an image of a view, whose index is from 0 at the left, as EXR, with the metadata of the frame. `name` is that
    /// of an auxiliary image or `disparity`; without it, the image is light.
    #[pyo3(signature = (path, view, image, name=None))]
    fn write_exr(
        &self,
        py: Python<'_>,
        path: PathBuf,
        view: usize,
        image: PyReadonlyArrayDyn<'_, f32>,
        name: Option<&str>,
    ) -> PyResult<()> {
        let channels: &[&str] = match name {
            None => &["R", "G", "B"],
            Some("disparity") => &["Y"],
            Some(name) => self.find(name)?.0.channels(),
        };
        let no_view = || PyIndexError::new_err(format!("the frame has no view {view}"));
        let tags = self.tags.values().get(view).ok_or_else(no_view)?;
        let tags = match name {
            None => Tags { pixel_centre: None, ..tags.clone() },
            Some(_) => Tags { exposure_ev: None, ..tags.clone() },
        };
        let planes = Planes::of(&image, channels)?;
        py.detach(|| planes.write(&path, &tags).map_err(exception))
    }

    /// Returns the frame with other light of the same size.
    fn with_light(&self, py: Python<'_>, views: Vec<PyReadonlyArrayDyn<'_, f32>>) -> PyResult<Self> {
        let extent = self.extent(py);
        let images: Vec<RgbImage> = views.iter().map(arrays::image).collect::<PyResult<_>>()?;
        if images.len() != self.views.len() || images.iter().any(|image| image.extent != extent) {
            let what = format!("there must be {} images of {extent}, one for each view", self.views.len());
            return Err(PyValueError::new_err(what));
        }
        let views: PyResult<_> = images.into_iter().map(|image| arrays::of_image(py, image)).collect();
        let shared = |views: &Vec<Pixels<f32>>| views.iter().map(|view| view.clone_ref(py)).collect();
        let aovs = self.aovs.iter().map(|(aov, views)| (*aov, shared(views))).collect();
        let (tags, report) = (self.tags.clone(), self.report.clone());
        Ok(Self { views: views?, aovs, tags, report, ..*self })
    }

    /// Width and height of each view's image in pixels.
    #[getter]
    fn size(&self, py: Python<'_>) -> (usize, usize) {
        let Extent { width, height } = self.extent(py);
        (width as usize, height as usize)
    }
}

impl Frame {
    fn find(&self, name: &str) -> PyResult<&(Aov, Vec<Pixels<f32>>)> {
        self.aovs.iter().find(|(aov, _)| aov.name() == name).ok_or_else(|| {
            let rendered = self.aovs().join(", ");
            let rendered = if rendered.is_empty() { "none" } else { &rendered };
            let what = format!("the frame has no auxiliary image '{name}', but {rendered}: give aov to the renderer");
            PyKeyError::new_err(what)
        })
    }

    fn extent(&self, py: Python<'_>) -> Extent {
        let shape = self.views[0].bind(py).shape();
        Extent::new(shape[1] as u32, shape[0] as u32)
    }
}
