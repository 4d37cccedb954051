//! Binocular rivalry of a stereo image, whose auxiliary images tell which pixels of the eyes show the same surface.

use std::path::Path;

use anyhow::{Context, Error};

use super::aovs;
use crate::exec::Stereo;
use crate::image::exr::Tags;
use crate::metrics::Pair;
use crate::metrics::disparity::FeatureDisparity;
use crate::metrics::rivalry::Differences;
use crate::metrics::surfaces::Surfaces;

/// Explanation of why rivalry is undefined.
pub const NEEDS: &str = "needs auxiliary images of both eyes: render with --aov position,normal";

/// Surfaces that an eye sees in a frame, and the metadata of their file.
pub struct Seen {
    pub surfaces: Surfaces,
    pub tags: Tags,
}

impl Seen {
    /// Reads the auxiliary images `position` and `normal` beside the first of `images` that has them; `None` if none
    /// has.
    pub fn read(images: &[&Path]) -> Result<Option<Self>, Error> {
        let xyz = ["X", "Y", "Z"];
        for image in images {
            let found = (aovs::read(image, "position", xyz)?, aovs::read(image, "normal", xyz)?);
            if let (Some(position), Some(normal)) = found {
                return Ok(Some(Self { surfaces: Surfaces::new(position.image, normal.image)?, tags: position.tags }));
            }
        }
        Ok(None)
    }
}

/// Subtracts the right eye's errors from the left eye's; `None` if `right_tags`, the metadata of the right eye's
/// auxiliary images, do not tell its camera.
pub fn differences(
    pairs: &Stereo<&Pair>,
    surfaces: &Stereo<&Surfaces>,
    right_tags: &Tags,
) -> Result<Option<Differences>, Error> {
    let Some(world_to_ndc) = right_tags.world_to_ndc else {
        return Ok(None);
    };
    let centre = right_tags.pixel_centre.unwrap_or([0.5; 2]);
    let in_right = surfaces.left.in_other_eye(surfaces.right, &world_to_ndc, centre)?;
    let differ = || "the auxiliary images position and normal differ from the images in size";
    Ok(Some(Differences::new(pairs.left, pairs.right, &in_right).with_context(differ)?))
}

/// Measures the disparity of highlights and reflections; nothing if `right_tags` do not tell the right eye's camera.
pub fn features(pairs: &Stereo<&Pair>, left: &Surfaces, right_tags: &Tags) -> Result<FeatureDisparity, Error> {
    let Some(world_to_ndc) = right_tags.world_to_ndc else {
        return Ok(FeatureDisparity::default());
    };
    let centre = right_tags.pixel_centre.unwrap_or([0.5; 2]);
    Ok(FeatureDisparity::new(pairs.left, pairs.right, left, &world_to_ndc, centre)?)
}
