//! Experiments as data: TOML files that name arrangements of options, the columns of the results, and published numbers
//! to print beside them.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::bench::Measured;
use super::csv::{Csv, number};
use super::study::cell;
use super::table::Table;

/// An experiment: arrangements that render the same frames in turns.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Name of the CSV file, without its ending.
    pub name: String,
    pub title: String,
    /// Heading of the table.
    pub heading: String,
    /// Caption of the table.
    pub note: String,
    /// Name of the column of arrangements.
    pub arrangements: String,
    #[serde(default)]
    pub frames: Frames,
    /// Options of all arrangements.
    #[serde(default)]
    pub options: toml::Table,
    #[serde(rename = "arrangement")]
    pub all: Vec<Arrangement>,
    pub columns: Vec<Column>,
    /// Columns of the printed table and of the page.
    pub table: Vec<Shown>,
    #[serde(default)]
    cited: Cited,
}

/// Numbers of frames where the command line gives none.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frames {
    pub warm_up: Option<u32>,
    pub repeats: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arrangement {
    pub name: String,
    /// Options beside those of all arrangements, by their names on the command line.
    #[serde(default)]
    pub options: toml::Table,
    /// True to trace as many pixels as `--foveation visual-polar` would.
    #[serde(default)]
    pub as_visual_polar: bool,
}

/// A column of numbers, with exactly one source.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Column {
    name: String,
    decimals: usize,
    /// One of [`MEASURES`].
    pub measure: Option<String>,
    /// Stages whose times are added; empty if none of them ran.
    stages: Option<Vec<String>>,
    /// Stages whose time is divided by that of all stages.
    fraction: Option<Vec<String>>,
    /// Column of which the first arrangement's value is divided by this one's.
    speedup: Option<String>,
}

/// A printed column. Its cells replace `{COLUMN:DECIMALS}` by the value, and `{COLUMN:%DECIMALS}` by the value in
/// percent.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shown {
    head: String,
    cell: String,
}

/// Published numbers.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Cited {
    /// Publication and conditions of the numbers.
    source: String,
    rows: Vec<CitedRow>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CitedRow {
    scene: String,
    arrangement: String,
    values: BTreeMap<String, f64>,
}

/// Measurements that columns can name. Errors are means of both eyes.
const MEASURES: [&str; 20] = [
    "time_ms",
    "time_ms_min",
    "time_ms_max",
    "frames_per_s",
    "rays",
    "rmse",
    "relmse",
    "psnr",
    "ssim",
    "flip",
    "flip_acuity",
    "flip_foveated",
    "flicker",
    "mean_ratio",
    "paths_left",
    "paths_right",
    "floor",
    "sigma",
    FOVEA[0],
    FOVEA[1],
];

/// Measures that need a moving gaze.
pub const FOVEA: [&str; 2] = ["fovea_flip", "fovea_flicker"];

/// Measures of an arrangement other than its times and errors, by name.
pub type Beside = BTreeMap<&'static str, f64>;

/// Results of an arrangement on a scene.
#[derive(Clone, Debug)]
pub struct Row {
    /// `measured` or `cited`.
    source: &'static str,
    scene: String,
    arrangement: String,
    /// Values in the order of the columns.
    values: Vec<Option<f64>>,
}

impl Experiment {
    /// Parses and checks the text of an experiment.
    ///
    /// # Errors
    /// A message that names the key.
    pub fn parse(text: &str) -> Result<Self, String> {
        let experiment: Self = toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned())?;
        experiment.check()?;
        Ok(experiment)
    }

    fn check(&self) -> Result<(), String> {
        let is_snake = |name: &str| {
            !name.is_empty() && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_')
        };
        let mut names = BTreeSet::from(["source", "scene", "shot"]);
        if !is_snake(&self.name) || self.name == "frames" {
            return Err(format!("name: '{}' is no name in snake_case other than frames", self.name));
        }
        let columns = self.columns.iter().map(|column| &column.name);
        for (key, name) in [("arrangements", &self.arrangements)].into_iter().chain(columns.map(|n| ("columns", n))) {
            if !is_snake(name) || !names.insert(name) {
                return Err(format!("{key}: '{name}' is no name in snake_case that occurs once"));
            }
        }
        if self.all.is_empty() {
            return Err("arrangement: there is none".to_owned());
        }
        let mut before = BTreeSet::new();
        if let Some(twice) = self.all.iter().find(|arrangement| !before.insert(&arrangement.name)) {
            return Err(format!("arrangement: there are two named '{}'", twice.name));
        }
        self.columns.iter().try_for_each(|column| self.check_column(column))?;
        let blank = self.row("", "", "", |_| None);
        for shown in &self.table {
            self.cell(shown, &blank).map_err(|reason| format!("table: {}: cell: {reason}", shown.head))?;
        }
        for CitedRow { scene, arrangement, values } in &self.cited.rows {
            if !before.contains(arrangement) {
                return Err(format!("cited: {scene}: there is no arrangement '{arrangement}'"));
            }
            if let Some(unknown) = values.keys().find(|name| self.at(name).is_none()) {
                return Err(format!("cited: {scene}: values: there is no column '{unknown}'"));
            }
        }
        Ok(())
    }

    fn check_column(&self, column: &Column) -> Result<(), String> {
        let Column { name, decimals, measure, stages, fraction, speedup } = column;
        let sources = [measure.is_some(), stages.is_some(), fraction.is_some(), speedup.is_some()];
        if sources.into_iter().filter(|is_given| *is_given).count() != 1 {
            return Err(format!("columns: {name}: give one of measure, stages, fraction and speedup"));
        }
        if *decimals > 12 {
            return Err(format!("columns: {name}: decimals: {decimals} are more than 12"));
        }
        if let Some(unknown) = measure.as_deref().filter(|measure| !MEASURES.contains(measure)) {
            let known = MEASURES.join(", ");
            return Err(format!("columns: {name}: measure: there is no '{unknown}': choose one of {known}"));
        }
        match speedup.as_deref().filter(|of| self.at(of).is_none_or(|at| self.columns[at].speedup.is_some())) {
            Some(unknown) => Err(format!("columns: {name}: speedup: there is no measured column '{unknown}'")),
            None => Ok(()),
        }
    }

    fn at(&self, column: &str) -> Option<usize> {
        self.columns.iter().position(|known| known.name == column)
    }

    fn row(&self, source: &'static str, scene: &str, name: &str, value: impl Fn(&Column) -> Option<f64>) -> Row {
        let values = self.columns.iter().map(value).collect();
        Row { source, scene: scene.to_owned(), arrangement: name.to_owned(), values }
    }

    /// Returns true if a column is one of these measures.
    pub fn has_any(&self, measures: &[&str]) -> bool {
        self.columns.iter().filter_map(|column| column.measure.as_deref()).any(|name| measures.contains(&name))
    }

    /// Returns the rows of a scene from the measurements of all arrangements.
    pub fn measured(&self, scene: &str, found: &[(Measured, Beside)]) -> Vec<Row> {
        let row = |(arrangement, (of, beside)): (&Arrangement, &(Measured, Beside))| {
            self.row("measured", scene, &arrangement.name, |column| column.value(of, beside))
        };
        let mut rows: Vec<Row> = self.all.iter().zip(found).map(row).collect();
        for (i, column) in self.columns.iter().enumerate() {
            let Some(of) = column.speedup.as_ref().and_then(|of| self.at(of)) else { continue };
            let first = rows.first().and_then(|row| row.values[of]);
            rows.iter_mut().for_each(|row| row.values[i] = first.zip(row.values[of]).map(|(first, own)| first / own));
        }
        rows
    }

    /// Returns the published numbers.
    pub fn cited(&self) -> Vec<Row> {
        let row = |cited: &CitedRow| {
            self.row("cited", &cited.scene, &cited.arrangement, |column| cited.values.get(&column.name).copied())
        };
        self.cited.rows.iter().map(row).collect()
    }

    /// Returns the caption of the table.
    pub fn notes(&self) -> Vec<String> {
        let cited = (!self.cited.rows.is_empty()).then(|| format!("Cited: {}", self.cited.source));
        [self.note.clone()].into_iter().chain(cited).collect()
    }

    fn cell(&self, shown: &Shown, row: &Row) -> Result<String, String> {
        let mut parts = shown.cell.split('{');
        let mut text = parts.next().unwrap_or_default().to_owned();
        let mut is_missing = true;
        for part in parts {
            let (of, literal) = part.split_once('}').ok_or_else(|| format!("'{{{part}' has no end"))?;
            let (name, format) = of.split_once(':').ok_or_else(|| format!("'{{{of}}}' has no decimals"))?;
            let at = self.at(name).ok_or_else(|| format!("there is no column '{name}'"))?;
            let (factor, decimals) = format.strip_prefix('%').map_or((1.0, format), |decimals| (100.0, decimals));
            let decimals = decimals.parse::<usize>().ok().filter(|decimals| *decimals <= 12);
            let decimals = decimals.ok_or_else(|| format!("'{{{of}}}' has no number of decimals up to 12"))?;
            is_missing &= row.values[at].is_none();
            text += &cell(row.values[at].map(|value| factor * value), decimals);
            text += literal;
        }
        Ok(if is_missing { "-".to_owned() } else { text })
    }

    /// Returns a table with a line per row.
    pub fn table(&'static self, rows: &[Row]) -> Table {
        let shown = self.table.iter().map(|shown| shown.head.as_str());
        let line = |row: &Row| {
            let names = [row.source.to_owned(), row.scene.clone(), row.arrangement.clone()];
            // Cells have been checked.
            let cells = self.table.iter().map(|shown| self.cell(shown, row).unwrap_or_else(|reason| reason));
            names.into_iter().chain(cells).collect()
        };
        let headers = ["source", "scene", &self.arrangements].into_iter().chain(shown).collect();
        Table { headers, rows: rows.iter().map(line).collect() }
    }

    /// Returns the contents of the CSV file.
    pub fn csv(&self, rows: &[Row]) -> Csv {
        let line = |row: &Row| {
            let names = [row.source.to_owned(), row.scene.clone(), row.arrangement.clone()];
            let values = self.columns.iter().zip(&row.values).map(|(column, value)| number(*value, column.decimals));
            names.into_iter().chain(values).collect()
        };
        let columns = ["source", "scene", &self.arrangements].into_iter().map(str::to_owned);
        let columns = columns.chain(self.columns.iter().map(|column| column.name.clone())).collect();
        Csv { columns, lines: rows.iter().map(line).collect() }
    }

    /// Returns a row as JSON. A column, its minimum and its maximum are one array.
    pub fn json(&self, row: &Row) -> Value {
        let text = [("source", row.source), ("scene", &row.scene), (&self.arrangements, &row.arrangement)];
        let mut members: Map<String, Value> =
            text.into_iter().map(|(name, text)| (name.to_owned(), text.into())).collect();
        for (i, Column { name, .. }) in self.columns.iter().enumerate() {
            let is_end = |end: &str| name.strip_suffix(end).is_some_and(|name| self.at(name).is_some());
            let ends = ["_min", "_max"].map(|end| self.at(&format!("{name}{end}")));
            if let [Some(least), Some(most)] = ends {
                let all = [i, least, most].map(|at| row.values[at]);
                members.insert(name.clone(), if all == [None; 3] { Value::Null } else { json!(all) });
            } else if !is_end("_min") && !is_end("_max") {
                members.insert(name.clone(), row.values[i].into());
            }
        }
        members.into()
    }
}

impl Column {
    /// Returns the value for an arrangement, except that of a speed-up.
    fn value(&self, of: &Measured, beside: &Beside) -> Option<f64> {
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

#[cfg(test)]
mod tests;
