//! Results of an experiment: one row per scene, camera motion and arrangement, as table, CSV and JSON.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use super::definition::{Arrangement, Camera, CitedRow, Column, Experiment};
use crate::report::bench::Measured;
use crate::report::csv::{Csv, number};
use crate::report::table::Table;

/// Groups of column-name suffixes. In JSON, columns that differ only in a suffix of the same group become one array,
/// named without the suffix.
const ARRAYS: [&[&str]; 2] = [&["", "_min", "_max"], &["_gaze", "_edge"]];

/// Measures of an arrangement other than its times and errors, by name.
pub type OtherMeasures = BTreeMap<&'static str, f64>;

/// Results of an arrangement on a scene with a camera motion.
#[derive(Clone, Debug)]
pub struct ExperimentRow {
    /// `measured` or `cited`.
    source: &'static str,
    scene: String,
    camera: Option<Camera>,
    arrangement: String,
    /// Values in the order of the columns.
    pub(super) values: Vec<Option<f64>>,
}

impl Experiment {
    fn row(
        &self,
        source: &'static str,
        scene: &str,
        camera: Option<Camera>,
        name: &str,
        value: impl Fn(&Column) -> Option<f64>,
    ) -> ExperimentRow {
        let values = self.columns.iter().map(value).collect();
        ExperimentRow { source, scene: scene.to_owned(), camera, arrangement: name.to_owned(), values }
    }

    /// Returns the cells of a row's text columns. `none` is the text for a row without a camera motion.
    fn texts(&self, row: &ExperimentRow, none: &str) -> Vec<String> {
        let camera = self.cameras.is_some().then(|| row.camera.map_or(none, |camera| camera.name()));
        let texts = [row.source, &row.scene].into_iter().chain(camera).chain([&row.arrangement[..]]);
        texts.map(str::to_owned).collect()
    }

    /// Returns the rows of `scene` with the motion `camera`, one per arrangement. `found` holds the measurements of
    /// each arrangement, in the order of [`Experiment::all`].
    pub fn measured(&self, scene: &str, camera: Camera, found: &[(Measured, OtherMeasures)]) -> Vec<ExperimentRow> {
        let row = |(arrangement, (of, beside)): (&Arrangement, &(Measured, OtherMeasures))| {
            self.row("measured", scene, Some(camera), &arrangement.name, |column| column.value(of, beside))
        };
        let mut rows: Vec<ExperimentRow> = self.all.iter().zip(found).map(row).collect();
        for (i, column) in self.columns.iter().enumerate() {
            let Some(of) = column.speedup.as_ref().and_then(|of| self.at(of)) else { continue };
            let first = rows.first().and_then(|row| row.values[of]);
            rows.iter_mut().for_each(|row| row.values[i] = first.zip(row.values[of]).map(|(first, own)| first / own));
        }
        rows
    }

    /// Returns the rows of published numbers.
    pub fn cited(&self) -> Vec<ExperimentRow> {
        let row = |cited: &CitedRow| {
            let CitedRow { scene, camera, arrangement, values } = cited;
            self.row("cited", scene, *camera, arrangement, |column| values.get(&column.name).copied())
        };
        self.cited.rows.iter().map(row).collect()
    }

    /// Returns a table with a line per row.
    pub fn table(&'static self, rows: &[ExperimentRow]) -> Table {
        let line = |row: &ExperimentRow| {
            // `Experiment::parse` has checked the templates, so this cannot fail.
            let cells = self.table.iter().map(|shown| self.cell(shown, &row.values).unwrap_or_else(|reason| reason));
            self.texts(row, "-").into_iter().chain(cells).collect()
        };
        let headers = self.labels().into_iter().chain(self.table.iter().map(|shown| &shown.head[..])).collect();
        Table { headers, rows: rows.iter().map(line).collect() }
    }

    /// Returns the contents of the CSV file.
    pub fn csv(&self, rows: &[ExperimentRow]) -> Csv {
        let line = |row: &ExperimentRow| {
            let values = self.columns.iter().zip(&row.values).map(|(column, value)| number(*value, column.decimals));
            self.texts(row, "").into_iter().chain(values).collect()
        };
        let names = self.labels().into_iter().chain(self.columns.iter().map(|column| &column.name[..]));
        Csv { columns: names.map(str::to_owned).collect(), lines: rows.iter().map(line).collect() }
    }

    /// Returns a row as JSON. Columns that differ only in a suffix such as `_min` or `_max` form one array.
    pub fn json(&self, row: &ExperimentRow) -> Value {
        let null_if_empty = |text: String| if text.is_empty() { Value::Null } else { text.into() };
        let texts =
            self.labels().into_iter().map(str::to_owned).zip(self.texts(row, "").into_iter().map(null_if_empty));
        let mut members: Map<String, Value> = texts.collect();
        for (Column { name, .. }, value) in self.columns.iter().zip(&row.values) {
            let mut parts = ARRAYS.iter().flat_map(|ends| ends.iter().map(move |end| (ends, end)));
            let array = parts.find_map(|(ends, end)| {
                let stem = name.strip_suffix(end)?;
                let all: Option<Vec<usize>> = ends.iter().map(|end| self.at(&format!("{stem}{end}"))).collect();
                Some((stem, all?))
            });
            match array {
                // An earlier column of the group has added the array.
                Some((stem, _)) if members.contains_key(stem) => {}
                Some((stem, _)) if stem == name && value.is_none() => _ = members.insert(name.clone(), Value::Null),
                Some((stem, all)) => {
                    let values: Vec<Option<f64>> = all.into_iter().map(|at| row.values[at]).collect();
                    members.insert(stem.to_owned(), json!(values));
                }
                None => _ = members.insert(name.clone(), (*value).into()),
            }
        }
        members.into()
    }
}

impl Column {
    /// Returns the column's value for an arrangement; `None` for a speedup, which [`Experiment::measured`] computes.
    fn value(&self, of: &Measured, beside: &OtherMeasures) -> Option<f64> {
        let sum = |stages: &Vec<String>| {
            let own: Vec<f64> = stages.iter().filter_map(|stage| of.stage_ms.get(stage).copied()).collect();
            (!own.is_empty()).then(|| own.iter().sum::<f64>())
        };
        if let Some(stages) = &self.fraction {
            return sum(stages).map(|ms| ms / of.stage_ms.values().sum::<f64>());
        }
        self.stages.as_ref().and_then(sum).or_else(|| match self.measure.as_deref()? {
            "time_ms" => Some(of.time_ms),
            "time_ms_min" => Some(of.time_ms_min),
            "time_ms_max" => Some(of.time_ms_max),
            "frames_per_s" => Some(1e3 / of.time_ms),
            "rays" => Some(of.frames.iter().map(|line| line.rays as f64).sum::<f64>() / of.frames.len() as f64),
            name => beside.get(name).copied().or_else(|| {
                let [left, right] = [&of.errors.left, &of.errors.right].map(|errors| errors.get(name));
                Some((left? + right?) / 2.0)
            }),
        })
    }
}
