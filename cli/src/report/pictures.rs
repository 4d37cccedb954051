//! Shows pictures on a page, two at a time, with a line to wipe between them.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::ReportError;
use super::html::escape;
use diptych::exec::PerView;
use diptych::image::RgbImage;
use diptych::image::display::{DisplayImage, encode_png, tonemap};
use diptych::image::tone::ToneCurve;
use diptych::metrics::Pair;
use diptych::metrics::heatmap::flip_heatmap;

/// Pictures that belong together, for example those of one frame.
pub struct Group {
    pub name: String,
    pub pictures: Vec<Picture>,
}

pub struct Picture {
    pub name: String,
    pub image: DisplayImage,
}

impl Group {
    /// Tonemaps both eyes' linear images, `exposure_ev` stops brighter, with the tone curve of the metrics.
    pub fn of_frame(name: String, linear: &PerView<RgbImage>, exposure_ev: f32) -> Self {
        let eye = |(eye, image)| Picture {
            name: format!("{eye} eye"),
            image: tonemap(image, exposure_ev, ToneCurve::Reinhard),
        };
        Self { name, pictures: linear.with_eyes().map(eye).collect() }
    }

    /// Returns the pictures of [`Self::of_frame`] and, for each eye, a FLIP heat map against `reference`, with the mean
    /// FLIP in its name.
    ///
    /// # Errors
    /// [`ReportError::Image`] for images of different sizes or without pixels.
    pub fn against(
        name: String,
        linear: &PerView<RgbImage>,
        reference: &PerView<RgbImage>,
        exposure_ev: f32,
    ) -> Result<Self, ReportError> {
        let mut group = Self::of_frame(name, linear, exposure_ev);
        for ((eye, image), right) in linear.with_eyes().zip(reference.iter()) {
            let pair = Pair::new(right, image, exposure_ev)?;
            let name = format!("FLIP, {eye} eye (mean {:.4})", pair.errors().flip);
            group.pictures.push(Picture { name, image: flip_heatmap(&pair) });
        }
        Ok(group)
    }
}

/// Returns the HTML of the viewer. Initially, it shows the first picture on the left of the line. On the right, it
/// shows the first picture of the last group or, with a single group, the second picture, if there is one. There must be
/// a picture, and all must have the same size.
///
/// # Errors
/// [`ReportError::Encoding`].
pub fn viewer(groups: &[Group]) -> Result<String, ReportError> {
    let (mut options, mut stage, mut number) = (String::new(), String::new(), 0usize);
    let before_last = groups.iter().rev().skip(1).map(|g| g.pictures.len()).sum::<usize>();
    for group in groups {
        options += &format!("<optgroup label=\"{}\">", escape(&group.name));
        for Picture { name, image } in &group.pictures {
            let (alt, data) = (escape(&format!("{}: {name}", group.name)), data_uri(name, image)?);
            options += &format!("<option value=\"{number}\">{}</option>", escape(name));
            let (width, height) = (image.extent.width, image.extent.height);
            stage += &format!("<img alt=\"{alt}\" width=\"{width}\" height=\"{height}\" src=\"{data}\">\n");
            number += 1;
        }
        options += "</optgroup>";
    }
    let right = before_last.max(1).min(number - 1);
    Ok(format!(
        "<div class=\"viewer\" data-right=\"{right}\">\n<div class=\"controls\">\n\
         <label>Left <select class=\"left\">{options}</select></label>\n\
         <label>Right <select class=\"right\">{options}</select></label>\n\
         <label>Line <input class=\"wipe\" type=\"range\" min=\"0\" max=\"100\" value=\"50\"></label>\n</div>\n\
         <div class=\"stage\">\n{stage}</div>\n</div>"
    ))
}

fn data_uri(name: &str, image: &DisplayImage) -> Result<String, ReportError> {
    let mut png = Vec::new();
    encode_png(image, &mut png).map_err(|source| ReportError::Encoding { name: name.to_owned(), source })?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(png)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::image::Extent;

    #[test]
    fn viewer_embeds_each_picture_once() {
        let grey = |value: f32| RgbImage::filled(Extent::new(12, 11), [value; 3]);
        let linear = PerView::both(grey(0.5), grey(0.25));
        let reference = PerView::both(grey(0.5), grey(0.5));
        let frame = Group::against("a <b>".into(), &linear, &reference, 0.0).unwrap();
        assert_eq!(frame.pictures[2].name, "FLIP, left eye (mean 0.0000)");
        assert!(frame.pictures[3].image.pixels[0] != [0, 0, 3], "{:?}", frame.pictures[3].image.pixels[0]);
        let html = viewer(&[frame, Group::of_frame("reference".into(), &reference, 0.0)]).unwrap();
        assert_eq!((html.matches("<img").count(), html.matches("<option ").count()), (6, 12));
        assert!(html.contains("alt=\"a &lt;b&gt;: left eye\"") && html.contains("data-right=\"4\""), "{html}");
        let lone = Picture { name: "lone".into(), image: tonemap(linear.left(), 0.0, ToneCurve::Reinhard) };
        let lone = viewer(&[Group { name: "map".into(), pictures: vec![lone] }]).unwrap();
        assert!(lone.contains("data-right=\"0\""), "{lone}");
        let encoded = html.split("base64,").nth(1).unwrap().split('"').next().unwrap();
        let png = ::image::load_from_memory(&STANDARD.decode(encoded).unwrap()).unwrap().into_rgb8();
        assert_eq!(
            (png.dimensions(), png.get_pixel(3, 3).0),
            ((12, 11), tonemap(linear.left(), 0.0, ToneCurve::Reinhard).pixels[0])
        );
    }

    #[test]
    fn flip_uses_the_exposure_of_shown_pictures() {
        let grey = |value: f32| RgbImage::filled(Extent::new(12, 11), [value; 3]);
        let eyes = |value| PerView::both(grey(value), grey(value));
        let names = |scale: f32, exposure_ev: f32| -> Vec<String> {
            let group = Group::against("a".into(), &eyes(0.25 * scale), &eyes(0.5 * scale), exposure_ev).unwrap();
            group.pictures.into_iter().map(|p| p.name).collect()
        };
        assert_eq!(names(1024.0, -10.0), names(1.0, 0.0));
        assert_ne!(names(1024.0, 0.0), names(1.0, 0.0));
    }
}
