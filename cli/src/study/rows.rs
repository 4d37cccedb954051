//! Results of a study: a row per scene, size, camera and arrangement, measured or published.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::{Map, Value};

use super::arrangement::Arrangement;
use super::columns::{Cell, Column, Found};
use super::definition::Study;
use super::locked::PUBLISHED;
use crate::report::csv::{Csv, number};
use crate::report::table::Table;

/// Text columns of all studies.
const LABELS: [&str; 9] =
    ["source", "conditions", "scene", "stands_for", "resolution", "size", "camera", "devices", "arrangement"];

/// Text columns of `frames.csv`.
pub const FRAME_LABELS: [&str; 5] = ["conditions", "scene", "resolution", "camera", "arrangement"];

/// Source of published numbers.
const CITED: &str = "cited";

/// Texts of a row; empty for those that it lacks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Labels {
    /// Origin of the numbers: measured, simulated or cited.
    pub source: &'static str,
    pub conditions: String,
    pub scene: String,
    /// Scene of the publication in place of which the row's was measured.
    pub stands_for: String,
    /// Name of the published size.
    pub resolution: String,
    pub size: String,
    pub camera: String,
    pub devices: String,
    pub arrangement: String,
}

impl Labels {
    fn texts(&self) -> [&str; 9] {
        let Self { source, conditions, scene, stands_for, resolution, size, camera, devices, arrangement } = self;
        [source, conditions, scene, stands_for, resolution, size, camera, devices, arrangement]
    }

    /// Returns the texts of a frame of the row, in the order of [`FRAME_LABELS`].
    pub fn of_frame(&self) -> [&str; 5] {
        let Self { conditions, scene, resolution, camera, arrangement, .. } = self;
        [conditions, scene, resolution, camera, arrangement]
    }
}

/// Results of an arrangement on a scene, or published ones.
#[derive(Clone, Debug)]
pub struct Row {
    pub labels: Labels,
    /// Values in the order of the columns.
    values: Vec<Option<f64>>,
}

/// A row of `published.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Published {
    scene: String,
    #[serde(default)]
    resolution: String,
    #[serde(default)]
    camera: String,
    arrangement: String,
    values: BTreeMap<String, f64>,
}

#[expect(clippy::expect_used, reason = "the file is part of the program, and a test reads it")]
static ALL_PUBLISHED: LazyLock<BTreeMap<String, Vec<Published>>> =
    LazyLock::new(|| toml::from_str(include_str!("published.toml")).expect("published.toml is valid"));

impl Study {
    /// Returns the rows of all arrangements, whose labels are `labels` but for the arrangement.
    pub fn rows(&self, labels: &Labels, all: &[Found]) -> Vec<Row> {
        let row = |(one, found): (&Arrangement, &Found)| {
            let cell = Cell { found, first: &all[0] };
            let devices = one.devices.map_or_else(|| labels.devices.clone(), |count| count.to_string());
            let labels = Labels { arrangement: one.name.to_owned(), devices, ..labels.clone() };
            Row { labels, values: self.columns.iter().map(|column| (column.value)(&cell)).collect() }
        };
        self.arrangements.iter().zip(all).map(row).collect()
    }

    /// Returns the published rows.
    pub fn published(&self) -> Vec<Row> {
        let row = |one: &Published| {
            let Published { scene, resolution, camera, arrangement, values } = one;
            let labels = Labels {
                source: CITED,
                conditions: PUBLISHED.to_owned(),
                scene: scene.clone(),
                resolution: resolution.clone(),
                camera: camera.clone(),
                arrangement: arrangement.clone(),
                ..Labels::default()
            };
            Row { labels, values: self.columns.iter().map(|column| values.get(column.name).copied()).collect() }
        };
        ALL_PUBLISHED.get(self.name).into_iter().flatten().map(row).collect()
    }

    /// Returns the printed table with this index. It leaves out labels and columns that are empty in all rows, and rows
    /// without any number.
    pub fn table(&self, index: usize, rows: &[Row]) -> Table {
        let columns: Vec<usize> = (0..self.columns.len())
            .filter(|i| self.columns[*i].table == index && !self.columns[*i].head.is_empty())
            .filter(|i| rows.iter().any(|row| row.values[*i].is_some()))
            .collect();
        let has_any = |row: &&Row| columns.iter().any(|i| row.values[*i].is_some());
        let rows: Vec<&Row> = rows.iter().filter(has_any).collect();
        let labels: Vec<usize> =
            (0..LABELS.len()).filter(|i| rows.iter().any(|row| !row.labels.texts()[*i].is_empty())).collect();
        let line = |row: &&Row| {
            let texts = row.labels.texts();
            let label = |i: &usize| if texts[*i].is_empty() { "-" } else { texts[*i] }.to_owned();
            labels.iter().map(label).chain(columns.iter().map(|i| shown(&self.columns[*i], row.values[*i]))).collect()
        };
        let heads = columns.iter().map(|i| self.columns[*i].head);
        let headers = labels.iter().map(|i| LABELS[*i]).chain(heads).collect();
        Table { headers, rows: rows.iter().map(line).collect() }
    }

    /// Returns the contents of the CSV file.
    pub fn csv(&self, rows: &[Row]) -> Csv {
        let line = |row: &Row| {
            let values =
                self.columns.iter().zip(&row.values).map(|(column, value)| number(*value, column.decimals + 4));
            row.labels.texts().map(str::to_owned).into_iter().chain(values).collect()
        };
        let names = LABELS.into_iter().chain(self.columns.iter().map(|column| column.name));
        Csv { columns: names.map(str::to_owned).collect(), lines: rows.iter().map(line).collect() }
    }

    /// Returns a row as JSON, without the labels that it lacks.
    pub fn json(&self, row: &Row) -> Value {
        let labels = LABELS.into_iter().zip(row.labels.texts()).filter(|(_, text)| !text.is_empty());
        let texts = labels.map(|(label, text)| (label.to_owned(), Value::from(text)));
        let values =
            self.columns.iter().zip(&row.values).map(|(column, value)| (column.name.to_owned(), (*value).into()));
        texts.chain(values).collect::<Map<_, _>>().into()
    }

    /// Returns the value of a row in a column.
    #[cfg(test)]
    pub fn value(&self, row: &Row, column: &str) -> Option<f64> {
        row.values[self.columns.iter().position(|known| known.name == column).unwrap()]
    }
}

/// Returns the text of a printed cell.
fn shown(column: &Column, value: Option<f64>) -> String {
    let factor = if column.is_percent { 100.0 } else { 1.0 };
    value.map_or("-".to_owned(), |value| format!("{:.*}", column.decimals, factor * value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::STUDIES;
    use crate::study::times::FrameTimes;

    fn study(name: &str) -> &'static Study {
        STUDIES.iter().find(|study| study.name == name).unwrap()
    }

    #[test]
    fn published_numbers_have_columns_and_arrangements() {
        assert_eq!(ALL_PUBLISHED.len(), STUDIES.len());
        for study in STUDIES {
            for Published { scene, arrangement, values, .. } in &ALL_PUBLISHED[study.name] {
                assert!(study.arrangements.iter().any(|one| one.name == arrangement), "{scene}, {arrangement}");
                for name in values.keys() {
                    assert!(study.columns.iter().any(|column| column.name == name), "{}: {name}", study.name);
                }
            }
        }
    }

    #[test]
    fn published_times_give_the_published_speedups() {
        for (name, time, speedup, error) in [
            ("andersson", "time_ms", "speedup", 1e-4),
            ("peres", "time_ms", "speedup", 0.011),
            ("koskela", "path_ms", "path_speedup", 0.05),
            ("leria", "total_s", "speedup", 1e-4),
        ] {
            let study = study(name);
            let rows = study.published();
            let mut compared = 0;
            for row in &rows {
                let is_first = |first: &&Row| {
                    let of = |row: &Row| {
                        [&row.labels.scene, &row.labels.resolution]
                            .map(|text| text.split(',').next().map(str::to_owned))
                    };
                    first.labels.arrangement == study.arrangements[0].name && of(first) == of(row)
                };
                let first = rows.iter().find(is_first).and_then(|first| study.value(first, time));
                let Some(((first, own), printed)) = first.zip(study.value(row, time)).zip(study.value(row, speedup))
                else {
                    continue;
                };
                assert!((first / own - printed).abs() < error, "{row:?}: {}", first / own);
                compared += 1;
            }
            assert!(compared > 3, "{name}: {compared}");
        }
    }

    #[test]
    fn tables_omit_columns_without_values() {
        let study = study("bmfr");
        let stages = [(0, "path_trace", 6.0), (0, "hole_fill", 2.0), (0, "accumulate", 4.0), (0, "fit", 4.0)];
        let times = [20.0, 19.0, 22.0].map(|ms| FrameTimes::new(ms, 1, stages.into_iter()));
        let found = Found { times: times.to_vec(), ..Found::default() };
        let labels = Labels { source: "measured", scene: "builtin:cornell".into(), ..Labels::default() };
        let rows = study.rows(&labels, &[found.clone(), found.clone(), found]);
        let [time, path, filter, share] =
            ["time_ms", "path_ms", "filter_ms", "filter_share"].map(|name| study.value(&rows[1], name));
        assert_eq!([time, path, filter, share], [Some(20.0), Some(8.0), Some(4.0), Some(0.25)]);
        let table = study.table(0, &rows);
        assert_eq!(table.headers[..3], ["source", "scene", "arrangement"]);
        assert!(!table.headers.contains(&"FLIP") && table.rows.len() == 3, "{table:?}");
        let csv = study.csv(&rows);
        assert!(csv.columns.contains(&"flip".to_owned()) && csv.lines[0].len() == csv.columns.len());
        assert_eq!(study.json(&rows[0])["scene"], "builtin:cornell");
    }
}
