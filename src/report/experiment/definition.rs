//! Definitions of experiments, and checks of them.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize;

use super::camera::Camera;
use super::column::Column;
use crate::image::Extent;
use crate::report::study::cell;

/// An experiment: named sets of options (arrangements), which take turns at rendering the same frames.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Name of the CSV file, without the extension.
    pub name: String,
    pub title: String,
    /// Heading of the first table.
    pub heading: String,
    /// Caption of the first table.
    pub caption: String,
    /// Name of the column that holds the names of the arrangements.
    pub arrangements: String,
    /// Text columns at the start of each row: names of [`LABELS`] or the value of `arrangements`. Without this key they
    /// are `source`, `scene`, `camera` if the file lists cameras, and the column of arrangements.
    labels: Option<Vec<String>>,
    /// Shots to measure unless the command line names others.
    #[serde(default)]
    pub shots: Vec<Shot>,
    /// Sizes to measure, each in separate rows, instead of that of the command line.
    #[serde(default)]
    pub resolutions: Vec<Resolution>,
    /// Overscan on each side, degrees.
    #[serde(default)]
    pub overscan_deg: f64,
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
    /// Columns of the first table that is printed in the terminal and shown on the HTML page.
    table: Vec<Shown>,
    #[serde(default)]
    further_tables: Vec<Printed>,
    #[serde(default)]
    pub(super) cited: Cited,
}

/// A shot, and the scene of the publication that it replaces.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shot {
    pub name: String,
    pub stands_for: Option<String>,
}

/// A named size of each eye's image.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Resolution {
    pub name: String,
    pub width: u32,
    pub height: u32,
    /// Outer radii of the inner and the middle foveal layer, in pixels of this size.
    layer_radii_px: Option<[f64; 2]>,
}

/// A further table, with the same rows as the first.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Printed {
    heading: String,
    caption: String,
    table: Vec<Shown>,
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
    /// Number of frames between the pose that a frame is rendered from and the pose at its display, for
    /// [`Camera::Late`].
    pub late_frames: Option<u32>,
    /// Groups of passes, as in `--ratios`, that run on all devices; all others run on the primary. Without this key,
    /// all groups run on all devices.
    pub distribute: Option<Vec<String>>,
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
    pub(super) resolution: Option<String>,
    pub(super) camera: Option<Camera>,
    pub(super) arrangement: String,
    pub(super) values: BTreeMap<String, f64>,
}

/// Names of text columns, besides the column of arrangements.
const LABELS: [&str; 8] = ["source", "scene", "shot", "stands_for", "camera", "resolution", "size", "devices"];

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
        let mut names = BTreeSet::from(LABELS);
        if !is_snake(&self.name) || ["frames", "rings"].contains(&&self.name[..]) {
            return Err(format!("name: '{}' must be in snake_case, and neither frames nor rings", self.name));
        }
        if [self.frames.warm_up, self.frames.repeats].into_iter().flatten().any(|count| count > 1000) {
            return Err("frames: give at most 1000".to_owned());
        }
        if self.cameras().is_empty() {
            return Err("cameras: give at least one, or leave out the key".to_owned());
        }
        let labels = self.labels();
        if let Some(unknown) = labels.iter().find(|name| !LABELS.contains(name) && **name != self.arrangements) {
            return Err(format!("labels: there is no '{unknown}': choose of {}", LABELS.join(", ")));
        }
        if labels.iter().collect::<BTreeSet<_>>().len() < labels.len() {
            return Err("labels: name each column once".to_owned());
        }
        if self.resolutions.iter().any(|resolution| resolution.width == 0 || resolution.height == 0) {
            return Err("resolutions: width and height must be above 0".to_owned());
        }
        if !(0.0..=45.0).contains(&self.overscan_deg) {
            return Err("overscan_deg: give a number from 0 to 45".to_owned());
        }
        let is_alone = |camera: &&Camera| matches!(camera, Camera::Late | Camera::Following);
        if let Some(camera) = self.cameras().iter().find(is_alone).filter(|_| self.cameras().len() > 1) {
            return Err(format!("cameras: {} cannot be combined with other cameras", camera.name()));
        }
        let is_late = self.cameras().contains(&Camera::Late);
        if let Some(other) = self.all.iter().find(|one| one.late_frames.is_some_and(|n| n > 0) != is_late) {
            return Err(format!("arrangement: {}: late_frames above 0 goes with the camera late", other.name));
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
        self.columns.iter().try_for_each(|column| column.check(&self.columns, self.cameras()))?;
        let blank = vec![None; self.columns.len()];
        for shown in self.printed().flat_map(|(_, _, table)| table) {
            self.cell(shown, &blank).map_err(|reason| format!("table: {}: cell: {reason}", shown.head))?;
        }
        for CitedRow { scene, resolution, arrangement, values, .. } in &self.cited.rows {
            let is_known = |name: &String| self.resolutions.iter().any(|known| known.name == *name);
            if let Some(unknown) = resolution.as_ref().filter(|name| !is_known(name)) {
                return Err(format!("cited: {scene}: there is no resolution '{unknown}'"));
            }
            if !before.contains(arrangement) {
                return Err(format!("cited: {scene}: there is no arrangement '{arrangement}'"));
            }
            if let Some(unknown) = values.keys().find(|name| self.at(name).is_none()) {
                return Err(format!("cited: {scene}: values: there is no column '{unknown}'"));
            }
        }
        Ok(())
    }

    pub(super) fn at(&self, column: &str) -> Option<usize> {
        self.columns.iter().position(|known| known.name == column)
    }

    /// Returns the camera motions to measure.
    pub fn cameras(&self) -> &[Camera] {
        self.cameras.as_deref().unwrap_or(&[Camera::Approaching])
    }

    /// Returns the names of a row's text columns.
    pub fn labels(&self) -> Vec<&str> {
        match &self.labels {
            Some(labels) => labels.iter().map(String::as_str).collect(),
            None => {
                let camera = self.cameras.is_some().then_some("camera");
                ["source", "scene"].into_iter().chain(camera).chain([&self.arrangements[..]]).collect()
            }
        }
    }

    /// Returns the names of the columns that tell arrangements apart in `frames.csv`.
    pub fn frame_labels(&self) -> Vec<&str> {
        let of_row = ["source", "scene", "stands_for", "size", "devices"];
        let labels: Vec<&str> = self.labels().into_iter().filter(|label| !of_row.contains(label)).collect();
        let without = |label| Some(label).filter(|label| !labels.contains(label));
        // A run along a path has a single shot.
        let shot = without("shot").filter(|_| !self.cameras().contains(&Camera::Following));
        let arrangement = without(&self.arrangements[..]);
        shot.into_iter().chain(labels.iter().copied()).chain(arrangement).collect()
    }

    /// Returns heading, caption and columns of all tables.
    pub(super) fn printed(&self) -> impl Iterator<Item = (&str, &str, &[Shown])> {
        let further = self.further_tables.iter().map(|of| (&of.heading[..], &of.caption[..], &of.table[..]));
        [(&self.heading[..], &self.caption[..], &self.table[..])].into_iter().chain(further)
    }

    /// True if published numbers stand in columns beside the measured ones instead of in rows.
    pub(super) fn cites_beside(&self) -> bool {
        self.columns.iter().any(|column| column.cited.is_some())
    }

    /// Returns true if any column shows one of these measures.
    pub fn has_any(&self, measures: &[&str]) -> bool {
        self.columns.iter().filter_map(|column| column.measure.as_deref()).any(|name| measures.contains(&name))
    }

    /// Returns a sentence with the source of the published numbers, if there are any.
    pub(super) fn cited_note(&self) -> Option<String> {
        (!self.cited.rows.is_empty()).then(|| format!("Cited: {}", self.cited.source))
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

impl Resolution {
    /// Returns the size in pixels, scaled by `factor`.
    pub fn size(&self, factor: f64) -> Extent {
        let scaled = |length: u32| ((f64::from(length) * factor).round() as u32).max(1);
        Extent::new(scaled(self.width), scaled(self.height))
    }

    /// Returns the outer radii of the inner and the middle foveal layer, as fractions of the image width.
    pub fn layer_radii(&self) -> Option<[f64; 2]> {
        self.layer_radii_px.map(|radii| radii.map(|px| px / f64::from(self.width)))
    }
}
