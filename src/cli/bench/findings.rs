//! Results of an experiment: its files, its page and its printed tables.

use serde::Serialize;

use crate::report::html::Section;
use crate::report::run::RunReport;
use crate::report::{Csv, Table};

use super::args::Args;
use crate::cli::failure::Failure;
use crate::cli::page::{self, and_page};

pub struct Findings<'a, R> {
    pub title: String,
    /// Rows of the result that --json prints.
    pub rows: &'a [R],
    pub files: Vec<(&'a str, Csv)>,
    /// Contents of `run.json`, for an experiment with one shot.
    pub run: Option<RunReport>,
    /// Tables with their notes, shown in `report.html` and on the terminal.
    pub tables: Vec<Section>,
    /// Sections that appear on the page only.
    pub more: Vec<Section>,
}

/// Returns a section with a heading, notes and a table.
pub fn section(heading: &'static str, notes: Vec<String>, table: Table) -> Section {
    Section { heading, notes, table: Some(table), figure: None }
}

impl<R: Serialize> Findings<'_, R> {
    /// Writes the files and, with --report, the page. Prints the tables or, with --json, the rows.
    pub fn write(&self, args: &Args) -> Result<(), Failure> {
        let options = &args.options;
        for (name, csv) in &self.files {
            csv.write(&options.out.join(name))?;
        }
        if let Some(run) = &self.run {
            run.write(&options.out.join("run.json"))?;
        }
        if args.report {
            page::write(&options.out, &self.title, &[&self.tables[..], &self.more].concat())?;
        }
        if options.json {
            say!("{}", serde_json::json!({ "event": "result", "rows": self.rows }));
        } else if !options.quiet {
            for Section { heading, notes, table, .. } in &self.tables {
                let table = table.as_ref().map_or(String::new(), |table| table.text());
                say!("{heading}\n{}\n{}\n", table.trim_end(), notes.join("\n"));
            }
            let files = self.files.iter().map(|(name, _)| *name).chain(self.run.is_some().then_some("run.json"));
            let files: Vec<&str> = files.collect();
            say!("{}{}: {}", and_page(args.report), files.join(", "), options.out.display());
        }
        Ok(())
    }
}
