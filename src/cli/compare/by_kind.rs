//! Errors by kind of pixel. Auxiliary images in the folders of the compared images tell the kinds apart.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::cli::kinds::{AOVS, guides};
use crate::image::display::DisplayImage;
use crate::image::exr::{ColourFile, read_channels};
use crate::metrics::Pair;
use crate::metrics::kinds::{KindError, KindMap};
use crate::passes::Aov;

/// Errors by kind of pixel, and a map of each pixel's kind.
pub struct ByKind {
    pub errors: [KindError; 6],
    pub picture: DisplayImage,
}

impl ByKind {
    /// Classifies the pixels of a pair by auxiliary images in the image's folder, or else in the reference's folder.
    ///
    /// # Errors
    /// A message that names the missing file.
    pub fn new(
        [reference_path, image_path]: [&Path; 2],
        reference: &ColourFile,
        pair: &Pair,
        exposure_ev: f32,
        yfov_deg: f64,
    ) -> Result<Self, anyhow::Error> {
        let guides = guides(|aov| {
            let paths = [image_path, reference_path].map(|path| beside(path, aov.name()));
            let Some(path) = paths.iter().find(|path| path.is_file()) else {
                bail!(
                    "there is no {}, which is needed to classify pixels: render with --aov {}",
                    paths[0].display(),
                    AOVS.map(Aov::name).join(",")
                );
            };
            let channels = aov.channels();
            Ok(read_channels(path, [0, 1, 2].map(|c| channels[c.min(channels.len() - 1)]))?.image)
        })?;
        let map = KindMap::new(&guides, &reference.image, exposure_ev, yfov_deg)
            .with_context(|| format!("auxiliary images of {}", image_path.display()))?;
        Ok(Self { errors: pair.by_kind(&map)?, picture: map.picture() })
    }
}

/// Returns the path of the auxiliary image that belongs to an eye's image: `left.depth.0007.exr` for `left.0007.exr`.
pub(super) fn beside(image: &Path, aov: &str) -> PathBuf {
    let name = image.file_name().unwrap_or_default().to_string_lossy();
    let (eye, rest) = name.split_once('.').unwrap_or((&name, "exr"));
    image.with_file_name(format!("{eye}.{aov}.{rest}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn auxiliary_images_lie_beside_the_image() {
        for (image, expected) in [("a/left.exr", "a/left.depth.exr"), ("right.0007.exr", "right.depth.0007.exr")] {
            assert_eq!(beside(Path::new(image), "depth"), Path::new(expected));
        }
    }
}
