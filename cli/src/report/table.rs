//! Tables and their layout on terminals.

use serde::Serialize;
use serde_json::Value;

use super::csv::Column;
use super::once;
use diptych::device::DeviceInfo;

/// Contents of a table, independent of layout.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    pub headers: Vec<&'static str>,
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// Creates a table with a line per row. The columns define headers and cells.
    pub fn new<T>(columns: &[Column<T>], rows: &[T]) -> Self {
        let line = |row: &T| columns.iter().map(|(_, cell)| cell(row)).collect();
        Self { headers: columns.iter().map(|(name, _)| *name).collect(), rows: rows.iter().map(line).collect() }
    }

    /// Adds the policy of each row as the second column, if there are several policies.
    pub fn with_policies<'a>(mut self, policies: impl Iterator<Item = &'a str> + Clone) -> Self {
        if once(policies.clone()).len() > 1 {
            self.headers.insert(1, "policy");
            self.rows.iter_mut().zip(policies).for_each(|(cells, policy)| cells.insert(1, policy.to_owned()));
        }
        self
    }

    /// Lays the table out by [`text_table`].
    pub fn text(&self) -> String {
        text_table(&self.headers, &self.rows)
    }

    /// Writes the table in LaTeX, with the rules of the package `booktabs`.
    pub fn latex(&self) -> String {
        let special = |c: char| matches!(c, '&' | '%' | '_' | '#').then_some('\\').into_iter().chain([c]);
        let escaped = |cell: &str| cell.chars().flat_map(special).collect::<String>();
        let line = |cells: Vec<&str>| cells.into_iter().map(escaped).collect::<Vec<_>>().join(" & ") + r" \\" + "\n";
        let rows: String = self.rows.iter().map(|row| line(row.iter().map(String::as_str).collect())).collect();
        let (columns, headers) = ("l".repeat(self.headers.len()), line(self.headers.clone()));
        let (top, middle, bottom) = (r"\toprule", r"\midrule", r"\bottomrule");
        format!("\\begin{{tabular}}{{{columns}}}\n{top}\n{headers}{middle}\n{rows}{bottom}\n\\end{{tabular}}\n")
    }

    /// Lists the names and values of a struct's fields. Anything other than a struct or a map gives an empty table.
    pub fn of_fields(of: &impl Serialize) -> Table {
        let fields = serde_json::to_value(of).ok().and_then(|value| value.as_object().cloned()).unwrap_or_default();
        let row = |(name, value): (String, Value)| match value {
            Value::String(text) => vec![name, text],
            Value::Null => vec![name, "-".to_owned()],
            value => vec![name, value.to_string()],
        };
        Table { headers: vec!["setting", "value"], rows: fields.into_iter().map(row).collect() }
    }

    /// Lists the devices of each run. Consecutive devices on the same adapter with equally many threads share a line.
    pub fn of_devices<'a>(runs: impl IntoIterator<Item = &'a [DeviceInfo]>) -> Table {
        let mut rows = Vec::new();
        for run in runs {
            let kinds = run.chunk_by(|a, b| (a.adapter, a.threads) == (b.adapter, b.threads));
            rows.extend(kinds.filter_map(|alike| {
                let DeviceInfo { name, driver, kind, threads, traversal, .. } = alike.first()?;
                let threads = threads.map_or("-".to_owned(), |threads| threads.to_string());
                let (all, these) = (run.len().to_string(), alike.len().to_string());
                Some(vec![all, these, name.clone(), driver.clone(), kind.clone(), threads, traversal.name().to_owned()])
            }));
        }
        Table { headers: vec!["devices", "of these", "adapter", "driver", "kind", "threads each", "traversal"], rows }
    }

    /// Returns an object per row, whose keys are the headers in snake case. Whole numbers become JSON numbers.
    pub fn objects(&self) -> Value {
        let value = |cell: &String| cell.parse::<u64>().map_or_else(|_| cell.as_str().into(), Value::from);
        let keys = || self.headers.iter().map(|header| header.replace(' ', "_"));
        self.rows.iter().map(|row| Value::Object(keys().zip(row.iter().map(value)).collect())).collect()
    }

    /// Returns true if a column holds only numbers.
    pub fn is_numeric(&self, column: usize) -> bool {
        self.rows.iter().all(|row| row.get(column).is_none_or(|cell| is_number(cell)))
    }
}

/// Lays out `rows` under `headers`, with columns two spaces apart and columns of numbers aligned to the right. A
/// missing cell is empty, and cells beyond the headers are dropped. Every line ends in a newline and has no trailing
/// space.
///
/// ```
/// let rows = [vec!["1".to_owned(), "40.2".to_owned()], vec!["2".to_owned(), "21.0".to_owned()]];
/// let table = diptych_cli::report::text_table(&["devices", "ms"], &rows);
/// assert_eq!(table, "devices    ms\n-------  ----\n      1  40.2\n      2  21.0\n");
/// ```
pub fn text_table(headers: &[&str], rows: &[Vec<String>]) -> String {
    let cell = |row: &[String], column: usize| row.get(column).map_or(String::new(), |c| c.replace('\n', " "));
    let columns: Vec<Layout> = headers
        .iter()
        .enumerate()
        .map(|(i, header)| Layout::fit(header, rows.iter().map(|row| cell(row, i))))
        .collect();
    let mut table = String::new();
    let mut push = |cells: Vec<String>| {
        let padded: Vec<String> = columns.iter().zip(&cells).map(|(c, text)| c.pad(text)).collect();
        table.push_str(padded.join("  ").trim_end());
        table.push('\n');
    };
    push(headers.iter().map(|h| (*h).to_owned()).collect());
    push(columns.iter().map(|c| "-".repeat(c.width)).collect());
    for row in rows {
        push((0..columns.len()).map(|i| cell(row, i)).collect());
    }
    table
}

/// Layout of a column.
struct Layout {
    /// Width in characters.
    width: usize,
    numeric: bool,
}

impl Layout {
    fn fit(header: &str, cells: impl Iterator<Item = String>) -> Self {
        let mut column = Self { width: header.chars().count(), numeric: true };
        for cell in cells {
            column.width = column.width.max(cell.chars().count());
            column.numeric &= is_number(&cell);
        }
        column
    }

    fn pad(&self, text: &str) -> String {
        let width = self.width;
        if self.numeric { format!("{text:>width$}") } else { format!("{text:<width$}") }
    }
}

/// Returns true for a number, with or without a short unit (`12.5 %`, `1.9x`) or an uncertainty (`1.9 ± 0.1`), for the
/// placeholder `-`, and for an empty cell.
fn is_number(cell: &str) -> bool {
    let cell = cell.trim();
    let number = cell.trim_end_matches(['%', 'x', ' ']);
    matches!(cell, "" | "-") || number.split(" ± ").all(|part| part.parse::<f64>().is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(cells: &[&[&str]]) -> Vec<Vec<String>> {
        cells.iter().map(|row| row.iter().map(|c| (*c).to_owned()).collect()).collect()
    }

    #[test]
    fn latex_has_a_line_per_row_and_escapes() {
        let table = Table { headers: vec!["a_b", "95 %"], rows: rows(&[&["x & y", "1..2"]]) };
        let lines = ["\\begin{tabular}{ll}", "\\toprule", "a\\_b & 95 \\% \\\\", "\\midrule", "x \\& y & 1..2 \\\\"];
        let text = lines.join("\n") + "\n\\bottomrule\n\\end{tabular}\n";
        assert_eq!(table.latex(), text);
    }

    #[test]
    fn numbers_align_right_and_words_left() {
        let table = text_table(
            &["stage", "ms", "share"],
            &rows(&[&["trace", "12.50", "80 ± 2 %"], &["denoise à-trous", "3.1", "-"], &["idle"]]),
        );
        let expected = "\
stage               ms     share
---------------  -----  --------
trace            12.50  80 ± 2 %
denoise à-trous    3.1         -
idle
";
        assert_eq!(table, expected);
    }

    #[test]
    fn table_without_rows_is_its_header() {
        assert_eq!(text_table(&["a", "bc"], &[]), "a  bc\n-  --\n");
    }

    #[test]
    fn line_break_in_a_cell_keeps_the_row() {
        assert_eq!(text_table(&["a"], &rows(&[&["x\ny", "dropped"]])), "a\n---\nx y\n");
    }
}
