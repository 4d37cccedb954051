//! Compares a ladder's rungs with the best setting that takes no longer.

use serde::Serialize;

use super::rows::SettingRow;
use super::tables::{COLUMNS, cells_of};
use crate::report::Table;
use diptych::control::{MIN_STEP, Rung};
use diptych::quality::Quality;

/// Comparison of a rung with the best measured setting, that is, the one with the lowest error among those that take no
/// longer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Regret {
    #[serde(rename = "knobs")]
    pub quality: Quality,
    pub time_ms: f64,
    /// FLIP + flicker of the rung, mean of both eyes.
    pub error: f64,
    /// Lowest FLIP + flicker among the settings whose time is at most (1 + [`MIN_STEP`]) times that of the rung.
    pub best_error: f64,
    /// Excess of the rung's error over the best, as a fraction of the best.
    pub regret: f64,
}

/// Returns the regret of each rung that was measured, cheapest rung first.
pub fn regrets(rungs: &[Quality], rows: &[SettingRow]) -> Vec<Regret> {
    let all: Vec<_> = rows.iter().map(SettingRow::rung).collect();
    let mut found: Vec<_> = all.iter().filter(|r| rungs.contains(&r.quality)).collect();
    found.sort_by(|a, b| a.time_ms.total_cmp(&b.time_ms));
    let of = |rung: &&Rung| {
        let no_longer = all.iter().filter(|r| r.time_ms <= rung.time_ms * (1.0 + MIN_STEP));
        let best_error = no_longer.map(|r| r.error).fold(rung.error, f64::min);
        let regret = rung.error / best_error.max(1e-9) - 1.0;
        Regret { quality: rung.quality, time_ms: rung.time_ms, error: rung.error, best_error, regret }
    };
    found.iter().map(of).collect()
}

pub fn regret_table(regrets: &[Regret]) -> Table {
    let line = |r: &Regret| {
        let mut line = cells_of(&r.quality).to_vec();
        line.push(format!("{:.1}", r.time_ms));
        line.extend([r.error, r.best_error].map(|error| format!("{error:.4}")));
        line.push(format!("{:.1} %", 100.0 * r.regret));
        line
    };
    let mut headers = COLUMNS.to_vec();
    headers.extend(["ms", "FLIP + flicker", "best", "regret"]);
    Table { headers, rows: regrets.iter().map(line).collect() }
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row;
    use super::*;

    #[test]
    fn regret_compares_with_the_best_in_the_same_time() {
        let rows = [("none", 1, 1.0, 0.4), ("none", 2, 2.0, 0.1), ("svgf", 1, 2.5, 0.2), ("svgf", 2, 9.0, 0.05)];
        let rows = rows.map(|(denoiser, spp, time_ms, rmse)| row(denoiser, spp, time_ms, &[rmse]));
        let rungs: Vec<Quality> = rows[..3].iter().rev().map(|r| r.quality).collect();
        let found = regrets(&rungs, &rows);
        assert_eq!(found.iter().map(|r| r.time_ms).collect::<Vec<_>>(), [1.0, 2.0, 2.5]);
        assert_eq!((found[0].regret, found[1].regret), (0.0, 0.0));
        assert_eq!(found[2].best_error, found[1].error);
        assert!(found[2].regret > 0.1, "{:?}", found[2]);
        assert_eq!(regret_table(&found).rows.len(), 3);
    }
}
