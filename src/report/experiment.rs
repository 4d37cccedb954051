//! Experiments as data: arrangements of options that render the same frames in turns, the columns of their table, and
//! published numbers to print beside them.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::Table;
use super::bench::Measured;
use super::csv::{Csv, number};
use super::study::cell;

/// Names of the errors that a column may hold: means over frames and eyes.
pub const ERRORS: [&str; 11] = [
    "rmse",
    "relmse",
    "psnr",
    "ssim",
    "flip",
    "mean_ratio",
    "block16",
    "flip_foveated",
    "flip_acuity",
    "flicker",
    "flip_flicker",
];
/// Columns that every experiment has, beside the source, the scene and the arrangement.
const TIMES: [&str; 4] = ["time_ms", "time_ms_min", "time_ms_max", "frames_per_s"];

/// An experiment, read from TOML.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Title of the page.
    pub title: String,
    /// Caption of the table.
    pub caption: String,
    /// Name of the column with the arrangements' names.
    pub key: String,
    #[serde(rename = "arrangement")]
    pub arrangements: Vec<Arrangement>,
    #[serde(rename = "column")]
    columns: Vec<Column>,
    /// Published numbers.
    #[serde(default)]
    cited: Vec<Cited>,
}

/// One arrangement to compare.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arrangement {
    pub name: String,
    /// Options of the command line that determine the quality of frames, by their long names. Others have their
    /// defaults.
    #[serde(default)]
    pub options: BTreeMap<String, toml::Value>,
}

/// A column: the summed time of stages, or an error.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Column {
    name: String,
    /// Its header in the printed table, if that is not the name.
    label: Option<String>,
    #[serde(default)]
    stages: Vec<String>,
    /// Whether the time of the stages is given as a fraction of the time of all stages.
    #[serde(default)]
    fraction: bool,
    error: Option<String>,
}

/// Published numbers of an arrangement.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Cited {
    scene: String,
    arrangement: String,
    values: BTreeMap<String, f64>,
}

impl Column {
    fn value(&self, of: &Measured) -> Option<f64> {
        if let Some(error) = &self.error {
            return Some(of.error(error));
        }
        let own: Vec<f64> = self.stages.iter().filter_map(|stage| of.stage_ms.get(stage).copied()).collect();
        let ms: f64 = own.iter().sum();
        let all_ms = if self.fraction { of.stage_ms.values().sum() } else { 1.0 };
        (!own.is_empty()).then_some(ms / all_ms)
    }

    fn shown(&self, value: Option<f64>) -> String {
        match (&self.error, self.fraction) {
            (Some(error), _) => cell(value, if error == "flicker" { 5 } else { 4 }),
            (None, true) => value.map_or("-".to_owned(), |fraction| format!("{:.1} %", 100.0 * fraction)),
            (None, false) => cell(value, 2),
        }
    }

    /// Returns the number of decimals in files.
    fn decimals(&self) -> usize {
        match (&self.error, self.fraction) {
            (Some(_), _) => 6,
            (None, true) => 5,
            (None, false) => 4,
        }
    }
}

/// Results of an arrangement on a scene, measured or cited.
#[derive(Clone, Debug)]
pub struct ExperimentRow {
    is_cited: bool,
    scene: String,
    arrangement: String,
    /// Median, minimum and maximum of the frames' makespans.
    time_ms: Option<[f64; 3]>,
    frames_per_s: Option<f64>,
    /// Values of the experiment's columns.
    values: Vec<Option<f64>>,
}

impl Experiment {
    /// Parses an experiment.
    ///
    /// # Errors
    /// A message that names the faulty key or value.
    pub fn parse(text: &str) -> Result<Self, String> {
        let experiment: Self = toml::from_str(text).map_err(|e| e.to_string())?;
        experiment.check().map(|()| experiment)
    }

    fn check(&self) -> Result<(), String> {
        if self.arrangements.len() < 2 {
            return Err("it needs at least two [[arrangement]]s to compare".to_owned());
        }
        let names = self.arrangements.iter().map(|a| &a.name);
        let own = ["source", "scene", &self.key].into_iter().chain(TIMES).map(str::to_owned);
        let columns = own.chain(self.columns.iter().map(|column| column.name.clone()));
        if let Some(twice) = repeated(names.cloned()).or_else(|| repeated(columns)) {
            return Err(format!("the name {twice:?} occurs twice"));
        }
        for Column { name, stages, fraction, error, .. } in &self.columns {
            match error {
                Some(error) if !ERRORS.contains(&error.as_str()) => {
                    return Err(format!("column {name:?}: the error {error:?} is none of {}", ERRORS.join(", ")));
                }
                Some(_) if !stages.is_empty() || *fraction => {
                    return Err(format!("column {name:?} has both an error and stages: leave one out"));
                }
                None if stages.is_empty() => return Err(format!("column {name:?} has neither stages nor an error")),
                _ => {}
            }
        }
        for Cited { arrangement, values, .. } in &self.cited {
            if !self.arrangements.iter().any(|a| a.name == *arrangement) {
                return Err(format!("cited: there is no arrangement {arrangement:?}"));
            }
            let is_known = |name: &&String| {
                ["time_ms", "frames_per_s"].contains(&name.as_str()) || self.columns.iter().any(|c| c.name == **name)
            };
            if let Some(name) = values.keys().find(|name| !is_known(name)) {
                return Err(format!("cited: there is no column {name:?}"));
            }
        }
        Ok(())
    }

    /// Returns the row of a measured arrangement.
    pub fn measured(&self, scene: &str, arrangement: &str, of: &Measured) -> ExperimentRow {
        ExperimentRow {
            is_cited: false,
            scene: scene.to_owned(),
            arrangement: arrangement.to_owned(),
            time_ms: Some([of.time_ms, of.time_ms_min, of.time_ms_max]),
            frames_per_s: Some(1e3 / of.time_ms),
            values: self.columns.iter().map(|column| column.value(of)).collect(),
        }
    }

    /// Returns the rows of published numbers.
    pub fn cited(&self) -> impl Iterator<Item = ExperimentRow> {
        self.cited.iter().map(|Cited { scene, arrangement, values }| ExperimentRow {
            is_cited: true,
            scene: scene.clone(),
            arrangement: arrangement.clone(),
            time_ms: values.get("time_ms").map(|&ms| [ms; 3]),
            frames_per_s: values.get("frames_per_s").copied(),
            values: self.columns.iter().map(|column| values.get(&column.name).copied()).collect(),
        })
    }

    /// Returns the names of columns that are empty in all measured rows, as if their stages did not exist.
    pub fn empty_columns(&self, rows: &[ExperimentRow]) -> Vec<&str> {
        let is_empty = |i: usize| rows.iter().filter(|row| !row.is_cited).all(|row| row.values[i].is_none());
        self.columns.iter().enumerate().filter(|(i, _)| is_empty(*i)).map(|(_, column)| column.name.as_str()).collect()
    }

    /// Returns a table with a line per scene and arrangement.
    pub fn table(&self, rows: &[ExperimentRow]) -> Table {
        // A run prints one table, so its headers may stay in memory.
        let labels = self.columns.iter().map(|column| &*column.label.clone().unwrap_or(column.name.clone()).leak());
        let headers = ["source", "scene", self.key.clone().leak(), "frame ms", "least..most", "frames/s"];
        let line = |row: &ExperimentRow| {
            let range = |[_, least, most]: [f64; 3]| format!("{least:.1}..{most:.1}");
            let first = [
                row.source().to_owned(),
                row.scene.clone(),
                row.arrangement.clone(),
                cell(row.time_ms.map(|ms| ms[0]), 1),
                row.time_ms.filter(|_| !row.is_cited).map_or("-".to_owned(), range),
                cell(row.frames_per_s, 1),
            ];
            let shown = self.columns.iter().zip(&row.values).map(|(column, value)| column.shown(*value));
            first.into_iter().chain(shown).collect()
        };
        Table { headers: headers.into_iter().chain(labels).collect(), rows: rows.iter().map(line).collect() }
    }

    /// Returns the contents of the CSV file.
    pub fn csv(&self, rows: &[ExperimentRow]) -> Csv {
        let own = ["source", "scene", &self.key].into_iter().chain(TIMES).map(str::to_owned);
        let line = |row: &ExperimentRow| {
            let times = (0..3).map(|i| number(row.time_ms.map(|ms| ms[i]), 4));
            let values = self.columns.iter().zip(&row.values).map(|(column, v)| number(*v, column.decimals()));
            [row.source().to_owned(), row.scene.clone(), row.arrangement.clone()]
                .into_iter()
                .chain(times)
                .chain([number(row.frames_per_s, 4)])
                .chain(values)
                .collect()
        };
        Csv {
            columns: own.chain(self.columns.iter().map(|column| column.name.clone())).collect(),
            lines: rows.iter().map(line).collect(),
        }
    }

    /// Returns the rows as JSON.
    pub fn json(&self, rows: &[ExperimentRow]) -> Vec<Value> {
        let object = |row: &ExperimentRow| {
            let own = json!({
                "source": row.source(), "scene": row.scene, self.key.as_str(): row.arrangement,
                "time_ms": row.time_ms, "frames_per_s": row.frames_per_s,
            });
            let mut object = own.as_object().cloned().unwrap_or_default();
            object.extend(self.columns.iter().zip(&row.values).map(|(c, v)| (c.name.clone(), json!(v))));
            Value::Object(Map::from_iter(object))
        };
        rows.iter().map(object).collect()
    }
}

impl ExperimentRow {
    fn source(&self) -> &'static str {
        if self.is_cited { "cited" } else { "measured" }
    }
}

/// Returns a name that occurs more than once.
fn repeated(names: impl IntoIterator<Item = String>) -> Option<String> {
    let mut seen = BTreeSet::new();
    names.into_iter().find(|name| !seen.insert(name.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exec::Stereo;
    use crate::report::bench::{Errors, SeenErrors};

    const BMFR: &str = include_str!("../cli/bench/experiments/bmfr.toml");

    fn measured(stages: &[(&str, f64)]) -> Measured {
        let eye = |flip: f64| Errors::mean_of(&[json!({ "flip": flip, "flicker": 2.0 * flip })]);
        Measured {
            time_ms: 20.0,
            time_ms_min: 19.0,
            time_ms_max: 22.0,
            stage_ms: stages.iter().map(|(name, ms)| ((*name).to_owned(), *ms)).collect(),
            errors: Stereo { left: eye(0.1), right: eye(0.2) },
            relmse_repeats: Stereo { left: Vec::new(), right: Vec::new() },
            frames: Vec::new(),
        }
    }

    #[test]
    fn a_filter_is_the_fit_or_what_stands_in_its_place() {
        let experiment = Experiment::parse(BMFR).unwrap();
        let paths = [("path_trace", 6.0), ("hole_fill", 2.0), ("accumulate", 4.0)];
        let fitted = measured(&[&paths[..], &[("fit", 4.0)]].concat());
        let svgf = measured(&[&paths[..], &[("variance", 1.0), ("svgf", 3.0)]].concat());
        for (denoiser, of) in [("bmfr", &fitted), ("svgf", &svgf)] {
            let csv = experiment.csv(&[experiment.measured("builtin:cornell", denoiser, of)]);
            let found = ["denoiser", "frames_per_s", "path_ms", "filter_ms", "filter_share", "flip", "flicker"];
            let found = found.map(|name| csv.value(0, name));
            let expected = ["50.0000", "8.0000", "4.0000", "0.25000", "0.150000", "0.300000"];
            assert_eq!(found, [&[denoiser], &expected[..]].concat()[..]);
        }
        let cited: Vec<ExperimentRow> = experiment.cited().collect();
        let shown = experiment.table(&cited).rows;
        assert_eq!(shown[0][3..9], ["-", "-", "78.0", "-", "-", "-"]);
        assert_eq!(shown[1][3..9], ["-", "-", "71.0", "7.08", "6.42", "42.7 %"]);
    }

    #[test]
    fn the_documented_example_is_valid() {
        let text = include_str!("../../docs/experiments.md");
        let example = text.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
        let experiment = Experiment::parse(example).unwrap();
        assert_eq!((experiment.arrangements.len(), experiment.columns.len(), experiment.cited().count()), (2, 2, 1));
    }

    #[test]
    fn all_errors_of_a_setting_can_be_columns() {
        let all = crate::metrics::Errors {
            rmse: 0.0,
            relmse: 0.0,
            psnr: 0.0,
            ssim: None,
            flip: 0.0,
            mean_ratio: None,
            block16: None,
            nonfinite_px: 0,
            nonfinite_reference_px: 0,
        };
        let seen = SeenErrors { all, flip_foveated: 0.0, flip_acuity: 0.0 };
        let names = serde_json::to_value(seen).unwrap().as_object().unwrap().keys().cloned().collect::<BTreeSet<_>>();
        let expected = names.iter().map(String::as_str).filter(|name| !name.starts_with("nonfinite"));
        let own: BTreeSet<&str> = ERRORS.into_iter().filter(|name| !name.contains("flicker")).collect();
        assert!(expected.eq(own), "{names:?}");
    }

    #[test]
    fn columns_without_any_stage_are_named() {
        let experiment = Experiment::parse(&BMFR.replace("\"path_trace\", \"hole_fill\"", "\"path_tracing\"")).unwrap();
        let row = experiment.measured("builtin:cornell", "svgf", &measured(&[("path_trace", 6.0), ("svgf", 1.0)]));
        assert_eq!(experiment.table(std::slice::from_ref(&row)).rows[0][6], "-");
        assert_eq!(experiment.empty_columns(&[row]), ["path_ms"]);
    }

    #[test]
    fn faulty_experiments_are_refused_with_a_reason() {
        for (from, to, reason) in [
            ("key = ", "kye = ", "unknown field `kye`"),
            ("error = \"flip\"", "error = \"flop\"", "column \"flip\": the error \"flop\" is none of rmse, "),
            ("error = \"flicker\"", "", "column \"flicker\" has neither"),
            ("error = \"flicker\"", "error = \"flicker\"\nstages = [\"fit\"]", "has both"),
            ("name = \"bmfr_noise\"", "name = \"bmfr\"", "\"bmfr\" occurs twice"),
            ("name = \"path_ms\"", "name = \"time_ms\"", "\"time_ms\" occurs twice"),
            ("path_ms = 7.08", "paths_ms = 7.08", "no column \"paths_ms\""),
            ("arrangement = \"bmfr\"", "arrangement = \"bmf\"", "no arrangement \"bmf\""),
        ] {
            let text = BMFR.replacen(from, to, 1);
            assert_ne!(text, BMFR, "{from}");
            let message = Experiment::parse(&text).unwrap_err();
            assert!(message.contains(reason), "{to}: {message}");
        }
    }
}
