//! CSV files for programs, with one value per cell; missing values are empty.

use std::path::Path;

use diptych::image::ImageError;
use diptych::image::file::atomic_write;

/// Name of a column, in snake_case and with its unit, and its value in a row.
pub type Column<T> = (&'static str, fn(&T) -> String);

/// A table with a line of values per row, under column names.
#[derive(Clone, Debug, PartialEq)]
pub struct Csv {
    pub columns: Vec<String>,
    /// The lines, each with as many values as there are columns.
    pub lines: Vec<Vec<String>>,
}

impl Csv {
    pub fn new<T>(columns: &[Column<T>], rows: &[T]) -> Self {
        Self {
            columns: columns.iter().map(|(name, _)| (*name).to_owned()).collect(),
            lines: rows.iter().map(|row| columns.iter().map(|(_, cell)| cell(row)).collect()).collect(),
        }
    }

    /// Appends the columns of `right`, which must have the same number of lines.
    pub fn beside(mut self, right: Self) -> Self {
        self.columns.extend(right.columns);
        self.lines.iter_mut().zip(right.lines).for_each(|(line, more)| line.extend(more));
        self
    }

    /// Writes the table to the file `path`.
    ///
    /// # Errors
    /// [`ImageError`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), ImageError> {
        atomic_write(path, |file| {
            let mut writer = csv::Writer::from_writer(file);
            writer.write_record(&self.columns)?;
            self.lines.iter().try_for_each(|line| writer.write_record(line))?;
            writer.flush()
        })
    }
}

/// Formats cells as a line of CSV, with its newline.
pub(super) fn line(cells: impl IntoIterator<Item: AsRef<[u8]>>) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    // Writing to memory cannot fail.
    let _ = writer.write_record(cells);
    writer.into_inner().unwrap_or_default()
}

/// Formats a number with `decimals` decimal places; `None` gives an empty cell.
pub fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or(String::new(), |v| format!("{v:.decimals$}"))
}

/// Formats a value; `None` gives an empty cell.
pub(super) fn optional<T: ToString>(value: Option<T>) -> String {
    value.map_or(String::new(), |v| v.to_string())
}

#[cfg(test)]
impl Csv {
    /// Returns the value of a line in the column of this name.
    pub fn value(&self, line: usize, column: &str) -> &str {
        let at = self.columns.iter().position(|name| name == column);
        &self.lines[line][at.unwrap_or_else(|| panic!("no column {column} in {:?}", self.columns))]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_cells_with_commas_and_quotes_round_trip() {
        let columns: [Column<&str>; 2] = [("text", |t| (*t).to_owned()), ("none", |_| optional(None::<u32>))];
        let table = Csv::new(&columns, &["a,b", "say \"c\"", "d"]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        table.write(&path).unwrap();
        let mut reader = csv::Reader::from_path(&path).unwrap();
        assert_eq!(reader.headers().unwrap(), vec!["text", "none"]);
        let lines: Vec<Vec<String>> =
            reader.records().map(|r| r.unwrap().iter().map(ToOwned::to_owned).collect()).collect();
        assert_eq!(lines, table.lines);
        assert_eq!((number(Some(1.0 / 3.0), 2), number(None, 2)), ("0.33".to_owned(), String::new()));
    }

    #[test]
    fn csv_tables_join_side_by_side() {
        let left = Csv::new(&[("a", |n: &u32| n.to_string())], &[1, 2]);
        let both = left.clone().beside(Csv::new(&[("b", |n: &u32| (10 * n).to_string())], &[1, 2]));
        assert_eq!(
            (both.columns, both.lines),
            (vec!["a".into(), "b".into()], [["1", "10"], ["2", "20"]].map(|l| l.map(str::to_owned).to_vec()).to_vec())
        );
    }
}
