//! The extension module of the Python package `diptych`, with the feature `python`. `docs/guide/python.md` describes
//! the package, and `python/diptych` has the part that is written in Python.
//!
//! Options have the names and the defaults of the command line, since [`options`] parses them with the same parser.

mod arrays;
mod control;
mod denoiser;
mod exclusive;
mod failure;
mod frame;
mod metrics;
mod options;
mod player;
mod policy;
mod reference;
mod renderer;
mod scene;
mod shot;
mod trace;

use pyo3::prelude::*;

use crate::console::keep_devices;

/// The module `diptych._native`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    keep_devices();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<renderer::Renderer>()?;
    module.add_class::<frame::Frame>()?;
    module.add_class::<player::Player>()?;
    module.add_class::<denoiser::FrameDenoiser>()?;
    module.add_function(wrap_pyfunction!(scene::load, module)?)?;
    module.add_function(wrap_pyfunction!(reference::reference, module)?)?;
    module.add_function(wrap_pyfunction!(metrics::errors, module)?)?;
    module.add_function(wrap_pyfunction!(metrics::flip_map, module)?)?;
    module.add_function(wrap_pyfunction!(metrics::interval, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::write_exr, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::read_exr, module)?)?;
    module.add_function(wrap_pyfunction!(trace::read_trace, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::show_in_tev, module)?)?;
    Ok(())
}
