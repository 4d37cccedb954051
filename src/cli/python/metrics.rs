//! Image errors.

use numpy::PyReadonlyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{self, Pixels};
use super::failure::exception;
use crate::image::Image;
use crate::metrics::{MEASURES, Pair};

/// Errors of an image against a reference, by their names; `None` where an error is undefined.
#[pyfunction]
#[pyo3(signature = (reference, image, exposure_ev=0.0))]
pub fn errors(
    py: Python<'_>,
    reference: PyReadonlyArrayDyn<'_, f32>,
    image: PyReadonlyArrayDyn<'_, f32>,
    exposure_ev: f32,
) -> PyResult<Vec<(&'static str, Option<f64>)>> {
    let (reference, image) = (arrays::image(&reference)?, arrays::image(&image)?);
    let values = py.detach(|| Ok(Pair::new(&reference, &image, exposure_ev)?.errors().values()));
    let values = values.map_err(|error: crate::image::ImageError| exception(error))?;
    Ok(MEASURES.iter().map(|(name, _)| *name).zip(values).collect())
}

/// FLIP of each pixel, float32 of the shape (height, width, 1).
#[pyfunction]
#[pyo3(signature = (reference, image, exposure_ev=0.0))]
pub fn flip_map(
    py: Python<'_>,
    reference: PyReadonlyArrayDyn<'_, f32>,
    image: PyReadonlyArrayDyn<'_, f32>,
    exposure_ev: f32,
) -> PyResult<Pixels<f32>> {
    let (reference, image) = (arrays::image(&reference)?, arrays::image(&image)?);
    let extent = image.extent;
    let map =
        py.detach(|| Ok(Pair::new(&reference, &image, exposure_ev)?.flip().iter().map(|v| [*v as f32]).collect()));
    arrays::of_image(py, Image { extent, pixels: map.map_err(|error: crate::image::ImageError| exception(error))? })
}
