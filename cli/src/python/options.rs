//! Keyword arguments as settings, so that names, defaults, checks and error messages are those of the command line.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyString};

use super::failure::exception;
use crate::failure::Failure;
use crate::options::{RenderFlags, RenderOptions, RunOptions};
use diptych::frame::settings::{Chosen, Group, Setting, Settings};

/// Options of a scene and of a renderer.
#[derive(Clone, Debug)]
pub struct Options {
    pub render: RenderOptions,
    /// Virtual devices on each adapter.
    pub virtual_devices: u16,
}

/// Settings that Python gives in another way, as arguments of methods.
const LEFT_OUT: [&str; 8] =
    ["fps", "frames_in_flight", "motion", "noise", "pass_spp", "passes_out", "time", "time_limit"];

/// Keyword of the number of virtual devices on each adapter, which is no setting.
const VIRTUAL: &str = "virtual";

/// A keyword argument.
#[derive(Clone, Debug, PartialEq)]
pub struct Given {
    /// Key of the setting, or [`VIRTUAL`].
    pub id: &'static str,
    text: String,
}

/// Command whose settings Python has.
const COMMAND: &str = "render";

/// The settings that keyword arguments may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Settings of a scene, those of [`Group::Scene`].
    Scene,
    /// All others.
    Renderer,
}

impl Scope {
    fn has(self, setting: &Setting) -> bool {
        (setting.group == Group::Scene) == (self == Self::Scene)
    }

    /// Returns the keywords.
    fn keywords(self) -> Vec<&'static str> {
        let settings = all().filter(|setting| self.has(setting)).map(|setting| setting.key);
        settings.chain((self == Self::Renderer).then_some(VIRTUAL)).collect()
    }
}

/// Returns all settings that are keywords.
fn all() -> impl Iterator<Item = &'static Setting> {
    Settings::TABLE.iter().filter(|setting| setting.is_of(COMMAND) && !LEFT_OUT.contains(&setting.key))
}

/// Reads keyword arguments; `None` leaves a setting at its default.
///
/// # Errors
/// `TypeError` if there is no such keyword in `scope`.
pub fn given(keywords: Option<&Bound<'_, PyDict>>, scope: Scope) -> PyResult<Vec<Given>> {
    let mut given = Vec::new();
    for (name, value) in keywords.into_iter().flatten() {
        let name: String = name.extract()?;
        let setting = all().find(|setting| setting.key == name);
        let is_in_scope = match setting {
            Some(setting) => scope.has(setting),
            None if name == VIRTUAL => scope == Scope::Renderer,
            None => {
                let known = scope.keywords().join(", ");
                return Err(PyTypeError::new_err(format!("there is no option '{name}': the options are {known}")));
            }
        };
        if !is_in_scope {
            let place = if scope == Scope::Scene { "a renderer" } else { "a scene: give it to load" };
            return Err(PyTypeError::new_err(format!("'{name}' is an option of {place}")));
        }
        if !value.is_none() {
            let id = setting.map_or(VIRTUAL, |setting| setting.key);
            given.push(Given { id, text: text(&value, setting)? });
        }
    }
    Ok(given)
}

/// Returns the text of a value: `on` or `off` for a truth value and for any value of a switch, and the items of a
/// sequence with separators between them.
fn text(value: &Bound<'_, PyAny>, setting: Option<&Setting>) -> PyResult<String> {
    let is_text = value.is_instance_of::<PyString>();
    let is_switch = setting.is_some_and(|setting| (setting.words)().iter().any(|(word, _)| *word == "on"));
    if !is_text && (is_switch || value.is_instance_of::<PyBool>()) {
        return Ok(if value.is_truthy()? { "on" } else { "off" }.to_owned());
    }
    if is_text || !value.hasattr("__len__")? {
        return Ok(value.str()?.to_string());
    }
    let items = value.try_iter()?.collect::<PyResult<Vec<_>>>()?;
    let is_text = items.iter().any(|item| item.is_instance_of::<PyString>());
    let separator = match setting {
        Some(setting) if setting.key == "size" => 'x',
        Some(Setting { separator: Some(separator), .. }) if is_text => *separator,
        _ => ',',
    };
    let items: PyResult<Vec<String>> = items.iter().map(|item| text(item, setting)).collect();
    Ok(items?.join(&separator.to_string()))
}

impl Options {
    /// Returns the options of a renderer of the scene `shot`, and takes over settings of the shot, whose `text` is
    /// there if it is no file.
    ///
    /// # Errors
    /// `ValueError` if a value is invalid or settings conflict.
    pub fn new<'a>(shot: &str, text: Option<&str>, given: impl IntoIterator<Item = &'a Given>) -> PyResult<Self> {
        let (mut settings, mut virtual_devices) = (Chosen::default(), 1);
        for Given { id, text } in given {
            if *id == VIRTUAL {
                let number = text.parse().ok().filter(|number| (1..=64).contains(number));
                let wrong = || PyValueError::new_err(format!("virtual cannot be {text}: give a number from 1 to 64"));
                virtual_devices = number.ok_or_else(wrong)?;
            } else {
                settings.set(id, text).map_err(|error| PyValueError::new_err(error.to_string()))?;
            }
        }
        let mut run = RunOptions::of(shot.to_owned(), settings.into());
        let completed = match text {
            Some(text) => run.complete_from(text, COMMAND),
            None => run.complete(COMMAND),
        };
        completed.map_err(exception)?;
        // Disturbances may name any frame.
        let render = RenderFlags { run, frames: u32::MAX }.options();
        let render = render.map_err(|error| exception(Failure::Input(error)))?;
        Ok(Self { render, virtual_devices })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_equal_those_of_the_command_line() {
        let Options { render, virtual_devices } = Options::new("builtin:cornell", None, []).unwrap();
        assert_eq!(
            (render.shot.as_str(), render.quality(), virtual_devices),
            ("builtin:cornell", diptych::quality::Quality::default(), 1)
        );
        assert_eq!(render.settings.size.to_string(), "640x360");
    }

    #[test]
    fn settings_of_shots_apply_unless_given() {
        let shot = "scene = 'builtin:cornell'\n[render]\nspp = 4\nsize = '32x18'\n";
        let given = [Given { id: "spp", text: "2".to_owned() }];
        let Options { render, .. } = Options::new("dict", Some(shot), &given).unwrap();
        assert_eq!((render.quality().spp, render.settings.size.to_string().as_str()), (2.into(), "32x18"));
    }

    #[test]
    fn scenes_and_renderers_divide_the_settings() {
        let [scene, renderer] = [Scope::Scene, Scope::Renderer].map(Scope::keywords);
        assert!(scene.contains(&"environment"));
        assert!(["denoiser", "gaze", "slowdown", "ratios", "aov", VIRTUAL].iter().all(|name| renderer.contains(name)));
        for name in ["controller", "keep_going", "speeds", "network_us"].iter().chain(&LEFT_OUT) {
            assert!(Setting::of_key(name).is_some() && !renderer.contains(name) && !scene.contains(name), "{name}");
        }
    }
}
