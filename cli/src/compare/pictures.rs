//! Compares pictures: PNG or JPEG files, whose levels are display values already.

use std::path::Path;

use anyhow::{Context, bail, ensure};

use crate::failure::Failure;
use diptych::image::display::DisplayImage;
use diptych::image::{Extent, Image};
use diptych::metrics::Pair;
use diptych::metrics::heatmap::{flip_heatmap, heatmap};

use super::{Args, check_seams, text, write_map};

/// Maximum width and height of a picture, pixels.
const MOST_PIXELS: u32 = 1 << 15;

/// True if the file's name is that of a picture.
pub fn is_picture(path: &Path) -> bool {
    let is = |extension: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
    ["png", "jpg", "jpeg"].into_iter().any(is)
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let pair = compared(args).map_err(Failure::Input)?;
    write_map(&args.heatmap, || Ok(heatmap(&pair)))?;
    write_map(&args.flip_map, || Ok(flip_heatmap(&pair)))?;
    let errors = pair.errors();
    let seams = (!args.seams.is_empty()).then(|| pair.seam_error(&args.seams));
    if args.json {
        let mut all = serde_json::to_value(errors).context("cannot print JSON")?;
        if let Some(seams) = seams {
            all["seams"] = serde_json::to_value(seams).context("cannot print JSON")?;
        }
        say!("{all}");
    } else {
        text::print_errors(&[errors.values()]);
        seams.iter().for_each(|seams| text::print_seams(seams, ""));
    }
    Ok(())
}

fn compared(args: &Args) -> Result<Pair, anyhow::Error> {
    let Args { reference, image, .. } = args;
    if let Some(other) = [reference, image].into_iter().find(|path| !is_picture(path)) {
        bail!("{} is no PNG or JPEG: compare two pictures, or two OpenEXR images", other.display());
    }
    let of_radiance = [
        ("--exposure", args.exposure.is_some()),
        ("--rings", args.rings.is_some()),
        ("--by-kind", args.by_kind),
        ("--kind-map", args.kind_map.is_some()),
        ("--rivalry-map", args.rivalry_map.is_some()),
    ];
    if let Some((option, _)) = of_radiance.iter().find(|(_, is_given)| *is_given) {
        bail!("{option} needs OpenEXR images, and these are pictures");
    }
    let (first, second) = (read(reference)?, read(image)?);
    check_seams(&args.seams, second.extent)?;
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
