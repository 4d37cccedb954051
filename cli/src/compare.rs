//! `diptych compare`.

mod aovs;
mod by_kind;
mod findings;
mod pictures;
mod rivalry;
mod sequence;
mod text;
mod viewing;

use std::path::{Path, PathBuf};

use anyhow::Context;
use diptych::exec::Stereo;
use diptych::image::display::{DisplayImage, write_png};
use diptych::image::exr::read_colour;
use diptych::image::{Extent, stereo};
use diptych::metrics::disparity::FeatureDisparity;
use diptych::metrics::heatmap::{flip_heatmap, heatmap};
use diptych::metrics::rings::Viewing;
use diptych::metrics::rivalry::Differences;
use diptych::metrics::{MEASURES, Pair};

use super::failure::Failure;
use by_kind::ByKind;
use findings::{BothFindings, Findings, Rings, mean};
use rivalry::Seen;
use sequence::frames_in;
use viewing::{Sourced, differences};

#[derive(clap::Args)]
#[command(after_long_help = text::help())]
pub struct Args {
    /// Reference: an image, or a folder with left.exr and right.exr or a sequence
    ///
    /// Images are OpenEXR files, or two pictures (PNG or JPEG), whose levels are compared as they are.
    reference: PathBuf,
    /// Image or folder to compare; render sequences with --aov motion,position,normal
    image: PathBuf,
    /// Exposure of displayed values, stops [default: the reference's]
    ///
    /// Without one in the reference file, the image's is used, else 0.
    #[arg(long, value_name = "EV", value_parser = exposure, allow_negative_numbers = true)]
    exposure: Option<f32>,
    /// Write the error of displayed values as a heatmap (PNG)
    #[arg(long, value_name = "FILE")]
    heatmap: Option<PathBuf>,
    /// Write FLIP per pixel as a heatmap (PNG)
    #[arg(long, value_name = "FILE")]
    flip_map: Option<PathBuf>,
    /// Also report errors in N rings of equal viewing angle around the gaze
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rings: Option<u16>,
    /// Gaze as a fraction of the image from the top left
    #[arg(long, value_name = "X,Y", default_value = "0.5,0.5", value_parser = gaze, requires = "rings")]
    gaze: [f64; 2],
    /// Vertical field of view for --rings, degrees [default: the reference's]
    ///
    /// Without one in the reference file, the image's is used, else 70.
    #[arg(long, value_name = "DEG", value_parser = yfov, requires = "rings")]
    yfov: Option<f64>,
    /// Also report the error near seams; R are the first rows of stripes
    ///
    /// This error is the RMSE within 4 rows of the seams, divided by the RMSE of all other rows.
    #[arg(long = "seam-rows", alias = "seams", value_name = "R,R,…", value_delimiter = ',')]
    seams: Vec<u32>,
    /// Also report errors by kind of pixel: silhouettes, creases, reflections, …
    ///
    /// The kinds come from auxiliary images in the folder of IMAGE or REFERENCE: render either with --aov
    /// depth,normal,base_color,diffuse_albedo,specular_albedo,roughness.
    #[arg(long)]
    by_kind: bool,
    /// Write the kind of each pixel as a map (PNG)
    #[arg(long, value_name = "FILE")]
    kind_map: Option<PathBuf>,
    /// Write the difference between the errors of the two eyes as a heatmap (PNG)
    ///
    /// Needs the auxiliary images position and normal in either folder: render with --aov position,normal. With
    /// shown_position,shown_normal,virtual_position as well, what mirrors and glass show is matched, not the mirrors
    /// themselves. Surfaces that the right eye does not show are grey.
    #[arg(long, value_name = "FILE")]
    rivalry_map: Option<PathBuf>,
    /// Print JSON
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
    let (reference, image) = (&args.reference, &args.image);
    match (reference.is_dir(), image.is_dir()) {
        (false, false) if [reference, image].into_iter().any(|path| pictures::is_picture(path)) => pictures::run(args),
        (false, false) => one(args),
        (true, true) if is_sequence(reference, image).map_err(Failure::Input)? => {
            refuse_options_of_images(args).map_err(Failure::Input)?;
            sequence::run(reference, image, args.exposure, args.json)
        }
        (true, true) => both_eyes(args),
        (reference_is_dir, _) => {
            let (folder, other) = if reference_is_dir { (reference, image) } else { (image, reference) };
            let what = if other.exists() { "is not" } else { "is not there" };
            let (folder, other) = (folder.display(), other.display());
            Err(input(format!("{folder} is a folder and {other} {what}: name two images or two folders")))
        }
    }
}

fn input(what: String) -> Failure {
    Failure::Input(anyhow::anyhow!(what))
}

/// True if two folders are compared as sequences: both have at least two numbered frames, or neither has left.exr or
/// right.exr.
fn is_sequence(reference: &Path, image: &Path) -> Result<bool, anyhow::Error> {
    let eyes = |folder: &Path| ["left.exr", "right.exr"].iter().any(|name| folder.join(name).is_file());
    let numbered = [frames_in(reference)?, frames_in(image)?];
    let is_one_of_eyes = [reference, image].into_iter().any(eyes);
    Ok(numbered.iter().all(|frames| frames.len() > 1) || !is_one_of_eyes)
}

fn one(args: &Args) -> Result<(), Failure> {
    if args.rivalry_map.is_some() {
        return Err(input("--rivalry-map compares two eyes: name two folders".to_owned()));
    }
    let compared = Compared::read(args, &args.reference, &args.image)?;
    compared.findings.warn("");
    compared.findings.rings.iter().for_each(Rings::warn);
    write_map(&args.heatmap, || Ok(heatmap(&compared.pair)))?;
    write_map(&args.flip_map, || Ok(flip_heatmap(&compared.pair)))?;
    if let Some(picture) = &compared.kinds {
        write_map(&args.kind_map, || Ok(picture.clone()))?;
    }
    if args.json {
        say!("{}", serde_json::to_string(&compared.findings).map_err(anyhow::Error::from)?);
    } else {
        text::print(&[("image", &compared.findings)]);
    }
    Ok(())
}

fn both_eyes(args: &Args) -> Result<(), Failure> {
    let read = |name: &str| Compared::read(args, &args.reference.join(name), &args.image.join(name));
    let (left, right) = (read("left.exr")?, read("right.exr")?);
    left.findings.warn("left eye: ");
    right.findings.warn("right eye: ");
    left.findings.rings.iter().for_each(Rings::warn);
    let side_by_side = |left: DisplayImage, right: DisplayImage| Ok(stereo::side_by_side(&left, &right)?);
    write_map(&args.heatmap, || side_by_side(heatmap(&left.pair), heatmap(&right.pair)))?;
    write_map(&args.flip_map, || side_by_side(flip_heatmap(&left.pair), flip_heatmap(&right.pair)))?;
    if let (Some(left), Some(right)) = (left.kinds, right.kinds) {
        write_map(&args.kind_map, || side_by_side(left, right))?;
    }
    let pairs = Stereo { left: &left.pair, right: &right.pair };
    let (differences, features) = of_both_eyes(args, &pairs).map_err(Failure::Input)?;
    if let Some(path) = &args.rivalry_map {
        let differences = differences.as_ref().ok_or_else(|| input(format!("--rivalry-map: {}", rivalry::NEEDS)))?;
        write_png(path, &differences.map())?;
    }
    let rivalry = differences.map(|differences| differences.rivalry()).unwrap_or_default();
    let eyes = Stereo { left: left.findings, right: right.findings };
    if args.json {
        let means = mean(&eyes.left, &eyes.right);
        let mean = MEASURES.iter().zip(means).map(|((name, _), mean)| ((*name).to_owned(), mean.into())).collect();
        say!(
            "{}",
            serde_json::to_string(&BothFindings { eyes, mean, rivalry, features }).map_err(anyhow::Error::from)?
        );
    } else {
        text::print(&[("left", &eyes.left), ("right", &eyes.right)]);
        text::print_rivalry(&rivalry, &features);
    }
    Ok(())
}

/// Returns the differences between the eyes' errors, and the errors of features' disparity; nothing without auxiliary
/// images that tell which pixels match.
fn of_both_eyes(args: &Args, pairs: &Stereo<&Pair>) -> Result<(Option<Differences>, FeatureDisparity), anyhow::Error> {
    let seen = |name: &str| Seen::read(&[&args.image.join(name), &args.reference.join(name)]);
    let (Some(left), Some(right)) = (seen("left.exr")?, seen("right.exr")?) else {
        return Ok((None, FeatureDisparity::default()));
    };
    let own = Stereo { left: &left.surfaces, right: &right.surfaces };
    let surfaces = rivalry::shared(own, Stereo { left: left.shown.as_ref(), right: right.shown.as_ref() });
    let differences = rivalry::differences(pairs, &surfaces, &right.tags)?;
    Ok((differences, rivalry::features(pairs, &left.surfaces, &right.tags)?))
}

fn write_map(path: &Option<PathBuf>, map: impl FnOnce() -> Result<DisplayImage, Failure>) -> Result<(), Failure> {
    path.as_ref().map_or(Ok(()), |path| Ok(write_png(path, &map()?)?))
}

/// An image and its reference, with the results of their comparison.
struct Compared {
    pair: Pair,
    findings: Findings,
    /// Map of each pixel's kind, if --by-kind or --kind-map is given.
    kinds: Option<DisplayImage>,
}

impl Compared {
    fn read(args: &Args, reference_path: &Path, image_path: &Path) -> Result<Self, Failure> {
        let read = |path: &Path| read_colour(path).map_err(|e| Failure::Input(e.into()));
        let (reference, image) = (read(reference_path)?, read(image_path)?);
        let exposure = Sourced::exposure(args.exposure, &reference.tags, &image.tags);
        let pair = Pair::new(&reference.image, &image.image, exposure.value)
            .with_context(|| format!("cannot compare {} with {}", image_path.display(), reference_path.display()))
            .map_err(Failure::Input)?;
        check_seams(&args.seams, image.image.extent).map_err(Failure::Input)?;
        let yfov = Sourced::yfov_deg(args.yfov, &reference.tags, &image.tags);
        let viewing = Viewing { gaze: args.gaze, yfov_deg: yfov.value };
        let rings = |count: u16| Rings { viewing, yfov_source: yfov.source, rings: pair.rings(&viewing, count.into()) };
        let by_kind = || {
            let paths = [reference_path, image_path];
            ByKind::new(paths, &reference, &pair, exposure.value, yfov.value).map_err(Failure::Input)
        };
        let by_kind = (args.by_kind || args.kind_map.is_some()).then(by_kind).transpose()?;
        let (by_kind, kinds) = by_kind.map(|found| (found.errors, found.picture)).unzip();
        let findings = Findings {
            exposure_ev: exposure.value,
            exposure_source: exposure.source,
            errors: pair.errors(),
            warnings: differences(&reference.tags, &image.tags),
            reference_source: reference.source.clone(),
            image_source: image.source.clone(),
            reference_tags: reference.tags.clone(),
            image_tags: image.tags.clone(),
            rings: args.rings.map(rings),
            by_kind,
            seams: (!args.seams.is_empty()).then(|| pair.seam_error(&args.seams)),
        };
        Ok(Self { pair, findings, kinds })
    }
}

fn refuse_options_of_images(args: &Args) -> Result<(), anyhow::Error> {
    let given = [
        ("--heatmap", args.heatmap.is_some()),
        ("--flip-map", args.flip_map.is_some()),
        ("--by-kind", args.by_kind),
        ("--kind-map", args.kind_map.is_some()),
        ("--rivalry-map", args.rivalry_map.is_some()),
        ("--rings", args.rings.is_some()),
        ("--seam-rows", !args.seams.is_empty()),
    ];
    match given.iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => {
            anyhow::bail!("{option} works on single frames: name two files, or folders without numbered frames")
        }
        None => Ok(()),
    }
}

fn check_seams(rows: &[u32], extent: Extent) -> Result<(), anyhow::Error> {
    match rows.iter().find(|&&row| row == 0 || row >= extent.height) {
        Some(row) => anyhow::bail!("--seam-rows {row}: an image of {extent} has no seam there: give rows inside it"),
        None => Ok(()),
    }
}
