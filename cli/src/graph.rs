//! `diptych graph`.

use std::io::Write;
use std::path::PathBuf;

use crate::report::Table;
use crate::report::program::{dot, left_out_table, passes_table, transfers_table};
use diptych::graph::FrameGraph;
use diptych::image::file::atomic_write;
use diptych::passes::{FrameSpec, declare};
use diptych::schedule::CostModel;

use super::failure::Failure;
use super::options::{self, RenderFlags, RunOptions};
use super::setting_flags::SettingFlags;
use super::setup;

#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// A shot (.toml), a .gltf/.glb, or builtin:NAME
    #[arg(default_value = "builtin:atrium")]
    shot: String,
    #[command(flatten)]
    settings: SettingFlags,
    /// Print JSON
    #[arg(long, help_heading = options::OUTPUT)]
    json: bool,
    /// Number of devices to distribute the frame over; no adapter is opened
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = options::DEVICES)]
    virtual_devices: u16,
    /// Write the tasks of all devices for Graphviz
    #[arg(long, value_name = "FILE", help_heading = options::OUTPUT)]
    dot: Option<PathBuf>,
}

/// Prints a table unless it is empty.
fn show(table: &Table) {
    if !table.rows.is_empty() {
        say!("{}", table.text());
    }
}

/// Vertical search range of temporal reprojection that the printed graph assumes, in rows above and below. It is the
/// range of a static scene with a static camera.
const HISTORY_ROWS: u32 = 4;

impl Args {
    /// Returns the options of the frame.
    pub fn run_options(&self) -> RunOptions {
        RunOptions { json: self.json, ..RunOptions::of(self.shot.clone(), self.settings.clone()) }
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let Args { virtual_devices, dot: file, .. } = args;
    let mut run = args.run_options();
    run.settings.check_command("graph").map_err(|error| Failure::Input(error.into()))?;
    run.complete("graph")?;
    let flags = RenderFlags { run, frames: 1 };
    let options = &flags.options().map_err(Failure::Input)?;
    let devices = usize::from(*virtual_devices);
    let loaded = setup::load_rig(options)?;
    setup::tell_remarks(&loaded.scene);
    let config = setup::config(options, &loaded)?;
    let spec = config.spec(devices, loaded.tables.has_surfaces());
    let spec = FrameSpec { history_rows: spec.history_rows.map(|_| HISTORY_ROWS), ..spec };
    let model = CostModel::new(&config.buffers.declarations.program(&spec), devices);
    let assignment = setup::policy(options, config.grid(), devices)?.assign(&model);
    let graph = FrameGraph::build(model.program(), &assignment, spec.history_rows.map(|_| &assignment));
    let left_out = left_out_table(&declare(&spec).left_out);
    let (passes, transfers) = (passes_table(&graph.program), transfers_table(&graph));
    let tasks = graph.dag.node_count();
    let pass_tasks = graph.dag.node_weights().filter(|t| graph.pass(t).is_some()).count();
    let bytes: u64 = graph.dag.node_weights().map(|t| graph.program.bytes(t)).sum::<u64>() / 2;
    if let Some(file) = file {
        atomic_write(file, |out| out.write_all(dot(&graph).as_bytes()))?;
    }
    if options.json {
        let tables = [&passes, &left_out, &transfers].map(Table::objects);
        let [passes, left_out, transfers] = tables;
        say!(
            "{}",
            serde_json::json!({
                "devices": devices, "tasks": tasks, "pass_tasks": pass_tasks, "transferred_bytes": bytes,
                "passes": passes, "left_out": left_out, "transfers": transfers,
            })
        );
        return Ok(());
    }
    say!("{}", passes.text());
    show(&left_out);
    show(&transfers);
    let mib = bytes as f64 / f64::from(1 << 20);
    say!("{tasks} tasks on {devices} device(s), {pass_tasks} of them passes; {mib:.2} MiB cross between devices");
    if let Some(file) = file {
        say!("{}", file.display());
    }
    Ok(())
}
