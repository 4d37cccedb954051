//! Options of an experiment's arrangements, which are the variants that the experiment compares.

use anyhow::{Context, anyhow, bail, ensure};
use clap::Parser;

use super::axes::FPS;
use crate::cli::balance::Balance;
use crate::cli::options::{RenderFlags, RenderOptions, RunOptions};
use crate::frame::Foveation;
use crate::frame::settings::{Setting, text_of};
use crate::image::Extent;
use crate::loaded::LoadedScene;
use crate::passes::partitions;
use crate::quality::{LogPolar, PolarSpace};
use crate::report::experiment::{Arrangement, Experiment, OtherMeasures};
use crate::scene::rig::Eye;
use crate::schedule::RatioRule;

/// Settings of devices that an arrangement may have.
const OTHERS: [&str; 2] = ["seam", "halo"];

/// Degrees from the gaze at which the linear falloff begins and ends.
const FALLOFF_DEG: [f64; 2] = [10.0, 20.0];

/// Exponent of the kernel of log-polar images.
const LOG_POLAR_ALPHA: f64 = 4.0;

/// Returns the options of all arrangements for a number of frames.
pub fn of(experiment: &Experiment, run: &RunOptions, frames: u32) -> Result<Vec<RenderOptions>, anyhow::Error> {
    let defaults = RenderFlags::try_parse_from(["arrangement", "--out=."])?;
    let mut common = RenderFlags { run: run.clone(), frames, ..defaults };
    common.run.settings.fps = Some(FPS);
    let mut shared = experiment.options.clone();
    if !run.balance.is_empty() || !run.ratios.is_empty() {
        shared.retain(|name, _| !["balance", "ratios"].contains(&name));
    }
    let common = with(common, &shared).context("options")?;
    let of = |arrangement: &Arrangement| {
        let mut flags = with(common.clone(), &arrangement.options)?;
        if let Some(blur) = arrangement.blur {
            let settings = &mut flags.run.settings;
            let is_log_polar = matches!(settings.polar_space(), Some(PolarSpace::Log(_)));
            ensure!(is_log_polar, "blur needs log-polar images");
            settings.polar.get_or_insert(LogPolar::COMPOSITE).blur = blur;
        }
        let options = flags.options()?;
        let known: Vec<&str> = partitions().into_iter().map(|group| group.0).collect();
        let unknown = arrangement.distribute.iter().flatten().find(|name| !known.contains(&name.as_str()));
        if let Some(unknown) = unknown {
            bail!("distribute: there is no group '{unknown}': choose of {}", known.join(", "));
        }
        let quality = options.quality();
        let has_mode = quality.polar != Some(PolarSpace::Visual) && quality.filter.is_some();
        ensure!(
            !arrangement.as_visual_polar || has_mode,
            "as_visual_polar needs a denoiser, and a foveation other than visual-polar"
        );
        Ok(options)
    };
    experiment.all.iter().map(|one| of(one).with_context(|| format!("arrangement '{}'", one.name))).collect()
}

/// Returns the options of an arrangement on a number of devices. If it distributes only some groups of passes, all other
/// passes run on the primary, also those of the right eye if it is not path traced in full.
pub fn distributed(arrangement: &Arrangement, mut options: RenderOptions, devices: usize) -> RenderOptions {
    let Some(distribute) = &arrangement.distribute else { return options };
    let run = &mut options.run;
    run.balance = vec![Balance::Static];
    let on_primary: Vec<f64> = (0..devices).map(|device| if device == 0 { 1.0 } else { 0.0 }).collect();
    for group in partitions() {
        for view in Eye::ALL {
            let is_traced = view == Eye::Left || !run.settings.reproject;
            if !(is_traced && distribute.iter().any(|name| name == group.0)) {
                let ratios = on_primary.clone();
                run.ratios.push(RatioRule { group: Some(group), view: Some(view), ratios });
            }
        }
    }
    options
}

/// Returns `flags`, changed by the entries of a table, whose keys are names of settings, `balance` and `ratios`.
fn with(mut flags: RenderFlags, table: &toml::Table) -> Result<RenderFlags, anyhow::Error> {
    let run = &mut flags.run;
    for (name, value) in table {
        let text = text_of(&serde_json::to_value(value)?).map_err(|what| anyhow!("{name}: {what}"))?;
        match name.as_str() {
            "balance" => run.balance = vec![Balance::from_name(&text).ok_or_else(|| anyhow!("no policy '{text}'"))?],
            "ratios" => run.ratios = vec![text.parse().map_err(|what| anyhow!("ratios: {what}"))?],
            _ => {
                let is_allowed = Setting::of_key(name).is_none_or(|s| s.is_of_shots() || OTHERS.contains(&s.key));
                ensure!(is_allowed, "arrangements cannot have the setting '{name}'");
                run.settings.set(name, &text)?;
            }
        }
    }
    Ok(flags)
}

/// Changes options so that they trace about as many pixels as a visual-polar image has: adjusts the floor of a linear
/// falloff if there are foveal layers, σ of log-polar images, or otherwise the render scale. Returns the floor or σ
/// under its name.
pub fn sample_as_visual_polar(options: &mut RenderOptions, loaded: &LoadedScene) -> OtherMeasures {
    let (time_s, size) = (options.settings.time, options.settings.size);
    let gaze = loaded.shot.gaze.at(time_s);
    let view = loaded.shot.rig.view(time_s, Eye::Left);
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
            OtherMeasures::from([("floor", 1.0 - unsampled)])
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
            OtherMeasures::from([("sigma", map.sigma)])
        }
        _ => {
            most.scale = share.sqrt();
            OtherMeasures::new()
        }
    }
}

/// Returns the number of pixels in the left eye's image as a fraction of those on its screen.
pub fn dispatched(options: &RenderOptions, loaded: &LoadedScene) -> f64 {
    let (view, gaze) =
        (loaded.shot.rig.view(options.settings.time, Eye::Left), loaded.shot.gaze.at(options.settings.time));
    options.quality().polar.map_or(1.0, |space| space.share(gaze, &view, options.settings.size))
}

/// Returns the tangents of half the horizontal and half the vertical field of view.
pub fn tan_half(loaded: &LoadedScene, size: Extent) -> [f64; 2] {
    let vertical = (loaded.shot.rig.yfov_rad / 2.0).tan();
    [vertical * f64::from(size.width) / f64::from(size.height), vertical]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::Quality;

    fn options_of(text: &str) -> Result<Vec<RenderOptions>, String> {
        let run = RunOptions::parse_from(["diptych", "builtin:cornell", "--set", "seed=7", "--out", "unused"]);
        of(&Experiment::parse(text)?, &run, 1).map_err(|error| format!("{error:#}"))
    }

    #[test]
    fn every_experiment_and_the_documented_one_have_options() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/cli/bench/experiments");
        let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let mut texts: Vec<String> = files.map(|path| std::fs::read_to_string(path).unwrap()).collect();
        let docs = include_str!("../../../docs/experiments.md");
        texts.push(docs.split("```toml\n").nth(1).unwrap().split("```").next().unwrap().to_owned());
        for text in texts {
            let all = options_of(&text).unwrap_or_else(|error| panic!("{text}: {error}"));
            assert!(all.len() > 1 && all.iter().all(|options| options.settings.seed == 7), "{text}");
        }
    }

    #[test]
    fn arrangements_change_what_they_name() {
        let text = include_str!("experiments/koskela.toml");
        let text = text.replace("spp = 1\n", "spp = 2\nreproject = 'off'\nratios = [1, 2]\nbalance = 'static'\n");
        let all = options_of(&text).unwrap();
        let quality = Quality { spp: 2.into(), ..Quality::default() };
        assert_eq!(all[0].quality(), quality);
        assert_eq!(all[3].quality(), Quality { polar: Some(PolarSpace::Visual), ..quality });
        assert_eq!(all[2].quality(), Quality { fovea: Some(Foveation::RADII), ..quality });
        assert!(all.iter().all(|options| !options.settings.reproject && options.ratios[0].ratios == [1.0, 2.0]));
    }

    #[test]
    fn wrong_options_are_named_with_their_arrangement() {
        let text = include_str!("experiments/koskela.toml");
        for (old, new, says) in [
            ("spp = 1", "spp = 0", &["options", "spp", "0"][..]),
            ("spp = 1", "spp = { a = 1 }", &["options", "spp"]),
            ("spp = 1", "frames = 3", &["options", "'frames'"]),
            (
                "options.foveation = \"layers\"",
                "distribute = ['shade']",
                &["'linear'", "distribute", "shade", "gbuffer"],
            ),
            ("options.foveation = \"layers\"", "options.foveation = \"rings\"", &["'linear'", "foveation", "rings"]),
            ("options.foveation = \"layers\"", "blur = false", &["'linear'", "blur"]),
            ("options.foveation = \"layers\"", "options.polar = \"fov\"", &["'linear'", "polar"]),
            (
                "options.foveation = \"layers\"",
                "options.foveation = \"visual-polar\"",
                &["'linear'", "as_visual_polar"],
            ),
        ] {
            assert!(text.contains(old), "{old}");
            let error = options_of(&text.replacen(old, new, 1)).unwrap_err();
            assert!(says.iter().all(|part| error.contains(part)), "{new}: {error}");
        }
    }
}
