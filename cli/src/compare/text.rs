//! Text output of `compare`, and its help.

use crate::report::csv::Column;
use crate::report::{Table, cell, percent, text_table};
use diptych::metrics::MEASURES;
use diptych::metrics::disparity::{FEATURE_MEASURES, FeatureDisparity};
use diptych::metrics::kinds::KindError;
use diptych::metrics::rings::Ring;
use diptych::metrics::rivalry::{RIVALRY_MEASURES, Rivalry};
use diptych::metrics::seams::SeamError;

use super::findings::{Findings, mean};
use super::rivalry::NEEDS;
use super::rows::{self, Row};
use super::sequence::{RIVALRY_FLICKER, SEQUENCE_MEASURES};
use super::viewing::{Source, source_note};

/// Lists the meaning of each measure, for `--help`.
pub fn help() -> String {
    let lines = |measures: &[(&str, &str)]| -> String {
        measures.iter().map(|(name, meaning)| format!("  {name:<22} {meaning}\n")).collect()
    };
    let more = [
        ("exposure_ev", "exposure of both images in stops, before tonemapping by c/(1+c) and sRGB"),
        ("seam_rmse", "with --by seams: RMSE of the rows within 4 rows of a seam"),
        ("elsewhere_rmse", "RMSE of the other rows"),
        ("seam_ratio", "seam_rmse / elsewhere_rmse; 1 if seams are no worse than other rows"),
    ];
    format!(
        "Measures of the image against the reference; for folders, one per view and their mean:\n{}{}\n\
         Measures of both eyes together, or means over neighbouring views, with --aov position,normal:\n{}{}\n\
         Measures of sequences, means over frames:\n{}{}",
        lines(&MEASURES),
        lines(&more),
        lines(&RIVALRY_MEASURES),
        lines(&FEATURE_MEASURES),
        lines(&SEQUENCE_MEASURES),
        lines(&[RIVALRY_FLICKER]).trim_end()
    )
}

/// Prints the measures of one image, or of all views with their mean. More than two views have a line each.
pub fn print(compared: &[(String, &Findings)]) {
    let is_one = compared.len() == 1;
    for (eye, findings) in compared {
        for (name, source) in [("reference", &findings.reference_source), ("image", &findings.image_source)] {
            if !source.is_plain() {
                say!("{}{name}: {source}", if is_one { String::new() } else { format!("{eye} ") });
            }
        }
    }
    let note = source_note(compared[0].1.exposure_source);
    let mut exposures: Vec<_> = compared.iter().map(|(_, found)| found.exposure_ev.to_string()).collect();
    let mut columns: Vec<_> = compared.iter().map(|(_, found)| found.errors.values()).collect();
    if !is_one {
        columns.push(mean(compared.iter().map(|(_, found)| *found)));
    }
    let names = compared.iter().map(|(eye, _)| eye.clone()).chain(["mean".to_owned()]);
    if compared.len() > 2 {
        exposures.truncate(1);
        line("exposure_ev", exposures, note);
        let row = |(image, errors)| Row { image, values: rows::of_errors(errors) };
        rows::print("view", &names.zip(columns).map(row).collect::<Vec<_>>());
    } else {
        if !is_one {
            line("", names, "");
            exposures.push(String::new());
        }
        line("exposure_ev", exposures, note);
        print_errors(&columns);
    }
    for (eye, findings) in compared {
        let of = match compared.len() {
            1 => String::new(),
            2 => format!(", {eye} eye"),
            _ => format!(", {eye}"),
        };
        if let Some(seams) = &findings.seams {
            print_seams(seams, of.trim_start_matches(", "));
        }
        if let Some(kinds) = &findings.by_kind {
            say!("\nby kind of pixel{of}; part: fraction of the total FLIP of all pixels");
            say!("{}", Table::new(&KINDS, kinds).text().trim_end());
        }
        if let Some(rings) = &findings.rings {
            let (yfov_deg, [x, y]) = (rings.viewing.yfov_deg, rings.viewing.gaze);
            let source = match rings.yfov_source {
                Source::Option => "",
                Source::Reference => ", as the reference says",
                Source::Image => ", as the image says",
                Source::Default => ", assumed",
            };
            say!("\nrings around {x},{y}{of}; vertical field of view {yfov_deg} degrees{source}");
            say!("{}", ring_table(&rings.rings).trim_end());
        }
    }
}

/// Prints a line per measure, with a value of each column.
pub fn print_errors(columns: &[[Option<f64>; 9]]) {
    for (i, (name, meaning)) in MEASURES.iter().enumerate() {
        let is_count = name.starts_with("nonfinite");
        line(name, columns.iter().map(|values| number(values[i], if is_count { 0 } else { 6 })), meaning);
    }
}

pub fn print_seams(seams: &SeamError, meaning: &str) {
    let SeamError { near_rmse, elsewhere_rmse, ratio } = *seams;
    for (name, value) in [("seam_rmse", near_rmse), ("elsewhere_rmse", elsewhere_rmse), ("seam_ratio", ratio)] {
        line(name, [number(value, 6)], meaning);
    }
}

/// Prints how much the errors of neighbours differ, and the errors of features' disparity, below `before` columns.
pub fn print_rivalry(rivalry: &Rivalry, features: &FeatureDisparity, before: usize) {
    let rivalry_values = RIVALRY_MEASURES.iter().zip(rivalry.values());
    for ((name, meaning), value) in rivalry_values.chain(FEATURE_MEASURES.iter().zip(features.values())) {
        let meaning = if rivalry.unmatched.is_none() { NEEDS } else { meaning };
        let decimals = if *name == FEATURE_MEASURES[0].0 { 0 } else { 6 };
        line(name, vec![String::new(); before].into_iter().chain([number(value, decimals)]), meaning);
    }
}

fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or("undefined".to_owned(), |value| format!("{value:.decimals$}"))
}

fn line(name: &str, values: impl IntoIterator<Item = String>, meaning: &str) {
    let values: String = values.into_iter().map(|value| format!(" {value:>12}")).collect();
    say!("{}", format!("{name:<22}{values}   {meaning}").trim_end());
}

/// Columns of the errors by kind of pixel.
const KINDS: [Column<KindError>; 4] = [
    ("kind", |found| found.kind.name().to_owned()),
    ("pixels", |found| percent(found.pixels)),
    ("flip", |found| number(found.flip, 6)),
    ("part", |found| found.part.map_or("-".to_owned(), percent)),
];

fn ring_table(rings: &[Ring]) -> String {
    let row = |ring: &Ring| {
        let bounds = [ring.inner_deg, ring.outer_deg].map(|deg| format!("{deg:.2}"));
        let errors = [ring.rmse, ring.relmse, ring.psnr, ring.ssim, ring.flip].map(|error| cell(error, 6));
        bounds.into_iter().chain([ring.pixels.to_string()]).chain(errors).collect()
    };
    let rows: Vec<Vec<String>> = rings.iter().map(row).collect();
    text_table(&["from_deg", "to_deg", "pixels", "rmse", "relmse", "psnr", "ssim", "flip"], &rows)
}
