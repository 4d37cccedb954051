//! Image errors.

use numpy::PyReadonlyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{self, Pixels};
use super::failure::exception;
use crate::report::intervals::positive_interval;
use diptych::image::{Extent, Image};
use diptych::metrics::{MEASURES, Pair};

type Array<'py> = PyReadonlyArrayDyn<'py, f32>;

fn pair(py: Python<'_>, reference: &Array<'_>, image: &Array<'_>, exposure_ev: f32) -> PyResult<(Extent, Pair)> {
    let (reference, image) = (arrays::image(reference)?, arrays::image(image)?);
    let pair = py.detach(|| Pair::new(&reference, &image, exposure_ev)).map_err(exception)?;
    Ok((image.extent, pair))
}

/// Errors of an image against a reference, by their names; `None` where an error is undefined.
#[pyfunction]
pub fn errors(
    py: Python<'_>,
    reference: Array<'_>,
    image: Array<'_>,
    exposure_ev: f32,
) -> PyResult<Vec<(&'static str, Option<f64>)>> {
    let (_, pair) = pair(py, &reference, &image, exposure_ev)?;
    let values = py.detach(|| pair.errors().values());
    Ok(MEASURES.iter().map(|(name, _)| *name).zip(values).collect())
}

/// Ends of the 95 % interval of the geometric mean of a few positive values; `None` if it is unknown.
#[pyfunction]
pub fn interval(values: Vec<f64>) -> Option<[f64; 2]> {
    positive_interval(values)
}

/// FLIP of each pixel, float32 of the shape (height, width, 1).
#[pyfunction]
pub fn flip_map(py: Python<'_>, reference: Array<'_>, image: Array<'_>, exposure_ev: f32) -> PyResult<Pixels<f32>> {
    let (extent, pair) = pair(py, &reference, &image, exposure_ev)?;
    arrays::of_image(py, Image { extent, pixels: pair.flip().iter().map(|flip| [*flip as f32]).collect() })
}
