//! Conditions under which settings have an effect.

use super::{FoveationMode, SeamMode, Settings};
use crate::projection::PolarSpace;
use crate::quality::Denoiser;
use crate::schedule::Balance;

/// The assignment that a setting lacks for an effect; `None` if it has one.
pub type Needs = Option<&'static str>;

fn missing(has_effect: bool, assignment: &'static str) -> Needs {
    (!has_effect).then_some(assignment)
}

pub fn denoiser(settings: &Settings) -> Needs {
    missing(settings.denoiser.is_some(), "a denoiser")
}

pub fn filled(settings: &Settings) -> Needs {
    missing(settings.render_scale >= 1.0 || settings.filter().is_some(), "a denoiser to fill in pixels")
}

pub fn atrous(settings: &Settings) -> Needs {
    missing(settings.denoiser == Some(Denoiser::ATROUS), "denoiser=atrous")
}

pub fn history(settings: &Settings) -> Needs {
    let keeps_history = settings.denoiser.is_some_and(Denoiser::keeps_history);
    missing(keeps_history, "denoiser=svgf").or_else(|| missing(settings.bounces > 1, "bounces=2 or more"))
}

pub fn finished_light(settings: &Settings) -> Needs {
    let leaves_it = settings.denoiser.is_some_and(|denoiser| denoiser.method().leaves_finished_light());
    missing(leaves_it, "denoiser=svgf").or_else(|| missing(settings.reproject, "reproject=on"))
}

pub fn reprojected_views(settings: &Settings) -> Needs {
    missing(settings.reproject, "reproject=on")
}

pub fn indirect_light(settings: &Settings) -> Needs {
    missing(settings.bounces > 1, "bounces=2 or more")
}

pub fn layers(settings: &Settings) -> Needs {
    missing(settings.foveation == FoveationMode::Layers, "foveation=layers")
}

pub fn log_polar(settings: &Settings) -> Needs {
    missing(matches!(settings.foveation, FoveationMode::Polar(PolarSpace::Log(_))), "foveation=log-polar")
}

pub fn foveated(settings: &Settings) -> Needs {
    missing(settings.foveation != FoveationMode::None, "foveation, for example foveation=layers")
}

pub fn several_controllers(settings: &Settings) -> Needs {
    missing(settings.controller.len() > 1, "controller=NAME,NAME")
}

pub fn static_balance(settings: &Settings) -> Needs {
    missing(settings.balances().contains(&Balance::Static), "balance=static")
}

pub fn halos(settings: &Settings) -> Needs {
    missing(settings.seam == SeamMode::Halo, "seam=halo")
}
