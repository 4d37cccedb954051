//! Exposure and field of view from options or the files' metadata, and contradictions between two files.

use diptych::image::exr::Tags;
use serde::Serialize;

/// Vertical field of view in degrees if neither options nor files specify one.
const ASSUMED_YFOV_DEG: f64 = 70.0;

/// Origin of an exposure or a field of view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    Option,
    Reference,
    Image,
    /// A default, since neither an option nor a file sets the value.
    Default,
}

/// Returns the first value that is given, and its origin.
fn first<T>(option: Option<T>, reference: Option<T>, image: Option<T>, default: T) -> (T, Source) {
    let said = [(option, Source::Option), (reference, Source::Reference), (image, Source::Image)];
    let first = said.into_iter().find_map(|(value, source)| Some((value?, source)));
    first.unwrap_or((default, Source::Default))
}

/// Chooses the exposure of both images in stops; the default is 0.
pub fn exposure_ev(option: Option<f32>, reference: &Tags, image: &Tags) -> (f32, Source) {
    first(option, reference.exposure_ev, image.exposure_ev, 0.0)
}

/// Chooses the vertical field of view, degrees.
pub fn yfov_deg(option: Option<f64>, reference: &Tags, image: &Tags) -> (f64, Source) {
    first(option, reference.field_of_view_deg(), image.field_of_view_deg(), ASSUMED_YFOV_DEG)
}

/// Returns a note on where the exposure comes from.
pub fn source_note(source: Source) -> &'static str {
    match source {
        Source::Option => "",
        Source::Reference => "as the reference says",
        Source::Image => "as the image says; the reference has none",
        Source::Default => "assumed, since neither file has one: set it with --exposure",
    }
}

/// Lists contradictions between the metadata of two images. Tags that either image lacks are skipped.
pub fn differences(reference: &Tags, image: &Tags) -> Vec<String> {
    let mut found = Vec::new();
    let eyes = reference.eye.as_ref().zip(image.eye.as_ref()).filter(|(a, b)| a != b);
    if let Some((a, b)) = eyes {
        found.push(match a.contains(" of ") || b.contains(" of ") {
            true => format!("the reference is of {a}, the image of {b}"),
            false => format!("the reference is of the {a} eye, the image of the {b} one"),
        });
    }
    let is_of_another_time = match (reference.time_s.zip(image.time_s), reference.frame.zip(image.frame)) {
        (Some((a, b)), _) => (a - b).abs() > 1e-6,
        (None, Some((a, b))) => a != b,
        (None, None) => false,
    };
    if is_of_another_time {
        found.push(format!("the reference is of {}, the image of {}", instant(reference), instant(image)));
    }
    let views = reference.world_to_ndc.zip(image.world_to_ndc);
    let is_of_another_view = views.map(|(a, b)| !is_same(&a, &b));
    let yfovs = reference.field_of_view_deg().zip(image.field_of_view_deg()).filter(|(a, b)| (a - b).abs() > 1e-3);
    match (is_of_another_view, yfovs) {
        (Some(false), _) | (None, None) => {}
        (_, Some((a, b))) => found.push(format!("their cameras differ: fields of view of {a} and {b} degrees")),
        (Some(true), None) if found.is_empty() => {
            found.push("their cameras differ in position or direction (worldToNDC)".to_owned());
        }
        (Some(true), None) => {}
    }
    if let Some((a, b)) = reference.exposure_ev.zip(image.exposure_ev).filter(|(a, b)| a != b) {
        found.push(format!("their exposures differ: {a} EV in the reference's file, {b} EV in the image's"));
    }
    found
}

/// Formats the frame number and the time, as `frame 3 at 0.125 s`.
fn instant(tags: &Tags) -> String {
    let frame = tags.frame.map(|frame| format!("frame {frame}"));
    let time = tags.time_s.map(|time_s| format!("at {} s", (time_s * 1e4).round() / 1e4));
    frame.into_iter().chain(time).collect::<Vec<_>>().join(" ")
}

/// True if two `worldToNDC` matrices project points to the same image positions, up to f32 rounding. Renderers differ
/// in z and in a common factor of x, y and w, so these are ignored.
fn is_same(a: &[[f32; 4]; 4], b: &[[f32; 4]; 4]) -> bool {
    let of_image = |matrix: &[[f32; 4]; 4]| {
        let scale = (0..3).map(|row| f64::from(matrix[row][3]).powi(2)).sum::<f64>().sqrt();
        let scale = if scale > 0.0 { scale } else { 1.0 };
        matrix.map(|row| [row[0], row[1], row[3]].map(|c| f64::from(c) / scale))
    };
    let (a, b) = (of_image(a), of_image(b));
    let pairs = || a.as_flattened().iter().zip(b.as_flattened());
    let largest = pairs().fold(0.0, |most: f64, (a, b)| most.max(a.abs()).max(b.abs()));
    pairs().all(|(a, b)| (a - b).abs() <= 1e-5 * largest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tags() -> Tags {
        let world_to_ndc = Some(std::array::from_fn(|r| std::array::from_fn(|c| (4 * r + c) as f32)));
        let eye = Some("left".to_owned());
        let (frame, time_s, exposure_ev) = (Some(2), Some(0.25), Some(0.5));
        Tags { world_to_ndc, eye, frame, time_s, exposure_ev, yfov_deg: Some(40.0), ..Tags::default() }
    }

    #[test]
    fn equal_or_absent_tags_do_not_differ() {
        let mut rounded = tags();
        rounded.world_to_ndc.as_mut().unwrap()[3][3] += 1e-5;
        let nothing = Tags::default();
        // A matrix of another renderer, with clip planes.
        let z_and_w = |row: [f32; 4]| [2.0 * row[0], 2.0 * row[1], -row[2], 2.0 * row[3]];
        let other = Tags { world_to_ndc: tags().world_to_ndc.map(|matrix| matrix.map(z_and_w)), ..tags() };
        for (a, b) in
            [(tags(), tags()), (tags(), nothing.clone()), (nothing, tags()), (tags(), rounded), (tags(), other)]
        {
            assert!(differences(&a, &b).is_empty(), "{a:?} {b:?}");
        }
        // Each run numbers its own frames: different numbers can be the same instant.
        assert!(differences(&tags(), &Tags { frame: Some(0), ..tags() }).is_empty());
    }

    #[test]
    fn differing_tags_are_named() {
        let mut moved = tags();
        moved.world_to_ndc.as_mut().unwrap()[3][3] += 0.01;
        for (image, parts) in [
            (Tags { eye: Some("right".into()), ..moved.clone() }, vec!["left eye, the image of the right"]),
            (
                Tags { time_s: Some(0.5), frame: Some(4), ..moved.clone() },
                vec!["frame 2 at 0.25 s", "frame 4 at 0.5 s"],
            ),
            (Tags { time_s: None, frame: Some(4), ..tags() }, vec!["frame 2 at 0.25 s", "frame 4"]),
            (Tags { yfov_deg: Some(70.0), ..moved.clone() }, vec!["40 and 70 degrees"]),
            (moved, vec!["worldToNDC"]),
            (Tags { exposure_ev: Some(-1.0), ..tags() }, vec!["0.5 EV", "-1 EV"]),
        ] {
            let found = differences(&tags(), &image);
            assert!(found.len() == 1 && parts.iter().all(|part| found[0].contains(part)), "{parts:?}: {found:?}");
        }
    }

    #[test]
    fn options_override_reference_and_image_tags() {
        let image = Tags { exposure_ev: Some(2.0), yfov_deg: Some(50.0), ..tags() };
        let exposure = |option, reference: &Tags| exposure_ev(option, reference, &image);
        assert_eq!(exposure(Some(1.0), &tags()), (1.0, Source::Option));
        assert_eq!(exposure(None, &tags()), (0.5, Source::Reference));
        assert_eq!(exposure(None, &Tags::default()), (2.0, Source::Image));
        assert_eq!(exposure_ev(None, &Tags::default(), &Tags::default()), (0.0, Source::Default));
        assert_eq!(yfov_deg(None, &tags(), &image).0, 40.0);
        assert_eq!(yfov_deg(None, &Tags::default(), &Tags::default()), (70.0, Source::Default));
    }
}
