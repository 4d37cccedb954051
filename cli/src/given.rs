//! Options of a command line.

use std::any::TypeId;
use std::ffi::OsStr;
use std::path::PathBuf;

use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command};
use serde_json::{Map, Value};

use super::setting_flags::SETTING;

/// The options of a command line.
pub struct Given {
    command: Command,
    matches: ArgMatches,
}

impl Given {
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
    pub fn values(&self) -> Map<String, Value> {
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

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::commands::command;

    fn given(args: &[&str]) -> Given {
        let command = command();
        Given::of(&command, &command.clone().try_get_matches_from(["diptych"].iter().chain(args)).unwrap()).unwrap()
    }

    #[test]
    fn options_have_their_values() {
        let typed = ["render", "a.glb", "--out", "7", "--also", "anaglyph,sheet", "--frames", "3", "--quiet"];
        let values = given(&typed).values();
        for (option, value) in [
            ("shot", json!("a.glb")),
            ("out", json!("7")),
            ("virtual", json!(1)),
            ("also", json!(["anaglyph", "sheet"])),
            ("trace", json!(null)),
            ("frames", json!(3)),
            ("quiet", json!(true)),
        ] {
            assert_eq!(values.get(option), Some(&value), "{option}");
        }
        assert!(!values.contains_key("help"), "{values:?}");
    }

    #[test]
    fn defaults_do_not_count_as_given() {
        let given = given(&["render", "--out", "o", "--frames", "1"]);
        assert_eq!(given.typed("frames").as_deref(), Some("--frames"));
        assert_eq!(["also", "nonsense", "virtual_devices"].map(|id| given.typed(id)), [None, None, None]);
    }
}
