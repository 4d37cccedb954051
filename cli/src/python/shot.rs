//! Shots given as dicts: converted to TOML, so that keys, defaults, checks and error messages are those of files.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyString};
use toml::{Table, Value};

/// Maximum depth of a dict. Shots have three levels; a dict that contains itself has no end.
const MOST_LEVELS: usize = 16;

/// Returns the TOML of a shot.
///
/// # Errors
/// `TypeError` for a key that is no string or a value that TOML cannot store, `ValueError` for a dict that is nested too
/// deeply.
pub fn text(shot: &Bound<'_, PyDict>) -> PyResult<String> {
    toml::to_string(&table(shot, "", 0)?).map_err(|error| PyValueError::new_err(error.to_string()))
}

/// Converts a dict. `None` leaves a key out. `place` is the dict's key for messages.
fn table(dict: &Bound<'_, PyDict>, place: &str, level: usize) -> PyResult<Table> {
    let mut table = Table::new();
    for (key, item) in dict.iter() {
        let Ok(key) = key.extract::<String>() else {
            return Err(PyTypeError::new_err(format!("the key {} of a shot is no string", key.repr()?)));
        };
        if !item.is_none() {
            let place = if place.is_empty() { key.clone() } else { format!("{place}.{key}") };
            table.insert(key, value(&item, &place, level + 1)?);
        }
    }
    Ok(table)
}

fn value(item: &Bound<'_, PyAny>, place: &str, level: usize) -> PyResult<Value> {
    if level > MOST_LEVELS {
        return Err(PyValueError::new_err(format!("the shot is nested too deeply at '{place}'")));
    }
    let wrong = || PyTypeError::new_err(format!("the value of '{place}' in the shot has the type {}", item.get_type()));
    if let Ok(dict) = item.cast::<PyDict>() {
        return Ok(Value::Table(table(dict, place, level)?));
    }
    if let Ok(truth) = item.cast::<PyBool>() {
        return Ok(Value::Boolean(truth.is_true()));
    }
    if let Ok(text) = item.cast::<PyString>() {
        return Ok(Value::String(text.to_cow()?.into_owned()));
    }
    if item.hasattr("__fspath__")? {
        return Ok(Value::String(item.call_method0("__fspath__")?.extract().map_err(|_| wrong())?));
    }
    if let Ok(items) = item.try_iter() {
        let items = items.map(|item| value(&item?, place, level + 1));
        return Ok(Value::Array(items.collect::<PyResult<_>>()?));
    }
    let whole = item.extract::<i64>().map(Value::Integer);
    whole.or_else(|_| item.extract::<f64>().map(Value::Float)).map_err(|_| wrong())
}
