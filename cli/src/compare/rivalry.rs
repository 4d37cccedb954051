//! Binocular rivalry of a stereo image, whose auxiliary images tell which pixels of the eyes show the same surface.

use std::path::Path;

use anyhow::{Context, Error};

use super::aovs;
use diptych::exec::PerView;
use diptych::image::exr::Tags;
use diptych::metrics::Pair;
use diptych::metrics::disparity::FeatureDisparity;
use diptych::metrics::rivalry::Differences;
use diptych::metrics::surfaces::Surfaces;

/// Explanation of why rivalry is undefined.
pub const NEEDS: &str = "needs auxiliary images of both eyes: render with --aov position,normal";

/// Coordinates of vectors in auxiliary images.
const XYZ: [&str; 3] = ["X", "Y", "Z"];

/// Surfaces that an eye sees in a frame, and the metadata of their file.
pub struct Seen {
    pub surfaces: Surfaces,
    /// Surfaces that mirrors and glass show, if auxiliary images tell them.
    pub shown: Option<Surfaces>,
    pub tags: Tags,
}

impl Seen {
    /// Reads the auxiliary images `position` and `normal` beside the first of `images` that has them; `None` if none
    /// has.
    pub fn read(images: &[&Path]) -> Result<Option<Self>, Error> {
        for image in images {
            let found = (aovs::read(image, "position", XYZ)?, aovs::read(image, "normal", XYZ)?);
            if let (Some(position), Some(normal)) = found {
                let surfaces = Surfaces::new(position.image, normal.image)?;
                return Ok(Some(Self { surfaces, shown: shown(image)?, tags: position.tags }));
            }
        }
        Ok(None)
    }
}

/// Surfaces of an eye: its own, and those that mirrors and glass show, if auxiliary images tell them.
pub type OfEye<'a> = (&'a Surfaces, Option<&'a Surfaces>);

/// Reads the auxiliary images `shown_position`, `shown_normal` and `virtual_position` beside an image; `None` if one is
/// missing.
pub fn shown(image: &Path) -> Result<Option<Surfaces>, Error> {
    let read = |name| aovs::read(image, name, XYZ);
    let found = (read("shown_position")?, read("shown_normal")?, read("virtual_position")?);
    let (Some(position), Some(normal), Some(seen_at)) = found else { return Ok(None) };
    Ok(Some(Surfaces::new(position.image, normal.image)?.seen_at(seen_at.image)?))
}

/// Returns the projection of an eye's camera and the centre of its pixels, if metadata tell them.
fn camera(tags: &Tags) -> Option<(&[[f32; 4]; 4], [f32; 2])> {
    Some((tags.world_to_ndc.as_ref()?, tags.pixel_centre.unwrap_or([0.5; 2])))
}

/// Subtracts the right eye's errors from the left eye's; `None` if `right_tags`, the metadata of the right eye's
/// auxiliary images, do not tell its camera. Compares what mirrors and glass show if auxiliary images of both eyes tell
/// it.
pub fn differences(
    pairs: &PerView<&Pair>,
    [left, right]: [OfEye; 2],
    right_tags: &Tags,
) -> Result<Option<Differences>, Error> {
    let Some((world_to_ndc, centre)) = camera(right_tags) else { return Ok(None) };
    let (left, right) = left.1.zip(right.1).unwrap_or((left.0, right.0));
    let in_right = left.in_other_eye(right, world_to_ndc, centre)?;
    let differ = || "the auxiliary images differ from the images in size";
    Ok(Some(Differences::new(pairs.left(), pairs.right(), &in_right).with_context(differ)?))
}

/// Measures the disparity of highlights and reflections; nothing if `right_tags` do not tell the right eye's camera.
pub fn features(pairs: &PerView<&Pair>, left: &Surfaces, right_tags: &Tags) -> Result<FeatureDisparity, Error> {
    let Some((world_to_ndc, centre)) = camera(right_tags) else { return Ok(FeatureDisparity::default()) };
    Ok(FeatureDisparity::new(pairs.left(), pairs.right(), left, world_to_ndc, centre)?)
}
