//! Error by kind of pixel: where an image differs from its reference, by what the pixel shows.
//!
//! A pixel has the first kind that applies, in the order of [`Kind::ALL`]. Edges are found between horizontal and
//! vertical neighbours, and both pixels belong to the edge. The guides are auxiliary images of the frame, one ray per
//! pixel centre, so that the kinds do not depend on noise. Light edges are those of the reference.

use serde::Serialize;

use super::Pair;
use super::error::mean;
use crate::image::display::{DisplayImage, display_value, gain, luminance};
use crate::image::{Extent, Image, ImageError, RgbImage, check_same_size};

/// Content of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Edge between surfaces at different depths, or between a surface and the sky.
    Silhouette,
    /// Edge between normals at the same depth.
    Crease,
    /// Smooth metal or glass, which shows other surfaces.
    Reflection,
    /// Edge in the base colour.
    Texture,
    /// Edge in the reference's light, for example of a shadow.
    LightEdge,
    /// Everything else.
    Rest,
}

impl Kind {
    pub const ALL: [Self; 6] =
        [Self::Silhouette, Self::Crease, Self::Reflection, Self::Texture, Self::LightEdge, Self::Rest];

    /// Returns its name in tables, columns and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Silhouette => "silhouette",
            Self::Crease => "crease",
            Self::Reflection => "reflection",
            Self::Texture => "texture",
            Self::LightEdge => "light_edge",
            Self::Rest => "rest",
        }
    }

    /// Returns its colour on maps: those of Okabe & Ito 2008, which viewers with colour blindness can tell apart.
    pub fn colour(self) -> [u8; 3] {
        match self {
            Self::Silhouette => [213, 94, 0],
            Self::Crease => [230, 159, 0],
            Self::Reflection => [86, 180, 233],
            Self::Texture => [0, 158, 115],
            Self::LightEdge => [240, 228, 66],
            Self::Rest => [40, 40, 40],
        }
    }
}

/// Minimum depth step at a silhouette, in widths of a pixel at that depth.
const STEP_PX: f64 = 0.5;
/// Maximum dot product of the two normals at a crease: the angle between them is at least 26 degrees.
const CREASE_COS: f32 = 0.9;
/// Minimum difference at a texture edge between the square roots of a base colour channel.
const TEXTURE_STEP: f32 = 0.1;
/// Minimum difference at a light edge between the display values of demodulated illumination.
const LIGHT_STEP: f64 = 0.1;
/// Perceptual roughness below which a surface counts as [`Kind::Reflection`] if its specular albedo exceeds its
/// diffuse albedo.
const SMOOTH: f32 = 0.3;
/// Minimum albedo in the demodulation of light: smaller albedos are raised to it.
const ALBEDO_MIN: f32 = 0.05;

/// Auxiliary images (AOVs) of an eye; the fields have the names of the images. Depth and roughness are in the first
/// channel. Depth is the distance along the ray in any unit, and 0 for the sky.
#[derive(Clone, Debug)]
pub struct Guides {
    pub depth: RgbImage,
    pub normal: RgbImage,
    pub base_color: RgbImage,
    pub diffuse_albedo: RgbImage,
    pub specular_albedo: RgbImage,
    pub roughness: RgbImage,
}

impl Guides {
    fn all(&self) -> [&RgbImage; 6] {
        let Self { depth, normal, base_color, diffuse_albedo, specular_albedo, roughness } = self;
        [depth, normal, base_color, diffuse_albedo, specular_albedo, roughness]
    }
}

/// The kind of each pixel of an image, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct KindMap {
    extent: Extent,
    kinds: Vec<Kind>,
}

/// Error of the pixels of a kind.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct KindError {
    pub kind: Kind,
    /// Fraction of the image's pixels.
    pub pixels: f64,
    /// Mean FLIP; `None` without pixels.
    pub flip: Option<f64>,
    /// Fraction of the sum of FLIP over all pixels; `None` if that is 0.
    pub part: Option<f64>,
}

impl KindMap {
    /// Classifies the pixels of a reference at this exposure and vertical field of view.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn new(guides: &Guides, reference: &RgbImage, exposure_ev: f32, yfov_deg: f64) -> Result<Self, ImageError> {
        let extent = reference.extent;
        guides.all().iter().try_for_each(|guide| check_same_size(extent, guide.extent))?;
        let pixel = 2.0 * (yfov_deg.to_radians() / 2.0).tan() / f64::from(extent.height.max(1));
        let is_surface = |i: usize| guides.depth.pixels[i][0] > 0.0;
        let both = |[_, a, b, _]: &Line, differ: &dyn Fn(usize, usize) -> bool| match (*a, *b) {
            (Some(a), Some(b)) => is_surface(a) && is_surface(b) && differ(a, b),
            _ => false,
        };

        let inverse_depth = |i: usize| match f64::from(guides.depth.pixels[i][0]) {
            depth if depth > 0.0 && depth.is_finite() => 1.0 / depth,
            _ => 0.0,
        };
        let silhouettes = edges(extent, |line| gap(line.map(|i| i.map(inverse_depth))) > STEP_PX * pixel);
        let normals = &guides.normal.pixels;
        let cos = |a: usize, b: usize| (0..3).map(|c| normals[a][c] * normals[b][c]).sum::<f32>();
        let creases = edges(extent, |line| both(line, &|a, b| cos(a, b) < CREASE_COS));
        let base = |i: usize| guides.base_color.pixels[i].map(|c| c.max(0.0).sqrt());
        let steps = |a: usize, b: usize| base(a).iter().zip(base(b)).any(|(a, b)| (a - b).abs() > TEXTURE_STEP);
        let textures = edges(extent, |line| both(line, &steps));

        let gain = gain(exposure_ev);
        let albedo = |i: usize, c: usize| match is_surface(i) {
            true => guides.diffuse_albedo.pixels[i][c] + guides.specular_albedo.pixels[i][c],
            false => 1.0,
        };
        let light = |i: usize| {
            let of = |c: usize| f64::from(reference.pixels[i][c] / albedo(i, c).max(ALBEDO_MIN));
            display_value(gain * luminance([0, 1, 2].map(of)))
        };
        let lights: Vec<f64> = (0..extent.area()).map(light).collect();
        let light_edges = edges(extent, |[_, a, b, _]| match (*a, *b) {
            (Some(a), Some(b)) => (lights[a] - lights[b]).abs() > LIGHT_STEP,
            _ => false,
        });

        let sum = |pixel: [f32; 3]| luminance(pixel.map(f64::from));
        let reflects = |i: usize| {
            let (diffuse, specular) = (guides.diffuse_albedo.pixels[i], guides.specular_albedo.pixels[i]);
            is_surface(i) && guides.roughness.pixels[i][0] < SMOOTH && sum(specular) > sum(diffuse)
        };
        let kind = |i: usize| match i {
            _ if silhouettes[i] => Kind::Silhouette,
            _ if creases[i] => Kind::Crease,
            _ if reflects(i) => Kind::Reflection,
            _ if textures[i] => Kind::Texture,
            _ if light_edges[i] => Kind::LightEdge,
            _ => Kind::Rest,
        };
        Ok(Self { extent, kinds: (0..extent.area()).map(kind).collect() })
    }

    pub fn kinds(&self) -> &[Kind] {
        &self.kinds
    }

    /// Colours each pixel by its kind.
    pub fn picture(&self) -> DisplayImage {
        Image { extent: self.extent, pixels: self.kinds.iter().map(|kind| kind.colour()).collect() }
    }
}

impl Pair {
    /// Returns the error of each kind, in the order of [`Kind::ALL`].
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn by_kind(&self, map: &KindMap) -> Result<[KindError; 6], ImageError> {
        check_same_size(self.extent, map.extent)?;
        let total: f64 = self.flip.iter().sum();
        Ok(Kind::ALL.map(|kind| {
            let of_kind = || self.flip.iter().zip(&map.kinds).filter(|(_, k)| **k == kind).map(|(flip, _)| *flip);
            let count = of_kind().count();
            KindError {
                kind,
                pixels: count as f64 / self.flip.len() as f64,
                flip: (count > 0).then(|| mean(of_kind())),
                part: (total > 0.0).then(|| of_kind().fold(0.0, |sum, flip| sum + flip) / total),
            }
        }))
    }
}

/// Indices of four pixels in a row or column; the first and the last may be outside the image.
type Line = [Option<usize>; 4];

/// Returns true for each pixel with an edge between it and one of its four neighbours. `is_edge` returns true if there
/// is an edge between the two middle pixels of a line.
fn edges(extent: Extent, is_edge: impl Fn(&Line) -> bool) -> Vec<bool> {
    let (width, height) = (extent.width as usize, extent.height as usize);
    let mut found = vec![false; extent.area()];
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let a = y * width + x;
        for (at, length, stride) in [(x, width, 1), (y, height, width)] {
            if at + 1 == length {
                continue;
            }
            let b = a + stride;
            let line = [(at > 0).then(|| a - stride), Some(a), Some(b), (at + 2 < length).then_some(b + stride)];
            if is_edge(&line) {
                (found[a], found[b]) = (true, true);
            }
        }
    }
    found
}

/// Returns the depth step between the middle two of four pixels in a line, as a fraction of the depth. The argument
/// holds inverse depths.
///
/// Inverse depth is linear across the image of a plane, at any angle. The planes of both sides are extended to one
/// another; if they meet between the pixels, there is no step.
fn gap([before, a, b, after]: [Option<f64>; 4]) -> f64 {
    let (Some(a), Some(b)) = (a, b) else { return 0.0 };
    let (left, right) = (before.map(|before| a - before), after.map(|after| after - b));
    let [left, right] = [left.or(right), right.or(left)].map(Option::unwrap_or_default);
    let (at_a, at_b) = (a - (b - right), a + left - b);
    let nearest = a.max(b);
    if at_a * at_b <= 0.0 || nearest <= 0.0 {
        return 0.0;
    }
    at_a.abs().min(at_b.abs()).min((a - b).abs()) / nearest
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXTENT: Extent = Extent { width: 24, height: 16 };
    const YFOV_DEG: f64 = 60.0;

    fn at(x: u32, y: u32) -> usize {
        (y * EXTENT.width + x) as usize
    }

    fn image(pixel: impl Fn(u32, u32) -> [f32; 3]) -> RgbImage {
        Image::from_fn(EXTENT, pixel)
    }

    /// A white wall at distance 2, without edges.
    fn wall() -> Guides {
        let all = |value: [f32; 3]| RgbImage::filled(EXTENT, value);
        Guides {
            depth: all([2.0; 3]),
            normal: all([0.0, 0.0, 1.0]),
            base_color: all([0.5; 3]),
            diffuse_albedo: all([0.5; 3]),
            specular_albedo: all([0.04; 3]),
            roughness: all([1.0; 3]),
        }
    }

    fn kinds(guides: &Guides, reference: &RgbImage) -> KindMap {
        KindMap::new(guides, reference, 0.0, YFOV_DEG).unwrap()
    }

    fn grey() -> RgbImage {
        RgbImage::filled(EXTENT, [0.3; 3])
    }

    /// Distances from the eye to a floor one unit below it, and to the wall beyond the floor.
    fn floor_and_wall(wall_z: f64) -> RgbImage {
        image(|x, y| {
            let pixel = 2.0 * (YFOV_DEG.to_radians() / 2.0).tan() / f64::from(EXTENT.height);
            let [right, down] = [(x, EXTENT.width), (y, EXTENT.height)]
                .map(|(at, length)| (f64::from(at) + 0.5 - f64::from(length) / 2.0) * pixel);
            let z = if down > 0.0 { (1.0 / down).min(wall_z) } else { wall_z };
            [(z * (1.0 + right * right + down * down).sqrt()) as f32; 3]
        })
    }

    #[test]
    fn planes_meet_in_creases_without_silhouettes() {
        let depth = floor_and_wall(6.0);
        let is_floor = |y: u32| depth.pixels[at(12, y)][0] < 5.9;
        let normal = image(|_, y| if is_floor(y) { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] });
        let map = kinds(&Guides { depth: depth.clone(), normal: normal.clone(), ..wall() }, &grey());
        let first = (0..EXTENT.height).find(|y| is_floor(*y)).unwrap();
        for y in 0..EXTENT.height {
            let expected = if y == first || y + 1 == first { Kind::Crease } else { Kind::Rest };
            assert!((0..EXTENT.width).all(|x| map.kinds()[at(x, y)] == expected), "row {y}");
        }
    }

    #[test]
    fn steps_in_depth_and_the_sky_have_silhouettes() {
        let depth = image(|x, _| match x {
            0..8 => [2.0; 3],
            8..16 => [2.3; 3],
            _ => [0.0; 3],
        });
        let map = kinds(&Guides { depth, ..wall() }, &grey());
        for x in 0..EXTENT.width {
            let expected = if [7, 8, 15, 16].contains(&x) { Kind::Silhouette } else { Kind::Rest };
            assert!((0..EXTENT.height).all(|y| map.kinds()[at(x, y)] == expected), "column {x}");
        }
    }

    #[test]
    fn texture_light_and_metal_have_separate_kinds() {
        let base_color = image(|x, _| if x < 6 { [0.5; 3] } else { [0.1, 0.5, 0.5] });
        let reference = image(|x, _| if x < 12 { [0.3; 3] } else { [0.03; 3] });
        let is_metal = |x: u32| x >= 20;
        let [diffuse_albedo, specular_albedo] =
            [false, true].map(|of_metal| image(|x, _| [if is_metal(x) == of_metal { 0.5 } else { 0.0 }; 3]));
        let roughness = image(|x, _| [if is_metal(x) { 0.0 } else { 1.0 }; 3]);
        let map = kinds(&Guides { base_color, diffuse_albedo, specular_albedo, roughness, ..wall() }, &reference);
        for x in 0..EXTENT.width {
            let expected = match x {
                5 | 6 => Kind::Texture,
                11 | 12 => Kind::LightEdge,
                20.. => Kind::Reflection,
                _ => Kind::Rest,
            };
            assert!((0..EXTENT.height).all(|y| map.kinds()[at(x, y)] == expected), "column {x}");
        }
        assert_eq!(map.picture().pixels[0], Kind::Rest.colour());
    }

    /// An image that is wrong in one column has all of its error there, apart from what FLIP's filters spread.
    #[test]
    fn errors_by_kind_cover_their_pixels_and_add_up() {
        let depth = image(|x, _| if x < 12 { [2.0; 3] } else { [4.0; 3] });
        let map = kinds(&Guides { depth, ..wall() }, &grey());
        let wrong = image(|x, _| if [11, 12].contains(&x) { [3.0; 3] } else { [0.3; 3] });
        let pair = Pair::new(&grey(), &wrong, 0.0).unwrap();
        let found = pair.by_kind(&map).unwrap();
        assert_eq!(found[0].kind, Kind::Silhouette);
        assert!((found[0].pixels - 2.0 / 24.0).abs() < 1e-12);
        let parts: f64 = found.iter().filter_map(|kind| kind.part).sum();
        let pixels: f64 = found.iter().map(|kind| kind.pixels).sum();
        assert!((parts - 1.0).abs() < 1e-12 && (pixels - 1.0).abs() < 1e-12);
        assert!(found[0].flip > found[5].flip && found[1].flip.is_none() && found[1].part == Some(0.0), "{found:?}");
        assert!(found.iter().all(|kind| kind.part.is_some_and(f64::is_sign_positive)), "{found:?}");
        let same = Pair::new(&grey(), &grey(), 0.0).unwrap().by_kind(&map).unwrap();
        assert_eq!((same[0].flip, same[0].part), (Some(0.0), None));
    }

    #[test]
    fn rejects_guides_of_another_size() {
        let other = RgbImage::filled(Extent::new(2, 3), [0.0; 3]);
        assert!(KindMap::new(&wall(), &other, 0.0, YFOV_DEG).is_err());
    }
}
