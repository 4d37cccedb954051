//! Binocular rivalry between neighbouring views, whose auxiliary images tell which of their pixels show the same surface.

use std::path::Path;

use anyhow::{Context, Error};

use super::aovs;
use diptych::image::exr::Tags;
use diptych::metrics::Pair;
use diptych::metrics::disparity::FeatureDisparity;
use diptych::metrics::rivalry::Differences;
use diptych::metrics::surfaces::Surfaces;

/// Explanation of why rivalry is undefined.
pub const NEEDS: &str = "needs auxiliary images of all views: render with --aov position,normal";

/// Coordinates of vectors in auxiliary images.
const XYZ: [&str; 3] = ["X", "Y", "Z"];

/// A view's image and reference, and the surfaces that it shows.
pub struct View<'a> {
    pub pair: &'a Pair,
    pub surfaces: &'a Surfaces,
    /// Surfaces that mirrors and glass show, if auxiliary images tell them.
    pub shown: Option<&'a Surfaces>,
    /// Metadata of the auxiliary images.
    pub tags: &'a Tags,
}

/// Surfaces that a view shows in a frame, and the metadata of their file.
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

    pub fn view<'a>(&'a self, pair: &'a Pair) -> View<'a> {
        View { pair, surfaces: &self.surfaces, shown: self.shown.as_ref(), tags: &self.tags }
    }
}

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

/// Subtracts the errors of the right one of two neighbours from those of the left one; `None` if metadata do not tell its
/// camera. Compares what mirrors and glass show if auxiliary images of both tell it.
pub fn differences([left, right]: [&View; 2]) -> Result<Option<Differences>, Error> {
    let Some((world_to_ndc, centre)) = camera(right.tags) else { return Ok(None) };
    let (of_left, of_right) = left.shown.zip(right.shown).unwrap_or((left.surfaces, right.surfaces));
    let in_right = of_left.in_other_eye(of_right, world_to_ndc, centre)?;
    let differ = || "the auxiliary images differ from the images in size";
    Ok(Some(Differences::new(left.pair, right.pair, &in_right).with_context(differ)?))
}

/// Returns the errors of the disparity of highlights and reflections between two neighbours; none if metadata do not tell
/// the right one's camera.
pub fn features([left, right]: [&View; 2]) -> Result<Vec<f64>, Error> {
    let Some((world_to_ndc, centre)) = camera(right.tags) else { return Ok(Vec::new()) };
    Ok(FeatureDisparity::errors(left.pair, right.pair, left.surfaces, world_to_ndc, centre)?)
}

/// Returns pairs of neighbours, from left to right.
pub fn neighbours<T>(views: &[T]) -> impl Iterator<Item = [&T; 2]> {
    views.windows(2).map(|pair| [&pair[0], &pair[1]])
}
