//! Axes of the benchmark's grid: the values given by options or by default, the settings that they span, and the frames
//! of each setting.

use anyhow::Context;
use serde_json::{Value as Json, json};

use super::args::Args;
use crate::failure::Failure;
use crate::report::once;
use crate::settings;
use diptych::control::Ladder;
use diptych::frame::settings::{FoveationMode, Settings, Value};
use diptych::quality::{Denoiser, DenoiserChoice, Filter, Quality};
use diptych::samples::Samples;

/// Frame rate at which the camera approaches the compared instant.
pub const FPS: f64 = 72.0;
/// Minimum number of warm-up frames for denoisers that keep a history.
pub const HISTORY_FRAMES: u32 = 15;

/// Denoisers that are measured by default.
const MEASURED: [DenoiserChoice; 3] = [None, Some(Denoiser::ATROUS), Some(Denoiser::SVGF)];

/// Upper bound on the frames of a setting, which keeps the settings' frame numbers in the trace apart.
pub const FRAMES_MAX: u32 = 10_000;

impl Args {
    fn spp(&self) -> Vec<Samples> {
        let default: &[u32] = if self.quick { &[1, 4] } else { &[1, 2, 4, 8, 16] };
        chosen(&self.spp, &default.iter().copied().map(Samples::from).collect::<Vec<_>>())
    }

    pub fn bounces(&self) -> Vec<u32> {
        chosen(&self.bounces, &[2, 6])
    }

    fn iterations(&self) -> Vec<u32> {
        chosen(&self.iterations, if self.quick { &[5] } else { &[3, 5] })
    }

    pub fn denoisers(&self) -> Vec<DenoiserChoice> {
        chosen(&self.denoiser, &MEASURED)
    }

    fn foveations(&self) -> Vec<FoveationMode> {
        chosen(&self.foveation, &[FoveationMode::None])
    }

    fn scales(&self) -> Vec<f64> {
        chosen(&self.scale, if self.quick { &[1.0, 0.5] } else { &[1.0, 0.7, 0.5] })
    }

    /// Returns the measured values of each axis, under the name of its option's field.
    pub fn measured(&self) -> [(&'static str, Json); 7] {
        [
            ("spp", json!(self.spp())),
            ("bounces", json!(self.bounces())),
            ("iterations", json!(self.iterations())),
            ("denoiser", json!(self.denoisers().into_iter().map(Denoiser::name_of).collect::<Vec<_>>())),
            ("foveation", json!(self.foveations().iter().map(Value::text).collect::<Vec<_>>())),
            ("render_scale", json!(self.scales())),
            ("balance", settings::names(&self.options.settings.balances())),
        ]
    }

    /// Returns the number of compared frames per setting: at least two, because flicker compares consecutive frames.
    fn judged_frames(&self) -> u32 {
        self.repeats.max(2)
    }

    /// Returns the number of warm-up frames, in which the camera approaches along its path. They suffice to fill the
    /// history of denoisers that keep one.
    pub fn warm_up_of(&self, quality: &Quality) -> u32 {
        if quality.denoiser().is_some_and(Denoiser::keeps_history) {
            self.warm_up.max(HISTORY_FRAMES)
        } else {
            self.warm_up
        }
    }

    /// Returns the number of frames of a setting, warm-up included.
    pub fn frames_of(&self, quality: &Quality) -> u32 {
        self.warm_up_of(quality) + self.judged_frames()
    }

    /// Returns the number of a turn's frames before the timed one. They give the history to denoisers that keep one, and
    /// distribute the rows over the devices. The times need no longer history.
    pub fn warm_up_of_turn(&self, quality: &Quality) -> u32 {
        self.warm_up_of(quality).min(self.warm_up.max(2))
    }

    /// Returns the instant of frame `i` in seconds. During the warm-up the camera moves along its path, so that the
    /// history comes from other views than the compared frames. Then it stands still.
    pub fn time_s(&self, quality: &Quality, i: u32) -> f64 {
        self.options.settings.time - f64::from(self.warm_up_of(quality).saturating_sub(i)) / FPS
    }

    /// Returns the settings of the grid; the sample count varies fastest. Without a denoiser there is neither foveation
    /// nor a render scale below 1.
    pub(super) fn settings(&self) -> Vec<Quality> {
        let mut settings = Vec::new();
        for denoiser in self.denoisers() {
            let filters =
                denoiser.map_or(vec![None], |d| once(self.iterations().into_iter().map(|n| Some(Filter::new(d, n)))));
            let foveations = if denoiser.is_some() { self.foveations() } else { vec![FoveationMode::None] };
            let scales = if denoiser.is_some() { self.scales() } else { vec![1.0] };
            for (&filter, foveation) in filters.iter().flat_map(|i| foveations.iter().map(move |f| (i, f))) {
                let foveated =
                    Settings { foveation: *foveation, polar: self.options.settings.polar, ..Settings::default() };
                let (fovea, polar) = (foveated.layer_radii(), foveated.polar_space());
                let grid = Quality { filter, fovea, polar, ..Quality::default() };
                for (bounces, &scale) in self.bounces().iter().flat_map(|b| scales.iter().map(move |s| (*b, s))) {
                    let quality = |spp| Quality { spp, bounces, scale, ..grid };
                    settings.extend(self.samples(scale).into_iter().map(quality));
                }
            }
        }
        settings
    }

    /// Returns the settings of a frame of this quality.
    fn settings_of(&self, quality: &Quality) -> Settings {
        let foveation = match (quality.fovea, quality.polar) {
            (Some(_), _) => FoveationMode::Layers,
            (None, Some(space)) => FoveationMode::Polar(space),
            (None, None) => FoveationMode::None,
        };
        let settings = (**self.options.settings).clone();
        Settings { denoiser: quality.denoiser(), bounces: quality.bounces, foveation, ..settings }
    }

    /// Checks that each given setting has an effect at some of these qualities.
    ///
    /// # Errors
    /// [`Failure::Input`].
    pub(super) fn check_effects(&self, qualities: impl IntoIterator<Item = Quality>) -> Result<(), Failure> {
        let all: Vec<Settings> = qualities.into_iter().map(|quality| self.settings_of(&quality)).collect();
        self.options.settings.check_any(&all).map_err(|error| Failure::Input(error.into()))
    }

    /// Returns the sample counts to measure at a render scale. A scale below 1 is a cheaper alternative to the lowest
    /// sample count, so only that count is measured.
    fn samples(&self, scale: f64) -> Vec<Samples> {
        let mut spp = self.spp();
        if scale < 1.0 {
            spp = spp.into_iter().min_by(|a, b| a.mean().total_cmp(&b.mean())).into_iter().collect();
        }
        spp
    }

    /// Reads the qualities of the rungs of `--ladder`; empty without this option.
    pub(super) fn judged(&self) -> Result<Vec<Quality>, Failure> {
        let Some(path) = &self.ladder else { return Ok(Vec::new()) };
        let ladder = Ladder::read(path).context("cannot use --ladder").map_err(Failure::Input)?;
        Ok(ladder.rungs().iter().map(|rung| rung.quality).collect())
    }
}

/// Returns the order in which `count` subjects are measured in a turn. Each turn begins with another.
pub fn order(count: usize, turn: usize) -> impl Iterator<Item = usize> {
    (0..count).map(move |i| (turn + i) % count)
}

/// Returns the requested values without duplicates, or the default if none are requested.
fn chosen<T: Copy + PartialEq>(asked: &[T], default: &[T]) -> Vec<T> {
    once(if asked.is_empty() { default } else { asked }.iter().copied())
}
