//! `diptych compare`.

mod aovs;
mod by;
mod by_kind;
mod findings;
mod maps;
mod pictures;
mod rivalry;
mod rows;
mod sequence;
mod text;
mod viewing;
mod views;

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use diptych::image::display::DisplayImage;
use diptych::image::exr::read_colour;
use diptych::image::{Extent, sheet};
use diptych::metrics::disparity::{FEATURE_MEASURES, FeatureDisparity};
use diptych::metrics::heatmap::{flip_heatmap, heatmap};
use diptych::metrics::rings::Viewing;
use diptych::metrics::rivalry::{Differences, RIVALRY_MEASURES, Rivalry};
use diptych::metrics::{MEASURES, Pair};
use diptych::scene::rig::Eye;
use serde::Serialize;

use super::failure::Failure;
use by::By;
use by_kind::{ByKind, Missing};
use findings::{AllFindings, Findings, Rings, mean};
use maps::Map;
use rivalry::{NEEDS, Seen, neighbours};
use rows::{Row, Values};
use viewing::differences;
use views::FolderViews;

#[derive(clap::Args)]
#[command(after_long_help = text::help())]
pub struct Args {
    /// Reference: an image, or a folder with all views or a sequence
    ///
    /// Images are OpenEXR files, or two pictures (PNG or JPEG), whose levels are compared as they are. Views have the names
    /// of `render`: left.exr and right.exr, or view00.exr, view01.exr, …
    reference: PathBuf,
    /// Images or folders to compare; render sequences with --aov motion,position,normal
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// Exposure of displayed values, stops [default: the reference's]
    ///
    /// Without one in the reference file, the image's is used, else 0.
    #[arg(long, value_name = "EV", value_parser = exposure, allow_negative_numbers = true)]
    exposure: Option<f32>,
    /// Also report errors by part: rings, rings=N, kind, seams=ROW,ROW
    ///
    /// rings: N rings of equal viewing angle around the gaze, or 10. kind: silhouettes, creases, reflections, …, told
    /// apart by auxiliary images in the folder of IMAGE or REFERENCE: render either with --aov
    /// depth,normal,base_color,diffuse_albedo,specular_albedo,roughness. seams: RMSE within 4 rows of the seams, of
    /// which ROW,ROW are the first rows below, over the RMSE of all other rows.
    #[arg(long, value_name = "LIST", value_parser = By::parse)]
    by: Option<By>,
    /// Gaze as a fraction of the image from the top left [default: 0.5,0.5]
    #[arg(long, value_name = "X,Y", value_parser = gaze)]
    gaze: Option<[f64; 2]>,
    /// Vertical field of view for rings and kinds, degrees [default: the reference's]
    ///
    /// Without one in the reference file, the image's is used, else 70.
    #[arg(long, value_name = "DEG", value_parser = yfov)]
    yfov: Option<f64>,
    /// Write error.png, flip.png, kind.png and rivalry.png into a folder
    ///
    /// error.png is the error of displayed values and flip.png FLIP, as heatmaps. kind.png has the kind of each pixel;
    /// it needs the auxiliary images of --by kind. rivalry.png is the difference between the errors of the two eyes, or
    /// of each view and the next one. It needs the auxiliary images position and normal in either folder: render with
    /// --aov position,normal. With shown_position,shown_normal,virtual_position as well, what mirrors and glass show is
    /// matched, not the mirrors themselves. Surfaces that the right eye does not show are grey. Maps of several images
    /// are in the folders 1, 2, … of DIR.
    #[arg(long, value_name = "DIR")]
    maps: Option<PathBuf>,
    /// Write a CSV file with a row per image: means over views and frames
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Print JSON, a line per image
    #[arg(long)]
    json: bool,
}

fn gaze(text: &str) -> Result<[f64; 2], String> {
    let parsed = text.split_once(',').and_then(|(x, y)| Some([x.trim().parse().ok()?, y.trim().parse().ok()?]));
    let inside = |gaze: &[f64; 2]| gaze.iter().all(|c| (0.0..=1.0).contains(c));
    parsed.filter(inside).ok_or_else(|| "give X,Y, each 0 to 1, e.g. 0.5,0.5".to_owned())
}

fn yfov(text: &str) -> Result<f64, String> {
    let parsed = text.parse().ok().filter(|&deg: &f64| deg > 0.0 && deg < 180.0);
    parsed.ok_or_else(|| "give degrees above 0 and below 180".to_owned())
}

fn exposure(text: &str) -> Result<f32, String> {
    let parsed = text.parse().ok().filter(|ev: &f32| ev.is_finite());
    parsed.ok_or_else(|| "give a number of stops, e.g. -0.5".to_owned())
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let by = args.by.clone().unwrap_or_default();
    if args.gaze.is_some() && by.rings.is_none() {
        return Err(input("--gaze is the centre of rings: add --by rings".to_owned()));
    }
    if args.yfov.is_some() && by.rings.is_none() && !by.kind && args.maps.is_none() {
        return Err(input("--yfov is for rings and kinds of pixels: add --by rings or --by kind".to_owned()));
    }
    let inputs = args.images.iter().chain([&args.reference]);
    args.csv.as_ref().map_or(Ok(()), |path| rows::check(path, inputs))?;
    let is_one = args.images.len() == 1;
    // Several images have a table, and each its own results only if `--by` asks for more than a row.
    let is_detailed = !args.json && (is_one || by.names().into_iter().any(|(_, is_given)| is_given));
    let mut rows = Vec::new();
    for (i, image) in args.images.iter().enumerate() {
        let folder = |maps: &PathBuf| if is_one { maps.clone() } else { maps.join((i + 1).to_string()) };
        if is_detailed && !is_one {
            say!("{}{}:", if i > 0 { "\n" } else { "" }, image.display());
        }
        let values = Comparison { args, by: &by, image, maps: args.maps.as_ref().map(folder), is_detailed }.run()?;
        rows.push(Row { image: image.display().to_string(), values });
    }
    if !args.json && !is_one {
        say!("{}", if is_detailed { "\nmeans over views and frames:" } else { "means over views and frames:" });
        rows::print("image", &rows);
    }
    args.csv.as_ref().map_or(Ok(()), |path| rows::write(path, &rows))
}

/// An image, or a folder of images, that is compared with the reference.
struct Comparison<'a> {
    args: &'a Args,
    by: &'a By,
    image: &'a Path,
    /// Folder of its maps.
    maps: Option<PathBuf>,
    /// True if its results are printed at length.
    is_detailed: bool,
}

/// Results as printed by `--json`.
#[derive(Serialize)]
struct Printed<'a, T> {
    /// The compared image, if there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    image: Option<String>,
    #[serde(flatten)]
    found: &'a T,
    /// Names of the written maps.
    #[serde(skip_serializing_if = "Option::is_none")]
    maps: Option<Vec<&'static str>>,
}

impl Comparison<'_> {
    /// Compares the image, and returns its measures.
    fn run(&self) -> Result<Values, Failure> {
        let (reference, image) = (&*self.args.reference, self.image);
        match (reference.is_dir(), image.is_dir()) {
            (false, false) if [reference, image].into_iter().any(pictures::is_picture) => pictures::run(self),
            (false, false) => self.one(),
            (true, true) => self.folders(),
            (reference_is_dir, _) => {
                let (folder, other) = if reference_is_dir { (reference, image) } else { (image, reference) };
                let what = if other.exists() { "is not" } else { "is not there" };
                let (folder, other) = (folder.display(), other.display());
                Err(input(format!("{folder} is a folder and {other} {what}: name two images or two folders")))
            }
        }
    }

    fn one(&self) -> Result<Values, Failure> {
        let compared = Compared::read(self, &self.args.reference, self.image)?;
        let findings = &compared.findings;
        findings.warn("");
        findings.rings.iter().for_each(Rings::warn);
        self.finish(findings, || Ok(compared.maps()), || text::print(&[("image".to_owned(), findings)]))?;
        Ok(rows::of_errors(findings.errors.values()))
    }

    fn folders(&self) -> Result<Values, Failure> {
        let (reference, image) = (&*self.args.reference, self.image);
        let read = |folder| FolderViews::read(folder).map_err(Failure::Input);
        let found = [&read(reference)?, &read(image)?];
        let eyes = views::common([reference, image], found).map_err(Failure::Input)?;
        if !sequence::is_sequence(found) {
            return self.views(&eyes);
        }
        let options = self.by.names().into_iter().chain([("--maps", self.maps.is_some())]);
        let what = "works on single frames: name two files, or folders without numbered frames";
        match options.into_iter().find(|(_, is_given)| *is_given) {
            Some((option, _)) => Err(input(format!("{option} {what}"))),
            None => sequence::run(self, found, eyes),
        }
    }

    fn views(&self, eyes: &[Eye]) -> Result<Values, Failure> {
        let mut views = Vec::new();
        for eye in eyes {
            let name = format!("{}.exr", eye.file_stem());
            let view = Compared::read(self, &self.args.reference.join(&name), &self.image.join(&name))?;
            view.findings.warn(&format!("{}: ", views::name(*eye)));
            views.push(view);
        }
        views[0].findings.rings.iter().for_each(Rings::warn);
        let (differences, features) = self.of_neighbours(eyes, &views).map_err(Failure::Input)?;
        let rivalries: Vec<_> = differences.iter().flatten().map(Differences::rivalry).collect();
        let (rivalry, features) = (Rivalry::mean_of(&rivalries), FeatureDisparity::of_errors(features));
        let maps = || {
            let all: Vec<Vec<Map>> = views.iter().map(Compared::maps).collect();
            let joined = |i: usize| {
                let pictures: Result<Vec<_>, _> = all.iter().map(|maps| maps[i].1.clone()).collect();
                let joined = match pictures {
                    Ok(pictures) => Ok(sheet::of_views(&pictures)?),
                    Err(reason) => Err(reason),
                };
                Ok((all[0][i].0, joined))
            };
            let rivalry = differences.as_ref().map(|found| found.iter().map(Differences::map).collect::<Vec<_>>());
            let rivalry = rivalry.map(|maps| sheet::of_views(&maps)).transpose()?.ok_or_else(|| NEEDS.to_owned());
            let rivalry = (eyes.len() > 1).then_some(Ok((maps::RIVALRY, rivalry)));
            (0..all[0].len()).map(joined).chain(rivalry).collect::<Result<Vec<Map>, Failure>>()
        };
        let found = || views.iter().map(|view| &view.findings);
        let means = mean(found());
        let mean = MEASURES.iter().zip(means).map(|((name, _), mean)| ((*name).to_owned(), mean.into())).collect();
        let print = || {
            text::print(&eyes.iter().map(|eye| eye.file_stem()).zip(found()).collect::<Vec<_>>());
            if eyes.len() > 2 {
                say!("\nmeans over neighbouring views:");
            }
            if eyes.len() > 1 {
                text::print_rivalry(&rivalry, &features, if eyes.len() == 2 { 2 } else { 0 });
            }
        };
        let of_neighbours = RIVALRY_MEASURES.iter().zip(rivalry.values());
        let of_neighbours = of_neighbours.chain(FEATURE_MEASURES.iter().zip(features.values()));
        let of_neighbours = of_neighbours.map(|((name, _), value)| (*name, value)).filter(|_| !rivalries.is_empty());
        let values = rows::of_errors(means).into_iter().chain(of_neighbours).collect();
        self.finish(&AllFindings { views: found().collect(), mean, rivalry, features }, maps, print)?;
        Ok(values)
    }

    /// Writes the maps that `--maps` asks for, and prints the results as JSON or with `print`.
    fn finish<T: Serialize>(
        &self,
        found: &T,
        maps: impl FnOnce() -> Result<Vec<Map>, Failure>,
        print: impl FnOnce(),
    ) -> Result<(), Failure> {
        let Args { reference, images, json, .. } = self.args;
        let maps = self.maps.as_ref().map(|folder| Ok::<_, Failure>((folder, maps()?))).transpose()?;
        let inputs = [reference].into_iter().chain(images);
        let written = maps.as_ref().map(|(folder, maps)| maps::write(folder, maps, inputs)).transpose()?;
        if *json {
            let image = (images.len() > 1).then(|| self.image.display().to_string());
            let printed = Printed { image, found, maps: written };
            say!("{}", serde_json::to_string(&printed).map_err(anyhow::Error::from)?);
        } else {
            if self.is_detailed {
                print();
            }
            maps.iter().zip(&written).for_each(|((folder, maps), written)| maps::say(folder, maps, written));
        }
        Ok(())
    }

    /// Returns the differences between the errors of each view and the next one, and the errors of features' disparity;
    /// nothing without auxiliary images that tell which pixels match.
    fn of_neighbours(
        &self,
        eyes: &[Eye],
        views: &[Compared],
    ) -> Result<(Option<Vec<Differences>>, Vec<f64>), anyhow::Error> {
        let seen = |eye: &Eye| {
            let name = format!("{}.exr", eye.file_stem());
            Seen::read(&[&self.image.join(&name), &self.args.reference.join(&name)])
        };
        let Some(seen) = eyes.iter().map(seen).collect::<Result<Option<Vec<_>>, _>>()? else {
            return Ok((None, Vec::new()));
        };
        let views: Vec<_> = views.iter().zip(&seen).map(|(view, seen)| seen.view(&view.pair)).collect();
        let differences = neighbours(&views).map(rivalry::differences).collect::<Result<_, _>>()?;
        let features: Vec<Vec<f64>> = neighbours(&views).map(rivalry::features).collect::<Result<_, _>>()?;
        Ok((differences, features.concat()))
    }
}

fn input(what: String) -> Failure {
    Failure::Input(anyhow!(what))
}

/// An image and its reference, with the results of their comparison.
struct Compared {
    pair: Pair,
    findings: Findings,
    /// Map of each pixel's kind, or why there is none; for `--by kind` and `--maps`.
    kinds: Option<Result<DisplayImage, String>>,
}

impl Compared {
    fn read(comparison: &Comparison<'_>, reference_path: &Path, image_path: &Path) -> Result<Self, Failure> {
        let Comparison { args, by, .. } = comparison;
        let read = |path: &Path| read_colour(path).map_err(|e| Failure::Input(e.into()));
        let (reference, image) = (read(reference_path)?, read(image_path)?);
        let (exposure_ev, exposure_source) = viewing::exposure_ev(args.exposure, &reference.tags, &image.tags);
        let pair = Pair::new(&reference.image, &image.image, exposure_ev)
            .with_context(|| format!("cannot compare {} with {}", image_path.display(), reference_path.display()))
            .map_err(Failure::Input)?;
        check_seams(&by.seams, image.image.extent).map_err(Failure::Input)?;
        let (yfov_deg, yfov_source) = viewing::yfov_deg(args.yfov, &reference.tags, &image.tags);
        let viewing = Viewing { gaze: args.gaze.unwrap_or([0.5; 2]), yfov_deg };
        let rings = |count: u16| Rings { viewing, yfov_source, rings: pair.rings(&viewing, count.into()) };
        let paths = [reference_path, image_path];
        let kinds = (by.kind || args.maps.is_some())
            .then(|| ByKind::new(paths, &reference, &pair, exposure_ev, yfov_deg))
            .map(|found| match found {
                Err(error) if !by.kind && error.is::<Missing>() => Ok(Err(error.to_string())),
                found => found.map(Ok),
            })
            .transpose()
            .map_err(Failure::Input)?;
        let findings = Findings {
            exposure_ev,
            exposure_source,
            errors: pair.errors(),
            warnings: differences(&reference.tags, &image.tags),
            reference_source: reference.source.clone(),
            image_source: image.source.clone(),
            reference_tags: reference.tags.clone(),
            image_tags: image.tags.clone(),
            rings: by.rings.map(rings),
            by_kind: kinds.as_ref().filter(|_| by.kind).and_then(|found| Some(found.as_ref().ok()?.errors)),
            seams: (!by.seams.is_empty()).then(|| pair.seam_error(&by.seams)),
        };
        Ok(Self { pair, findings, kinds: kinds.map(|found| found.map(|found| found.picture)) })
    }

    fn maps(&self) -> Vec<Map> {
        let kinds = self.kinds.clone().map(|kinds| (maps::KIND, kinds));
        let errors = [(maps::ERROR, heatmap(&self.pair)), (maps::FLIP, flip_heatmap(&self.pair))];
        errors.map(|(name, map)| (name, Ok(map))).into_iter().chain(kinds).collect()
    }
}

fn check_seams(rows: &[u32], extent: Extent) -> Result<(), anyhow::Error> {
    match rows.iter().find(|&&row| row == 0 || row >= extent.height) {
        Some(row) => bail!("--by seams={row}: an image of {extent} has no seam there: give rows inside it"),
        None => Ok(()),
    }
}
