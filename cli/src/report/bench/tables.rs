//! Tables of settings with their times and errors, as text and as CSV, and the notes printed below them.

use super::errors::{ERROR, NOISE_MARGIN, SHOWN};
use super::rows::{Measured, SettingRow};
use crate::report::csv::{Csv, number};
use crate::report::frames::FrameLine;
use crate::report::intervals::positive_interval;
use crate::report::{Table, cell};
use diptych::accumulation::Noise;
use diptych::exec::PerView;
use diptych::quality::{Denoiser, FrameQuality, Quality};

/// Describes the exposure at which the rows' errors were measured.
pub fn exposure_note(exposure_ev: f64) -> String {
    format!("PSNR, SSIM, FLIP and flicker are of pictures tonemapped at {exposure_ev} EV, the shot's exposure.")
}

/// Returns the caption of the settings whose place the intervals leave open; `None` without any.
pub fn undecided_note(rows: &[SettingRow]) -> Option<String> {
    let count = rows.iter().filter(|r| r.undecided).count();
    (count > 0).then(|| {
        format!(
            "{count} of {} settings are undecided: the 95 % intervals do not show whether they belong on the front. \
             More --turns narrow the intervals of times, more --repeats those of errors.",
            rows.len()
        )
    })
}

/// Caption that explains `flip_flicker`, the error measure of Pareto fronts and ladders.
pub const ERROR_NOTE: &str = "Fronts and ladders use flip_flicker: mean FLIP plus flicker, over the frame on which the \
    moving camera stops and the frames after it, each with the history of the frames before. Flicker is the mean \
    change of pixels from one of these frames to the next.";

/// Columns whose value is the same in all rows of a table: name and value.
pub type Shared = Vec<(&'static str, String)>;

/// Returns the rows as CSV, with a line per setting and eye. Cells of undefined values are empty.
pub fn csv(shared: &Shared, rows: &[SettingRow]) -> Csv {
    let metrics = rows.first().map_or(Vec::new(), |r| r.measured.errors.left().names());
    let mut columns: Vec<&str> = shared.iter().map(|(name, _)| *name).collect();
    columns.extend(COLUMNS);
    columns.extend(["time_ms", "time_ms_min", "time_ms_max", "on_front", "eye"]);
    columns.extend(&metrics);
    columns.extend(["undecided", "turns", "time_ms_low", "time_ms_high", "flip_flicker_low", "flip_flicker_high"]);
    let mut lines = Vec::new();
    for SettingRow { quality, measured, on_front, undecided } in rows {
        let Measured { time_ms, time_ms_min, time_ms_max, errors, .. } = measured;
        for (eye, errors) in errors.with_eyes() {
            let each = measured.repeats.iter().filter_map(|both| both.of(eye).get(ERROR));
            let ends = |interval: Option<[f64; 2]>| interval.map_or([None; 2], |ends| ends.map(Some));
            let mut line: Vec<String> = shared.iter().map(|(_, value)| value.clone()).collect();
            line.extend(cells_of(quality));
            line.extend([time_ms, time_ms_min, time_ms_max].map(|ms| format!("{ms:.4}")));
            line.extend([on_front.to_string(), eye.to_string()]);
            line.extend(metrics.iter().map(|name| number(errors.get(name), 9)));
            line.extend([undecided.to_string(), measured.frames.len().to_string()]);
            line.extend(ends(measured.time_interval()).map(|ms| number(ms, 4)));
            line.extend(ends(positive_interval(each)).map(|error| number(error, 9)));
            lines.push(line);
        }
    }
    Csv { columns: columns.into_iter().map(str::to_owned).collect(), lines }
}

/// Returns the contents of `frames.csv`: a line per timed frame, which begins with the settings that [`FrameLine`]
/// lacks.
pub fn frames(rows: &[SettingRow]) -> Csv {
    let lines = || rows.iter().flat_map(|row| row.measured.frames.iter().map(move |line| (row, line)));
    let setting = |(row, _): (&SettingRow, &FrameLine)| {
        let [denoiser, _, _, foveation, ..] = cells_of(&row.quality);
        vec![denoiser, foveation]
    };
    let columns = ["denoiser", "foveation"].map(str::to_owned).into();
    let settings = Csv { columns, lines: lines().map(setting).collect() };
    settings.beside(FrameLine::csv(&lines().map(|(_, line)| line.clone()).collect::<Vec<_>>()))
}

/// Names of the columns that describe a [`Quality`].
pub(super) const COLUMNS: [&str; 6] = ["denoiser", "iterations", "bounces", "foveation", "scale", "spp"];

/// Returns a quality's cells for [`COLUMNS`], with the names that the command line uses.
pub(super) fn cells_of(quality: &Quality) -> [String; 6] {
    let FrameQuality { bounces, iterations, scale, fovea, .. } = quality.into();
    let foveation = match (fovea, &quality.polar) {
        (Some(_), _) => "layers",
        (None, Some(space)) => space.method().name(),
        (None, None) => "none",
    };
    let [iterations, bounces] = [iterations, bounces].map(|n| n.to_string());
    let (denoiser, spp) = (Denoiser::name_of(quality.denoiser()).to_owned(), quality.spp.to_string());
    [denoiser, iterations, bounces, foveation.to_owned(), scale.to_string(), spp]
}

/// Returns a table with a line per setting and eye. The last column marks settings on the front, those that may belong
/// there, and errors that are within the `noise` of the reference.
pub fn table(rows: &[SettingRow], noise: Option<&PerView<Noise>>) -> Table {
    let metrics: Vec<&str> =
        SHOWN.into_iter().filter(|m| rows.iter().any(|r| r.measured.errors.left().0.contains_key(*m))).collect();
    let mut headers = COLUMNS.to_vec();
    headers.extend(["ms", "95 %", "eye"]);
    headers.extend(&metrics);
    headers.push("note");
    let mut lines = Vec::new();
    for SettingRow { quality, measured, on_front, undecided } in rows {
        for (eye, errors) in measured.errors.with_eyes() {
            let noise = noise.map_or(0.0, |noise| noise.of(eye).relmse);
            let mut line = cells_of(quality).to_vec();
            let within = measured.time_interval().map_or("-".to_owned(), |[low, high]| format!("{low:.1}..{high:.1}"));
            line.extend([format!("{:.1}", measured.time_ms), within, eye.to_string()]);
            line.extend(metrics.iter().map(|m| cell(errors.get(m), 4)));
            let is_lost = errors.get("relmse").is_some_and(|e| e < NOISE_MARGIN * noise);
            let front = match (on_front, undecided) {
                (true, _) => "front",
                (false, true) => "undecided",
                (false, false) => "",
            };
            let notes = [front, if is_lost { "within the reference's noise" } else { "" }];
            line.push(notes.into_iter().filter(|note| !note.is_empty()).collect::<Vec<_>>().join(", "));
            lines.push(line);
        }
    }
    Table { headers, rows: lines }
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row;
    use super::*;

    #[test]
    fn csv_has_a_column_per_metric_and_a_line_per_eye() {
        let rows = [row("none", 4, 12.5, &[0.25, 0.75])];
        let table = csv(&vec![("devices", "2".into())], &rows);
        let begin = "devices,denoiser,iterations,bounces,foveation,scale,spp,time_ms,";
        assert!(table.columns.join(",").starts_with(begin), "{:?}", table.columns);
        assert_eq!(table.lines[0][..7], ["2", "none", "0", "6", "none", "1", "4"]);
        let found = ["time_ms", "on_front", "eye", "rmse"];
        assert_eq!(found.map(|name| table.value(0, name)), ["12.5000", "false", "left", "0.500000000"]);
        assert_eq!(found.map(|name| table.value(1, name)), ["12.5000", "false", "right", "1.000000000"]);
        assert!(table.lines.iter().all(|line| line.len() == table.columns.len()), "{table:?}");
        assert_eq!(["undecided", "turns", "time_ms_low"].map(|name| table.value(0, name)), ["false", "2", ""]);
        assert!(table.value(0, "flip_flicker_low") < table.value(0, "flip_flicker"), "{table:?}");
        // The mean ratio to a black reference is undefined.
        assert_eq!(table.value(0, "mean_ratio"), "");

        let frames = frames(&rows);
        assert_eq!(frames.lines.len(), 2);
        let found = ["denoiser", "foveation", "spp", "makespan_ms"];
        assert_eq!(found.map(|name| frames.value(1, name)), ["none", "none", "4", "12.5000"]);
    }

    #[test]
    fn errors_within_the_noise_are_marked() {
        let floor = Noise { rmse: 100.0, relmse: 10.0 };
        let noise = PerView::both(floor, floor);
        let text = table(&[row("none", 4, 12.5, &[0.5])], Some(&noise)).text();
        let noted: Vec<bool> = text.lines().skip(2).map(|l| l.contains("noise")).collect();
        assert_eq!(noted, [true, false], "{text}");
    }
}
