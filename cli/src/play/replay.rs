//! `diptych play --replay`: repeats the decisions of an earlier run.

use std::collections::VecDeque;
use std::path::Path;

use anyhow::{Context, Error, ensure};
use serde::Deserialize;
use serde_json::{Map, Value};

use super::args::Args;
use crate::failure::Failure;
use diptych::control::{Budget, Control, Decision};
use diptych::frame::Disturbance;
use diptych::frame::settings::{Group, Setting, Settings};

/// Settings that decide how a scene is read, or that the recorded run and its ladder determine.
const OTHERS: [&str; 7] =
    ["fps", "max_scene_memory", "scene_cache", "allow_outside", "strict", "denoiser", "iterations"];

/// Returns the names of the shot and of settings on which images depend, and which the ladder does not contain.
fn of_images() -> impl Iterator<Item = &'static str> {
    let is_of_images = |setting: &&Setting| {
        let is_of_group = matches!(setting.group, Group::Scene | Group::Picture | Group::Quality);
        (is_of_group || setting.key == "seam") && setting.is_of("play") && !OTHERS.contains(&setting.key)
    };
    let settings = Settings::TABLE.iter().filter(is_of_images);
    std::iter::once("shot").chain(settings.map(|setting| setting.key))
}

/// The decisions of an earlier run.
pub struct Replay {
    settings: Map<String, Value>,
    /// Rungs of the frames that are still to come.
    rungs: VecDeque<usize>,
}

/// The parts of `run.json` that a replay needs.
#[derive(Deserialize)]
struct Recorded {
    settings: Map<String, Value>,
    play: Play,
    frames: Vec<Frame>,
}

#[derive(Deserialize)]
struct Play {
    fps: f64,
}

#[derive(Deserialize)]
struct Frame {
    rung: usize,
}

impl Replay {
    /// Reads the `run.json` of `--replay`. Returns the options with the run's ladder, frame rate, number of frames and
    /// scene cuts.
    pub fn read(args: &Args, path: &Path) -> Result<(Self, Args), Failure> {
        Self::of_file(args, path)
            .with_context(|| format!("cannot use --replay {}", path.display()))
            .map_err(Failure::Input)
    }

    fn of_file(args: &Args, path: &Path) -> Result<(Self, Args), Error> {
        let text = std::fs::read_to_string(path)?;
        let Recorded { mut settings, play, frames } =
            serde_json::from_str(&text).context("it is no run.json of `diptych play`")?;
        ensure!(!frames.is_empty(), "it has no frames");
        // Earlier versions wrote null for some settings at their defaults.
        for (key, value) in settings.iter_mut().filter(|(_, value)| value.is_null()) {
            *value = Setting::of_key(key).map_or(Value::Null, |setting| setting.json(&Settings::default()));
        }
        let mut again = args.clone();
        again.frames = frames.len().try_into().context("it has too many frames")?;
        again.options.run.settings.keep_going = true;
        let options_again = &mut again.options;
        options_again.ladder = Some(path.with_file_name("ladder.toml"));
        options_again.run.settings.fps = Some(play.fps);
        for text in settings.get("disturb").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str) {
            if let Ok(cut @ Disturbance::SceneCut { .. }) = text.parse() {
                options_again.run.settings.disturb.push(cut);
            }
        }
        Ok((Self { settings, rungs: frames.iter().map(|frame| frame.rung).collect() }, again))
    }

    /// Checks that the settings of the images are those of the earlier run, on a ladder with this number of rungs.
    ///
    /// # Errors
    /// Names the first setting that differs.
    pub fn check(&self, settings: &Map<String, Value>, rungs: usize) -> Result<(), Error> {
        for name in of_images() {
            let [then, now] = [&self.settings, settings].map(|of| of.get(name).unwrap_or(&Value::Null));
            ensure!(then == now, "--replay: the run had {name}={then}, not {now}: give the same value");
        }
        let most = self.rungs.iter().copied().max().unwrap_or(0);
        ensure!(most < rungs, "--replay: a frame is on rung {most}, but ladder.toml has {rungs} rungs to use");
        Ok(())
    }
}

impl Control for Replay {
    fn next(&mut self, predict: &dyn Fn(usize) -> f64) -> Decision {
        let rung = self.rungs.pop_front().unwrap_or(0);
        Decision { rung, expected_ms: predict(rung), fits: true }
    }

    fn observe(&mut self, _rung: usize, _makespan_ms: f64) {}

    fn set_budget(&mut self, _budget: Budget) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_depend_on_settings_of_the_table() {
        let all: Vec<&str> = of_images().collect();
        for name in ["shot", "seed", "gaze", "baseline", "unsampled_fraction", "bypass_narrow_lobes", "seam"] {
            assert!(all.contains(&name), "{name}");
        }
        for name in ["spp", "bounces", "render_scale", "halo", "slowdown"].into_iter().chain(OTHERS) {
            assert!(Setting::of_key(name).is_some() && !all.contains(&name), "{name}");
        }
    }
}
