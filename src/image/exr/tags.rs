//! Image metadata in the attributes of a file's header, under OpenEXR's own names where they exist.

use ::exr::meta::attribute::{AttributeValue, Text};
use ::exr::meta::header::{Header, LayerAttributes};
use serde::Serialize;

use crate::image::Extent;

/// Metadata of an image. Files of other programs may hold only some of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Tags {
    /// `worldToCamera`, for row vectors: (x, y, z, 1) times the matrix. The camera looks along +z, with x to the right
    /// and y up.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub world_to_camera: Option<[[f32; 4]; 4]>,
    /// `worldToNDC`, for row vectors: after division by w, (0, 0) is the image's top left corner and (1, 1) the bottom
    /// right one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub world_to_ndc: Option<[[f32; 4]; 4]>,
    /// `fieldOfViewVertical`, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub yfov_deg: Option<f32>,
    /// `view`: `left` or `right`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eye: Option<String>,
    /// `imageCounter`: the frame number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<i32>,
    /// `diptych.time_s`: the frame's time in seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
    /// `diptych.exposure_ev`: exposure in stops for display. The image's values are not scaled by it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure_ev: Option<f32>,
    /// `diptych.baseline_m` and `diptych.baseline_units`: distance between the eyes in metres and in scene units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub baseline_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub baseline_units: Option<f64>,
    /// `diptych.pixel_centre`, of auxiliary images: sample position in each pixel, from its top left corner.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_centre: Option<[f32; 2]>,
}

const FRAME: &str = "imageCounter";
const TIME: &str = "diptych.time_s";
const EXPOSURE: &str = "diptych.exposure_ev";
const BASELINE_M: &str = "diptych.baseline_m";
const BASELINE_UNITS: &str = "diptych.baseline_units";
const PIXEL_CENTRE: &str = "diptych.pixel_centre";

impl Tags {
    /// Reads the metadata of a part. Invalid numbers count as missing.
    pub(super) fn of(header: &Header) -> Self {
        let own = &header.own_attributes;
        let other = |name: &str| {
            let name = Text::new_or_none(name)?;
            own.other.get(&name).or_else(|| header.shared_attributes.other.get(&name))
        };
        let number = |name| match *other(name)? {
            AttributeValue::F64(value) => Some(value),
            AttributeValue::F32(value) => Some(f64::from(value)),
            _ => None,
        };
        let finite = |name| number(name).filter(|value| value.is_finite());
        let matrix = |values: Option<[f32; 16]>| {
            let rows = |v: [f32; 16]| std::array::from_fn(|r| std::array::from_fn(|c| v[4 * r + c]));
            values.filter(|v| v.iter().all(|c| c.is_finite())).map(rows)
        };
        Self {
            world_to_camera: matrix(own.world_to_camera),
            world_to_ndc: matrix(own.world_to_normalized_device),
            yfov_deg: own.vertical_field_of_view.filter(|deg| *deg > 0.0 && *deg < 180.0),
            eye: own.view_name.as_ref().map(Text::to_string),
            frame: match other(FRAME) {
                Some(AttributeValue::I32(frame)) => Some(*frame),
                _ => None,
            },
            time_s: finite(TIME),
            exposure_ev: finite(EXPOSURE).map(|ev| ev as f32),
            baseline_m: finite(BASELINE_M),
            baseline_units: finite(BASELINE_UNITS),
            pixel_centre: match other(PIXEL_CENTRE) {
                Some(AttributeValue::FloatVec2(at)) => Some([at.0, at.1]),
                _ => None,
            },
        }
    }

    /// Returns the header's attributes. They include the program's name unless there is no metadata.
    pub(super) fn attributes(&self, extent: Extent) -> LayerAttributes {
        let flat = |rows: [[f32; 4]; 4]| -> [f32; 16] { std::array::from_fn(|i| rows[i / 4][i % 4]) };
        let mut attributes = LayerAttributes {
            world_to_camera: self.world_to_camera.map(flat),
            world_to_normalized_device: self.world_to_ndc.map(flat),
            vertical_field_of_view: self.yfov_deg,
            view_name: self.eye.as_deref().and_then(Text::new_or_none),
            ..LayerAttributes::default()
        };
        let others = [
            (FRAME, self.frame.map(AttributeValue::I32)),
            (TIME, self.time_s.map(AttributeValue::F64)),
            (EXPOSURE, self.exposure_ev.map(AttributeValue::F32)),
            (BASELINE_M, self.baseline_m.map(AttributeValue::F64)),
            (BASELINE_UNITS, self.baseline_units.map(AttributeValue::F64)),
            (PIXEL_CENTRE, self.pixel_centre.map(|[x, y]| AttributeValue::FloatVec2((x, y).into()))),
        ];
        for (name, value) in others {
            attributes.other.extend(Text::new_or_none(name).zip(value));
        }
        if *self != Self::default() {
            attributes.software_name = Text::new_or_none(concat!("diptych ", env!("CARGO_PKG_VERSION")));
        }
        // `screenWindowWidth` is the image's width at distance 1 from the camera.
        if let Some(yfov_deg) = self.yfov_deg {
            let height = 2.0 * (f64::from(yfov_deg).to_radians() / 2.0).tan();
            attributes.screen_window_width = (height * f64::from(extent.width) / f64::from(extent.height)) as f32;
        }
        attributes
    }

    /// Returns the vertical field of view in degrees: `yfov_deg` if there is one, else derived from the two matrices.
    pub fn field_of_view_deg(&self) -> Option<f64> {
        let said = self.yfov_deg.and_then(|deg| deg.to_string().parse().ok());
        said.or_else(|| self.field_of_view_of_matrices())
    }

    fn field_of_view_of_matrices(&self) -> Option<f64> {
        let (camera, ndc) = (self.world_to_camera?, self.world_to_ndc?);
        let column = |matrix: [[f32; 4]; 4], c: usize| [0, 1, 2].map(|row: usize| f64::from(matrix[row][c]));
        let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (up, forward) = (column(camera, 1), column(camera, 2));
        // Change of a homogeneous coordinate per unit step along a camera axis.
        let share = |of: [f64; 3], axis: [f64; 3]| dot(of, axis) / dot(axis, axis);
        let tan_half = 0.5 * (share(column(ndc, 3), forward) / share(column(ndc, 1), up)).abs();
        (tan_half.is_finite() && tan_half > 0.0).then(|| 2.0 * tan_half.atan().to_degrees())
    }
}

/// Sorts the attributes of a single-part file by name, so that equal images give equal bytes: the exr crate writes
/// custom attributes in the order of a hash map, which differs between runs. The header's length does not change.
pub(super) fn sort(file: &mut [u8]) {
    // Length of the magic number and the version, in bytes.
    const BEGIN: usize = 8;
    let mut attributes = Vec::new();
    let mut rest = file.get(BEGIN..).unwrap_or_default();
    while let Some((attribute, after)) = attribute(rest) {
        attributes.push(attribute.to_vec());
        rest = after;
    }
    attributes.sort();
    let sorted = attributes.concat();
    file[BEGIN..BEGIN + sorted.len()].copy_from_slice(&sorted);
}

/// Splits the first attribute (name, type, length and value) from the rest. Returns `None` at the header's end.
fn attribute(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let text_end = |from: usize| Some(from + bytes.get(from..)?.iter().position(|byte| *byte == 0)? + 1);
    let name_end = text_end(0).filter(|end| *end > 1)?;
    let type_end = text_end(name_end)?;
    let length = u32::from_le_bytes(*bytes.get(type_end..)?.first_chunk()?);
    bytes.split_at_checked(type_end + 4 + length as usize)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;
    use crate::image::RgbImage;
    use crate::image::exr::{read_colour, write_tagged_rgb};

    fn tags() -> Tags {
        Tags {
            world_to_camera: Some(std::array::from_fn(|r| std::array::from_fn(|c| (4 * r + c) as f32 - 7.5))),
            world_to_ndc: Some(std::array::from_fn(|r| std::array::from_fn(|c| (r * r + c) as f32))),
            yfov_deg: Some(39.6),
            eye: Some("left".into()),
            frame: Some(-3),
            time_s: Some(1.0 / 3.0),
            exposure_ev: Some(-0.9),
            baseline_m: Some(0.064),
            baseline_units: Some(6.4),
            pixel_centre: Some([0.25, 0.75]),
        }
    }

    #[test]
    fn valid_tags_round_trip() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let image = RgbImage::filled(Extent::new(6, 4), [0.5, -1.0, 2.0]);
        let back = |tags: &Tags| {
            write_tagged_rgb(&path, &image, tags).unwrap();
            let back = read_colour(&path).unwrap();
            assert_eq!(back.image, image);
            back.tags
        };
        for tags in [tags(), Tags { eye: Some("right".into()), ..Tags::default() }, Tags::default()] {
            assert_eq!(back(&tags), tags);
        }
        assert_eq!(tags().field_of_view_deg(), Some(39.6));
        let odd = Tags { exposure_ev: Some(f32::NAN), time_s: Some(f64::INFINITY), yfov_deg: Some(180.0), ..tags() };
        assert_eq!(back(&odd), Tags { exposure_ev: None, time_s: None, yfov_deg: None, ..tags() });
        let mut odd = tags();
        odd.world_to_ndc.as_mut().unwrap()[2][1] = f32::NEG_INFINITY;
        assert_eq!(back(&odd), Tags { world_to_ndc: None, ..tags() });
    }

    /// The writer puts custom attributes into a random order.
    #[test]
    fn attributes_are_in_the_order_of_their_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let image = RgbImage::filled(Extent::new(6, 4), [0.5, -1.0, 2.0]);
        let write = || {
            write_tagged_rgb(&path, &image, &tags()).unwrap();
            fs::read(&path).unwrap()
        };
        let bytes = write();
        let at = |name: &str| bytes.windows(name.len()).position(|w| w == name.as_bytes()).unwrap();
        let names = [
            "channels\0",
            "diptych.baseline_m\0",
            "diptych.exposure_ev\0",
            "imageCounter\0",
            "software\0",
            "worldToNDC\0",
        ];
        assert!(names.windows(2).all(|pair| at(pair[0]) < at(pair[1])));
        assert!((0..8).all(|_| write() == bytes));
    }

    /// Header written by OpenEXR 3.5.3 through its Python binding: a camera at (1, 2, 3) that looks along −z, with
    /// half-angle tangents tan 30° vertically and 1.5 times that horizontally, and without a field of view.
    #[test]
    fn attributes_by_the_reference_library_are_read() {
        let tags = read_colour(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src/image/exr/openexr_camera.exr")))
            .unwrap()
            .tags;
        let world_to_camera =
            [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [-1.0, -2.0, 3.0, 1.0]];
        assert_eq!(tags.world_to_camera, Some(world_to_camera));
        assert!((tags.field_of_view_deg().unwrap() - 60.0).abs() < 1e-5, "{tags:?}");
        let said = (tags.eye.as_deref(), tags.frame, tags.time_s, tags.exposure_ev, tags.yfov_deg);
        assert_eq!(said, (Some("right"), Some(7), Some(0.25), Some(-1.5), None));
    }
}
