//! Controllers written in Python.

use std::sync::{Arc, Mutex, PoisonError};

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;

use diptych::control::{Budget, Control, Decision, Ladder};

/// Exceptions of callbacks, which surface once the library has returned.
#[derive(Clone, Default)]
pub struct Raised(Arc<Mutex<Option<PyErr>>>);

impl Raised {
    fn keep(&self, error: PyErr) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }

    /// Returns the first exception since the last call.
    pub fn check(&self) -> PyResult<()> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}

/// Checks that an object can be a controller: it has the method `next`.
///
/// # Errors
/// `TypeError` if it has not.
pub fn check(object: &Bound<'_, PyAny>) -> PyResult<()> {
    if object.getattr_opt(intern!(object.py(), "next"))?.is_some_and(|next| next.is_callable()) {
        return Ok(());
    }
    let what = format!("a controller has a method next(predicted_ms), which {} lacks", object.get_type().name()?);
    Err(PyTypeError::new_err(what))
}

/// A Python object that chooses rungs: `next(predicted_ms)` returns the index of one, and the optional
/// `observe(rung, frame_ms)` takes the time of a finished frame.
pub struct Controller {
    object: Py<PyAny>,
    budget: Budget,
    /// Times of the ladder's rungs, for those that the cost model cannot predict.
    times_ms: Vec<f64>,
    raised: Raised,
}

impl Controller {
    /// Makes a controller of an object that [`check`] accepts. Its exceptions go to `raised`.
    pub fn new(object: Py<PyAny>, ladder: &Ladder, budget: Budget, raised: Raised) -> Self {
        let times_ms = ladder.rungs().iter().map(|rung| rung.time_ms).collect();
        Self { object, budget, times_ms, raised }
    }

    fn choose(&self, predicted_ms: &[f64]) -> PyResult<usize> {
        Python::attach(|py| {
            let chosen = self.object.bind(py).call_method1(intern!(py, "next"), (predicted_ms,))?;
            let Ok(rung) = chosen.extract::<i64>() else {
                let what = format!("the controller returned {}, which is not the index of a rung", chosen.repr()?);
                return Err(PyTypeError::new_err(what));
            };
            let last = predicted_ms.len() - 1;
            let out_of_range = || {
                PyValueError::new_err(format!("the controller chose rung {rung}, but the ladder has rungs 0 to {last}"))
            };
            usize::try_from(rung).ok().filter(|rung| *rung <= last).ok_or_else(out_of_range)
        })
    }

    fn tell(&self, rung: usize, makespan_ms: f64) -> PyResult<()> {
        Python::attach(|py| {
            let observe = self.object.bind(py).getattr_opt(intern!(py, "observe"))?;
            observe.map_or(Ok(()), |observe| observe.call1((rung, makespan_ms)).map(drop))
        })
    }
}

impl Control for Controller {
    /// Returns the cheapest rung if the object fails; the caller then finds the exception in [`Raised`].
    fn next(&mut self, predict: &dyn Fn(usize) -> f64) -> Decision {
        let predicted = |(rung, known_ms): (usize, &f64)| {
            let ms = predict(rung);
            if ms.is_finite() && ms > 0.0 { ms } else { *known_ms }
        };
        let predicted_ms: Vec<f64> = self.times_ms.iter().enumerate().map(predicted).collect();
        let rung = self.choose(&predicted_ms).unwrap_or_else(|error| {
            self.raised.keep(error);
            0
        });
        let fits = predicted_ms.iter().any(|ms| *ms <= self.budget.hi_ms());
        Decision { rung, expected_ms: predicted_ms[rung], fits }
    }

    fn observe(&mut self, rung: usize, makespan_ms: f64) {
        if let Err(error) = self.tell(rung, makespan_ms) {
            self.raised.keep(error);
        }
    }

    fn set_budget(&mut self, budget: Budget) {
        self.budget = budget;
    }
}
