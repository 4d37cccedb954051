//! Reports quality ladders: as tables, and as plots together with the Pareto front of each denoiser.

use super::charts::{fronts, time_chart};
use super::errors::ERROR;
use super::front::shown_front;
use super::rows::SettingRow;
use super::tables::{COLUMNS, cells_of};
use crate::report::intervals::ratio_interval;
use crate::report::peers::{self, Peer};
use crate::report::plot::Series;
use crate::report::{ReportError, Table, cell, once};
use diptych::control::{Ladder, Rung, mean_error};
use diptych::quality::Denoiser;

/// Returns the settings of the front of each denoiser that the intervals show, as rungs.
pub fn rungs(rows: &[SettingRow]) -> Vec<Rung> {
    let of = |denoiser: Option<Denoiser>| {
        let own: Vec<&SettingRow> = rows.iter().filter(|r| r.quality.denoiser() == denoiser).collect();
        shown_front(&own, ERROR).into_iter().map(|i| own[i].rung()).collect::<Vec<_>>()
    };
    once(rows.iter().map(|r| r.quality.denoiser())).into_iter().flat_map(of).collect()
}

/// Returns the denoisers other than `best` whose front the intervals do not show to be worse than that of `best`. Fronts
/// are compared turn by turn, by their [`mean_error`] between the shortest and the longest time.
pub fn no_worse(rows: &[SettingRow], best: Option<Denoiser>) -> Vec<&'static str> {
    let times = || rows.iter().flat_map(|r| r.measured.times_ms());
    let range = [times().fold(f64::INFINITY, f64::min), times().fold(0.0, f64::max)];
    let errors = rows.iter().map(|r| r.measured.error(ERROR)).filter(|e| e.is_finite());
    let worst = errors.fold(0.0, f64::max);
    let turns = rows.iter().map(|r| r.measured.frames.len()).min().unwrap_or(0);
    let of = |denoiser: Option<Denoiser>| -> Vec<f64> {
        let own = || rows.iter().map(|r| (r.quality.denoiser(), &r.measured)).filter(|(d, _)| *d == denoiser);
        let points = |turn: usize| own().map(|(_, m)| (m.frames[turn].makespan_ms, m.error(ERROR))).collect::<Vec<_>>();
        (0..turns).map(|turn| mean_error(&points(turn), range, worst)).collect()
    };
    let own = of(best);
    let is_no_worse = |d: &Option<Denoiser>| ratio_interval(&own, &of(*d)).is_none_or(|[_, high]| high >= 1.0);
    let others = once(rows.iter().map(|r| r.quality.denoiser())).into_iter().filter(|d| *d != best);
    others.filter(is_no_worse).map(Denoiser::name_of).collect()
}

/// Plots the mean FLIP + flicker of both eyes over time: the Pareto front of each denoiser, and the ladder. With
/// `peers` (other renderers, whose flicker is unknown), the plot shows FLIP alone, also that of the peers.
///
/// # Errors
/// [`ReportError`] if there is nothing to draw.
pub fn ladder_svg(title: String, rows: &[SettingRow], peers: &[Peer], ladder: &Ladder) -> Result<String, ReportError> {
    let is_alone = peers.is_empty();
    let (error, label) = if is_alone { (ERROR, "FLIP + flicker") } else { ("flip", "FLIP") };
    let mut series = fronts(rows, error);
    series.extend(peers::series(peers));
    let point = |r: &Rung| Some((r.time_ms, if is_alone { r.error } else { r.flip? }));
    let points = ladder.rungs().iter().filter_map(point).collect();
    series.push(Series { name: "ladder".into(), points, guide: true, ..Series::default() });
    time_chart(title, &format!("{label}, mean of both eyes"), &series)
}

/// Returns a table with a line per rung, cheapest first.
pub fn ladder_table(ladder: &Ladder) -> Table {
    let mut headers = vec!["rung"];
    headers.extend(COLUMNS);
    headers.extend(["ms", ladder.origin().measure.name(), "FLIP", "flicker", "relMSE"]);
    let cells = |(i, rung): (usize, &Rung)| {
        let mut cells = vec![i.to_string()];
        cells.extend(cells_of(&rung.quality));
        cells.extend([format!("{:.1}", rung.time_ms), format!("{:.4}", rung.error)]);
        cells.extend([rung.flip, rung.flicker, rung.relmse].map(|error| cell(error, 4)));
        cells
    };
    Table { headers, rows: ladder.rungs().iter().enumerate().map(cells).collect() }
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row_in_turns;
    use super::*;
    use diptych::control::{Measure, Origin};

    #[test]
    fn each_denoiser_has_a_ladder_best_first() {
        // If only the fastest setting counted, `none` would be best.
        let times = |ms: f64| [1.0, 1.01, 0.99, 1.01, 1.0].map(|f| f * ms);
        let rows = [
            row_in_turns("none", 1, &times(1.0), 0.4),
            row_in_turns("none", 2, &times(2.0), 0.5),
            row_in_turns("none", 4, &times(3.0), 0.3),
            row_in_turns("svgf", 1, &times(1.2), 0.1),
            row_in_turns("svgf", 2, &times(3.0), 0.05),
        ];
        // It has more error than the setting of 3 ms, and the intervals do not show that it is faster.
        let scattered = row_in_turns("svgf", 4, &[3.3, 2.9, 2.5, 3.4, 2.6], 0.0501);
        let rows = rows.into_iter().chain([scattered]).collect::<Vec<_>>();
        let rungs = rungs(&rows);
        let (shot, size, version) = ("s".into(), "8x8".into(), "0".into());
        let measure = Measure::FlipFlicker;
        let origin = Origin { shot, size, exposure_ev: 0.0, measure, devices: Vec::new(), version };
        let [best, other] = Ladder::by_denoiser(&origin, &rungs).unwrap().try_into().unwrap();
        assert_eq!((best.denoisers(), other.denoisers()), (vec![(Some(Denoiser::SVGF), 2)], vec![(None, 2)]));
        assert_eq!(other.rungs().iter().map(|r| r.time_ms).collect::<Vec<_>>(), [1.0, 3.0]);
        assert_eq!(other.rungs()[1].stage_ms["atrous"], 0.75);
        assert!(ladder_svg("t".into(), &rows, &[], &other).unwrap().contains("FLIP + flicker"));
        assert_eq!(ladder_table(&best).headers[8], "FLIP + flicker");
        assert_eq!(no_worse(&rows, Some(Denoiser::SVGF)), Vec::<&str>::new());
        assert_eq!(no_worse(&rows, None), ["svgf"]);
    }
}
