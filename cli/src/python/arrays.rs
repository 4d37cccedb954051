//! Images as NumPy arrays.

use std::path::{Path, PathBuf};

use numpy::{PyArray1, PyArray3, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::failure::exception;
use crate::tev::Viewer;
use diptych::image::exr::Tags;
use diptych::image::{Extent, Image, ImageError, RgbImage, exr};

/// An array of the shape (height, width, channels).
pub type Pixels<T> = Py<PyArray3<T>>;

/// Makes an array of the values, whose memory it takes over. `channels` is the number of values of a pixel.
pub fn array<T: numpy::Element>(
    py: Python<'_>,
    extent: Extent,
    channels: usize,
    values: Vec<T>,
) -> PyResult<Pixels<T>> {
    let shape = [extent.height as usize, extent.width as usize, channels];
    Ok(PyArray1::from_vec(py, values).reshape(shape)?.unbind())
}

/// Makes an array of an image, whose memory it takes over.
pub fn of_image<T: numpy::Element, const N: usize>(py: Python<'_>, image: Image<[T; N]>) -> PyResult<Pixels<T>> {
    array(py, image.extent, N, image.pixels.into_flattened())
}

/// Copies an array of the shape (height, width, 3) to an image.
///
/// # Errors
/// `ValueError` if the array has another shape or no pixel.
pub fn image(array: &PyReadonlyArrayDyn<'_, f32>) -> PyResult<RgbImage> {
    let shape = array.shape();
    let side = |pixels: usize| u32::try_from(pixels).ok().filter(|pixels| (1..=16384).contains(pixels));
    let &[height, width, 3] = shape else {
        return Err(PyValueError::new_err(format!("an image has the shape (height, width, 3), not {shape:?}")));
    };
    let (Some(width), Some(height)) = (side(width), side(height)) else {
        return Err(PyValueError::new_err(format!("an image has sides of 1 to 16384 pixels, not {shape:?}")));
    };
    let extent = Extent::new(width, height);
    if let Ok(values) = array.as_slice() {
        return Ok(Image { extent, pixels: values.as_chunks().0.to_vec() });
    }
    let values: Vec<f32> = array.as_array().iter().copied().collect();
    Ok(Image { extent, pixels: values.as_chunks().0.to_vec() })
}

/// The channels of an image, each with its name.
pub struct Planes<'a> {
    extent: Extent,
    channels: Vec<(&'a str, Vec<f32>)>,
}

impl<'a> Planes<'a> {
    /// Copies an array of the shape (height, width, channels), or (height, width) if there is one channel.
    ///
    /// # Errors
    /// `ValueError` if the array has another shape.
    pub fn of(array: &PyReadonlyArrayDyn<'_, f32>, names: &[&'a str]) -> PyResult<Self> {
        let (shape, count) = (array.shape(), names.len());
        let wrong = || PyValueError::new_err(format!("the image has {count} channels, and not the shape {shape:?}"));
        let [height, width] = match *shape {
            [height, width, channels] if channels == count => [height, width],
            [height, width] if count == 1 => [height, width],
            _ => return Err(wrong()),
        };
        let side = |pixels: usize| u32::try_from(pixels).map_err(|_| wrong());
        let extent = Extent::new(side(width)?, side(height)?);
        let plane = |(i, &name): (usize, &&'a str)| {
            (name, array.as_array().iter().skip(i).step_by(count).copied().collect::<Vec<f32>>())
        };
        Ok(Self { extent, channels: names.iter().enumerate().map(plane).collect() })
    }

    /// Writes the channels to an EXR file.
    pub fn write(&self, path: &Path, tags: &Tags) -> Result<(), ImageError> {
        exr::write_tagged_channels(path, self.extent, &self.borrowed(), tags)
    }

    fn borrowed(&self) -> Vec<(&str, &[f32])> {
        self.channels.iter().map(|(name, plane)| (*name, &plane[..])).collect()
    }
}

/// Shows an image of the shape (height, width, channels) in tev.
#[pyfunction]
pub fn show_in_tev(
    py: Python<'_>,
    address: &str,
    name: &str,
    image: PyReadonlyArrayDyn<'_, f32>,
    channels: Vec<String>,
) -> PyResult<()> {
    let names: Vec<&str> = channels.iter().map(String::as_str).collect();
    let planes = Planes::of(&image, &names)?;
    py.detach(|| Viewer::connect(address)?.show(name, planes.extent, &planes.borrowed())).map_err(exception)
}

/// Writes an array of the shape (height, width, 3) to an EXR file.
#[pyfunction]
pub fn write_exr(path: PathBuf, array: PyReadonlyArrayDyn<'_, f32>) -> PyResult<()> {
    exr::write_rgb(&path, &image(&array)?).map_err(exception)
}

/// Reads the channels R, G and B of an EXR file.
#[pyfunction]
pub fn read_exr(py: Python<'_>, path: PathBuf) -> PyResult<Pixels<f32>> {
    of_image(py, exr::read_rgb(&path).map_err(exception)?)
}
