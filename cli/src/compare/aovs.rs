//! Auxiliary images that belong to the compared images: files beside them, or their layers.

use std::path::{Path, PathBuf};

use diptych::image::ImageError;
use diptych::image::exr::{ColourFile, read_channels, read_layer};

/// Reads an auxiliary image of the file `image`, or else its layer of this name; `None` if there is neither.
pub fn read(image: &Path, aov: &str, channels: [&'static str; 3]) -> Result<Option<ColourFile>, ImageError> {
    let file = beside(image, aov);
    if file.is_file() {
        return read_channels(&file, channels).map(Some);
    }
    if !image.is_file() {
        return Ok(None);
    }
    match read_layer(image, &format!("{aov}."), channels) {
        Err(ImageError::NoChannels { .. }) => Ok(None),
        found => found.map(Some),
    }
}

/// Returns the path of the auxiliary image that belongs to an eye's image: `left.depth.0007.exr` for `left.0007.exr`.
pub fn beside(image: &Path, aov: &str) -> PathBuf {
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
