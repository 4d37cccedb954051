//! Fits the rate at which the error falls with the number of samples.

use std::fmt;

use serde::Serialize;

use super::errors::NOISE_MARGIN;
use super::rows::{Measured, SettingRow};
use crate::report::once;
use crate::report::statistics::{deviation, mean};
use diptych::accumulation::Noise;
use diptych::exec::PerView;
use diptych::quality::{Denoiser, Quality};
use diptych::scene::rig::Eye;

/// Exponent of the error, √relMSE, as a function of samples per pixel. It is −0.5 for independent samples.
#[derive(Clone, Debug, Serialize)]
pub struct Slope {
    pub denoiser: &'static str,
    pub iterations: u32,
    pub eye: &'static str,
    /// Mean of the slopes of the repeats.
    pub slope: f64,
    /// Standard error of that mean; `None` for a single repeat.
    pub standard_error: Option<f64>,
    /// Number of settings in the fit.
    pub points: usize,
}

impl fmt::Display for Slope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { denoiser, iterations, eye, slope, standard_error, points } = self;
        let iterations = if *iterations == 0 { String::new() } else { format!(" x{iterations}") };
        let error = standard_error.map_or(String::new(), |e| format!(" ± {e:.3}"));
        write!(f, "{denoiser}{iterations}, {eye} eye: √relMSE ∝ spp^{slope:.3}{error} over {points} settings")?;
        write!(f, " (independent samples: -0.5)")
    }
}

/// Returns the slope of a least-squares line through (ln x, ln y); `None` for fewer than two different x.
fn log_slope(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points.iter().map(|p| (p.0.ln(), p.1.ln())).collect();
    let mean = |f: &dyn Fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / logs.len() as f64;
    let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
    let spread: f64 = logs.iter().map(|p| (p.0 - x).powi(2)).sum();
    (spread > 0.0).then(|| logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / spread)
}

/// Returns the slopes by denoiser, iterations and eye. The fit uses the rows with full render scale, without foveation
/// and with the most bounces. It subtracts the noise of the reference, which adds to every relMSE. It omits
/// settings whose error is within that noise, and settings of 1 spp, since their sample goes through the pixel's centre
/// and estimates a different image.
pub fn slopes(rows: &[SettingRow], noise: Option<&PerView<Noise>>) -> Vec<Slope> {
    let rows: Vec<&SettingRow> = rows
        .iter()
        .filter(|r| {
            let Quality { spp, scale, fovea, polar, .. } = r.quality;
            !spp.varies() && scale == 1.0 && fovea.is_none() && polar.is_none()
        })
        .collect();
    let bounces = rows.iter().map(|r| r.quality.bounces).max();
    let rows: Vec<&SettingRow> = rows.into_iter().filter(|r| Some(r.quality.bounces) == bounces).collect();
    let filters = once(rows.iter().map(|r| filter(r)));
    let of = |name: &(&'static str, u32)| {
        let own = || rows.iter().filter(|r| filter(r) == *name && r.quality.spp.least > 1);
        let of_eye = |measured: &Measured, eye| -> Vec<f64> {
            measured.repeats.iter().filter_map(|both| both.of(eye).get("relmse")).collect()
        };
        [(Eye::LEFT, "left"), (Eye::RIGHT, "right")].map(|(eye, of)| {
            let settings = own().map(|r| (r.quality.spp.least, of_eye(&r.measured, eye))).collect();
            slope(*name, of, settings, noise.map_or(0.0, |noise| noise.of(eye).relmse))
        })
    };
    filters.iter().flat_map(of).flatten().collect()
}

fn filter(row: &SettingRow) -> (&'static str, u32) {
    (Denoiser::name_of(row.quality.denoiser()), row.quality.most_iterations())
}

/// Fits a slope of √relMSE over samples per pixel to each repeat, and averages the slopes.
fn slope(
    (denoiser, iterations): (&'static str, u32),
    eye: &'static str,
    mut settings: Vec<(u32, Vec<f64>)>,
    noise: f64,
) -> Option<Slope> {
    settings.retain(|(_, repeats)| repeats.iter().all(|&e| e > NOISE_MARGIN * noise));
    let fit = |i: usize| {
        let point = |(spp, repeats): &(u32, Vec<f64>)| Some((f64::from(*spp), (repeats.get(i)? - noise).sqrt()));
        log_slope(&settings.iter().map(point).collect::<Option<Vec<_>>>()?)
    };
    let fits: Vec<f64> = (0..settings.first()?.1.len()).map_while(fit).collect();
    let (slope, standard_error) = mean_and_error(&fits)?;
    Some(Slope { denoiser, iterations, eye, slope, standard_error, points: settings.len() })
}

/// Returns the mean of the values and its standard error, which is `None` for a single value. Returns `None` without
/// values.
fn mean_and_error(values: &[f64]) -> Option<(f64, Option<f64>)> {
    let error = (values.len() > 1).then(|| deviation(values) / (values.len() as f64).sqrt());
    (!values.is_empty()).then(|| (mean(values), error))
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row;
    use super::*;

    #[test]
    fn slope_equals_the_exponent_of_a_power_law() {
        let points: Vec<(f64, f64)> = [2.0f64, 4.0, 8.0, 64.0].map(|n| (n, 3.0 * n.powf(-0.7))).into();
        assert!((log_slope(&points).unwrap() + 0.7).abs() < 1e-12);
        assert_eq!((log_slope(&points[..1]), log_slope(&[])), (None, None));
    }

    #[test]
    fn slopes_exclude_reference_noise_and_one_sample() {
        // The relMSE of an image of uniform value v against a black one is 100 v².
        let noise = PerView::both(Noise { rmse: 0.01, relmse: 0.01 }, Noise { rmse: 0.02, relmse: 0.04 });
        let seen = |n: f64| (0.16 / n + 1e-4).sqrt();
        // At 4096 spp the error is below the noise of the reference. At 1 spp it belongs to another estimator.
        let spps = [1u32, 2, 8, 64, 4096];
        let rows: Vec<SettingRow> =
            spps.map(|n| row("none", n, 1.0, &[if n == 1 { 9.0 } else { seen(n.into()) }; 2])).into();
        let found = slopes(&rows, Some(&noise));
        assert_eq!(found.len(), 2);
        for slope in found {
            assert!((slope.slope + 0.5).abs() < 1e-5, "{slope:?}");
            assert_eq!((slope.points, slope.standard_error.unwrap() < 1e-9), (3, true));
        }
    }

    #[test]
    fn fewer_bounces_than_the_reference_has_tell_no_slope() {
        let mut rows: Vec<SettingRow> = [2, 8].map(|spp| row("none", spp, 1.0, &[1.0 / f64::from(spp)])).into();
        let all = slopes(&rows, None);
        rows.extend([2, 8].map(|spp| row("none", spp, 0.5, &[0.5])));
        rows[2..].iter_mut().for_each(|r| r.quality.bounces = 2);
        let found = slopes(&rows, None);
        assert_eq!((found.len(), found[0].slope), (2, all[0].slope));
    }
}
