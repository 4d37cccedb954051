//! Compares pictures: PNG or JPEG files, whose levels are display values already.

use std::path::Path;

use anyhow::{Context, bail, ensure};

use crate::failure::Failure;
use diptych::image::display::DisplayImage;
use diptych::image::{Extent, Image};
use diptych::metrics::heatmap::{flip_heatmap, heatmap};
use diptych::metrics::seams::SeamError;
use diptych::metrics::{Errors, Pair};
use serde::Serialize;

use super::rows::{self, Values};
use super::{Comparison, check_seams, maps, text};

/// Maximum width and height of a picture, pixels.
const MOST_PIXELS: u32 = 1 << 15;

/// True if the file's name is that of a picture.
pub fn is_picture(path: &Path) -> bool {
    let is = |extension: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
    ["png", "jpg", "jpeg"].into_iter().any(is)
}

/// Results as printed by `--json`.
#[derive(Serialize)]
struct Found {
    #[serde(flatten)]
    errors: Errors,
    #[serde(skip_serializing_if = "Option::is_none")]
    seams: Option<SeamError>,
}

pub fn run(comparison: &Comparison<'_>) -> Result<Values, Failure> {
    let pair = compared(comparison).map_err(Failure::Input)?;
    let seams = &comparison.by.seams;
    let found = Found { errors: pair.errors(), seams: (!seams.is_empty()).then(|| pair.seam_error(seams)) };
    let maps = || Ok(vec![(maps::ERROR, Ok(heatmap(&pair))), (maps::FLIP, Ok(flip_heatmap(&pair)))]);
    comparison.finish(&found, maps, || {
        text::print_errors(&[found.errors.values()]);
        found.seams.iter().for_each(|seams| text::print_seams(seams, ""));
    })?;
    Ok(rows::of_errors(found.errors.values()))
}

fn compared(comparison: &Comparison<'_>) -> Result<Pair, anyhow::Error> {
    let Comparison { args, by, image, .. } = comparison;
    let (reference, image) = (&*args.reference, *image);
    if let Some(other) = [reference, image].into_iter().find(|path| !is_picture(path)) {
        bail!("{} is no PNG or JPEG: compare two pictures, or two OpenEXR images", other.display());
    }
    let [rings, kind, _] = by.names();
    let of_radiance = [("--exposure", args.exposure.is_some()), rings, kind, ("--yfov", args.yfov.is_some())];
    if let Some((option, _)) = of_radiance.iter().find(|(_, is_given)| *is_given) {
        bail!("{option} needs OpenEXR images, and these are pictures");
    }
    let (first, second) = (read(reference)?, read(image)?);
    check_seams(&by.seams, second.extent)?;
    let pair = Pair::of_pictures(&first, &second);
    pair.with_context(|| format!("cannot compare {} with {}", image.display(), reference.display()))
}

/// Reads the colours of a picture, 8 bits per channel. Transparency is left out.
fn read(path: &Path) -> Result<DisplayImage, anyhow::Error> {
    let decode = || -> Result<DisplayImage, anyhow::Error> {
        let mut reader = ::image::ImageReader::open(path)?.with_guessed_format()?;
        let mut limits = ::image::Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(MOST_PIXELS), Some(MOST_PIXELS));
        reader.limits(limits);
        let rgb = reader.decode()?.into_rgb8();
        let extent = Extent::new(rgb.width(), rgb.height());
        ensure!(extent.area() > 0, "it has no pixels");
        Ok(Image { extent, pixels: rgb.pixels().map(|p| p.0).collect() })
    };
    decode().with_context(|| format!("cannot read {}: check that it is a whole PNG or JPEG", path.display()))
}
