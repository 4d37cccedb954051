//! What lands in `--out`.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;

use diptych::exec::{Renderer, Stereo};
use diptych::graph::PhysicalImage;
use diptych::image::display::{DisplayImage, write_png};
use diptych::image::file::atomic_write;
use diptych::image::{Extent, Image, RgbImage, exr, stereo};
use diptych::metrics::heatmap::map_of_numbers;
use diptych::stages::{Aov, Foveation};

use super::failure::Failure;

/// Makes the folder that `option` names and checks that files can be made in it, before anything is rendered for it.
pub fn prepare(dir: &Path, option: &str) -> Result<(), Failure> {
    std::fs::create_dir_all(dir)
        .and_then(|()| tempfile_in(dir))
        .with_context(|| format!("cannot write into '{}': choose another {option}", dir.display()))
        .map_err(Failure::Run)
}

fn tempfile_in(dir: &Path) -> std::io::Result<()> {
    let probe = dir.join(format!(".diptych-{}", std::process::id()));
    std::fs::write(&probe, b"")?;
    std::fs::remove_file(&probe)
}

pub fn write_text(dir: &Path, name: &str, text: &str) -> Result<(), Failure> {
    Ok(atomic_write(&dir.join(name), |file| file.write_all(text.as_bytes()))?)
}

/// Whether images have the same bytes.
pub fn same_bits(a: &Stereo<RgbImage>, b: &Stereo<RgbImage>) -> bool {
    let bits = |image: &RgbImage| image.pixels.as_flattened().iter().map(|c| c.to_bits()).collect::<Vec<_>>();
    bits(&a.left) == bits(&b.left) && bits(&a.right) == bits(&b.right)
}

/// A frame's images, off the devices.
pub struct FrameImages {
    pub linear: Stereo<RgbImage>,
    pub display: Stereo<DisplayImage>,
    pub aovs: Vec<(Aov, Stereo<Vec<Vec<f32>>>)>,
}

impl FrameImages {
    /// What [`Self::read`] reads.
    pub fn on_devices(aovs: &[Aov]) -> Vec<PhysicalImage> {
        let aovs = (0..aovs.len()).map(|i| PhysicalImage::Aov(i as u8));
        [PhysicalImage::Linear, PhysicalImage::Display].into_iter().chain(aovs).collect()
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
        Ok(Self {
            linear: renderer.read_linear()?,
            display: Stereo { left: rgb(display.left), right: rgb(display.right) },
            aovs: read,
        })
    }

    /// Draws a line at each of `edges` on the display images.
    pub fn overlay(&mut self, edges: &[u32]) {
        for image in [&mut self.display.left, &mut self.display.right] {
            let width = image.extent.width as usize;
            for &edge in edges.iter().filter(|e| **e < image.extent.height) {
                let row = edge as usize * width;
                image.pixels[row..row + width].fill([255, 160, 0]);
            }
        }
    }

    /// Draws where the inner and the middle layer end.
    pub fn overlay_layers(&mut self, foveation: &Foveation, time_s: f64) {
        for (eye, image) in [&mut self.display.left, &mut self.display.right].into_iter().enumerate() {
            let Extent { width, height } = image.extent;
            let (radii, [x, y]) = foveation.circles(eye, time_s, width, height);
            for (i, pixel) in image.pixels.iter_mut().enumerate() {
                let (column, row) = (i % width as usize, i / width as usize);
                let distance = f64::hypot(column as f64 + 0.5 - x, row as f64 + 0.5 - y);
                if radii.iter().any(|r| (distance - r).abs() < 0.75) {
                    *pixel = [0, 220, 255];
                }
            }
        }
    }

    /// Writes everything; `number` names the frame of a sequence.
    pub fn write(&self, dir: &Path, number: Option<u32>, anaglyph: bool) -> Result<(), Failure> {
        let _span = tracing::info_span!("write files").entered();
        let name = |stem: &str, extension: &str| named(dir, stem, number, extension);
        exr::write_rgb(&name("left", "exr"), &self.linear.left)?;
        exr::write_rgb(&name("right", "exr"), &self.linear.right)?;
        for (aov, images) in &self.aovs {
            for (eye, planes) in [("left", &images.left), ("right", &images.right)] {
                let channels: Vec<_> = aov.channels().iter().zip(planes).map(|(n, p)| (*n, p.as_slice())).collect();
                let path = name(&format!("{eye}.{}", aov.name()), "exr");
                exr::write_channels(&path, self.linear.left.extent, &channels)?;
            }
        }
        for (aov, Stereo { left, right }) in self.aovs.iter().filter(|(aov, _)| aov.counts()) {
            let most = left.iter().chain(right).flatten().fold(0.0, |a: f32, b| a.max(*b));
            let map = |planes: &[Vec<f32>]| map_of_numbers(&planes[0], most, self.linear.left.extent);
            write_png(&name(aov.name(), "png"), &stereo::side_by_side(&map(left), &map(right))?)?;
        }
        write_png(&name("stereo", "png"), &stereo::side_by_side(&self.display.left, &self.display.right)?)?;
        if anaglyph {
            write_png(&name("anaglyph", "png"), &stereo::anaglyph(&self.display.left, &self.display.right)?)?;
        }
        Ok(())
    }
}

/// `left.exr`, or `left.0007.exr` in a sequence.
fn named(dir: &Path, stem: &str, number: Option<u32>, extension: &str) -> PathBuf {
    dir.join(match number {
        Some(n) => format!("{stem}.{n:04}.{extension}"),
        None => format!("{stem}.{extension}"),
    })
}
