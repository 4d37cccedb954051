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

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use diptych::exec::PerView;
use diptych::image::display::DisplayImage;
use diptych::image::exr::read_colour;
use diptych::image::{Extent, stereo};
use diptych::metrics::disparity::{FEATURE_MEASURES, FeatureDisparity};
use diptych::metrics::heatmap::{flip_heatmap, heatmap};
use diptych::metrics::rings::Viewing;
use diptych::metrics::rivalry::{Differences, RIVALRY_MEASURES};
use diptych::metrics::{MEASURES, Pair};
use serde::Serialize;

use super::failure::Failure;
use by::By;
use by_kind::{ByKind, Missing};
use findings::{BothFindings, Findings, Rings, mean};
use maps::Map;
use rivalry::{NEEDS, Seen};
use rows::{Row, Values};
use viewing::differences;

#[derive(clap::Args)]
#[command(after_long_help = text::help())]
pub struct Args {
    /// Reference: an image, or a folder with left.exr and right.exr or a sequence
    ///
    /// Images are OpenEXR files, or two pictures (PNG or JPEG), whose levels are compared as they are.
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
    /// it needs the auxiliary images of --by kind. rivalry.png is the difference between the errors of the two eyes. It
    /// needs the auxiliary images position and normal in either folder: render with --aov position,normal. With
    /// shown_position,shown_normal,virtual_position as well, what mirrors and glass show is matched, not the mirrors
    /// themselves. Surfaces that the right eye does not show are grey. Maps of several images are in the folders
    /// 1, 2, … of DIR.
    #[arg(long, value_name = "DIR")]
    maps: Option<PathBuf>,
    /// Write a CSV file with a row per image: means over eyes and frames
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
        say!("{}", if is_detailed { "\nmeans over eyes and frames:" } else { "means over eyes and frames:" });
        rows::print(&rows);
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
            (true, true) if sequence::is_sequence(reference, image).map_err(Failure::Input)? => {
                let options = self.by.names().into_iter().chain([("--maps", self.maps.is_some())]);
                let what = "works on single frames: name two files, or folders without numbered frames";
                match options.into_iter().find(|(_, is_given)| *is_given) {
                    Some((option, _)) => Err(input(format!("{option} {what}"))),
                    None => sequence::run(self),
                }
            }
            (true, true) => self.both_eyes(),
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
        self.finish(findings, || Ok(compared.maps()), || text::print(&[("image", findings)]))?;
        Ok(rows::of_errors(findings.errors.values()))
    }

    fn both_eyes(&self) -> Result<Values, Failure> {
        let read = |name: &str| Compared::read(self, &self.args.reference.join(name), &self.image.join(name));
        let (left, right) = (read("left.exr")?, read("right.exr")?);
        left.findings.warn("left eye: ");
        right.findings.warn("right eye: ");
        left.findings.rings.iter().for_each(Rings::warn);
        let pairs = PerView::both(&left.pair, &right.pair);
        let (differences, features) = self.of_both_eyes(&pairs).map_err(Failure::Input)?;
        let rivalry = differences.as_ref().map(Differences::rivalry).unwrap_or_default();
        let maps = || {
            let both = left.maps().into_iter().zip(right.maps());
            let side_by_side = |((name, left), (_, right)): (Map, Map)| match (left, right) {
                (Ok(left), Ok(right)) => Ok((name, Ok(stereo::side_by_side(&left, &right)?))),
                (left, right) => Ok((name, left.and(right))),
            };
            let rivalry = differences.as_ref().map(Differences::map).ok_or_else(|| NEEDS.to_owned());
            both.map(side_by_side).chain([Ok((maps::RIVALRY, rivalry))]).collect::<Result<Vec<Map>, Failure>>()
        };
        let means = mean(&left.findings, &right.findings);
        let mean = MEASURES.iter().zip(means).map(|((name, _), mean)| ((*name).to_owned(), mean.into())).collect();
        let both = [&left.findings, &right.findings];
        let print = || {
            text::print(&[("left", both[0]), ("right", both[1])]);
            text::print_rivalry(&rivalry, &features);
        };
        let of_eyes = RIVALRY_MEASURES.iter().zip(rivalry.values());
        let of_both = of_eyes.chain(FEATURE_MEASURES.iter().zip(features.values())).map(|((name, _), v)| (*name, v));
        let values = rows::of_errors(means).into_iter().chain(of_both.filter(|_| differences.is_some())).collect();
        let eyes = both.into_iter().collect();
        self.finish(&BothFindings { eyes, mean, rivalry, features }, maps, print)?;
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

    /// Returns the differences between the eyes' errors, and the errors of features' disparity; nothing without
    /// auxiliary images that tell which pixels match.
    fn of_both_eyes(&self, pairs: &PerView<&Pair>) -> Result<(Option<Differences>, FeatureDisparity), anyhow::Error> {
        let seen = |name: &str| Seen::read(&[&self.image.join(name), &self.args.reference.join(name)]);
        let (Some(left), Some(right)) = (seen("left.exr")?, seen("right.exr")?) else {
            return Ok((None, FeatureDisparity::default()));
        };
        let surfaces = [&left, &right].map(|seen| (&seen.surfaces, seen.shown.as_ref()));
        let differences = rivalry::differences(pairs, surfaces, &right.tags)?;
        Ok((differences, rivalry::features(pairs, &left.surfaces, &right.tags)?))
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
