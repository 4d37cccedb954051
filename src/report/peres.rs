//! Reproduces tables 4 and 5 of the thesis by Peres 2022, "Non-homogeneous denoising for virtual reality in real-time
//! path tracing rendering". The tables show our numbers next to those of the thesis.

use serde::Serialize;

use super::Table;
use super::csv::{Column, Csv, number, optional};
use super::study::{cell, deviation, mean, table};

/// Scenes of the thesis, in its order.
pub const SCENES: [&str; 3] = ["Pink Room", "Sponza", "Forest"];

/// Resolutions per eye in the thesis, in its order.
pub const RESOLUTIONS: [Resolution; 2] = [
    Resolution { name: "FHD", width: 960, height: 1080, radii_px: [144.0, 288.0] },
    Resolution { name: "Quest 2", width: 1832, height: 1920, radii_px: [265.0, 530.0] },
];

/// A resolution per eye, with the radii of its foveal layers.
#[derive(Clone, Copy, Debug)]
pub struct Resolution {
    pub name: &'static str,
    pub width: u32,
    pub height: u32,
    /// Outer radii of the inner and the middle layer, pixels (the thesis's table 2).
    radii_px: [f64; 2],
}

impl Resolution {
    /// Returns the outer radii of the inner and the middle layer as fractions of the width: 0.15 and 0.3, or 0.1447 and
    /// 0.2893.
    pub fn radii(&self) -> [f64; 2] {
        self.radii_px.map(|px| px / f64::from(self.width))
    }
}

/// Configurations of the thesis, in its order.
pub const CONFIGURATIONS: [&str; 3] = ["Base", "NH2LD", "NH3LD"];

/// Table 4: ms per frame, by resolution, scene and configuration.
const TIMES_MS: [[[f64; 3]; 3]; 2] = [
    [[16.26, 13.99, 12.81], [31.01, 23.28, 22.95], [22.84, 18.46, 17.54]],
    [[45.32, 40.58, 39.19], [99.27, 75.52, 74.62], [73.66, 60.24, 59.03]],
];

/// Table 5: RMSE in %, SSIM and PSNR in dB, by scene and configuration.
const QUALITY: [[ImageErrors; 3]; 3] = [
    [errors(3.2862, 0.986438, 28.659183), errors(3.4374, 0.985774, 28.030232), errors(3.5997, 0.987343, 27.619445)],
    [errors(5.7633, 0.918678, 21.879093), errors(5.9252, 0.913988, 21.420517), errors(5.9029, 0.913633, 21.468767)],
    [errors(3.7991, 0.813191, 22.339938), errors(3.8649, 0.795324, 22.378790), errors(4.1787, 0.778536, 21.692040)],
];

/// Image errors, computed on display values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ImageErrors {
    /// RMSE in % of the range of display values.
    pub rmse_percent: f64,
    pub ssim: Option<f64>,
    /// PSNR in dB.
    pub psnr: f64,
}

const fn errors(rmse_percent: f64, ssim: f64, psnr: f64) -> ImageErrors {
    ImageErrors { rmse_percent, ssim: Some(ssim), psnr }
}

impl ImageErrors {
    /// Creates errors from PSNR (dB) and SSIM. The RMSE follows from the PSNR, whose peak value is the display range.
    pub fn new(psnr: f64, ssim: Option<f64>) -> Self {
        Self { rmse_percent: 100.0 * 10f64.powf(-psnr / 20.0), ssim, psnr }
    }
}

/// Results of a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ConfigurationResults {
    /// Quartiles of the warm frames' makespans over all instants.
    pub time_ms: [f64; 3],
    /// Speedup over the base configuration.
    pub speed_up: f64,
    /// Number of instants along the path.
    pub instants: usize,
    /// Means over instants.
    pub quality: ImageErrors,
    /// Standard deviations over instants; `None` for a single instant.
    pub deviation: Option<ImageErrors>,
    /// Exposure of the shot in stops, at which pictures are compared.
    pub exposure_ev: f64,
}

/// Returns the mean of the errors and, for several instants, the standard deviation (over n − 1). The SSIM is `None` if
/// it is undefined at any instant.
pub fn over_instants(of: &[ImageErrors]) -> (ImageErrors, Option<ImageErrors>) {
    let values = |value: fn(&ImageErrors) -> f64| of.iter().map(value).collect::<Vec<_>>();
    let ssims: Option<Vec<f64>> = of.iter().map(|errors| errors.ssim).collect();
    let all = |statistic: fn(&[f64]) -> f64| ImageErrors {
        rmse_percent: statistic(&values(|e| e.rmse_percent)),
        ssim: ssims.as_deref().map(statistic),
        psnr: statistic(&values(|e| e.psnr)),
    };
    (all(mean), (of.len() > 1).then(|| all(deviation)))
}

/// A configuration of the thesis at one resolution and scene.
#[derive(Clone, Debug, Serialize)]
pub struct PeresRow {
    /// Indices into [`RESOLUTIONS`], [`SCENES`] and [`CONFIGURATIONS`].
    #[serde(skip)]
    pub of: [usize; 3],
    pub resolution: &'static str,
    pub size: String,
    pub shot: String,
    /// Scene of the thesis that the shot replaces.
    pub stands_for: &'static str,
    pub configuration: &'static str,
    /// Measured results; `None` if this configuration was not measured.
    pub found: Option<ConfigurationResults>,
}

impl PeresRow {
    /// Creates a row; `of` must be within the bounds of the constants.
    pub fn new(of: [usize; 3], size: String, shot: String, found: Option<ConfigurationResults>) -> Self {
        let [resolution, scene, configuration] = of;
        let (resolution, stands_for) = (RESOLUTIONS[resolution].name, SCENES[scene]);
        Self { of, resolution, size, shot, stands_for, configuration: CONFIGURATIONS[configuration], found }
    }

    fn time_ms(&self) -> Option<f64> {
        self.found.map(|f| f.time_ms[1])
    }

    /// Returns the error that `of` selects, as its mean over instants.
    fn quality(&self, of: fn(&ImageErrors) -> Option<f64>) -> Option<f64> {
        of(&self.found?.quality)
    }

    /// Returns the standard deviation over instants of the error that `of` selects.
    fn deviation(&self, of: fn(&ImageErrors) -> Option<f64>) -> Option<f64> {
        of(&self.found?.deviation?)
    }

    /// Formats the error that `of` selects as mean ± standard deviation.
    fn quality_text(&self, of: fn(&ImageErrors) -> Option<f64>, decimals: usize) -> String {
        let deviation = self.deviation(of).map_or(String::new(), |d| format!(" ± {d:.decimals$}"));
        cell(self.quality(of), decimals) + &deviation
    }

    fn cited_ms(&self) -> f64 {
        let [resolution, scene, configuration] = self.of;
        TIMES_MS[resolution][scene][configuration]
    }

    fn cited_speed_up(&self) -> f64 {
        let [resolution, scene, _] = self.of;
        TIMES_MS[resolution][scene][0] / self.cited_ms()
    }

    fn cited_quality(&self) -> ImageErrors {
        let [_, scene, configuration] = self.of;
        QUALITY[scene][configuration]
    }
}

const RMSE: fn(&ImageErrors) -> Option<f64> = |e| Some(e.rmse_percent);
const SSIM: fn(&ImageErrors) -> Option<f64> = |e| e.ssim;
const PSNR: fn(&ImageErrors) -> Option<f64> = |e| Some(e.psnr);

const SUBJECT: [Column<PeresRow>; 5] = [
    ("resolution", |r| r.resolution.to_owned()),
    ("size", |r| r.size.clone()),
    ("shot", |r| r.shot.clone()),
    ("stands for", |r| r.stands_for.to_owned()),
    ("configuration", |r| r.configuration.to_owned()),
];

const TIME: [Column<PeresRow>; 5] = [
    ("ms", |r| cell(r.time_ms(), 2)),
    ("iqr ms", |r| cell(r.found.map(|f| f.time_ms[2] - f.time_ms[0]), 2)),
    ("speed-up", |r| cell(r.found.map(|f| f.speed_up), 2)),
    ("thesis ms", |r| format!("{:.2}", r.cited_ms())),
    ("thesis speed-up", |r| format!("{:.2}", r.cited_speed_up())),
];

const ERRORS: [Column<PeresRow>; 7] = [
    ("exposure_ev", |r| r.found.map_or("-".to_owned(), |f| f.exposure_ev.to_string())),
    ("rmse %", |r| r.quality_text(RMSE, 4)),
    ("ssim", |r| r.quality_text(SSIM, 6)),
    ("psnr", |r| r.quality_text(PSNR, 3)),
    ("thesis rmse %", |r| format!("{:.4}", r.cited_quality().rmse_percent)),
    ("thesis ssim", |r| cell(r.cited_quality().ssim, 6)),
    ("thesis psnr", |r| format!("{:.3}", r.cited_quality().psnr)),
];

/// The caption of [`time_table`].
pub const TIME_NOTE: &str = "Median makespan of warm frames at instants along the path, both eyes, and its \
    interquartile range; the speed-up is relative to Base. Thesis: table 4, mean GPU time of 1000 frames along a path \
    on a GeForce RTX 2080 at full resolution. Base: 4 samples and 5 iterations for every pixel. NH2LD and NH3LD: on \
    average 4, 3 and 2 samples per pixel in the inner, middle and outer layer, with 3, 5 and 5 or 2, 3 and 5 \
    iterations.";

/// The caption of [`quality_table`].
pub const QUALITY_NOTE: &str = "Mean and standard deviation over instants along the path, for both eyes and all frames \
    of each. The reference has many samples and no denoiser; both are tonemapped at exposure_ev, the shot's exposure. \
    RMSE is a percentage of the display range, so PSNR = -20 log10(RMSE / 100 %) at each instant. Thesis: table 5. It \
    does not state its resolution or the quantity of its RMSE: its PSNR is 1.0 (Pink Room, Base) to 6.1 dB (Forest, \
    Base) below this formula. Scenes and renderers differ, so compare the configurations of one scene, not the \
    columns.";

/// Returns table 4, with a line per resolution, shot and configuration.
pub fn time_table(rows: &[PeresRow]) -> Table {
    table(&[&SUBJECT[..], &TIME].concat(), rows)
}

/// Returns table 5, with the same lines as [`time_table`].
pub fn quality_table(rows: &[PeresRow]) -> Table {
    table(&[&SUBJECT[..], &ERRORS].concat(), rows)
}

const CSV: [Column<PeresRow>; 21] = [
    ("resolution", |r| r.resolution.to_owned()),
    ("size", |r| r.size.clone()),
    ("shot", |r| r.shot.clone()),
    ("stands_for", |r| r.stands_for.to_owned()),
    ("configuration", |r| r.configuration.to_owned()),
    ("time_ms", |r| number(r.time_ms(), 4)),
    ("time_ms_iqr", |r| number(r.found.map(|f| f.time_ms[2] - f.time_ms[0]), 4)),
    ("speedup", |r| number(r.found.map(|f| f.speed_up), 4)),
    ("thesis_time_ms", |r| r.cited_ms().to_string()),
    ("thesis_speedup", |r| format!("{:.4}", r.cited_speed_up())),
    ("exposure_ev", |r| optional(r.found.map(|f| f.exposure_ev))),
    ("rmse_percent", |r| number(r.quality(RMSE), 4)),
    ("ssim", |r| number(r.quality(SSIM), 6)),
    ("psnr", |r| number(r.quality(PSNR), 4)),
    ("thesis_rmse_percent", |r| r.cited_quality().rmse_percent.to_string()),
    ("thesis_ssim", |r| optional(r.cited_quality().ssim)),
    ("thesis_psnr", |r| r.cited_quality().psnr.to_string()),
    ("instants", |r| optional(r.found.map(|f| f.instants))),
    ("rmse_percent_deviation", |r| number(r.deviation(RMSE), 4)),
    ("ssim_deviation", |r| number(r.deviation(SSIM), 6)),
    ("psnr_deviation", |r| number(r.deviation(PSNR), 4)),
];

/// Returns both tables as CSV.
pub fn peres_csv(rows: &[PeresRow]) -> Csv {
    Csv::new(&CSV, rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The thesis prints two digits and truncates the rest.
    #[test]
    fn cited_times_give_the_cited_speed_ups() {
        let printed = [[[1.16, 1.26], [1.33, 1.35], [1.23, 1.30]], [[1.11, 1.15], [1.31, 1.33], [1.22, 1.24]]];
        for (resolution, scenes) in printed.iter().enumerate() {
            for (scene, speed_ups) in scenes.iter().enumerate() {
                for (configuration, printed) in (1..).zip(speed_ups) {
                    let row = PeresRow::new([resolution, scene, configuration], String::new(), String::new(), None);
                    let cut = (row.cited_speed_up() * 100.0).floor() / 100.0;
                    assert!((cut - printed).abs() < 1e-9, "{row:?}: {cut}");
                }
            }
        }
    }

    #[test]
    fn an_error_of_a_tenth_of_the_range_is_20_db() {
        assert!((ImageErrors::new(20.0, None).rmse_percent - 10.0).abs() < 1e-12);
        assert_eq!(ImageErrors::new(f64::INFINITY, None).rmse_percent, 0.0);
    }

    #[test]
    fn what_was_not_measured_leaves_the_cited_numbers_alone() {
        let quality = ImageErrors::new(20.0, Some(0.5));
        let (quality, deviation) = over_instants(&[quality, ImageErrors { psnr: 22.0, ..quality }]);
        let found = ConfigurationResults {
            time_ms: [9.0, 10.0, 12.0],
            speed_up: 1.0,
            instants: 2,
            quality,
            deviation,
            exposure_ev: 2.0,
        };
        let row = |configuration, found| {
            PeresRow::new([0, 2, configuration], "240x270".into(), "builtin:forest".into(), found)
        };
        let rows = [row(0, Some(found)), row(2, None)];
        assert_eq!(time_table(&rows).rows[0][3..], ["Forest", "Base", "10.00", "3.00", "1.00", "22.84", "1.00"]);
        assert_eq!(time_table(&rows).rows[1][5..], ["-", "-", "-", "17.54", "1.30"]);
        assert_eq!(
            quality_table(&rows).rows[0][5..9],
            ["2", "10.0000 ± 0.0000", "0.500000 ± 0.000000", "21.000 ± 1.414"]
        );
        assert_eq!(quality_table(&rows).rows[1][5..], ["-", "-", "-", "-", "4.1787", "0.778536", "21.692"]);
        let table = peres_csv(&rows);
        let found = ["time_ms", "speedup", "exposure_ev", "psnr", "psnr_deviation", "instants", "thesis_time_ms"];
        let expected = ["10.0000", "1.0000", "2", "21.0000", "1.4142", "2", "22.84"];
        assert_eq!(found.map(|name| table.value(0, name)), expected);
        assert_eq!(found.map(|name| table.value(1, name)), ["", "", "", "", "", "", "17.54"]);
    }

    #[test]
    fn layers_are_those_of_table_2() {
        let [fhd, quest] = RESOLUTIONS.map(|resolution| resolution.radii());
        assert_eq!(fhd, crate::stages::Foveation::RADII);
        assert!((quest[0] - 0.1447).abs() < 1e-4 && (quest[1] - 0.2893).abs() < 1e-4, "{quest:?}");
        assert_eq!(over_instants(&[ImageErrors::new(20.0, None)]), (ImageErrors::new(20.0, None), None));
    }
}
