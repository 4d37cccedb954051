//! Files that are written to `--out`.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;

use anyhow::Context;

use crate::report::record::Unfinished;
use diptych::exec::{PerView, Renderer};
use diptych::frame::Foveation;
use diptych::graph::Resource;
use diptych::image::display::{DisplayImage, write_png};
use diptych::image::exr::{self, Tags};
use diptych::image::file::atomic_write;
use diptych::image::key::{Entry, with_key};
use diptych::image::{Extent, Image, RgbImage, sheet, stereo};
use diptych::metrics::heatmap::number_colour;
use diptych::passes::Aov;
use diptych::passes::aov_image;
use diptych::passes::tonemap::{DISPLAY, LINEAR};
use diptych::projection::PolarSpace;
use diptych::scene::optics::Optics;
use diptych::scene::rig::{Eye, Rig};

use super::failure::Failure;
use super::quilt::Quilt;
use super::tev::Viewer;

/// Creates the folder that `option` names and checks that it is writable, before the run renders anything. Renames
/// files that a killed run left there, with a warning.
pub fn prepare(dir: &Path, option: &str) -> Result<(), Failure> {
    std::fs::create_dir_all(dir)
        .and_then(|()| tempfile::tempfile_in(dir))
        .with_context(|| format!("cannot write into '{}': choose another {option}", dir.display()))
        .map_err(Failure::Run)?;
    if let Some(Unfinished { frames, kept }) = Unfinished::keep(dir)? {
        let names: Vec<_> = kept.iter().filter_map(|path| path.file_name()?.to_str()).collect();
        log!(
            "warning: the last run into '{}' did not finish: its {frames} frame(s) are kept in {}",
            dir.display(),
            names.join(" and ")
        );
    }
    Ok(())
}

pub fn write_text(dir: &Path, name: &str, text: &str) -> Result<(), Failure> {
    Ok(atomic_write(&dir.join(name), |file| file.write_all(text.as_bytes()))?)
}

/// True if the pixels of all views are the same in `a` and `b`, bit for bit.
pub fn same_bits(a: &PerView<RgbImage>, b: &PerView<RgbImage>) -> bool {
    let bits = |image: &RgbImage| image.pixels.as_flattened().iter().map(|c| c.to_bits()).collect::<Vec<_>>();
    let is_same = |a: &RgbImage, b: &RgbImage| a.extent == b.extent && bits(a) == bits(b);
    a.iter().zip(b.iter()).all(|(a, b)| is_same(a, b))
}

/// File name of the contact sheet of a sequence.
pub const SHEET: &str = "sheet.png";

/// A contact sheet of the left eye or of all of more than two views, filled frame by frame.
#[derive(Default)]
pub struct Sheet {
    pictures: Vec<DisplayImage>,
}

impl Sheet {
    /// Pictures per row.
    const COLUMNS: usize = 4;
    /// Maximum width of a picture, pixels.
    const WIDTH: u32 = 480;

    pub fn add(&mut self, images: &FrameImages) {
        let shown = if images.display.iter().len() > 2 { usize::MAX } else { 1 };
        let reduced = images.display.iter().take(shown).map(|picture| sheet::reduced(picture, Self::WIDTH));
        self.pictures.extend(reduced);
    }

    /// Writes the sheet, unless there are no frames.
    pub fn write(&self, dir: &Path) -> Result<(), Failure> {
        if self.pictures.is_empty() {
            return Ok(());
        }
        Ok(write_png(&dir.join(SHEET), &sheet::contact_sheet(&self.pictures, Self::COLUMNS)?)?)
    }
}

/// Outputs of `render` in addition to the images of each frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Also {
    /// Each task, in run.json
    Details,
    /// The left eye's frames, or all of more than two views, as a contact sheet, sheet.png
    Sheet,
    /// Stripes and foveal layers, drawn on stereo.png
    Overlay,
    /// A red-cyan anaglyph
    Anaglyph,
    /// The left eye above the right in stereo.png, not beside it
    OverUnder,
    /// The picture so far of --reference or of warm-up frames, each second, preview.png
    Preview,
    /// Auxiliary images as layers of left.exr and right.exr, such as normal.X, and not as files of their own
    Layers,
    /// Frames in the viewer tev, which listens at 127.0.0.1:14158 or at $TEV
    Tev,
}

/// A frame's images, read back from the devices.
pub struct FrameImages {
    pub linear: PerView<RgbImage>,
    pub display: PerView<DisplayImage>,
    pub aovs: Vec<(Aov, PerView<Vec<Vec<f32>>>)>,
    /// Value of [`diptych::exec::FrameReport::pixel_centre`], for auxiliary images.
    pub pixel_centre: [f32; 2],
}

/// Returns the metadata of each view's images, without the tags that only auxiliary images have.
pub fn tags(rig: &Rig, exposure_ev: f32, extent: Extent, time_s: f64, frame: u32) -> PerView<Tags> {
    let of = |eye: Eye| {
        let matrices = rig.matrices(time_s, eye, extent);
        Tags {
            world_to_camera: Some(matrices.world_to_camera),
            world_to_ndc: Some(matrices.world_to_ndc),
            yfov_deg: rig.optics.is_none().then(|| rig.yfov_rad.to_degrees() as f32),
            eye: Some(eye.to_string()),
            frame: i32::try_from(frame).ok(),
            time_s: Some(time_s),
            exposure_ev: Some(exposure_ev),
            baseline_m: Some(rig.baseline_m),
            baseline_units: Some(rig.baseline_units()),
            pixel_centre: None,
        }
    };
    rig.eyes().map(of).collect()
}

/// Overlay colour of seams between stripes.
const STRIPES: [u8; 3] = [255, 160, 0];
/// Overlay colour of layers and rings around the gaze.
const FOVEA: [u8; 3] = [0, 220, 255];

/// Optics of the display and size of the rendered image, if displayed images are resampled from it.
pub type Rectified<'a> = Option<(&'a Optics, Extent)>;

/// Returns the position in the rendered image of each pixel of an eye's displayed image, row by row, and the number of
/// rendered pixels per displayed pixel along an axis.
fn rendered_points(eye: Eye, extent: Extent, rectified: Rectified) -> impl Iterator<Item = ([f64; 2], f64)> {
    (0..extent.area() as u32).map(move |i| {
        let centre = [i % extent.width, i / extent.width].map(|side| f64::from(side) + 0.5);
        rectified.map_or((centre, 1.0), |(optics, grid)| optics.rectified_point(eye, [extent, grid], centre))
    })
}

impl FrameImages {
    /// Returns the images that [`Self::read`] reads.
    pub fn on_devices(aovs: &[Aov]) -> Vec<Resource> {
        let aovs = (0..aovs.len()).map(|i| aov_image(i as u8));
        [LINEAR, DISPLAY].into_iter().chain(aovs).collect()
    }

    pub fn read(renderer: &mut Renderer, aovs: &[Aov]) -> Result<Self, Failure> {
        let _span = tracing::info_span!("read images").entered();
        let rgb = |i: Image<[u8; 4]>| Image {
            extent: i.extent,
            pixels: i.pixels.iter().map(|p| [p[0], p[1], p[2]]).collect(),
        };
        let display = renderer.read_display()?;
        let mut read = Vec::new();
        for (i, &aov) in aovs.iter().enumerate() {
            read.push((aov, renderer.read_aov(i)?));
        }
        Ok(Self { linear: renderer.read_linear()?, display: display.map(rgb), aovs: read, pixel_centre: [0.5; 2] })
    }

    /// Draws a line on the display images at each of `edges`, which are row numbers of the rendered image.
    pub fn overlay(&mut self, edges: &[u32], rectified: Rectified) {
        for (eye, image) in self.display.with_eyes_mut() {
            let width = image.extent.width as usize;
            let rows: Vec<f64> = rendered_points(eye, image.extent, rectified).map(|([_, row], _)| row).collect();
            let stripe = |i: usize| edges.iter().filter(|&&edge| rows[i] >= f64::from(edge)).count();
            for i in (width..rows.len()).filter(|i| stripe(*i) != stripe(i - width)) {
                image.pixels[i] = STRIPES;
            }
        }
    }

    /// Draws the outer borders of the inner and the middle foveal layer on the display images.
    pub fn overlay_layers(&mut self, foveation: Foveation, gaze: [[f64; 2]; 2], rectified: Rectified) {
        for (eye, image) in self.display.with_eyes_mut() {
            let (radii, gaze) = foveation.circles_rendered(gaze, image.extent, rectified);
            let [x, y] = gaze[eye.index()];
            let points = rendered_points(eye, image.extent, rectified);
            for (pixel, ([column, row], density)) in image.pixels.iter_mut().zip(points) {
                let distance = f64::hypot(column - x, row - y);
                if radii.iter().any(|r| (distance - r).abs() < 0.75 * density) {
                    *pixel = FOVEA;
                }
            }
        }
    }

    /// Draws the seams between stripes of polar images, and contours where the density of polar pixels on the screen
    /// halves.
    pub fn overlay_rings(&mut self, polar: PolarSpace, gaze: [[f64; 2]; 2], rig: &Rig, time_s: f64, edges: &[u32]) {
        for (eye, image) in self.display.with_eyes_mut() {
            let places = polar.places(gaze[eye.index()], &rig.view(time_s, eye), image.extent);
            let stripe = |i: usize| edges.iter().filter(|&&edge| places[i].row >= f64::from(edge)).count();
            let octave = |i: usize| places[i].density.log2().floor();
            let width = image.extent.width as usize;
            for i in width..places.len() {
                let beside = [i - width, i - usize::from(i % width > 0)];
                if beside.iter().any(|&j| stripe(i) != stripe(j)) {
                    image.pixels[i] = STRIPES;
                } else if beside.iter().any(|&j| octave(i) != octave(j)) {
                    image.pixels[i] = FOVEA;
                }
            }
        }
    }

    /// Writes all images of a frame and returns the names of the files. `number` is the frame's number in a sequence.
    pub fn write(
        &self,
        dir: &Path,
        number: Option<u32>,
        also: &[Also],
        quilt: Option<Quilt>,
        tags: &PerView<Tags>,
    ) -> Result<Vec<String>, Failure> {
        let _span = tracing::info_span!("write files").entered();
        let mut names = Vec::new();
        let mut name = |stem: &str, extension: &str| {
            names.push(named(stem, number, extension));
            dir.join(&names[names.len() - 1])
        };
        let extent = self.linear.left().extent;
        for (eye, image) in self.linear.with_eyes() {
            let (path, tags) = (name(&eye.file_stem(), "exr"), tags.of(eye));
            if also.contains(&Also::Layers) {
                let tags = Tags { pixel_centre: Some(self.pixel_centre), ..tags.clone() };
                exr::write_tagged_channels(&path, extent, &borrowed(&self.layers(eye)), &tags)?;
            } else {
                exr::write_tagged_rgb(&path, image, tags)?;
            }
        }
        for (aov, images) in self.aovs.iter().filter(|_| !also.contains(&Also::Layers)) {
            for (eye, planes) in images.with_eyes() {
                let tags = Tags { exposure_ev: None, pixel_centre: Some(self.pixel_centre), ..tags.of(eye).clone() };
                let channels: Vec<_> = aov.channels().iter().zip(planes).map(|(n, p)| (*n, p.as_slice())).collect();
                let path = name(&format!("{}.{}", eye.file_stem(), aov.name()), "exr");
                exr::write_tagged_channels(&path, extent, &channels, &tags)?;
            }
        }
        for (aov, images) in self.aovs.iter().filter(|(aov, _)| aov.counts()) {
            let (colour, key) = colours(*aov, images);
            let map = |planes: &Vec<Vec<f32>>| planes[0].iter().map(|number| colour(*number)).collect();
            let maps: Vec<_> = images.iter().map(|planes| Image { extent, pixels: map(planes) }).collect();
            write_png(&name(aov.name(), "png"), &with_key(&sheet::of_views(&maps)?, &key))?;
        }
        for (eye, picture) in self.display.with_eyes() {
            write_png(&name(&eye.file_stem(), "png"), picture)?;
        }
        if self.display.iter().len() == 2 {
            let [left, right] = self.display.outer();
            let arrange = if also.contains(&Also::OverUnder) { stereo::over_under } else { stereo::side_by_side };
            write_png(&name("stereo", "png"), &arrange(left, right)?)?;
            if also.contains(&Also::Anaglyph) {
                write_png(&name("anaglyph", "png"), &stereo::anaglyph(left, right)?)?;
            }
        }
        if let Some(quilt) = quilt {
            let pictures: Vec<_> = self.display.iter().collect();
            write_png(&name(&quilt.stem(extent), "png"), &quilt.picture(&pictures))?;
        }
        Ok(names)
    }

    /// Returns the channels of an eye's image and of its auxiliary images.
    fn layers(&self, eye: Eye) -> Vec<(String, Vec<f32>)> {
        let colour = |(c, name): (usize, &str)| {
            (name.to_owned(), self.linear.of(eye).pixels.iter().map(|p| p[c]).collect::<Vec<f32>>())
        };
        let mut layers: Vec<_> = ["R", "G", "B"].into_iter().enumerate().map(colour).collect();
        for (aov, images) in &self.aovs {
            let named = aov.channels().iter().map(|channel| format!("{}.{channel}", aov.name()));
            layers.extend(named.zip(images.of(eye).iter().cloned()));
        }
        layers
    }

    /// Shows all views with their auxiliary images in tev, in place of the frame before.
    pub fn show(&self, viewer: &mut Viewer, scene: &str) -> Result<(), Failure> {
        let mut show = |eye: Eye| {
            let layers = self.layers(eye);
            viewer.show(&format!("{scene} {eye}"), self.linear.left().extent, &borrowed(&layers))
        };
        self.linear.with_eyes().try_for_each(|(eye, _)| show(eye))
    }
}

fn borrowed(layers: &[(String, Vec<f32>)]) -> Vec<(&str, &[f32])> {
    layers.iter().map(|(name, plane)| (name.as_str(), plane.as_slice())).collect()
}

/// Key of the `holes` image, in the colour-blind-safe colours of Okabe & Ito.
const HOLE_KEY: [([u8; 3], &str); 8] = [
    ([0, 0, 0], "0 reprojected, no surface, or left eye"),
    ([213, 94, 0], "1 outside the left image"),
    ([0, 114, 178], "2 left eye saw another normal"),
    ([230, 159, 0], "3 left eye saw another depth"),
    ([240, 228, 66], "4 left eye saw another material"),
    ([86, 180, 233], "5 several surfaces share the pixel"),
    ([204, 121, 167], "6 mirror, glass or gloss"),
    ([0, 158, 115], "7 left to the denoiser"),
];

/// Numbers of frames in the key of the `history` image.
const HISTORY_KEY: [u32; 10] = [0, 1, 2, 4, 8, 16, 32, 64, 128, 255];

/// Returns the colour map for an auxiliary image of small integers, and its key.
fn colours(aov: Aov, images: &PerView<Vec<Vec<f32>>>) -> (impl Fn(f32) -> [u8; 3] + use<>, Vec<Entry>) {
    let numbers: BTreeSet<u32> = images.iter().flat_map(|planes| planes[0].iter().map(|n| *n as u32)).collect();
    let most = numbers.last().map_or(0.0, |n| *n as f32);
    let colour = move |number: f32| match (aov, HOLE_KEY.get(number as usize)) {
        (Aov::Holes, Some((colour, _))) => *colour,
        // Logarithmic, since short histories matter most.
        (Aov::History, _) => number_colour((1.0 + number).log2(), (1.0 + most).log2()),
        _ => number_colour(number, most),
    };
    let key = match aov {
        Aov::Holes => HOLE_KEY.map(|(colour, text)| (colour, text.to_owned())).to_vec(),
        Aov::Stripes => numbers.into_iter().map(|n| (colour(n as f32), format!("device {n}"))).collect(),
        Aov::History => {
            let shown = HISTORY_KEY.into_iter().filter(|n| *n as f32 <= most);
            shown.map(|n| (colour(n as f32), format!("{n} frame{}", if n == 1 { "" } else { "s" }))).collect()
        }
        _ => numbers.into_iter().map(|n| (colour(n as f32), format!("{n} {}", aov.name()))).collect(),
    };
    (colour, key)
}

/// Returns `left.exr`, or `left.0007.exr` in a sequence.
fn named(stem: &str, number: Option<u32>, extension: &str) -> String {
    match number {
        Some(n) => format!("{stem}.{n:04}.{extension}"),
        None => format!("{stem}.{extension}"),
    }
}
