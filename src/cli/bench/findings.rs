//! What an experiment found: its files, its page, and what is said of it.

use serde::Serialize;

use crate::report::html::Section;
use crate::report::run::RunReport;
use crate::report::{Csv, Table};

use super::Args;
use crate::cli::failure::Failure;
use crate::cli::page::{self, and_page};

pub struct Findings<'a, R> {
    pub title: String,
    /// For programs.
    pub rows: &'a [R],
    pub files: Vec<(&'static str, Csv)>,
    /// `run.json`, of an experiment with one shot.
    pub run: Option<RunReport>,
    /// Tables with their notes, which are said as well.
    pub tables: Vec<Section>,
    /// What stands on the page alone.
    pub more: Vec<Section>,
}

/// A table under its heading, above its notes.
pub fn section(heading: &'static str, notes: Vec<String>, table: Table) -> Section {
    Section { heading, notes, table: Some(table), figure: None }
}

impl<R: Serialize> Findings<'_, R> {
    /// Writes the files, with --report the page, and says the tables.
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
