//! A row per compared image, with the means of each measure over views and frames.

use std::path::{Path, PathBuf};

use anyhow::anyhow;

use crate::failure::Failure;
use crate::report::csv::number;
use crate::report::{Csv, Table, cell, once};
use diptych::metrics::MEASURES;

/// Names and values of measures.
pub type Values = Vec<(&'static str, Option<f64>)>;

/// A compared image with its measures.
pub struct Row {
    pub image: String,
    pub values: Values,
}

/// Returns the measures of an image, or their means over views, with their names.
pub fn of_errors(values: [Option<f64>; 9]) -> Values {
    MEASURES.iter().map(|(name, _)| *name).zip(values).collect()
}

/// Returns the mean of some values; `None` if one is undefined.
pub fn mean(values: impl ExactSizeIterator<Item = Option<f64>>) -> Option<f64> {
    let count = values.len();
    Some(values.sum::<Option<f64>>()? / count as f64)
}

/// Returns the names of all measures, and the values of each row.
fn columns(rows: &[Row]) -> (Vec<&'static str>, Vec<Vec<Option<f64>>>) {
    let names = once(rows.iter().flat_map(|row| row.values.iter().map(|(name, _)| *name)));
    let value = |row: &Row, name: &str| row.values.iter().find(|(n, _)| *n == name).and_then(|(_, value)| *value);
    let values = rows.iter().map(|row| names.iter().map(|name| value(row, name)).collect()).collect();
    (names, values)
}

/// Prints a line per image; `what` is the heading of their names. Measures that are defined for none of them are left
/// out.
pub fn print(what: &'static str, rows: &[Row]) {
    let (names, values) = columns(rows);
    let known: Vec<usize> = (0..names.len()).filter(|i| values.iter().any(|row| row[*i].is_some())).collect();
    let headers = [what].into_iter().chain(known.iter().map(|i| names[*i])).collect();
    let decimals = |i: usize| if names[i].starts_with("nonfinite") || names[i] == "features" { 0 } else { 6 };
    let line = |(row, values): (&Row, Vec<Option<f64>>)| {
        let cells = known.iter().map(|i| cell(values[*i], decimals(*i)));
        [row.image.clone()].into_iter().chain(cells).collect()
    };
    say!("{}", Table { headers, rows: rows.iter().zip(values).map(line).collect() }.text().trim_end());
}

/// Checks that a file of [`write`] is none of the inputs, which it would replace.
pub fn check<'a>(path: &Path, mut inputs: impl Iterator<Item = &'a PathBuf>) -> Result<(), Failure> {
    let own = path.canonicalize().ok();
    if own.is_some() && inputs.any(|input| input.canonicalize().ok() == own) {
        return Err(Failure::Input(anyhow!("--csv {}: this file is compared: give another", path.display())));
    }
    Ok(())
}

/// Writes a line per image as CSV; undefined values are empty.
pub fn write(path: &Path, rows: &[Row]) -> Result<(), Failure> {
    let (names, values) = columns(rows);
    let columns = ["image"].into_iter().chain(names).map(str::to_owned).collect();
    let line = |(row, values): (&Row, Vec<Option<f64>>)| {
        [row.image.clone()].into_iter().chain(values.into_iter().map(|value| number(value, 9))).collect()
    };
    Ok(Csv { columns, lines: rows.iter().zip(values).map(line).collect() }.write(path)?)
}
