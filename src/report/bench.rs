//! What a grid of settings costs and how wrong it is: rows, CSV, the plot of time against error, and how fast the error
//! falls with samples.

use std::fmt;

use serde::Serialize;

use super::plot::{Axis, Chart, Series, line_chart_svg};
use super::{ReportError, Table, median_of};
use crate::accumulation::Noise;
use crate::exec::Stereo;
use crate::metrics;

/// The metrics that tables show, in their order; others follow in files.
const SHOWN: [&str; 6] = ["rmse", "relmse", "psnr", "ssim", "flip", "mean_ratio"];

/// A relMSE below this many times the reference's own is not told apart from it.
const NOISE_MARGIN: f64 = 4.0;

/// An eye's errors by name, as many as [`metrics::Errors`] has.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Errors(serde_json::Map<String, serde_json::Value>);

impl Errors {
    /// Means over repeats. What is undefined in one is so in the mean.
    pub fn mean_of(comparisons: &[metrics::Errors]) -> Self {
        let all: Vec<serde_json::Value> = comparisons.iter().filter_map(|c| serde_json::to_value(c).ok()).collect();
        let names = all.first().and_then(|v| v.as_object()).into_iter().flat_map(|v| v.keys());
        let mean = |name: &String| -> Option<f64> {
            let values: Option<Vec<f64>> = all.iter().map(|v| v.get(name)?.as_f64()).collect();
            values.map(|v| v.iter().sum::<f64>() / v.len() as f64)
        };
        Self(names.map(|name| (name.clone(), mean(name).into())).collect())
    }

    pub fn get(&self, name: &str) -> Option<f64> {
        self.0.get(name)?.as_f64()
    }

    /// Those of [`SHOWN`] first.
    fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.0.keys().map(String::as_str).collect();
        names.sort_by_key(|n| SHOWN.iter().position(|s| s == n).unwrap_or(SHOWN.len()));
        names
    }
}

/// One setting.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub denoiser: String,
    pub iterations: u32,
    pub spp: u32,
    /// Median, least and most of the repeats' makespans.
    pub time_ms: f64,
    pub time_ms_min: f64,
    pub time_ms_max: f64,
    pub errors: Stereo<Errors>,
    /// relMSE of each repeat.
    pub relmse_repeats: Stereo<Vec<f64>>,
    /// No other setting is both faster and better by both eyes' relMSE.
    pub on_front: bool,
}

impl Row {
    /// Of repeats: makespans, and comparisons per eye.
    pub fn new(
        denoiser: String,
        iterations: u32,
        spp: u32,
        times_ms: Vec<f64>,
        found: &Stereo<Vec<metrics::Errors>>,
    ) -> Self {
        let relmse = |c: &[metrics::Errors]| c.iter().map(|c| c.relmse).collect();
        Self {
            denoiser,
            iterations,
            spp,
            time_ms_min: times_ms.iter().copied().fold(f64::INFINITY, f64::min),
            time_ms_max: times_ms.iter().copied().fold(0.0, f64::max),
            time_ms: median_of(times_ms),
            errors: Stereo { left: Errors::mean_of(&found.left), right: Errors::mean_of(&found.right) },
            relmse_repeats: Stereo { left: relmse(&found.left), right: relmse(&found.right) },
            on_front: false,
        }
    }

    /// Of both eyes; the error that settings are held against each other by. RMSE would hang on the few pixels at the
    /// edges of lamps, which no filter touches.
    fn relmse(&self) -> f64 {
        let [l, r] = [&self.errors.left, &self.errors.right].map(|e| e.get("relmse").unwrap_or(f64::INFINITY));
        (l + r) / 2.0
    }
}

/// Marks the rows of the Pareto front.
pub fn mark_front(rows: &mut [Row]) {
    let all: Vec<(f64, f64)> = rows.iter().map(|r| (r.time_ms, r.relmse())).collect();
    for (row, own) in rows.iter_mut().zip(&all) {
        row.on_front = !all.iter().any(|o| o.0 <= own.0 && o.1 <= own.1 && o != own);
    }
}

/// Exponent of the error, √relMSE, over samples per pixel: −0.5 for independent samples.
#[derive(Clone, Debug, Serialize)]
pub struct Slope {
    pub denoiser: String,
    pub eye: &'static str,
    /// Mean over the repeats' slopes.
    pub slope: f64,
    /// Of that mean; `None` for a single repeat.
    pub standard_error: Option<f64>,
    /// Settings that it goes through.
    pub points: usize,
}

impl fmt::Display for Slope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { denoiser, eye, slope, standard_error, points } = self;
        let error = standard_error.map_or(String::new(), |e| format!(" ± {e:.3}"));
        write!(f, "{denoiser}, {eye} eye: √relMSE ∝ spp^{slope:.3}{error} over {points} settings")?;
        write!(f, " (independent samples: -0.5)")
    }
}

/// Least squares through (ln x, ln y); `None` for fewer than two different x.
pub fn log_slope(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points.iter().map(|p| (p.0.ln(), p.1.ln())).collect();
    let mean = |f: &dyn Fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / logs.len() as f64;
    let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
    let spread: f64 = logs.iter().map(|p| (p.0 - x).powi(2)).sum();
    (spread > 0.0).then(|| logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / spread)
}

/// Slopes per denoiser and eye. The reference's noise, which adds to every relMSE, is taken off; settings whose error is
/// lost in it are left out, as is 1 spp, whose sample goes through the pixel's centre and estimates another image.
pub fn slopes(rows: &[Row], noise: Option<&Stereo<Noise>>) -> Vec<Slope> {
    let mut denoisers: Vec<&str> = rows.iter().map(|r| r.denoiser.as_str()).collect();
    denoisers.dedup();
    let of = |denoiser: &&str| {
        let own = rows.iter().filter(|r| r.denoiser == *denoiser && r.spp > 1);
        let eyes = own.map(|r| (r.spp, &r.relmse_repeats));
        let left = eyes.clone().map(|(spp, e)| (spp, e.left.as_slice())).collect();
        let right = eyes.map(|(spp, e)| (spp, e.right.as_slice())).collect();
        [
            slope(denoiser, "left", left, noise.map_or(0.0, |n| n.left.relmse)),
            slope(denoiser, "right", right, noise.map_or(0.0, |n| n.right.relmse)),
        ]
    };
    denoisers.iter().flat_map(of).flatten().collect()
}

/// Through the relMSE of each repeat, by samples per pixel.
fn slope(denoiser: &str, eye: &'static str, mut settings: Vec<(u32, &[f64])>, noise: f64) -> Option<Slope> {
    settings.retain(|(_, repeats)| repeats.iter().all(|&e| e > NOISE_MARGIN * noise));
    let fit = |i: usize| {
        let point = |(spp, repeats): &(u32, &[f64])| Some((f64::from(*spp), (repeats.get(i)? - noise).sqrt()));
        log_slope(&settings.iter().map(point).collect::<Option<Vec<_>>>()?)
    };
    let fits: Vec<f64> = (0..settings.first()?.1.len()).map_while(fit).collect();
    let (slope, standard_error) = mean_and_error(&fits)?;
    Some(Slope { denoiser: denoiser.to_owned(), eye, slope, standard_error, points: settings.len() })
}

/// Mean and its standard error, which takes two values; none of no values.
fn mean_and_error(values: &[f64]) -> Option<(f64, Option<f64>)> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    let error = (values.len() > 1).then(|| (squares / (n - 1.0) / n).sqrt());
    (!values.is_empty()).then_some((mean, error))
}

/// What all rows of a table share: names and values of columns.
pub type Shared = Vec<(&'static str, String)>;

/// A line per setting and eye. What is undefined is empty.
pub fn csv(shared: &Shared, rows: &[Row]) -> String {
    let metrics = rows.first().map_or(Vec::new(), |r| r.errors.left.names());
    let mut text = String::new();
    for (name, _) in shared {
        text += &format!("{name},");
    }
    text += "denoiser,iterations,spp,time_ms,time_ms_min,time_ms_max,on_front,eye";
    metrics.iter().for_each(|m| text += &format!(",{m}"));
    text.push('\n');
    for row in rows {
        for (eye, errors) in [("left", &row.errors.left), ("right", &row.errors.right)] {
            shared.iter().for_each(|(_, value)| text += &format!("{value},"));
            let Row { denoiser, iterations, spp, time_ms, time_ms_min, time_ms_max, on_front, .. } = row;
            let times = format!("{time_ms:.4},{time_ms_min:.4},{time_ms_max:.4}");
            text += &format!("{denoiser},{iterations},{spp},{times},{on_front},{eye}");
            for name in &metrics {
                text += &errors.get(name).map_or(",".to_owned(), |v| format!(",{v:.9}"));
            }
            text.push('\n');
        }
    }
    text
}

/// Time against both eyes' relMSE, a line per denoiser, and the reference's noise below them.
///
/// # Errors
/// [`ReportError`] if there is nothing to draw.
pub fn svg(title: String, rows: &[Row], noise: Option<&Stereo<Noise>>) -> Result<String, ReportError> {
    let chart = Chart {
        title,
        x: Axis { label: "time of a frame, ms".into(), log: true },
        y: Axis { label: "relMSE, mean of both eyes".into(), log: true },
    };
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let point = (row.time_ms, row.relmse());
        match series.iter_mut().find(|s| s.name == row.denoiser) {
            Some(line) => line.points.push(point),
            None => series.push(Series { name: row.denoiser.clone(), points: vec![point], band: None, guide: false }),
        }
    }
    for line in &mut series {
        line.points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    if let Some(noise) = noise {
        let level = (noise.left.relmse + noise.right.relmse) / 2.0;
        let ends = rows.iter().map(|r| r.time_ms).fold([f64::INFINITY, 0.0], |[a, b], t| [a.min(t), b.max(t)]);
        let points = ends.map(|t| (t, level)).into();
        series.push(Series { name: "noise of the reference".into(), points, band: None, guide: true });
    }
    line_chart_svg(&chart, &series)
}

/// A line per setting and eye.
pub fn table(rows: &[Row], noise: Option<&Stereo<Noise>>) -> Table {
    let metrics: Vec<&str> =
        SHOWN.into_iter().filter(|m| rows.iter().any(|r| r.errors.left.0.contains_key(*m))).collect();
    let mut headers = vec!["denoiser", "spp", "ms", "eye"];
    headers.extend(&metrics);
    headers.push("note");
    let mut lines = Vec::new();
    for row in rows {
        let of = |n: fn(&Stereo<Noise>) -> f64| noise.map_or(0.0, n);
        for (eye, errors, noise) in
            [("left", &row.errors.left, of(|n| n.left.relmse)), ("right", &row.errors.right, of(|n| n.right.relmse))]
        {
            let mut line =
                vec![row.denoiser.clone(), row.spp.to_string(), format!("{:.1}", row.time_ms), eye.to_owned()];
            line.extend(metrics.iter().map(|m| errors.get(m).map_or("-".into(), |v| format!("{v:.4}"))));
            let is_lost = errors.get("relmse").is_some_and(|e| e < NOISE_MARGIN * noise);
            let front = if row.on_front { "front" } else { "" };
            line.push(if is_lost { "within the reference's noise".into() } else { front.to_owned() });
            lines.push(line);
        }
    }
    Table { headers, rows: lines }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Extent, RgbImage};
    use crate::metrics::compare;

    /// A setting whose repeats have these RMSE in the left eye, and twice that in the right.
    fn row(denoiser: &str, spp: u32, time_ms: f64, rmse: &[f64]) -> Row {
        let black = RgbImage::filled(Extent::new(12, 12), [0.0; 3]);
        let flat = |v: f64| compare(&black, &RgbImage::filled(black.extent, [v as f32; 3])).unwrap();
        let eye = |scale: f64| rmse.iter().map(|v| flat(v * scale)).collect();
        Row::new(denoiser.into(), 0, spp, vec![time_ms; rmse.len()], &Stereo { left: eye(1.0), right: eye(2.0) })
    }

    #[test]
    fn a_power_law_has_its_exponent() {
        let points: Vec<(f64, f64)> = [2.0f64, 4.0, 8.0, 64.0].map(|n| (n, 3.0 * n.powf(-0.7))).into();
        assert!((log_slope(&points).unwrap() + 0.7).abs() < 1e-12);
        assert_eq!((log_slope(&points[..1]), log_slope(&[])), (None, None));
    }

    #[test]
    fn the_references_noise_is_taken_off_and_one_sample_left_out() {
        // The relMSE of a flat image to a black one is 100 times its square.
        let noise = Stereo { left: Noise { rmse: 0.01, relmse: 0.01 }, right: Noise { rmse: 0.02, relmse: 0.04 } };
        let seen = |n: f64| (0.16 / n + 1e-4).sqrt();
        // At 4096 samples the error is below the noise, at 1 it is that of another estimator.
        let spps = [1u32, 2, 8, 64, 4096];
        let rows: Vec<Row> = spps.map(|n| row("none", n, 1.0, &[if n == 1 { 9.0 } else { seen(n.into()) }; 2])).into();
        let found = slopes(&rows, Some(&noise));
        assert_eq!(found.len(), 2);
        for slope in found {
            assert!((slope.slope + 0.5).abs() < 1e-5, "{slope:?}");
            assert_eq!((slope.points, slope.standard_error.unwrap() < 1e-9), (3, true));
        }
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let mut rows = vec![
            row("a", 1, 1.0, &[0.4]),
            row("a", 2, 2.0, &[0.3]),
            row("b", 1, 1.5, &[0.2]),
            row("b", 2, 3.0, &[0.1]),
        ];
        mark_front(&mut rows);
        assert_eq!(rows.iter().map(|r| r.on_front).collect::<Vec<_>>(), [true, false, true, true]);
    }

    #[test]
    fn a_csv_has_a_column_per_metric_and_a_line_per_eye() {
        let text = csv(&vec![("devices", "2".into())], &[row("none", 4, 12.5, &[0.25, 0.75])]);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].starts_with("devices,denoiser,iterations,spp,time_ms,"), "{text}");
        assert!(lines[0].contains(",eye,rmse,relmse,psnr,ssim,"), "{text}");
        assert!(lines[1].starts_with("2,none,0,4,12.5000,12.5000,12.5000,false,left,0.500000000,"), "{text}");
        assert!(lines[2].contains(",right,1.000000000,"), "{text}");
        assert!(lines.iter().all(|l| l.split(',').count() == lines[0].split(',').count()), "{text}");
        // The mean ratio to a black reference is undefined.
        assert!(lines[1].contains(",,"), "{text}");
    }

    #[test]
    fn errors_within_the_noise_are_said_to_be() {
        let floor = Noise { rmse: 100.0, relmse: 10.0 };
        let noise = Stereo { left: floor, right: floor };
        let text = table(&[row("none", 4, 12.5, &[0.5])], Some(&noise)).text();
        let noted: Vec<bool> = text.lines().skip(2).map(|l| l.contains("noise")).collect();
        assert_eq!(noted, [true, false], "{text}");
    }
}
