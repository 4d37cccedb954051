//! `report.html`, the page of `--report`: sections that several commands share.

use std::path::Path;

use anyhow::Context;

use crate::report::Table;
use crate::report::html::{Section, page};
use crate::report::lanes::{LaneFrame, lanes};
use crate::report::pictures::{Group, viewer};
use crate::report::run::SceneSummary;
use diptych::exec::PerView;
use diptych::image::RgbImage;
use diptych::loaded::LoadedScene;

use super::console::command_line;
use super::failure::Failure;
use super::options::RunOptions;
use super::output;

/// Writes the page, with the command line.
pub fn write(dir: &Path, title: &str, sections: &[Section]) -> Result<(), Failure> {
    output::write_text(dir, "report.html", &page(title, &command_line(), sections))
}

/// Returns the page's entry in a list of files, if `--report` asks for it.
pub fn and_page(report: bool) -> &'static str {
    if report { "report.html, " } else { "" }
}

/// Returns the pictures of a frame and its FLIP against the reference.
pub fn against(
    name: String,
    linear: &PerView<RgbImage>,
    reference: &PerView<RgbImage>,
    loaded: &LoadedScene,
) -> Result<Group, Failure> {
    let frame = Group::against(name, linear, reference, loaded.shot.exposure_ev);
    Ok(frame.context("cannot compare the pictures of the page")?)
}

const VIEWER_NOTE: &str = "Choose the picture on each side of the line. Drag the line, or move it with the arrow keys.";

/// Returns the caption of the FLIP maps.
pub fn flip_note(loaded: &LoadedScene) -> String {
    format!(
        "FLIP compares these pictures, tonemapped at {} EV, at 67 pixels per degree. Its maps have the colours of \
         magma: black is 0, pale yellow is 1.",
        loaded.shot.exposure_ev
    )
}

/// Returns a section with a picture viewer; `note` describes the pictures.
pub fn pictures(note: String, groups: &[Group]) -> Result<Section, Failure> {
    let figure = Some(viewer(groups).context("cannot make the pictures of the page")?);
    Ok(Section { heading: "Pictures", notes: vec![note, VIEWER_NOTE.to_owned()], figure, table: None })
}

const LANES_NOTE: &str = "Each lane is a device and an eye. Each box is a pass on a stripe of rows, timed by the \
    device's clock. Transfers have lanes of their own, timed by the host's clock. The line at the right marks the time \
    at which the primary has the whole images. The critical path below the lanes is the chain of tasks and waits that \
    determines this time; waits are white. The sums at the end are over devices and eyes.";

/// Returns a section with swimlanes. `note` describes the frames; `shown` is the index of the frame that is visible at
/// first. `budget_ms` is marked if the frames have a budget.
pub fn swimlanes(
    note: String,
    frames: &[LaneFrame<'_>],
    shown: usize,
    budget_ms: Option<[f64; 2]>,
) -> Result<Section, Failure> {
    let figure = Some(lanes(frames, shown, budget_ms).context("cannot encode the tasks of the frames")?);
    Ok(Section { heading: "Swimlanes of a frame", notes: vec![note, LANES_NOTE.to_owned()], figure, table: None })
}

/// Returns a section with statistics of the scene.
pub fn scene(options: &RunOptions, loaded: &LoadedScene) -> Section {
    let summary = SceneSummary::of(&loaded.scene, loaded.needs, options.settings.skip_unused);
    let mut table = Table::of_fields(&summary);
    table.rows.retain(|row| {
        row.first().is_none_or(|name| !["needs", "warnings", "notes", "skipped"].contains(&name.as_str()))
    });
    let notes = summary.warnings.iter().map(|warning| format!("Warning: {warning}")).collect();
    Section { heading: "Scene", notes, table: Some(table), figure: None }
}
