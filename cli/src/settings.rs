//! Options in force, as shown in `run.json` and on report pages.

use serde_json::{Value, json};

use crate::report::once;
use crate::report::run::RunSettings;
use diptych::device::DeviceInfo;
use diptych::frame::settings::{self, Chosen};
use diptych::quality::Denoiser;

use super::console;
pub use super::given::Given;
use super::options::RenderOptions;

/// Returns all settings, and all options of this command line as typed or by default. `known` holds the values of those
/// options that others determine; they replace what was typed.
pub fn of_command_line(
    exposure_ev: f64,
    settings: &Chosen,
    known: impl IntoIterator<Item = (&'static str, Value)>,
) -> RunSettings {
    let mut options = Given::here().map(|given| given.values()).unwrap_or_default();
    options.extend(settings.json());
    for (name, value) in known {
        if let Some(option) = options.get_mut(name) {
            *option = value;
        }
    }
    RunSettings { command: console::command_line(), exposure_ev, options }
}

/// Returns the text of one value, or a list of several.
pub fn names<T: settings::Value>(values: &[T]) -> Value {
    match values {
        [one] => one.text().into(),
        several => several.iter().map(T::text).collect(),
    }
}

/// Returns the options in force for frames that are rendered with `options` on `devices`: those of the command line,
/// except where a preset, --reference or another option determines the value. `devices` is empty if not all frames were
/// rendered on the same devices.
pub fn in_force(options: &RenderOptions, exposure_ev: f64, devices: &[DeviceInfo]) -> RunSettings {
    let quality = options.quality();
    let is_layered = quality.fovea.is_some();
    let grid = if is_layered { "layers" } else { "none" };
    let mut known = vec![
        ("out", json!(options.out.display().to_string())),
        ("balance", names(&options.settings.balances())),
        ("controller", names(&options.settings.controller)),
        ("fps", json!(options.fps)),
        ("spp", json!(quality.spp)),
        ("bounces", json!(quality.bounces)),
        ("render_scale", json!(quality.scale)),
        ("denoiser", json!(Denoiser::name_of(quality.denoiser()))),
        ("iterations", if is_layered { json!(quality.iterations()) } else { json!(quality.iterations()[0]) }),
        ("foveation", json!(quality.polar.map_or(grid, |space| space.method().name()))),
    ];
    if !devices.is_empty() {
        let threads: Vec<Option<usize>> = devices.iter().map(|d| d.threads).collect();
        known.push(("devices", json!(once(devices.iter().map(|d| d.adapter)))));
        known.push(("threads_per_device", json!(threads)));
        known.push(("traversal", json!(devices[0].traversal)));
    }
    of_command_line(exposure_ev, &options.settings, known)
}
