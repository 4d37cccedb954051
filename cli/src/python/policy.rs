//! Policies written in Python.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use diptych::graph::{Assignment, Partition, Stripes, Work};
use diptych::schedule::{CostModel, Policy};

/// A Python function that distributes the rows of frames, and the rows of the next frame. It takes the predicted costs
/// and the number of rows, and returns the number of rows of each device.
///
/// [`Self::ask`] calls it before a frame begins, so that its exceptions surface before devices have work.
pub struct Function {
    function: Py<PyAny>,
    next: Mutex<Next>,
}

/// The rows of the next frame.
struct Next {
    /// Numbers of the devices that have not failed.
    devices: Vec<usize>,
    stripes: Stripes,
}

impl Function {
    /// Makes a policy of a function.
    ///
    /// # Errors
    /// `TypeError` if the object cannot be called.
    pub fn new(function: Bound<'_, PyAny>) -> PyResult<Arc<Self>> {
        if !function.is_callable() {
            let what = format!("policy is a function stripes(costs, rows), not {}", function.repr()?);
            return Err(PyTypeError::new_err(what));
        }
        let next = Mutex::new(Next { devices: vec![0], stripes: Stripes::even(0, 1) });
        Ok(Arc::new(Self { function: function.unbind(), next }))
    }

    /// Returns the policy of a renderer of images with this number of rows. Rows are distributed evenly until
    /// [`Self::ask`] is called.
    pub fn policy(self: &Arc<Self>, rows: u32, devices: usize) -> Box<dyn Policy> {
        *self.next() = Next { devices: (0..devices).collect(), stripes: Stripes::even(rows, devices) };
        Box::new(Asked(Arc::clone(self)))
    }

    fn next(&self) -> MutexGuard<'_, Next> {
        self.next.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks the function for the rows of the next frame. Returns the time in milliseconds that this took.
    ///
    /// # Errors
    /// Errors of the function, `TypeError` if it returns no numbers, `ValueError` if these are not the rows of the
    /// devices.
    pub fn ask(&self, model: &CostModel) -> PyResult<f64> {
        let begin = Instant::now();
        let (devices, rows) = {
            let next = self.next();
            (next.devices.clone(), next.stripes.height())
        };
        let costs = costs(&model.of_devices(&devices), rows);
        let stripes = Python::attach(|py| {
            let costs = PyArray1::from_vec(py, costs).reshape([devices.len(), rows as usize])?;
            stripes(&self.function.bind(py).call1((costs, rows))?, devices.len(), rows)
        })?;
        self.next().stripes = stripes;
        Ok(begin.elapsed().as_secs_f64() * 1e3)
    }
}

/// Predicts the time in milliseconds of each row of both eyes on each device, all rows of the first device first. Before
/// the model has learned from a frame, all rows cost the same.
fn costs(model: &CostModel, rows: u32) -> Vec<f64> {
    let devices = model.devices();
    if !model.has_learned() {
        return vec![1.0; devices * rows as usize];
    }
    let program = model.program();
    // Every device does the whole work of such passes.
    let is_repeated = |group: &Partition| {
        program.passes().iter().any(|linked| linked.pass.partition == *group && linked.pass.work == Work::Once)
    };
    let sets = program.partition_sets().iter().flatten();
    let groups: Vec<Partition> = sets.copied().filter(|group| !is_repeated(group)).collect();
    let stripes = model.stripes_of(&groups);
    let by_row: Vec<Vec<f64>> = (0..rows).map(|row| stripes.own_ms(&(row..row + 1))).collect();
    (0..devices).flat_map(|device| by_row.iter().map(move |costs| costs[device])).collect()
}

/// Makes stripes of the rows that a function has returned.
fn stripes(returned: &Bound<'_, PyAny>, devices: usize, height: u32) -> PyResult<Stripes> {
    let no_numbers = || {
        let what = format!("the policy returned {}, not the number of rows of each device", returned.repr()?);
        Err(PyTypeError::new_err(what))
    };
    let Ok(items) = returned.try_iter() else { return no_numbers() };
    let mut rows: Vec<i64> = Vec::new();
    for item in items {
        match item?.extract() {
            Ok(count) => rows.push(count),
            Err(_) => return no_numbers(),
        }
    }
    if rows.len() != devices {
        let what = format!("the policy returned rows for {} devices, but {devices} render the frame", rows.len());
        return Err(PyValueError::new_err(what));
    }
    let mut edges = Vec::new();
    let mut edge = 0u32;
    for &count in &rows {
        let below = u32::try_from(count).ok().and_then(|count| edge.checked_add(count));
        let Some(below) = below.filter(|below| *below <= height) else { break };
        edge = below;
        edges.push(edge);
    }
    if edges.len() != devices || edge != height {
        let what = format!("the policy returned the rows {rows:?}, which are not at least 0 each and {height} in all");
        return Err(PyValueError::new_err(what));
    }
    Ok(Stripes::from_edges(height, &edges[..devices - 1]))
}

/// The policy of a renderer, which gives frames the rows for which a function was asked.
struct Asked(Arc<Function>);

impl Policy for Asked {
    fn name(&self) -> &'static str {
        "python"
    }

    fn assign(&mut self, _model: &CostModel) -> Assignment {
        Assignment::uniform(self.0.next().stripes.clone())
    }

    /// Distributes the rows evenly over the other devices until the function is asked again.
    fn remove_device(&mut self, device: usize) {
        let mut next = self.0.next();
        next.devices.remove(device);
        next.stripes = Stripes::even(next.stripes.height(), next.devices.len());
    }
}
