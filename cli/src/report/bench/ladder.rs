//! Reports quality ladders: as tables, and as plots together with the Pareto front of each denoiser.

use super::charts::{fronts, time_chart};
use super::errors::ERROR;
use super::rows::SettingRow;
use super::tables::{COLUMNS, cells_of};
use crate::report::peers::{self, Peer};
use crate::report::plot::Series;
use crate::report::{ReportError, Table, cell};
use diptych::control::{Ladder, Rung};

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
    use super::super::rows::tests::row;
    use super::*;
    use diptych::control::{Measure, Origin};
    use diptych::quality::Denoiser;

    #[test]
    fn each_denoiser_has_a_ladder_best_first() {
        // If only the fastest setting counted, `none` would be best.
        let rows = [
            row("none", 1, 1.0, &[0.4]),
            row("none", 2, 2.0, &[0.5]),
            row("none", 4, 3.0, &[0.3]),
            row("svgf", 1, 1.2, &[0.1]),
            row("svgf", 2, 3.0, &[0.05]),
        ];
        let rungs: Vec<Rung> = rows.iter().map(SettingRow::rung).collect();
        let (shot, size, version) = ("s".into(), "8x8".into(), "0".into());
        let measure = Measure::FlipFlicker;
        let origin = Origin { shot, size, exposure_ev: 0.0, measure, devices: Vec::new(), version };
        let [best, other] = Ladder::by_denoiser(&origin, &rungs).unwrap().try_into().unwrap();
        assert_eq!((best.denoisers(), other.denoisers()), (vec![(Some(Denoiser::SVGF), 2)], vec![(None, 2)]));
        assert_eq!(other.rungs().iter().map(|r| r.time_ms).collect::<Vec<_>>(), [1.0, 3.0]);
        assert_eq!(other.rungs()[1].stage_ms["atrous"], 0.75);
        assert!(ladder_svg("t".into(), &rows, &[], &other).unwrap().contains("FLIP + flicker"));
        assert_eq!(ladder_table(&best).headers[8], "FLIP + flicker");
    }
}
