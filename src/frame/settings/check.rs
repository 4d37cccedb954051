//! Valid ranges of settings.

use super::Settings;
use crate::image::Extent;
use crate::projection::within;
use crate::quality::{Denoiser, Quality, SettingError};
use crate::scene::rig::Eye;
use crate::scene::shot::allowed::{ANY, Allowed, FPS, NOT_NEGATIVE, POSITIVE, YFOV};
use crate::schedule::Balance;

impl Settings {
    /// Checks the settings of the scene.
    ///
    /// # Errors
    /// [`SettingError::Invalid`], and [`SettingError::Conflict`].
    pub fn check_scene(&self) -> Result<(), SettingError> {
        let allowed = |key: &'static str, value: f64, allowed: &Allowed| match allowed.allows(value) {
            true => Ok(()),
            false => {
                Err(SettingError::Invalid { key, value: value.to_string(), why: format!("give {}", allowed.what) })
            }
        };
        allowed("time", self.time, &ANY)?;
        self.fps.map_or(Ok(()), |fps| allowed("fps", fps, &FPS))?;
        self.yfov.map_or(Ok(()), |yfov| allowed("yfov", yfov, &YFOV))?;
        self.baseline.map_or(Ok(()), |baseline| allowed("baseline", baseline, &NOT_NEGATIVE))?;
        self.convergence.map_or(Ok(()), |distance| allowed("convergence", distance, &POSITIVE))?;
        within("views", self.views.unwrap_or(2), 1..=Eye::MOST_VIEWS as u32)?;
        self.metres_per_unit.map_or(Ok(()), |metres| allowed("metres_per_unit", metres, &POSITIVE))?;
        for (key, point) in [("position", self.position), ("target", self.target)] {
            point.map_or([0.0; 3], |point| point.to_array()).into_iter().try_for_each(|c| allowed(key, c, &ANY))?;
        }
        let cameras = [
            ("position", self.position.is_some()),
            ("target", self.target.is_some()),
            ("camera", self.camera.is_some()),
        ];
        let other = cameras.into_iter().find(|(_, is_given)| *is_given && self.orbit.is_some());
        other.map_or(Ok(()), |(other, _)| Err(SettingError::Conflict("orbit", other)))
    }

    /// Checks the settings of the command.
    fn check_run(&self) -> Result<(), SettingError> {
        let invalid = |key, value: String, why: &str| Err(SettingError::Invalid { key, value, why: why.to_owned() });
        within("time_limit", self.time_limit.unwrap_or(1.0), f64::MIN_POSITIVE..=1e9)?;
        within("noise", self.noise.unwrap_or(1.0), f64::MIN_POSITIVE..=1e9)?;
        if !self.pass_spp.is_power_of_two() || !(2..=4096).contains(&self.pass_spp) {
            return invalid("pass_spp", self.pass_spp.to_string(), "give a power of two, 2 to 4096");
        }
        if self.speeds.is_empty() {
            return invalid("speeds", "empty".to_owned(), "give at least one number");
        }
        for speed in &self.speeds {
            within("speeds", *speed, f64::MIN_POSITIVE..=f64::MAX)?;
        }
        within("network_us", self.network_us.unwrap_or(0.0), 0.0..=f64::MAX)?;
        within("network_gbps", self.network_gbps.unwrap_or(1.0), f64::MIN_POSITIVE..=f64::MAX)?;
        for threads in &self.threads_per_device {
            within("threads_per_device", *threads, 1..=1024)?;
        }
        if self.balances().contains(&Balance::Static) && self.ratios.is_empty() {
            return invalid("balance", Balance::Static.name().to_owned(), "it needs ratios");
        }
        if self.controller.is_empty() {
            return invalid("controller", "empty".to_owned(), "give at least one name");
        }
        within("runs", self.runs, 1..=1000)?;
        within("report_spp", self.report_spp.unwrap_or(1), 1..=1 << 24)?;
        for times in &self.slowdown {
            within("slowdown", *times, 1..=64)?;
        }
        Ok(within("watchdog_ms", self.watchdog_ms.unwrap_or(1), 1..=86_400_000)?)
    }

    /// Checks all values. Whether they have an effect together is for [`Chosen`](super::Chosen) to say, which knows
    /// those that were given.
    ///
    /// # Errors
    /// [`SettingError`], except for [`SettingError::OutsideEnvelope`] and [`SettingError::NoEffect`].
    pub fn check(&self) -> Result<(), SettingError> {
        self.check_scene()?;
        for iterations in self.iterations.into_iter().flatten() {
            within("iterations", iterations, 0..=Denoiser::MAX_ITERATIONS)?;
        }
        within("render_scale", self.render_scale, Quality::SCALES)?;
        within("size", self.size.width, Extent::SIDES)?;
        within("size", self.size.height, Extent::SIDES)?;
        within("clamp", self.clamp, 0.0..=f32::MAX)?;
        within("unsampled_fraction", self.unsampled_fraction, 0.0..=1.0)?;
        within("frames_in_flight", self.frames_in_flight, 1..=3)?;
        self.check_run()?;
        within("max_dispatch_ms", self.max_dispatch_ms.unwrap_or(1.0), f64::MIN_POSITIVE..=f64::MAX)?;
        self.quality().check()
    }
}
