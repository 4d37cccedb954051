//! Definitions of experiments, and checks of them.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize;

use crate::report::study::cell;

/// An experiment: named sets of options (arrangements), which take turns at rendering the same frames.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Name of the CSV file, without the extension.
    pub name: String,
    pub title: String,
    /// Heading of the table.
    pub heading: String,
    /// Caption of the table.
    pub caption: String,
    /// Name of the column that holds the names of the arrangements.
    pub arrangements: String,
    /// Camera motions to measure, each in separate rows; the column `camera` names the motion. Without this key, there
    /// is no such column, and the motion is [`Camera::Approaching`].
    pub cameras: Option<Vec<Camera>>,
    /// True to set the gaze to the screen's centre instead of the shot's gaze.
    #[serde(default)]
    pub gazes_ahead: bool,
    #[serde(default)]
    pub frames: Frames,
    /// Options that all arrangements share, by their names on the command line.
    #[serde(default)]
    pub options: toml::Table,
    #[serde(rename = "arrangement")]
    pub all: Vec<Arrangement>,
    pub columns: Vec<Column>,
    /// Columns of the table that is printed in the terminal and shown on the HTML page.
    pub table: Vec<Shown>,
    #[serde(default)]
    pub(super) cited: Cited,
}

/// Motion of the camera before the compared frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Camera {
    /// The camera moves along its path during the warm-up, and rests in the compared frames.
    Approaching,
    /// The camera rests all the time.
    Still,
    /// The camera moves along its path to several instants, and the frame at each instant is compared.
    Moving,
}

/// Numbers of frames to use unless the command line gives others.
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
    /// Options of this arrangement in addition to [`Experiment::options`], by their names on the command line.
    #[serde(default)]
    pub options: toml::Table,
    /// True to trace as many pixels as `--foveation visual-polar` would.
    #[serde(default)]
    pub as_visual_polar: bool,
    /// False to leave out the blur of log-polar images.
    pub blur: Option<bool>,
}

/// A column of numbers. Exactly one of `measure`, `stages`, `fraction` and `speedup` must be given.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Column {
    pub(super) name: String,
    pub(super) decimals: usize,
    /// One of [`MEASURES`].
    pub measure: Option<String>,
    /// Stages whose busy times are added up. Cells are empty if none of the stages ran.
    pub(super) stages: Option<Vec<String>>,
    /// Stages whose fraction of the busy time is shown: their total busy time divided by that of all stages.
    pub(super) fraction: Option<Vec<String>>,
    /// Column that speedups are computed from: its value for the first arrangement is divided by its value for the
    /// row's arrangement.
    pub(super) speedup: Option<String>,
}

/// Header and cell template of a printed column. In the template, `{COLUMN:DECIMALS}` stands for the column's value,
/// and `{COLUMN:%DECIMALS}` for the value in percent.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shown {
    pub(super) head: String,
    cell: String,
}

/// Published numbers, which are printed below the measured ones.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Cited {
    /// Publication and conditions of the numbers.
    source: String,
    pub(super) rows: Vec<CitedRow>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CitedRow {
    pub(super) scene: String,
    pub(super) camera: Option<Camera>,
    pub(super) arrangement: String,
    pub(super) values: BTreeMap<String, f64>,
}

/// Valid values of [`Column::measure`]. Errors are means of both eyes.
const MEASURES: [&str; 25] = [
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
    "dispatched",
    FOVEA[0],
    FOVEA[1],
    RINGS[0],
    RINGS[1],
    RINGS[2],
    RINGS[3],
];

/// Measures of the fovea under a moving gaze, for which additional frames are rendered.
pub const FOVEA: [&str; 2] = ["fovea_flip", "fovea_flicker"];

/// Measures of rings around the gaze: SSIM against the reference in the innermost ring, and in the outermost ring whose
/// SSIM is defined; then SSIM against the first arrangement in the same two rings.
pub const RINGS: [&str; 4] = ["ssim_gaze", "ssim_edge", "ssim_basic_gaze", "ssim_basic_edge"];

impl Experiment {
    /// Parses and checks the text of an experiment.
    ///
    /// # Errors
    /// A message that names the invalid key.
    pub fn parse(text: &str) -> Result<Self, String> {
        let experiment: Self = toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned())?;
        experiment.check()?;
        Ok(experiment)
    }

    fn check(&self) -> Result<(), String> {
        let is_snake = |name: &str| {
            !name.is_empty() && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_')
        };
        let mut names = BTreeSet::from(["source", "scene", "shot", "camera"]);
        if !is_snake(&self.name) || ["frames", "rings"].contains(&&self.name[..]) {
            return Err(format!("name: '{}' must be in snake_case, and neither frames nor rings", self.name));
        }
        if [self.frames.warm_up, self.frames.repeats].into_iter().flatten().any(|count| count > 1000) {
            return Err("frames: give at most 1000".to_owned());
        }
        if self.cameras().is_empty() {
            return Err("cameras: give at least one, or leave out the key".to_owned());
        }
        let columns = self.columns.iter().map(|column| &column.name);
        for (key, name) in [("arrangements", &self.arrangements)].into_iter().chain(columns.map(|n| ("columns", n))) {
            if !is_snake(name) || !names.insert(name) {
                return Err(format!("{key}: '{name}' must be in snake_case and differ from all other column names"));
            }
        }
        if self.all.is_empty() {
            return Err("arrangement: give at least one".to_owned());
        }
        let mut before = BTreeSet::new();
        if let Some(twice) = self.all.iter().find(|arrangement| !before.insert(&arrangement.name)) {
            return Err(format!("arrangement: there are two named '{}'", twice.name));
        }
        self.columns.iter().try_for_each(|column| self.check_column(column))?;
        let blank = vec![None; self.columns.len()];
        for shown in &self.table {
            self.cell(shown, &blank).map_err(|reason| format!("table: {}: cell: {reason}", shown.head))?;
        }
        for CitedRow { scene, arrangement, values, .. } in &self.cited.rows {
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
            return Err(format!("columns: {name}: decimals: {decimals} is more than 12"));
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

    pub(super) fn at(&self, column: &str) -> Option<usize> {
        self.columns.iter().position(|known| known.name == column)
    }

    /// Returns the camera motions to measure.
    pub fn cameras(&self) -> &[Camera] {
        self.cameras.as_deref().unwrap_or(&[Camera::Approaching])
    }

    /// Returns the names of a row's text columns: `source`, `scene`, `camera` if the file lists cameras, and the column
    /// of arrangements.
    pub fn labels(&self) -> Vec<&str> {
        let camera = self.cameras.is_some().then_some("camera");
        ["source", "scene"].into_iter().chain(camera).chain([&self.arrangements[..]]).collect()
    }

    /// Returns true if any column shows one of these measures.
    pub fn has_any(&self, measures: &[&str]) -> bool {
        self.columns.iter().filter_map(|column| column.measure.as_deref()).any(|name| measures.contains(&name))
    }

    /// Returns the caption of the table and, if it has cited rows, their source.
    pub fn captions(&self) -> Vec<String> {
        let cited = (!self.cited.rows.is_empty()).then(|| format!("Cited: {}", self.cited.source));
        [self.caption.clone()].into_iter().chain(cited).collect()
    }

    /// Fills in the template of a printed cell. `values` are a row's values in the order of the columns. The cell is
    /// `-` if the row lacks every value that the template names.
    ///
    /// # Errors
    /// A message that names the invalid part of the template.
    pub(super) fn cell(&self, shown: &Shown, values: &[Option<f64>]) -> Result<String, String> {
        let mut parts = shown.cell.split('{');
        let mut text = parts.next().unwrap_or_default().to_owned();
        let mut is_missing = shown.cell.contains('{');
        for part in parts {
            let (of, literal) =
                part.split_once('}').ok_or_else(|| format!("'{{{part}' has no end: '}}' is missing"))?;
            let (name, format) = of.split_once(':').ok_or_else(|| format!("'{{{of}}}' lacks ':' and decimals"))?;
            let at = self.at(name).ok_or_else(|| format!("there is no column '{name}'"))?;
            let (factor, decimals) = format.strip_prefix('%').map_or((1.0, format), |decimals| (100.0, decimals));
            let decimals = decimals.parse::<usize>().ok().filter(|decimals| *decimals <= 12);
            let decimals = decimals.ok_or_else(|| format!("'{{{of}}}' needs a number of decimals from 0 to 12"))?;
            is_missing &= values[at].is_none();
            text += &cell(values[at].map(|value| factor * value), decimals);
            text += literal;
        }
        Ok(if is_missing { "-".to_owned() } else { text })
    }
}

impl Camera {
    pub fn name(self) -> &'static str {
        match self {
            Self::Approaching => "approaching",
            Self::Still => "still",
            Self::Moving => "moving",
        }
    }
}
