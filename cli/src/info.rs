//! `diptych info`: what this machine has, the scene of a shot, and all settings.

use serde_json::json;

use crate::report::csv::Column;
use crate::report::{Table, text_table};
use diptych::device::{self, AdapterReport, Selection};
use diptych::frame::settings::{NO_SHOT, Setting, Settings};
use diptych::scene::builtin::BUILTINS;
use diptych::scene::motion::Moves;

use super::failure::Failure;
use super::measure::{self, Options};
use super::setting_flags::SettingFlags;
use super::{console, hints, scene_loading, setup};

#[derive(clap::Args)]
pub struct Args {
    /// Shot (.toml), .gltf/.glb or builtin:NAME [default: adapters and built-in scenes]
    shot: Option<String>,
    /// List all settings, which --set, shots and Python share
    #[arg(long, conflicts_with_all = ["shot", "check"])]
    settings: bool,
    /// Measure how fast this machine renders the shot, or else built-in scenes
    ///
    /// For a shot, it prints which sizes take at most 11 and 20 ms. Without one, it also checks the images, and writes
    /// report.html and machine.json.
    #[arg(long)]
    check: bool,
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    chosen: SettingFlags,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let command = if args.shot.is_some() { "info" } else { NO_SHOT };
    let checked = args.chosen.check_command(command).and_then(|()| args.chosen.check());
    checked.map_err(|error| Failure::Input(error.into()))?;
    match &args.shot {
        _ if args.settings => settings(args.options.json),
        None if args.check => measure::run(&args.options),
        None => machine(args.options.json),
        Some(shot) if args.check => measure::shot(&args.options, &setup::load_alone(shot, &args.chosen)?),
        Some(shot) => describe(shot, args),
    }
}

/// Lists all settings.
fn settings(as_json: bool) -> Result<(), Failure> {
    if as_json {
        let all = Settings::TABLE.iter().map(|setting| {
            let words: Vec<&str> = (setting.words)().into_iter().map(|(word, _)| word).collect();
            json!({
                "key": setting.key, "group": format!("{:?}", setting.group).to_lowercase(), "form": setting.form,
                "words": words, "default": setting.default(), "help": setting.text(),
            })
        });
        say!("{}", json!(all.collect::<Vec<_>>()));
        return Ok(());
    }
    let row = |setting: &Setting| {
        let words: Vec<&str> = (setting.words)().into_iter().map(|(word, _)| word).collect();
        let values = if words.is_empty() { setting.form.to_owned() } else { words.join("|") };
        vec![setting.key.to_owned(), setting.default(), values, setting.summary().to_owned()]
    };
    let rows: Vec<_> = Settings::TABLE.iter().map(row).collect();
    say!("{}", text_table(&["setting", "default", "values", "meaning"], &rows).trim_end());
    Ok(())
}

/// Opens a device if the adapter lacks nothing else, since drivers may list adapters on which none can be opened.
fn try_to_open(adapter: &mut AdapterReport) {
    let selection = Selection {
        adapters: Some(vec![adapter.index]),
        virtual_devices: 1,
        pool: console::devices(),
        ..Default::default()
    };
    if adapter.missing.is_empty()
        && let Err(error) = device::open(&selection)
    {
        let cause = std::error::Error::source(&error).map_or_else(|| error.to_string(), ToString::to_string);
        adapter.missing.push(format!("a device that can be opened ({cause})"));
        adapter.hint = "update its driver or choose another adapter";
    }
}

/// Columns of the list of adapters.
const COLUMNS: [Column<AdapterReport>; 8] = [
    ("#", |a| a.index.to_string()),
    ("adapter", |a| a.name.clone()),
    ("kind", |a| a.kind.clone()),
    ("backend", |a| a.backend.clone()),
    ("driver", |a| a.driver.clone()),
    ("largest buffer", |a| format!("{} MiB", a.max_storage_mib)),
    ("ray queries", |a| if a.ray_queries { "yes" } else { "no" }.to_owned()),
    ("state", |a| match &a.missing[..] {
        [] => "ready".to_owned(),
        missing => format!("lacks {}: {} ({})", missing.join(", "), a.hint, hints::ADAPTER),
    }),
];

/// Lists adapters and built-in scenes.
fn machine(as_json: bool) -> Result<(), Failure> {
    let mut adapters = device::adapters();
    adapters.iter_mut().for_each(try_to_open);
    if as_json {
        let scenes: Vec<_> = BUILTINS.iter().map(|b| json!({ "name": b.name, "about": b.about })).collect();
        let all = json!({ "adapters": adapters, "scenes": scenes });
        say!("{}", serde_json::to_string_pretty(&all).map_err(anyhow::Error::from)?);
        return Ok(());
    }
    if adapters.is_empty() {
        return Err(device::DeviceError::NoAdapter.into());
    }
    say!("{}", Table::new(&COLUMNS, &adapters).text().trim_end());
    for (adapter, advice) in adapters.iter().filter_map(|a| Some((a, a.advice.as_ref()?))) {
        say!("\nadapter {}: {advice}", adapter.index);
    }
    say!("");
    for builtin in BUILTINS {
        say!("builtin:{:<10} {}", builtin.name, builtin.about);
    }
    Ok(())
}

fn describe(shot: &str, args: &Args) -> Result<(), Failure> {
    let (shot, scene) = scene_loading::load(&args.chosen, shot)?;
    let moves = scene.motion.moves();
    let [triangles, instances, lights] = [scene.triangle_count(), scene.instances.len(), scene.lights.len()];
    if args.options.json {
        let scene = json!({
            "name": shot.name, "triangles": triangles, "instances": instances, "lights": lights, "moves": moves,
            "warnings": scene.warnings, "notes": scene.notes,
        });
        say!("{scene}");
        return Ok(());
    }
    setup::tell_remarks(&scene);
    say!("{}: {triangles} triangles, {instances} instances, {lights} lights", shot.name);
    match &moves {
        None => say!("the scene is static"),
        Some(moves) => say!("{}", text(moves)),
    }
    Ok(())
}

fn text(moves: &Moves) -> String {
    let animation = |(i, name, s): (usize, &str, f64)| match name {
        "" => format!("animation {i}: {s:.3} s\n"),
        name => format!("animation {i} '{name}': {s:.3} s\n"),
    };
    let played = moves.animations.iter().enumerate();
    let animations: String = played.map(|(i, a)| animation((i, &a.name, a.duration_s))).collect();
    let counts = [
        (moves.rigid_instances, "rigid instances"),
        (moves.skinned_instances, "skinned instances"),
        (moves.morphing_instances, "morphing instances"),
        (moves.skins, "skins"),
        (moves.nodes, "nodes"),
        (moves.lights, "lights"),
        (moves.cameras, "cameras"),
        (moves.materials, "materials"),
    ];
    let counts = counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    format!("{animations}moving: {}", counts.collect::<Vec<_>>().join(", "))
}
