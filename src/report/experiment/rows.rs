//! Results of an experiment as tables, CSV and JSON: one row per shot, resolution, camera motion and arrangement.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use super::column::{Column, Found};
use super::definition::{Arrangement, CitedRow, Experiment, Shown};
use crate::report::csv::{Csv, number};
use crate::report::table::Table;

/// Groups of column-name suffixes. In JSON, columns that differ only in a suffix of the same group become one array,
/// named without the suffix.
const ARRAYS: [&[&str]; 2] = [&["", "_min", "_max"], &["_gaze", "_edge"]];

/// Cells of a row's text columns, by label.
pub type Texts = BTreeMap<String, Value>;

/// Results of an arrangement on a shot, or published ones.
#[derive(Clone, Debug)]
pub struct ExperimentRow {
    texts: Texts,
    /// Values in the order of the columns.
    pub(super) values: Vec<Option<f64>>,
}

impl Experiment {
    /// Returns the cells of a row's text columns. `none` is the text of empty cells.
    fn texts(&self, row: &ExperimentRow, none: &str) -> Vec<String> {
        self.labels().into_iter().map(|label| text_of(&row.texts, label).unwrap_or(none.to_owned())).collect()
    }

    /// Returns the texts of `subject` for an arrangement.
    pub fn texts_of(&self, subject: &Texts, arrangement: &str) -> Texts {
        let named = (self.arrangements.clone(), arrangement.into());
        subject.clone().into_iter().chain([named]).collect()
    }

    /// Returns the rows of a shot, one per arrangement. `subject` holds the texts that its rows share, and `all` the
    /// measurements of each arrangement, in the order of [`Experiment::all`].
    pub fn measured(&self, subject: &Texts, all: &[Found]) -> Vec<ExperimentRow> {
        let row = |(arrangement, found): (&Arrangement, &Found)| {
            let texts = self.texts_of(subject, &arrangement.name);
            let value = |column: &Column| match &column.cited {
                Some(cited) => self.cited_value(&texts, cited),
                None => column.value(found, &all[0]),
            };
            ExperimentRow { values: self.columns.iter().map(value).collect(), texts }
        };
        let mut rows: Vec<ExperimentRow> = self.all.iter().zip(all).map(row).collect();
        for (i, column) in self.columns.iter().enumerate() {
            let Some(of) = column.speedup.as_ref().and_then(|of| self.at(of)) else { continue };
            let first = rows.first().and_then(|row| row.values[of]);
            rows.iter_mut().for_each(|row| row.values[i] = first.zip(row.values[of]).map(|(first, own)| first / own));
        }
        rows
    }

    /// Returns the published number in a column for the row with these texts.
    fn cited_value(&self, texts: &Texts, column: &str) -> Option<f64> {
        let text = |label| text_of(texts, label);
        let scene = text("stands_for").or_else(|| text("scene"));
        let is_of = |cited: &&CitedRow| {
            let CitedRow { scene: published, resolution, camera, arrangement, .. } = cited;
            scene.as_ref() == Some(published)
                && text(&self.arrangements).as_ref() == Some(arrangement)
                && resolution.as_ref().is_none_or(|own| Some(own) == text("resolution").as_ref())
                && camera.is_none_or(|own| Some(own.name()) == text("camera").as_deref())
        };
        self.cited.rows.iter().filter(is_of).find_map(|cited| cited.values.get(column).copied())
    }

    /// Returns the rows of published numbers. There are none if columns beside the measured ones show them.
    pub fn cited(&self) -> Vec<ExperimentRow> {
        let row = |cited: &CitedRow| {
            let CitedRow { scene, resolution, camera, arrangement, values } = cited;
            let camera = camera.map(|camera| camera.name().to_owned());
            let texts = [("source", Some("cited".to_owned())), ("scene", Some(scene.clone())), ("camera", camera)];
            let texts = texts.into_iter().chain([("resolution", resolution.clone())]);
            let subject = texts.filter_map(|(label, text)| Some((label.to_owned(), text?.into()))).collect();
            let values = self.columns.iter().map(|column| values.get(&column.name).copied()).collect();
            ExperimentRow { texts: self.texts_of(&subject, arrangement), values }
        };
        self.cited.rows.iter().filter(|_| !self.cites_beside()).map(row).collect()
    }

    /// Returns each table with its heading and its notes. The first one states the source of published numbers, and the
    /// last one ends with `notes`.
    pub fn tables(
        &'static self,
        rows: &[ExperimentRow],
        notes: Vec<String>,
    ) -> Vec<(&'static str, Vec<String>, Table)> {
        let table = |shown: &'static [Shown]| {
            let line = |row: &ExperimentRow| {
                // `Experiment::parse` has checked the templates, so this cannot fail.
                let cells = shown.iter().map(|shown| self.cell(shown, &row.values).unwrap_or_else(|reason| reason));
                self.texts(row, "-").into_iter().chain(cells).collect()
            };
            let headers = self.labels().into_iter().chain(shown.iter().map(|shown| &shown.head[..])).collect();
            Table { headers, rows: rows.iter().map(line).collect() }
        };
        let of = |(heading, caption, shown): (_, &str, _)| (heading, vec![caption.to_owned()], table(shown));
        let mut tables: Vec<_> = self.printed().map(of).collect();
        tables[0].1.extend(self.cited_note());
        let last = tables.len() - 1;
        tables[last].1.extend(notes);
        tables
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
        let text = |label: &str| (label.to_owned(), row.texts.get(label).cloned().unwrap_or_default());
        let mut members: Map<String, Value> = self.labels().into_iter().map(text).collect();
        for (Column { name, decimals, .. }, value) in self.columns.iter().zip(&row.values) {
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
                None => {
                    let whole = value.filter(|value| *decimals == 0 && value.fract() == 0.0).map(|value| value as i64);
                    members.insert(name.clone(), whole.map_or((*value).into(), Value::from));
                }
            }
        }
        members.into()
    }
}

/// Returns the text of a label, if the row has one.
pub fn text_of(texts: &Texts, label: &str) -> Option<String> {
    texts.get(label).map(|value| value.as_str().map_or_else(|| value.to_string(), str::to_owned))
}
