//! Arrangements of studies: variants of settings that a study compares.

use super::columns::Measures;
use super::locked::{Conditions, TODAY};
use super::turns::FPS;
use crate::failure::Failure;
use crate::options::{RenderOptions, RunOptions};
use diptych::frame::Foveation;
use diptych::image::Extent;
use diptych::loaded::LoadedScene;
use diptych::passes::partitions;
use diptych::projection::{LogPolar, PolarSpace};
use diptych::scene::rig::Eye;
use diptych::schedule::{Balance, RatioRule};

/// A variant of settings.
pub struct Arrangement {
    pub name: &'static str,
    /// Settings, besides those of the study's conditions.
    pub settings: &'static [(&'static str, &'static str)],
    /// Groups of passes whose rows are distributed over all devices, while all other passes run on the primary; `None`
    /// to distribute all of them.
    pub distributes: Option<&'static [&'static str]>,
    /// Number of devices; `None` for all.
    pub devices: Option<usize>,
    /// Adapts the options to the scene. Returns the measures that it has chosen.
    pub adapt: Option<fn(&mut RenderOptions, &LoadedScene) -> Measures>,
}

impl Arrangement {
    pub const fn new(name: &'static str, settings: &'static [(&'static str, &'static str)]) -> Self {
        Self { name, settings, distributes: None, devices: None, adapt: None }
    }

    pub const fn adapt(self, adapt: fn(&mut RenderOptions, &LoadedScene) -> Measures) -> Self {
        Self { adapt: Some(adapt), ..self }
    }

    /// Returns the options of the arrangement under some conditions.
    pub fn options(&self, conditions: &Conditions, run: &RunOptions) -> Result<RenderOptions, Failure> {
        let mut run = run.clone();
        // The publications that distribute rows give every device the same number.
        if conditions.name != TODAY && run.settings.balance.is_empty() && run.settings.ratios.is_empty() {
            run.settings.balance = vec![Balance::Even];
        }
        let applied = conditions.apply(&mut run.settings, self.settings);
        applied.map_err(|error| Failure::Input(anyhow::Error::from(error).context(self.name)))?;
        let quality = run.settings.quality();
        let options = RenderOptions { fps: FPS, ..RenderOptions::new(run, quality) };
        options.check().map_err(Failure::Input)?;
        Ok(options)
    }

    /// Returns options that run the passes which are not distributed on the primary, also those of views that are
    /// not path traced in full.
    pub fn distributed(&self, mut options: RenderOptions, devices: usize) -> RenderOptions {
        let Some(distributes) = self.distributes else { return options };
        let run = &mut options.run;
        run.settings.balance = vec![Balance::Static];
        let on_primary: Vec<f64> = (0..devices).map(|device| if device == 0 { 1.0 } else { 0.0 }).collect();
        let settings = &run.settings;
        let (views, sources) = (settings.views.unwrap_or(2) as usize, settings.sources as usize);
        for group in partitions() {
            for view in Eye::of_rig(views).map(|view| view.among(sources)) {
                let is_traced = view.is_source() || !run.settings.reproject;
                if !(is_traced && distributes.contains(&group.0)) {
                    let ratios = on_primary.clone();
                    run.settings.ratios.push(RatioRule { group: Some(group), view: Some(view), ratios });
                }
            }
        }
        options
    }
}

/// Degrees from the gaze at which the linear falloff begins and ends.
const FALLOFF_DEG: [f64; 2] = [10.0, 20.0];

/// Exponent of the kernel of log-polar images.
const LOG_POLAR_ALPHA: f64 = 4.0;

/// Adapts options to trace about as many pixels as a visual-polar image has: adjusts the floor of a linear
/// falloff if there are foveal layers, σ of log-polar images, or otherwise the render scale. Returns the floor or σ
/// under its name.
pub fn sample_as_visual_polar(options: &mut RenderOptions, loaded: &LoadedScene) -> Measures {
    let (time_s, size) = (options.settings.time, options.settings.size);
    let gaze = loaded.shot.gaze.at(time_s);
    let view = loaded.shot.rig.view(time_s, Eye::LEFT);
    let share = PolarSpace::Visual.share(gaze, &view, size).min(1.0);
    let most = &mut options.envelope.most;
    match (most.polar, most.fovea) {
        (None, Some(_)) => {
            let [tan, _] = tan_half(loaded, size);
            let radii = FALLOFF_DEG.map(|degrees| degrees.to_radians().tan() / (2.0 * tan));
            let falloff = Foveation { radii, ..Default::default() };
            let unsampled = falloff.unsampled_fraction_for(share, gaze, size);
            most.fovea = Some(radii);
            options.run.settings.unsampled_fraction = unsampled;
            Measures::from([("floor", 1.0 - unsampled)])
        }
        (Some(PolarSpace::Log(_)), _) => {
            let aspect = f64::from(size.width) / f64::from(size.height);
            let mut map = LogPolar { sigma: 1.0, alpha: LOG_POLAR_ALPHA, gaze: 0.0, aspect, blur: true };
            // The number of pixels is proportional to 1 / σ², except for a margin around the screen, so a few
            // iterations suffice.
            for _ in 0..4 {
                map.sigma *= (PolarSpace::Log(map).traced_fraction(gaze, &view, size) / share).sqrt();
            }
            most.polar = Some(PolarSpace::Log(map));
            Measures::from([("sigma", map.sigma)])
        }
        _ => {
            most.scale = share.sqrt();
            Measures::new()
        }
    }
}

/// Returns the number of pixels in the left eye's image as a fraction of those on its screen.
pub fn dispatched(options: &RenderOptions, loaded: &LoadedScene) -> f64 {
    let (view, gaze) =
        (loaded.shot.rig.view(options.settings.time, Eye::LEFT), loaded.shot.gaze.at(options.settings.time));
    options.quality().polar.map_or(1.0, |space| space.share(gaze, &view, options.settings.size))
}

/// Returns the tangents of half the horizontal and half the vertical field of view.
pub fn tan_half(loaded: &LoadedScene, size: Extent) -> [f64; 2] {
    let vertical = (loaded.shot.rig.yfov_rad / 2.0).tan();
    [vertical * f64::from(size.width) / f64::from(size.height), vertical]
}

/// Leaves log-polar images without blur.
pub fn without_blur(options: &mut RenderOptions, _: &LoadedScene) -> Measures {
    if let Some(PolarSpace::Log(map)) = &mut options.envelope.most.polar {
        map.blur = false;
    }
    Measures::new()
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::study::{STUDIES, leria, locked};

    fn options_of(arrangement: &Arrangement, study: &str) -> RenderOptions {
        let run = RunOptions::parse_from(["diptych", "builtin:cornell", "--set", "seed=7", "--out", "unused"]);
        arrangement.options(&locked::published(study), &run).ok().unwrap()
    }

    #[test]
    fn arrangements_keep_command_line_settings() {
        for study in STUDIES {
            for arrangement in study.arrangements {
                let options = options_of(arrangement, study.name);
                assert!(options.settings.seed == 7 && options.settings.cache == Some(false), "{}", study.name);
            }
        }
    }

    #[test]
    fn baseline_runs_all_but_path_tracing_on_the_primary() {
        let [baseline, proposed] = leria::STUDY.arrangements else { panic!("leria has two arrangements") };
        let even = proposed.distributed(options_of(proposed, "leria"), 3);
        assert!(even.settings.ratios.is_empty() && even.settings.policy() == Balance::Even);
        let options = baseline.distributed(options_of(baseline, "leria"), 3);
        assert_eq!(options.settings.policy(), Balance::Static);
        let left_out = options.settings.ratios.iter().all(|rule| {
            let is_path_tracing = rule.group.is_some_and(|group| group.0 == "path_trace");
            rule.ratios == [1.0, 0.0, 0.0] && !(is_path_tracing && rule.view == Some(Eye::LEFT))
        });
        assert!(
            left_out && options.settings.ratios.len() == 2 * partitions().len() - 1,
            "{:?}",
            options.settings.ratios
        );
    }
}
