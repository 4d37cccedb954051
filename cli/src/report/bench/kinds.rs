//! The table of errors by kind of pixel.

use super::rows::SettingRow;
use super::tables::{COLUMNS, cells_of};
use crate::report::Table;
use diptych::metrics::kinds::{Kind, KindMap};

/// Caption of [`kind_table`].
pub const KIND_NOTE: &str = "Mean FLIP of each kind of pixel, and its part of the sum of FLIP over all pixels; means of \
    both eyes and all frames. The first line has the fraction of pixels. A pixel has the first kind that applies. Edges \
    are between neighbours: silhouette, in depth; crease, in the normal; texture, in the base colour; light_edge, in \
    the reference's light. reflection: smooth metal or glass.";

/// Returns a line per setting, with a column for each kind of pixel, below a line with the fractions of pixels.
pub fn kind_table(rows: &[SettingRow], maps: &[KindMap; 2]) -> Table {
    let fraction = |kind: Kind| {
        let counts = maps.each_ref().map(|map| {
            let count = map.kinds().iter().filter(|k| **k == kind).count();
            count as f64 / map.kinds().len() as f64
        });
        50.0 * (counts[0] + counts[1])
    };
    let cell = |row: &SettingRow, kind: Kind| {
        let [flip, part] = ["flip", "part"].map(|of| row.measured.error(&format!("{of}_{}", kind.name())));
        if flip.is_finite() { format!("{flip:.4}, {:.1} %", 100.0 * part) } else { "-".to_owned() }
    };
    let line = |row: &SettingRow| {
        let cells = cells_of(&row.quality).into_iter().chain([format!("{:.1}", row.measured.time_ms)]);
        cells.chain(Kind::ALL.map(|kind| cell(row, kind))).collect()
    };
    let fractions = Kind::ALL.map(|kind| format!("{:.1} %", fraction(kind)));
    let blank = vec![String::new(); COLUMNS.len()];
    let first = [&blank[..], &["pixels".to_owned()], &fractions].concat();
    let headers = COLUMNS.into_iter().chain(["ms"]).chain(Kind::ALL.map(Kind::name)).collect();
    Table { headers, rows: [first].into_iter().chain(rows.iter().map(line)).collect() }
}
