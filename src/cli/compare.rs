//! `diptych compare`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use diptych::image::display::write_png;
use diptych::image::exr::{ColourSource, read_colour};
use diptych::image::{Extent, RgbImage};
use diptych::metrics::heatmap::{flip_heatmap, heatmap};
use diptych::metrics::rings::{Ring, Viewing};
use diptych::metrics::seams::SeamError;
use diptych::metrics::{Errors, Pair};
use diptych::report::text_table;
use serde::Serialize;

use super::failure::Failure;
use super::sequence;

#[derive(clap::Args)]
pub struct Args {
    /// What is right: an image, or the folder of a sequence
    reference: PathBuf,
    /// What is judged: an image, or the folder of a sequence, rendered with --aov motion,position,normal
    image: PathBuf,
    /// Stops by which both are brightened to be shown, for PSNR, SSIM, FLIP, flicker, ghosting and the maps: the
    /// shot's, to judge what render and play show of it
    #[arg(long, value_name = "EV", default_value = "0", value_parser = exposure, allow_negative_numbers = true)]
    exposure: f32,
    /// Writes the error of display values as a colour-coded PNG
    #[arg(long, value_name = "FILE")]
    heatmap: Option<PathBuf>,
    /// Writes the FLIP of each pixel as a PNG in the colours of magma
    #[arg(long, value_name = "FILE")]
    flip_map: Option<PathBuf>,
    /// Also the errors in N rings of equal viewing angle around the gaze, out to the farthest corner
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rings: Option<u16>,
    /// Where the viewer looks, 0 to 1 from the left and from the top
    #[arg(long, value_name = "X,Y", default_value = "0.5,0.5", value_parser = gaze, requires = "rings")]
    gaze: [f64; 2],
    /// Vertical field of view of the images, degrees, for the rings
    #[arg(long, value_name = "DEG", default_value = "70", value_parser = yfov, requires = "rings")]
    yfov: f64,
    /// Also the RMSE within 4 rows of where stripes meet over the RMSE elsewhere; R are rows with which stripes begin
    #[arg(long, value_name = "R,R,…", value_delimiter = ',')]
    seams: Vec<u32>,
    /// As JSON
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

/// What `--json` prints.
#[derive(Serialize)]
struct Findings {
    exposure_ev: f32,
    #[serde(flatten)]
    errors: Errors,
    reference_source: ColourSource,
    image_source: ColourSource,
    #[serde(skip_serializing_if = "Option::is_none")]
    rings: Option<Rings>,
    #[serde(skip_serializing_if = "Option::is_none")]
    seams: Option<SeamError>,
}

#[derive(Serialize)]
struct Rings {
    #[serde(flatten)]
    viewing: Viewing,
    rings: Vec<Ring>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if args.reference.is_dir() && args.image.is_dir() {
        refuse_options_of_images(args).map_err(Failure::Input)?;
        return sequence::run(&args.reference, &args.image, args.exposure, args.json);
    }
    let (reference, reference_source) = read(&args.reference)?;
    let (image, image_source) = read(&args.image)?;
    let pair = Pair::new(&reference, &image, args.exposure)
        .with_context(|| format!("cannot compare {} with {}", args.image.display(), args.reference.display()))
        .map_err(Failure::Input)?;
    check_seams(&args.seams, image.extent).map_err(Failure::Input)?;
    let viewing = Viewing { gaze: args.gaze, yfov_deg: args.yfov };
    let findings = Findings {
        exposure_ev: args.exposure,
        errors: pair.errors(),
        reference_source,
        image_source,
        rings: args.rings.map(|count| Rings { viewing, rings: pair.rings(&viewing, count.into()) }),
        seams: (!args.seams.is_empty()).then(|| pair.seam_error(&args.seams)),
    };
    if let Some(path) = &args.heatmap {
        write_png(path, &heatmap(&reference, &image, args.exposure)?)?;
    }
    if let Some(path) = &args.flip_map {
        write_png(path, &flip_heatmap(&pair))?;
    }
    if args.json {
        say!("{}", serde_json::to_string(&findings).map_err(anyhow::Error::from)?);
    } else {
        print(&findings);
    }
    Ok(())
}

fn read(path: &Path) -> Result<(RgbImage, ColourSource), Failure> {
    read_colour(path).map_err(|e| Failure::Input(e.into()))
}

fn refuse_options_of_images(args: &Args) -> Result<(), anyhow::Error> {
    let given = [
        ("--heatmap", args.heatmap.is_some()),
        ("--flip-map", args.flip_map.is_some()),
        ("--rings", args.rings.is_some()),
        ("--seams", !args.seams.is_empty()),
    ];
    match given.iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => anyhow::bail!("{option} is of single images: name two files instead of folders"),
        None => Ok(()),
    }
}

fn check_seams(rows: &[u32], extent: Extent) -> Result<(), anyhow::Error> {
    match rows.iter().find(|&&row| row == 0 || row >= extent.height) {
        Some(row) => anyhow::bail!("--seams {row}: no stripe of {extent} meets another there, give rows from 1 on"),
        None => Ok(()),
    }
}

fn print(findings: &Findings) {
    for (name, source) in [("reference", &findings.reference_source), ("image", &findings.image_source)] {
        if !source.is_plain() {
            say!("{name}: {source}");
        }
    }
    say!("{:<22} {:>12}", "exposure_ev", findings.exposure_ev);
    say!("{}", findings.errors);
    if let Some(seams) = &findings.seams {
        for (name, value) in
            [("seam_rmse", seams.near_rmse), ("elsewhere_rmse", seams.elsewhere_rmse), ("seam_ratio", seams.ratio)]
        {
            say!("{name:<22} {:>12}", value.map_or("undefined".to_owned(), |v| format!("{v:.6}")));
        }
    }
    if let Some(rings) = &findings.rings {
        say!("\n{}", ring_table(&rings.rings).trim_end());
    }
}

fn ring_table(rings: &[Ring]) -> String {
    let row = |ring: &Ring| {
        let bounds = [ring.inner_deg, ring.outer_deg].map(|deg| format!("{deg:.2}"));
        let errors = [ring.rmse, ring.relmse, ring.psnr, ring.flip]
            .map(|error| error.map_or("-".to_owned(), |error| format!("{error:.6}")));
        bounds.into_iter().chain([ring.pixels.to_string()]).chain(errors).collect()
    };
    let rows: Vec<Vec<String>> = rings.iter().map(row).collect();
    text_table(&["from_deg", "to_deg", "pixels", "rmse", "relmse", "psnr", "flip"], &rows)
}
