//! Charts of time against error, with the front of each denoiser.

use super::errors::{ERROR, FLICKER};
use super::front::shown_front;
use super::rows::SettingRow;
use crate::report::intervals::positive_interval;
use crate::report::plot::{Chart, Dot, Series, line_chart_svg};
use crate::report::{ReportError, once};
use diptych::accumulation::Noise;
use diptych::exec::PerView;
use diptych::quality::{Denoiser, Quality};

/// Errors that [`svg`] can plot. Smaller is better in each.
pub const METRICS: [&str; 8] =
    ["rmse", "relmse", "flip", FLICKER, ERROR, "flip_foveated", "flip_acuity", "rivalry_seen"];

/// Plots the mean error of both eyes over time: each setting with its intervals, the front of each denoiser and, as a
/// horizontal guide line, the noise of the reference if `metric` is one that it has.
///
/// # Errors
/// [`ReportError`] if there is nothing to draw.
pub fn svg(
    title: String,
    rows: &[SettingRow],
    metric: &str,
    noise: Option<&PerView<Noise>>,
) -> Result<String, ReportError> {
    let mut series = fronts(rows, metric);
    for one in &mut series {
        let own = rows.iter().filter(|r| Denoiser::name_of(r.quality.denoiser()) == one.name);
        one.dots = own.map(|row| dot(row, metric)).collect();
    }
    let level = |noise: &Noise| match metric {
        "rmse" => Some(noise.rmse),
        "relmse" => Some(noise.relmse),
        _ => None,
    };
    if let Some((left, right)) = noise.and_then(|noise| level(noise.left()).zip(level(noise.right()))) {
        let times_ms = rows.iter().map(|r| r.measured.time_ms);
        let ends = times_ms.fold([f64::INFINITY, 0.0], |[a, b], t| [a.min(t), b.max(t)]);
        let points = ends.map(|t| (t, (left + right) / 2.0)).into();
        series.push(Series { name: "noise of the reference".into(), points, guide: true, ..Series::default() });
    }
    time_chart(title, &format!("{metric}, mean of both eyes"), &series)
}

fn dot(row: &SettingRow, metric: &str) -> Dot {
    let measured = &row.measured;
    Dot {
        at: (measured.time_ms, measured.error(metric)),
        within: [measured.time_interval(), positive_interval(measured.errors_of(metric))],
        hollow: row.undecided,
    }
}

pub(super) fn time_chart(title: String, error: &str, series: &[Series]) -> Result<String, ReportError> {
    line_chart_svg(&Chart::new(title, ["time of a frame, ms", error], true), series)
}

/// Returns the front of each denoiser's settings that the intervals show.
pub(super) fn fronts(rows: &[SettingRow], error: &str) -> Vec<Series> {
    let denoisers = once(rows.iter().map(|r| r.quality.denoiser()));
    let series = |denoiser: &Option<Denoiser>| {
        let own: Vec<&SettingRow> = rows.iter().filter(|r| r.quality.denoiser() == *denoiser).collect();
        let point = |i: usize| (own[i].measured.time_ms, own[i].measured.error(error));
        let front = shown_front(&own, error);
        let label = |i: &usize| match own[*i].quality {
            Quality { spp, scale: 1.0, .. } => format!("{spp} spp"),
            Quality { spp, scale, .. } => format!("{spp} spp, scale {scale}"),
        };
        let (labels, points) = (front.iter().map(label).collect(), front.into_iter().map(point).collect());
        Series { name: Denoiser::name_of(*denoiser).to_owned(), points, labels, ..Series::default() }
    };
    denoisers.iter().map(series).collect()
}

#[cfg(test)]
mod tests {
    use super::super::front::mark_front;
    use super::super::rows::tests::row_in_turns;
    use super::*;

    #[test]
    fn charts_show_all_settings_and_join_the_front() {
        let times = |ms: f64| [1.0, 1.01, 0.99, 1.0, 1.01].map(|f| f * ms);
        let mut rows =
            [(1, 1.0, 0.4), (2, 2.0, 0.5), (4, 3.0, 0.3)].map(|(spp, ms, e)| row_in_turns("none", spp, &times(ms), e));
        mark_front(&mut rows);
        let svg = svg("t".into(), &rows, "flip", None).unwrap();
        assert_eq!((svg.matches("r=\"4\"").count(), svg.matches("r=\"3\"").count()), (2, 3));
        assert!(["flip, mean of both eyes", "1 spp", "4 spp"].iter().all(|text| svg.contains(text)));
        assert!(!svg.contains("2 spp"));
    }
}
