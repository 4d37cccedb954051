//! Results of a comparison, as printed by `--json`, and their warnings.

use diptych::exec::PerView;
use diptych::image::exr::{ColourSource, Tags};
use diptych::metrics::Errors;
use diptych::metrics::disparity::FeatureDisparity;
use diptych::metrics::kinds::KindError;
use diptych::metrics::rings::{Ring, Viewing};
use diptych::metrics::rivalry::Rivalry;
use diptych::metrics::seams::SeamError;
use serde::Serialize;

use super::rows;
use super::viewing::Source;

/// Results for a pair of images, as printed by `--json`.
#[derive(Serialize)]
pub struct Findings {
    pub(super) exposure_ev: f32,
    pub(super) exposure_source: Source,
    #[serde(flatten)]
    pub(super) errors: Errors,
    /// Contradictions between the metadata of the images.
    pub(super) warnings: Vec<String>,
    pub(super) reference_source: ColourSource,
    pub(super) image_source: ColourSource,
    /// Metadata stored in the files.
    pub(super) reference_tags: Tags,
    pub(super) image_tags: Tags,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rings: Option<Rings>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) by_kind: Option<[KindError; 6]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) seams: Option<SeamError>,
}

#[derive(Serialize)]
pub(super) struct Rings {
    #[serde(flatten)]
    pub(super) viewing: Viewing,
    pub(super) yfov_source: Source,
    pub(super) rings: Vec<Ring>,
}

/// Results for the views of a rig, as printed by `--json`.
#[derive(Serialize)]
pub(super) struct AllFindings<'a> {
    #[serde(flatten)]
    pub(super) views: PerView<&'a Findings>,
    /// Means over views; `null` for measures that are undefined in one of them.
    pub(super) mean: serde_json::Map<String, serde_json::Value>,
    /// Means over neighbouring views; `null` without auxiliary images that tell which of their pixels show the same
    /// surface.
    #[serde(flatten)]
    pub(super) rivalry: Rivalry,
    #[serde(flatten)]
    pub(super) features: FeatureDisparity,
}

impl Findings {
    pub(super) fn warn(&self, of: &str) {
        self.warnings.iter().for_each(|warning| log!("warning: {of}{warning}"));
    }
}

impl Rings {
    pub(super) fn warn(&self) {
        if self.yfov_source == Source::Default {
            let assumed = self.viewing.yfov_deg;
            log!(
                "warning: neither file stores its field of view, so --by rings assumes {assumed} degrees: give --yfov"
            );
        }
    }
}

/// Returns the mean of each measure over views, if it is defined in all of them.
pub(super) fn mean<'a>(views: impl ExactSizeIterator<Item = &'a Findings> + Clone) -> [Option<f64>; 9] {
    std::array::from_fn(|i| rows::mean(views.clone().map(|view| view.errors.values()[i])))
}
