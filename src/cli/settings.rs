//! What options are in force, as `run.json` and pages show it.

use std::ffi::OsString;

use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command, CommandFactory};
use serde_json::{Map, Value, json};

use diptych::device::DeviceInfo;
use diptych::report::once;
use diptych::report::run::RunSettings;

use super::Cli;
use super::foveation::FoveationMode;
use super::options::{RenderOptions, RunOptions};
use super::setup::name;

/// The options of a command line.
pub struct Given {
    command: Command,
    matches: ArgMatches,
}

impl Given {
    /// Of this process; none where its command line is not the program's, as in tests.
    pub fn here() -> Option<Self> {
        Self::of(std::env::args_os())
    }

    fn of(args: impl IntoIterator<Item = OsString>) -> Option<Self> {
        let mut program = Cli::command();
        let (name, matches) = program.try_get_matches_from_mut(args).ok()?.remove_subcommand()?;
        Some(Self { command: program.find_subcommand(&name)?.clone(), matches })
    }

    /// Whether an option was typed rather than left at its default.
    pub fn has(&self, option: &str) -> bool {
        self.arg(option)
            .is_some_and(|arg| self.matches.value_source(arg.get_id().as_str()) == Some(ValueSource::CommandLine))
    }

    fn arg(&self, option: &str) -> Option<&Arg> {
        self.command.get_arguments().find(|arg| arg.get_long() == Some(option))
    }

    /// Every option by its long name in snake_case, and the shot. Values stand as they were typed, numbers as numbers;
    /// of what was left out, the default; an option without any is null, a list empty.
    fn values(&self) -> Map<String, Value> {
        let arguments = self.command.get_arguments().filter(|arg| {
            !matches!(
                arg.get_action(),
                ArgAction::Help | ArgAction::HelpShort | ArgAction::HelpLong | ArgAction::Version
            )
        });
        let name = |arg: &Arg| arg.get_long().unwrap_or(arg.get_id().as_str()).replace('-', "_");
        arguments.map(|arg| (name(arg), self.value(arg))).collect()
    }

    fn value(&self, arg: &Arg) -> Value {
        let id = arg.get_id().as_str();
        if matches!(arg.get_action(), ArgAction::SetTrue) {
            return self.matches.get_flag(id).into();
        }
        let typed = self.matches.get_raw(id).into_iter().flatten().map(|value| scalar(&value.to_string_lossy()));
        let is_list = matches!(arg.get_action(), ArgAction::Append) || arg.get_value_delimiter().is_some();
        if is_list { typed.collect() } else { typed.last().unwrap_or(Value::Null) }
    }
}

/// A number where a text is one.
fn scalar(text: &str) -> Value {
    let whole = text.parse::<i64>().ok().map(Value::from);
    whole.or_else(|| text.parse().ok().filter(|n: &f64| n.is_finite()).map(Value::from)).unwrap_or_else(|| text.into())
}

/// Every option of this command line, as [`Given::values`] has it.
pub fn of_command_line(options: &RunOptions, exposure_ev: f64) -> RunSettings {
    let mut values = Given::here().map_or_else(Map::new, |given| given.values());
    values.insert("shot".to_owned(), json!(options.shot));
    values.insert("size".to_owned(), json!(options.size.to_string()));
    RunSettings { exposure_ev, options: values }
}

/// The same with what presets, references and other options make of them, in frames that are rendered with `options` on
/// these devices, where they are the same for all frames. Only options that the command has are there.
pub fn in_force(options: &RenderOptions, exposure_ev: f64, devices: &[DeviceInfo]) -> RunSettings {
    let mut settings = of_command_line(options, exposure_ev);
    let is_filtered = options.iterations() > 0;
    let layers = options.layer_iterations();
    let is_layered = options.foveated.foveation == FoveationMode::Layers;
    for (option, value) in [
        ("spp", json!(options.spp)),
        ("bounces", json!(options.bounces)),
        ("scale", json!(options.scale)),
        ("denoiser", json!(if is_filtered { name(&options.denoiser) } else { "none".to_owned() })),
        ("iterations", if is_layered { json!(layers) } else { json!(layers[0]) }),
        ("foveation", json!(name(&options.foveated.foveation))),
        ("reproject", json!(name(&options.reproject))),
        ("balance", json!(name(&options.balance()))),
        ("fps", json!(options.fps)),
    ] {
        if let Some(there) = settings.options.get_mut(option) {
            *there = value;
        }
    }
    if !devices.is_empty() {
        let threads: Vec<Option<usize>> = devices.iter().map(|d| d.threads).collect();
        settings.options.insert("devices".to_owned(), json!(once(devices.iter().map(|d| d.adapter))));
        settings.options.insert("threads_per_device".to_owned(), json!(threads));
    }
    settings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(args: &[&str]) -> Given {
        Given::of(["diptych"].iter().chain(args).map(OsString::from)).unwrap()
    }

    #[test]
    fn every_option_of_every_command_has_its_value() {
        let typed = ["render", "a.glb", "--out", "o", "--aov", "depth,normal", "--clamp", "2.5", "--no-skip"];
        let values = given(&typed).values();
        for (option, value) in [
            ("shot", json!("a.glb")),
            ("out", json!("o")),
            ("size", json!("640x360")),
            ("virtual", json!(1)),
            ("aov", json!(["depth", "normal"])),
            ("ratios", json!([])),
            ("clamp", json!(2.5)),
            ("watchdog_ms", json!(null)),
            ("no_skip", json!(true)),
            ("details", json!(false)),
        ] {
            assert_eq!(values.get(option), Some(&value), "{option}");
        }
        assert!(!values.contains_key("help"), "{values:?}");
        for command in ["render", "play", "scale", "bench"] {
            let given = given(&[command, "--out", "o"]);
            let values = given.values();
            let options: Vec<&str> = given.command.get_arguments().filter_map(Arg::get_long).collect();
            let missing = options.iter().filter(|o| **o != "help" && !values.contains_key(&o.replace('-', "_")));
            assert_eq!(missing.collect::<Vec<_>>(), Vec::<&&str>::new(), "{command}");
        }
    }

    #[test]
    fn defaults_are_not_given() {
        let given = given(&["render", "--out", "o", "--denoiser", "svgf"]);
        assert!(given.has("denoiser") && given.has("out"));
        assert!(!given.has("spp") && !given.has("iterations") && !given.has("nonsense"));
    }
}
