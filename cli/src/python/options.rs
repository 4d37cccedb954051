//! Keyword arguments as options of the command line, so that names, defaults, checks and error messages are the same.

use clap::{Arg, ArgAction, Args, Command, FromArgMatches};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyString};

use super::failure::exception;
use crate::failure::Failure;
use crate::options::{RenderFlags, RenderOptions};
use crate::setting_flags::{setting_of, with_flags};
use diptych::frame::settings::{Group, Settings, Value};

/// Options of a scene and of a renderer.
#[derive(Clone, Debug)]
pub struct Options {
    pub render: RenderOptions,
    /// Virtual devices on each adapter.
    pub virtual_devices: u16,
}

/// Options of the command line that Python sets in another way: arguments of methods, files, and terminal output.
const LEFT_OUT: [&str; 12] = [
    "fps",
    "frames",
    "frames_in_flight",
    "json",
    "motion",
    "out",
    "pass_spp",
    "quiet",
    "set",
    "time",
    "time_limit",
    "trace",
];

/// An option that the caller has set.
#[derive(Clone, Debug, PartialEq)]
pub struct Given {
    /// Key of the setting, or name of the option's field.
    pub id: String,
    /// The option with its value, as on the command line.
    text: String,
}

fn parser() -> Command {
    let devices = Arg::new("virtual_devices").long("virtual").default_value("1");
    let devices = devices.value_parser(clap::value_parser!(u16).range(1..=64));
    let flags = RenderFlags::augment_args(Command::new("diptych").no_binary_name(true));
    let keys: Vec<&str> = Settings::TABLE.iter().map(|setting| setting.key).collect();
    with_flags(flags, &keys).arg(devices)
}

/// Command whose options and settings Python has.
const COMMAND: &str = "render";

/// Returns the name of a keyword argument, such as `render_scale` for `--render-scale`.
fn keyword(arg: &Arg) -> Option<String> {
    let name = arg.get_long()?.replace('-', "_");
    let is_read = setting_of(arg).is_none_or(|setting| setting.is_of(COMMAND));
    (is_read && !LEFT_OUT.contains(&name.as_str())).then_some(name)
}

/// The options that keyword arguments may set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Options of a scene, those of [`Group::Scene`].
    Scene,
    /// All other options.
    Renderer,
}

impl Scope {
    fn has(self, arg: &Arg) -> bool {
        let is_of_scene = setting_of(arg).is_some_and(|setting| setting.group == Group::Scene);
        is_of_scene == (self == Self::Scene)
    }
}

/// Converts keyword arguments to options; `None` leaves an option at its default.
///
/// # Errors
/// `TypeError` if there is no such option in `scope`.
pub fn given(keywords: Option<&Bound<'_, PyDict>>, scope: Scope) -> PyResult<Vec<Given>> {
    let Some(keywords) = keywords else { return Ok(Vec::new()) };
    let parser = parser();
    let mut given = Vec::new();
    for (name, value) in keywords.iter() {
        let name: String = name.extract()?;
        let Some(arg) = parser.get_arguments().find(|arg| keyword(arg).as_ref() == Some(&name)) else {
            return Err(unknown(&name, &parser, scope));
        };
        if !scope.has(arg) {
            let place = if scope == Scope::Scene { "a renderer" } else { "a scene: give it to load" };
            return Err(PyTypeError::new_err(format!("'{name}' is an option of {place}")));
        }
        given.extend(option(arg, &value)?);
    }
    Ok(given)
}

fn unknown(name: &str, parser: &Command, scope: Scope) -> PyErr {
    let known: Vec<String> = parser.get_arguments().filter(|arg| scope.has(arg)).filter_map(keyword).collect();
    PyTypeError::new_err(format!("there is no option '{name}': the options are {}", known.join(", ")))
}

fn option(arg: &Arg, value: &Bound<'_, PyAny>) -> PyResult<Option<Given>> {
    let name = arg.get_long().unwrap_or_default();
    let id = setting_of(arg).map_or(arg.get_id().as_str(), |setting| setting.key);
    let given = |text: String| Given { id: id.to_owned(), text };
    let is_empty_list = || Ok::<_, PyErr>(name == "aov" && value.hasattr("__len__")? && value.len()? == 0);
    if value.is_none() || is_empty_list()? {
        return Ok(None);
    }
    if matches!(arg.get_action(), ArgAction::SetTrue) {
        return Ok(is_on(id, value)?.then(|| given(format!("--{name}"))));
    }
    let separator = if name == "size" { "x" } else { "," };
    Ok(Some(given(format!("--{name}={}", text(value, separator)?))))
}

/// Returns true if a value turns a switch on. Text must be `on`, `off` or a truth value.
fn is_on(id: &str, value: &Bound<'_, PyAny>) -> PyResult<bool> {
    let Ok(text) = value.cast::<PyString>() else { return value.is_truthy() };
    let text = text.to_cow()?;
    bool::parse(&text).map_err(|why| PyValueError::new_err(format!("{id} cannot be {text}: {why}")))
}

/// Returns a value as on the command line: `on` or `off` for a truth value, and items of a sequence with a separator
/// between them.
fn text(value: &Bound<'_, PyAny>, separator: &str) -> PyResult<String> {
    if let Ok(truth) = value.cast::<PyBool>() {
        return Ok(if truth.is_true() { "on" } else { "off" }.to_owned());
    }
    if value.is_instance_of::<PyString>() || !value.hasattr("__len__")? {
        return Ok(value.str()?.to_string());
    }
    let items: PyResult<Vec<String>> = value.try_iter()?.map(|item| text(&item?, separator)).collect();
    Ok(items?.join(separator))
}

impl Options {
    /// Parses the options of a renderer of the scene `shot`, and takes over settings of the shot, whose `text` is there
    /// if it is no file.
    ///
    /// # Errors
    /// `ValueError` if a value is invalid or options conflict, with the text of the command line.
    pub fn parse<'a>(shot: &str, text: Option<&str>, given: impl IntoIterator<Item = &'a Given>) -> PyResult<Self> {
        let fixed = ["--out=out", "--quiet"].map(str::to_owned);
        let given = given.into_iter().map(|given| given.text.clone());
        let line = fixed.into_iter().chain(given).chain(["--".to_owned(), shot.to_owned()]);
        let parsed = parser().try_get_matches_from(line);
        let parsed = parsed.and_then(|matches| Ok((RenderFlags::from_arg_matches(&matches)?, matches)));
        let (mut render, matches) = parsed.map_err(|error| PyValueError::new_err(shortened(&error.to_string())))?;
        let run = &mut render.run;
        let completed = match text {
            Some(text) => run.complete_from(text, COMMAND),
            None => run.complete(COMMAND),
        };
        completed.map_err(exception)?;
        // Disturbances may name any frame.
        render.frames = u32::MAX;
        let render = render.options().map_err(|error| exception(Failure::Input(error)))?;
        Ok(Self { render, virtual_devices: matches.get_one("virtual_devices").copied().unwrap_or(1) })
    }
}

/// Returns an error message of the parser without the parts that speak of a terminal.
fn shortened(message: &str) -> String {
    let message = message.strip_prefix("error: ").unwrap_or(message);
    let lines = message.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let lines: Vec<&str> = lines.map(str::trim).filter(|line| !line.is_empty()).collect();
    lines.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_left_out_exist_on_the_command_line() {
        let parser = parser();
        for name in LEFT_OUT {
            let is_named = |arg: &Arg| arg.get_long().is_some_and(|long| long.replace('-', "_") == name);
            assert!(parser.get_arguments().any(is_named), "{name}");
        }
    }

    #[test]
    fn defaults_equal_those_of_the_command_line() {
        let Options { render, virtual_devices } = Options::parse("builtin:cornell", None, []).unwrap();
        assert_eq!(
            (render.shot.as_str(), render.quality(), virtual_devices),
            ("builtin:cornell", diptych::quality::Quality::default(), 1)
        );
        assert_eq!(render.settings.size.to_string(), "640x360");
    }

    #[test]
    fn settings_of_shots_apply_unless_given() {
        let shot = "scene = 'builtin:cornell'\n[render]\nspp = 4\nsize = '32x18'\n";
        let given = [Given { id: "spp".to_owned(), text: "--spp=2".to_owned() }];
        let Options { render, .. } = Options::parse("dict", Some(shot), &given).unwrap();
        assert_eq!((render.quality().spp, render.settings.size.to_string().as_str()), (2.into(), "32x18"));
    }

    #[test]
    fn scenes_and_renderers_divide_the_options() {
        let parser = parser();
        let names = |scope: Scope| -> Vec<String> {
            parser.get_arguments().filter(|arg| scope.has(arg)).filter_map(keyword).collect()
        };
        assert!(names(Scope::Scene).contains(&"environment".to_owned()));
        for name in ["denoiser", "gaze", "slowdown"] {
            assert!(names(Scope::Renderer).contains(&name.to_owned()), "{name}");
        }
        for name in ["controller", "keep_going", "speeds", "network_us", "time_limit", "pass_spp"] {
            assert!(!names(Scope::Renderer).contains(&name.to_owned()), "{name}");
        }
        assert!(names(Scope::Scene).iter().all(|name| !names(Scope::Renderer).contains(name)));
    }
}
