//! Image errors by name, and the selection of them that tables show.

use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

use diptych::metrics;
use diptych::metrics::kinds::KindError;
use diptych::metrics::rings::Viewing;
use diptych::metrics::rivalry::Rivalry;
use diptych::metrics::temporal::{Change, TemporalError};

/// Metrics that tables show, in this order. Files contain these first, then all other metrics.
pub(super) const SHOWN: [&str; 11] = [
    "rmse",
    "relmse",
    "psnr",
    "ssim",
    "flip",
    FLICKER,
    ERROR,
    "flip_foveated",
    "flip_acuity",
    "rivalry_seen",
    "mean_ratio",
];

/// Names of two metrics: the flicker between frames, and FLIP + flicker, the error of Pareto fronts and ladders
/// ([`diptych::control::Measure::FlipFlicker`]).
pub(super) const FLICKER: &str = "flicker";
pub const ERROR: &str = "flip_flicker";

/// Factor of the reference's own relMSE (its noise). A smaller relMSE of an image cannot be distinguished from this
/// noise.
pub(super) const NOISE_MARGIN: f64 = 4.0;

/// Errors of one eye by name. The names are those in the JSON of [`SeenErrors`], `flicker` and [`ERROR`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Errors(pub(super) serde_json::Map<String, serde_json::Value>);

impl Errors {
    /// Returns the mean of each error over the repeats. An error that is undefined in one repeat has no mean.
    pub fn mean_of(comparisons: &[impl Serialize]) -> Self {
        let all: Vec<serde_json::Value> = comparisons.iter().filter_map(|c| serde_json::to_value(c).ok()).collect();
        let names = all.first().and_then(|v| v.as_object()).into_iter().flat_map(|v| v.keys());
        let mean = |name: &String| -> Option<f64> {
            let values: Option<Vec<f64>> = all.iter().map(|v| v.get(name)?.as_f64()).collect();
            values.map(|v| v.iter().sum::<f64>() / v.len() as f64)
        };
        Self(names.map(|name| (name.clone(), mean(name).into())).collect())
    }

    /// Returns the errors of an eye over compared frames, and those of each frame. Each frame has its errors, and its
    /// change since the frame before it.
    pub(super) fn of(compared: impl Iterator<Item = (SeenErrors, Option<Change>)>) -> (Self, Vec<Self>) {
        let (found, changes): (Vec<SeenErrors>, Vec<Option<Change>>) = compared.unzip();
        let flicker =
            |changes: &[Option<Change>]| TemporalError::from(changes.iter().flatten().copied().sum::<Change>()).flicker;
        let of_frame = |(i, found): (usize, &SeenErrors)| {
            Self::mean_of(&[found]).with_flicker(flicker(&changes[i..changes.len().min(i + 2)]))
        };
        let each = found.iter().enumerate().map(of_frame).collect();
        (Self::mean_of(&found).with_flicker(flicker(&changes)), each)
    }

    pub fn get(&self, name: &str) -> Option<f64> {
        self.0.get(name)?.as_f64()
    }

    /// Adds the flicker between frames, and the sum of FLIP and flicker, which is undefined if one of them is.
    pub(super) fn with_flicker(mut self, flicker: Option<f64>) -> Self {
        let sum = self.get("flip").zip(flicker).map(|(flip, flicker)| flip + flicker);
        for (name, value) in [(FLICKER, flicker), (ERROR, sum)] {
            self.0.insert(name.to_owned(), value.into());
        }
        self
    }

    /// Returns the names of the errors, those of [`SHOWN`] first.
    pub(super) fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.0.keys().map(String::as_str).collect();
        names.sort_by_key(|n| SHOWN.iter().position(|s| s == n).unwrap_or(SHOWN.len()));
        names
    }
}

/// Errors of an eye: unweighted ones, and FLIP weighted by visual acuity around the gaze.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SeenErrors {
    #[serde(flatten)]
    pub all: metrics::Errors,
    /// The result of [`metrics::Pair::foveated_flip`].
    pub flip_foveated: f64,
    /// The result of [`metrics::Pair::acuity_flip`].
    pub flip_acuity: f64,
    #[serde(flatten)]
    pub by_kind: KindColumns,
    /// How much the errors of this and the other eye differ, which is the same for both.
    #[serde(flatten)]
    pub rivalry: Option<Rivalry>,
}

/// Errors by kind of pixel, serialized as the members `flip_KIND` and `part_KIND` ([`KindError`]); `None` adds no
/// members.
#[derive(Clone, Copy, Debug, Default)]
pub struct KindColumns(pub Option<[KindError; 6]>);

impl Serialize for KindColumns {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for KindError { kind, flip, part, .. } in self.0.iter().flatten() {
            map.serialize_entry(&format!("flip_{}", kind.name()), flip)?;
            map.serialize_entry(&format!("part_{}", kind.name()), part)?;
        }
        map.end()
    }
}

impl SeenErrors {
    pub fn new(pair: &metrics::Pair, viewing: &Viewing) -> Self {
        Self {
            all: pair.errors(),
            flip_foveated: pair.foveated_flip(viewing),
            flip_acuity: pair.acuity_flip(viewing),
            by_kind: KindColumns::default(),
            rivalry: None,
        }
    }
}
