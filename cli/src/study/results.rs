//! Results of a study: its files, its page and its printed tables.

use anyhow::Context;

use super::args::StudyArgs;
use super::columns::Found;
use super::definition::Study;
use super::locked::{Departure, departures};
use super::rows::{FRAME_LABELS, Labels, Row};
use crate::failure::Failure;
use crate::page::{self, and_page};
use crate::report::frames::FrameLine;
use crate::report::html::Section;
use crate::report::pictures::Group;
use crate::report::rings::{self, RingRow, ring_charts, ring_csv, ring_table};
use crate::report::{Csv, Table};
use diptych::device::DeviceInfo;

pub struct Results {
    study: &'static Study,
    rows: Vec<Row>,
    pub rings: Vec<RingRow>,
    /// Timed frames, each with the labels of its row.
    frames: Vec<(Labels, FrameLine)>,
    pub devices: Vec<DeviceInfo>,
    /// Number of renderers so far.
    pub renderers: usize,
    notes: Vec<String>,
    /// Pictures of the last frame of each row, for the page.
    pub pictures: Vec<Group>,
    /// Further sections of the page.
    pub sections: Vec<Section>,
}

impl Results {
    pub fn new(study: &'static Study) -> Self {
        let (rows, rings, frames, devices, renderers, notes, pictures, sections) = Default::default();
        Self { study, rows, rings, frames, devices, renderers, notes, pictures, sections }
    }

    /// True if nothing has been measured.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Adds a note on a subject to the last table, unless there is one.
    pub fn note(&mut self, subject: &str, note: &str) {
        if !self.notes.iter().any(|known| known.starts_with(subject)) {
            self.notes.push(format!("{subject}: {note}"));
        }
    }

    /// Adds the results of all arrangements to the rows and the frames.
    pub fn keep(&mut self, labels: &Labels, all: &[Found]) {
        for (arrangement, found) in self.study.arrangements.iter().zip(all) {
            let labels = Labels { arrangement: arrangement.name.to_owned(), ..labels.clone() };
            self.frames.extend(found.lines.iter().map(|line| (labels.clone(), line.clone())));
        }
        self.rows.extend(self.study.rows(labels, all));
    }

    /// Writes the files and, with --report, the page. Prints the tables or, with --json, the rows.
    pub fn write(mut self, args: &StudyArgs) -> Result<(), Failure> {
        let (study, options) = (self.study, &args.options);
        self.rows.extend(study.published());
        let mut files =
            vec![(format!("{}.csv", study.name), study.csv(&self.rows)), ("frames.csv".to_owned(), self.frames())];
        if study.has_rings() {
            files.push(("rings.csv".to_owned(), ring_csv(&self.rings)));
        }
        for (name, csv) in &files {
            csv.write(&options.out.join(name))?;
        }
        let tables = self.tables();
        if args.report {
            let sections = [&tables[..], &self.sections, &self.more()?].concat();
            page::write(&options.out, study.title, &sections)?;
        }
        if options.json {
            let rows: Vec<_> = self.rows.iter().map(|row| study.json(row)).collect();
            say!("{}", serde_json::json!({ "event": "result", "rows": rows }));
        } else if !options.quiet {
            for Section { heading, notes, table, .. } in &tables {
                let table = table.as_ref().map_or(String::new(), Table::text);
                say!("{heading}\n{}\n{}\n", table.trim_end(), notes.join("\n"));
            }
            let files: Vec<&str> = files.iter().map(|(name, _)| &name[..]).collect();
            say!("{}{}: {}", and_page(args.report), files.join(", "), options.out.display());
        }
        Ok(())
    }

    fn frames(&self) -> Csv {
        let (labels, lines): (Vec<_>, Vec<_>) = self.frames.iter().cloned().unzip();
        let columns = FRAME_LABELS.map(str::to_owned).to_vec();
        let lines_of = labels.iter().map(|labels: &Labels| labels.of_frame().map(str::to_owned).to_vec()).collect();
        Csv { columns, lines: lines_of }.beside(FrameLine::csv(&lines))
    }

    /// Returns the printed tables: those of the study, the settings in which diptych departs from the publication, and the
    /// conditions that cannot be repeated.
    fn tables(&self) -> Vec<Section> {
        let study = self.study;
        let table = |(index, [heading, caption]): (usize, &[&'static str; 2])| Section {
            heading,
            notes: vec![(*caption).to_owned()],
            table: Some(study.table(index, &self.rows)),
            figure: None,
        };
        let mut tables: Vec<Section> = study.tables.iter().enumerate().map(table).collect();
        tables[0].notes.push(format!("cited: {}", study.source));
        let last = tables.len() - 1;
        tables[last].notes.extend(self.notes.iter().cloned());
        let departure = |Departure { key, published, today }: Departure| vec![key.to_owned(), published, today];
        let rows = departures(study.name).into_iter().map(departure).collect();
        tables.push(Section {
            heading: "Departures",
            notes: vec![
                "Settings in which diptych today departs from the publication; --conditions each measures every one \
                of them alone."
                    .to_owned(),
            ],
            table: Some(Table { headers: vec!["setting", "published", "today"], rows }),
            figure: None,
        });
        let rows = study.unlike.iter().map(|row| row.map(str::to_owned).to_vec()).collect();
        tables.push(Section {
            heading: "Not repeated",
            notes: Vec::new(),
            table: Some(Table { headers: vec!["in the publication", "needs"], rows }),
            figure: None,
        });
        tables
    }

    /// Returns the sections that only the page has.
    fn more(&self) -> Result<Vec<Section>, Failure> {
        let mut more = Vec::new();
        if self.study.has_rings() {
            let names: Vec<&str> = self.study.arrangements.iter().map(|one| one.name).collect();
            let figure = Some(ring_charts(&self.rings, &names).context("cannot draw the rings")?);
            let table = Some(ring_table(&self.rings, &names));
            more.push(Section { heading: "By ring", notes: vec![rings::NOTE.to_owned()], table, figure });
        }
        if !self.pictures.is_empty() {
            let note = "The last frame of each arrangement and its FLIP against the reference.";
            more.push(page::pictures(note.to_owned(), &self.pictures)?);
        }
        let table = Some(Table::of_devices([&self.devices[..]]));
        more.push(Section { heading: "Devices", table, ..Section::default() });
        Ok(more)
    }
}
