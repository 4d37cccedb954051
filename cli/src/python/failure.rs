//! Conversion of failures to Python exceptions.

use pyo3::PyErr;
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError, PyValueError};

use crate::failure::Failure;

/// Converts a failure to an exception with the text of the command line: `ValueError` for invalid input, `RuntimeError`
/// for a failure of the run.
pub fn exception(failure: impl Into<Failure>) -> PyErr {
    let failure = failure.into();
    match failure {
        Failure::Input(_) => PyValueError::new_err(failure.line()),
        Failure::Run(_) => PyRuntimeError::new_err(failure.line()),
        Failure::Interrupted => PyKeyboardInterrupt::new_err(()),
    }
}
