//! Charts of time against error, with the Pareto front of each denoiser.

use super::rows::{SettingRow, points};
use crate::report::plot::{Chart, Series, line_chart_svg};
use crate::report::{ReportError, once};
use diptych::accumulation::Noise;
use diptych::control::front;
use diptych::exec::Stereo;
use diptych::quality::Denoiser;

/// Plots the mean relMSE of both eyes over time: the Pareto front of each denoiser and, as a horizontal guide line, the
/// noise of the reference.
///
/// # Errors
/// [`ReportError`] if there is nothing to draw.
pub fn svg(title: String, rows: &[SettingRow], noise: Option<&Stereo<Noise>>) -> Result<String, ReportError> {
    let mut series = fronts(rows, "relmse");
    if let Some(noise) = noise {
        let level = (noise.left.relmse + noise.right.relmse) / 2.0;
        let times_ms = rows.iter().map(|r| r.measured.time_ms);
        let ends = times_ms.fold([f64::INFINITY, 0.0], |[a, b], t| [a.min(t), b.max(t)]);
        let points = ends.map(|t| (t, level)).into();
        series.push(Series { name: "noise of the reference".into(), points, guide: true, ..Series::default() });
    }
    time_chart(title, "relMSE, mean of both eyes", &series)
}

pub(super) fn time_chart(title: String, error: &str, series: &[Series]) -> Result<String, ReportError> {
    line_chart_svg(&Chart::new(title, ["time of a frame, ms", error], true), series)
}

/// Returns the Pareto front of each denoiser's settings.
pub(super) fn fronts(rows: &[SettingRow], error: &str) -> Vec<Series> {
    let denoisers = once(rows.iter().map(|r| r.quality.denoiser()));
    let series = |denoiser: &Option<Denoiser>| {
        let points = points(&rows.iter().filter(|r| r.quality.denoiser() == *denoiser).collect::<Vec<_>>(), error);
        let points = front(&points).into_iter().map(|i| points[i]).collect();
        Series { name: Denoiser::name_of(*denoiser).to_owned(), points, ..Series::default() }
    };
    denoisers.iter().map(series).collect()
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row;
    use super::*;

    #[test]
    fn charts_show_only_settings_on_the_front() {
        let rows = [row("none", 1, 1.0, &[0.4]), row("none", 2, 2.0, &[0.5]), row("none", 4, 3.0, &[0.3])];
        let svg = svg("t".into(), &rows, None).unwrap();
        assert_eq!(svg.matches("<circle").count(), 2);
    }
}
