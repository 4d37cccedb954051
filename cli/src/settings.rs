//! Options in force, as shown in `run.json` and on report pages.

use std::any::TypeId;
use std::ffi::OsStr;
use std::path::PathBuf;
use std::sync::Arc;

use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command};
use serde_json::{Map, Value, json};

use crate::report::once;
use crate::report::run::RunSettings;
use diptych::device::DeviceInfo;
use diptych::frame::settings::Chosen;
use diptych::quality::Denoiser;

use super::balance::Balance;
use super::console;
use super::options::RenderOptions;
use super::setting_flags::SETTING;

/// The options of a command line.
pub struct Given {
    command: Command,
    matches: ArgMatches,
}

impl Given {
    /// Returns the options of this command; `None` before they are kept, as in tests.
    pub fn here() -> Option<Arc<Self>> {
        console::options()
    }

    /// Returns the options of a command line. `command` is the definition of all commands.
    pub fn of(command: &Command, matches: &ArgMatches) -> Option<Self> {
        let (name, matches) = matches.subcommand()?;
        Some(Self { command: command.find_subcommand(name)?.clone(), matches: matches.clone() })
    }

    /// Returns the name of an option as the user types it, such as `--size` or `SHOT`, if the command line sets the
    /// option; `None` if it has its default. `id` is the name of its field.
    pub fn typed(&self, id: &str) -> Option<String> {
        let arg = self.arg(id)?;
        (self.matches.value_source(id)? == ValueSource::CommandLine)
            .then(|| arg.get_long().map_or_else(|| id.to_uppercase(), |long| format!("--{long}")))
    }

    fn arg(&self, id: &str) -> Option<&Arg> {
        self.command.get_arguments().find(|arg| arg.get_id() == id)
    }

    /// Returns every option by its long name in snake_case, and the shot. Values are as typed, and numbers are JSON
    /// numbers. An omitted option has its default; without one it is null, or an empty list.
    fn values(&self) -> Map<String, Value> {
        let arguments = self.command.get_arguments().filter(|arg| {
            let is_setting = arg.get_id().as_str().starts_with(SETTING) || arg.get_id() == "set";
            !is_setting
                && !matches!(
                    arg.get_action(),
                    ArgAction::Help | ArgAction::HelpShort | ArgAction::HelpLong | ArgAction::Version
                )
        });
        arguments.map(|arg| (setting(arg), self.value(arg))).collect()
    }

    fn value(&self, arg: &Arg) -> Value {
        let id = arg.get_id().as_str();
        if matches!(arg.get_action(), ArgAction::SetTrue) {
            return self.matches.get_flag(id).into();
        }
        let kind = arg.get_value_parser().type_id();
        let is_text = kind == TypeId::of::<PathBuf>() || kind == TypeId::of::<String>();
        let value = |text: &OsStr| match text.to_string_lossy() {
            text if is_text => text.into(),
            text => scalar(&text),
        };
        let mut typed = self.matches.get_raw(id).into_iter().flatten().map(value);
        let is_list = matches!(arg.get_action(), ArgAction::Append) || arg.get_value_delimiter().is_some();
        if is_list { typed.collect() } else { typed.next().unwrap_or(Value::Null) }
    }
}

/// Returns the long name of an option in snake_case.
fn setting(arg: &Arg) -> String {
    arg.get_long().unwrap_or(arg.get_id().as_str()).replace('-', "_")
}

/// Converts text to a JSON number if it is one.
fn scalar(text: &str) -> Value {
    let whole = text.parse::<i64>().ok().map(Value::from);
    whole.or_else(|| text.parse().ok().filter(|n: &f64| n.is_finite()).map(Value::from)).unwrap_or_else(|| text.into())
}

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

/// Returns the name of the policy, or a list of several names.
pub fn balance(policies: &[Balance]) -> Value {
    match policies {
        [one] => json!(one.name()),
        several => json!(several.iter().map(|policy| policy.name()).collect::<Vec<_>>()),
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
        ("balance", balance(&options.balances())),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::command;

    fn given(args: &[&str]) -> Given {
        let command = command();
        Given::of(&command, &command.clone().try_get_matches_from(["diptych"].iter().chain(args)).unwrap()).unwrap()
    }

    #[test]
    fn every_option_of_every_command_has_its_value() {
        let typed = ["render", "a.glb", "--out", "7", "--aov", "depth,normal", "--frames", "3", "--quiet"];
        let values = given(&typed).values();
        for (option, value) in [
            ("shot", json!("a.glb")),
            ("out", json!("7")),
            ("virtual", json!(1)),
            ("aov", json!(["depth", "normal"])),
            ("ratios", json!([])),
            ("trace", json!(null)),
            ("frames", json!(3)),
            ("quiet", json!(true)),
        ] {
            assert_eq!(values.get(option), Some(&value), "{option}");
        }
        assert!(!values.contains_key("help"), "{values:?}");
        for command in ["render", "play", "scale", "bench"] {
            let given = given(&[command, "--out", "o"]);
            let values = given.values();
            let is_option = |arg: &&Arg| !arg.get_id().as_str().starts_with(SETTING);
            let options: Vec<&str> =
                given.command.get_arguments().filter(is_option).filter_map(Arg::get_long).collect();
            let missing =
                options.iter().filter(|o| **o != "help" && **o != "set" && !values.contains_key(&o.replace('-', "_")));
            assert_eq!(missing.collect::<Vec<_>>(), Vec::<&&str>::new(), "{command}");
        }
    }

    #[test]
    fn defaults_are_not_given() {
        let given = given(&["render", "--out", "o", "--frames", "1"]);
        assert_eq!(given.typed("frames").as_deref(), Some("--frames"));
        assert_eq!(["aov", "nonsense", "virtual_devices"].map(|id| given.typed(id)), [None, None, None]);
    }
}
