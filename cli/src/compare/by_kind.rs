//! Errors by kind of pixel. Auxiliary images in the folders of the compared images tell the kinds apart.

use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::kinds::{AOVS, guides};
use diptych::image::display::DisplayImage;
use diptych::image::exr::ColourFile;
use diptych::metrics::Pair;
use diptych::metrics::kinds::{KindError, KindMap};
use diptych::passes::Aov;

use super::aovs::{self, beside};

/// An auxiliary image that is not there.
#[derive(Debug, thiserror::Error)]
#[error(
    "there is no {}, which is needed to classify pixels: render with --aov {}",
    .0.display(), AOVS.map(Aov::name).join(",")
)]
pub struct Missing(PathBuf);

/// Errors by kind of pixel, and a map of each pixel's kind.
pub struct ByKind {
    pub errors: [KindError; 6],
    pub picture: DisplayImage,
}

impl ByKind {
    /// Classifies the pixels of a pair by auxiliary images in the image's folder, or else in the reference's folder.
    ///
    /// # Errors
    /// [`Missing`] if neither folder has an auxiliary image; errors of files.
    pub fn new(
        [reference_path, image_path]: [&Path; 2],
        reference: &ColourFile,
        pair: &Pair,
        exposure_ev: f32,
        yfov_deg: f64,
    ) -> Result<Self, anyhow::Error> {
        let guides = guides(|aov| -> Result<_, anyhow::Error> {
            let channels = aov.channels();
            let channels = [0, 1, 2].map(|c| channels[c.min(channels.len() - 1)]);
            for path in [image_path, reference_path] {
                if let Some(found) = aovs::read(path, aov.name(), channels)? {
                    return Ok(found.image);
                }
            }
            Err(Missing(beside(image_path, aov.name())).into())
        })?;
        let map = KindMap::new(&guides, &reference.image, exposure_ev, yfov_deg)
            .with_context(|| format!("auxiliary images of {}", image_path.display()))?;
        Ok(Self { errors: pair.by_kind(&map)?, picture: map.picture() })
    }
}
