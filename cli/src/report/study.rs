//! Tables of studies: errors of sequences, and errors at seams compared with those of Leria et al.

use serde::Serialize;

use super::bench::Errors;
use super::csv::{Column, Csv, number};
use super::statistics::mean;
use super::{Table, cell, statistics};
use diptych::exec::PerView;
use diptych::metrics;
use diptych::metrics::temporal::TemporalError;
use diptych::scene::rig::Eye;

/// Errors of one view of a sequence against its reference.
#[derive(Clone, Debug, Serialize)]
pub struct SequenceRow {
    pub eye: Eye,
    pub frames: usize,
    /// Exposure in stops at which images are tonemapped for metrics of display values.
    pub exposure_ev: f32,
    /// Means over frames.
    pub mean: Errors,
    #[serde(flatten)]
    pub temporal: TemporalError,
    pub per_frame: Vec<metrics::Errors>,
}

impl SequenceRow {
    pub fn new(eye: Eye, exposure_ev: f32, per_frame: Vec<metrics::Errors>, temporal: TemporalError) -> Self {
        Self { eye, frames: per_frame.len(), exposure_ev, mean: Errors::mean_of(&per_frame), temporal, per_frame }
    }
}

const SEQUENCE: &[Column<SequenceRow>] = &[
    ("eye", |r| r.eye.file_stem()),
    ("frames", |r| r.frames.to_string()),
    ("exposure_ev", |r| r.exposure_ev.to_string()),
    ("relmse", |r| cell(r.mean.get("relmse"), 6)),
    ("psnr", |r| cell(r.mean.get("psnr"), 4)),
    ("flip", |r| cell(r.mean.get("flip"), 6)),
    ("mean_ratio", |r| cell(r.mean.get("mean_ratio"), 6)),
    ("flicker", |r| cell(r.temporal.flicker, 6)),
    ("ghosting", |r| cell(r.temporal.ghosting, 4)),
    ("new_share", |r| cell(r.temporal.new_share, 4)),
];

/// Returns a table with a line per view.
pub fn sequence_table(rows: &PerView<SequenceRow>) -> Table {
    Table::new(SEQUENCE, rows.values())
}

/// Errors of one eye's image in one frame that several devices rendered in stripes. In comments and field names, `one`
/// is the same image rendered by a single device.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SeamErrors {
    /// Errors against the reference.
    pub psnr: f64,
    pub flip: f64,
    /// Banding index of the image, without a reference.
    pub cambi: f64,
    /// RMSE of the rows near seams divided by the RMSE of the other rows; `None` for one device.
    pub seam: Option<f64>,
    /// RMSE of the rows near seams divided by the RMSE of the same rows of `one`. 1 means that seams add no error.
    pub seam_over_one: Option<f64>,
    /// Errors against `one`. For identical pictures, PSNR is infinite, and FLIP and the RMSE near seams are 0.
    pub psnr_one: f64,
    pub flip_one: f64,
    pub seam_rmse_one: Option<f64>,
}

impl SeamErrors {
    /// Returns the mean of each error. An error that is undefined in one element has no mean.
    pub fn mean_of(all: &[Self]) -> Self {
        let mean = |of: fn(&Self) -> f64| mean(&all.iter().map(of).collect::<Vec<_>>());
        let mean_if = |of: fn(&Self) -> Option<f64>| {
            all.iter().map(of).collect::<Option<Vec<f64>>>().as_deref().map(statistics::mean)
        };
        Self {
            psnr: mean(|e| e.psnr),
            flip: mean(|e| e.flip),
            cambi: mean(|e| e.cambi),
            seam: mean_if(|e| e.seam),
            seam_over_one: mean_if(|e| e.seam_over_one),
            psnr_one: mean(|e| e.psnr_one),
            flip_one: mean(|e| e.flip_one),
            seam_rmse_one: mean_if(|e| e.seam_rmse_one),
        }
    }
}

/// Results of a seam policy on a number of devices, for one eye.
#[derive(Clone, Debug, Serialize)]
pub struct SeamRow {
    pub devices: usize,
    /// Seam policy, `-` for one device.
    pub policy: String,
    pub eye: Eye,
    /// Exposure in stops at which images are tonemapped for PSNR, FLIP and CAMBI.
    pub exposure_ev: f64,
    #[serde(flatten)]
    pub errors: SeamErrors,
    /// True if every frame is identical, byte for byte, to that of a single device.
    pub same_bytes: bool,
    /// Quartiles of the warm frames' makespans.
    pub time_ms: [f64; 3],
}

/// Name of the seam policy in files for rows of one device, which has no seams.
pub const ONE_DEVICE: &str = "one_device";

impl SeamRow {
    fn policy_name(&self) -> &str {
        if self.policy == "-" { ONE_DEVICE } else { &self.policy }
    }
}

const SEAMS: &[Column<SeamRow>] = &[
    ("devices", |r| r.devices.to_string()),
    ("seam policy", |r| r.policy.clone()),
    ("eye", |r| r.eye.to_string()),
    ("exposure_ev", |r| r.exposure_ev.to_string()),
    ("psnr", |r| format!("{:.3}", r.errors.psnr)),
    ("flip", |r| format!("{:.5}", r.errors.flip)),
    ("cambi", |r| format!("{:.4}", r.errors.cambi)),
    ("seam", |r| cell(r.errors.seam, 4)),
    ("seam / one's", |r| cell(r.errors.seam_over_one, 4)),
    ("psnr to one", |r| format!("{:.3}", r.errors.psnr_one)),
    ("flip to one", |r| format!("{:.5}", r.errors.flip_one)),
    ("seam rmse to one", |r| cell(r.errors.seam_rmse_one, 6)),
    ("same bytes", |r| if r.same_bytes { "yes" } else { "no" }.to_owned()),
    ("ms", |r| format!("{:.1}", r.time_ms[1])),
    ("iqr ms", |r| format!("{:.1}", r.time_ms[2] - r.time_ms[0])),
];

/// Description of the columns of [`seam_table`].
pub const SEAM_NOTE: &str = "Means over frames. psnr (dB) and flip compare with the reference, both tonemapped at \
    exposure_ev. cambi: index of visible bands of the image alone; 0 is none, and bands annoy from about 5. seam: \
    RMSE within 4 rows of a seam over RMSE elsewhere. seam / one's: RMSE of these rows over that of the same rows of \
    the one-device image; 1 means that the seam adds no error. psnr, flip and seam rmse to one compare with the \
    one-device image: inf, 0 and 0 if all bytes are the same. ms: median of warm frames; iqr: interquartile range.";

/// Returns a table with a line per setting and eye.
pub fn seam_table(rows: &[SeamRow]) -> Table {
    Table::new(SEAMS, rows)
}

const SEAMS_CSV: &[Column<SeamRow>] = &[
    ("devices", |r| r.devices.to_string()),
    ("seam_policy", |r| r.policy_name().to_owned()),
    ("eye", |r| r.eye.to_string()),
    ("exposure_ev", |r| r.exposure_ev.to_string()),
    ("psnr", |r| format!("{:.4}", r.errors.psnr)),
    ("flip", |r| format!("{:.6}", r.errors.flip)),
    ("cambi", |r| format!("{:.6}", r.errors.cambi)),
    ("seam_ratio", |r| number(r.errors.seam, 4)),
    ("seam_over_one", |r| number(r.errors.seam_over_one, 4)),
    ("psnr_to_one", |r| format!("{:.4}", r.errors.psnr_one)),
    ("flip_to_one", |r| format!("{:.6}", r.errors.flip_one)),
    ("seam_rmse_to_one", |r| number(r.errors.seam_rmse_one, 9)),
    ("same_bytes", |r| r.same_bytes.to_string()),
    ("time_ms", |r| format!("{:.4}", r.time_ms[1])),
    ("time_ms_iqr", |r| format!("{:.4}", r.time_ms[2] - r.time_ms[0])),
];

/// Returns the rows as CSV, for programs.
pub fn seam_csv(rows: &[SeamRow]) -> Csv {
    Csv::new(SEAMS_CSV, rows)
}

/// The paper's name of a method, the corresponding policy here, and values for San Miguel, Sponza and Bistro Exterior.
type Cited = [(&'static str, &'static str, [f64; 3]); 3];
type Measure = fn(&SeamErrors) -> f64;

/// Leria, Mäkitalo & Jääskeläinen 2024, "Image quality related to seam artifacts": PSNR in dB and CAMBI.
const LERIA: [(&str, Measure, Cited); 2] = [
    (
        "psnr",
        |errors| errors.psnr,
        [
            ("no filter", "none", [20.30, 21.73, 20.89]),
            ("bilateral filter", "filter", [19.90, 21.71, 20.46]),
            ("no seam", "-", [20.83, 21.97, 21.09]),
        ],
    ),
    (
        "cambi",
        |errors| errors.cambi,
        [
            ("no filter", "none", [0.06, 0.05, 0.09]),
            ("bilateral filter", "filter", [0.06, 0.06, 0.09]),
            ("no seam", "-", [0.07, 0.06, 0.09]),
        ],
    ),
];

/// The caption of [`leria_table`].
pub const LERIA_NOTE: &str = "PSNR in dB and CAMBI; in brackets, the difference from the image without seams. This \
    shot: mean of both eyes at the largest device count; 'no seam' is one device. Cited: Leria, Mäkitalo & \
    Jääskeläinen 2024, Real-time Stereoscopic Image-parallel Path Tracing, 1280x720 per eye, 1 spp, 6 bounces, SVGF, \
    several GPUs. Scenes, references and denoiser differ, so compare only the differences within a column.";

/// Returns a table of our PSNR and CAMBI at the largest device count beside the paper's.
pub fn leria_table(rows: &[SeamRow]) -> Table {
    let most = rows.iter().map(|r| r.devices).max().unwrap_or(0);
    let against = |value: f64, unseamed: f64| format!("{value:.2} ({:+.2})", value - unseamed);
    let lines = LERIA.iter().flat_map(|(measure, of, cited)| {
        let own = |policy: &str| {
            let own = rows.iter().filter(|r| r.policy == policy && (policy == "-" || r.devices == most));
            let values: Vec<f64> = own.map(|r| of(&r.errors)).collect();
            (!values.is_empty()).then(|| mean(&values))
        };
        let ours = |policy: &str| own(policy).zip(own("-")).map_or("-".to_owned(), |(p, one)| against(p, one));
        let [.., (_, _, unseamed)] = cited;
        let line = |name: &str, policy, theirs: [String; 3]| {
            [(*measure).to_owned(), name.to_owned(), ours(policy)].into_iter().chain(theirs).collect()
        };
        let theirs = |values: &[f64; 3]| std::array::from_fn(|i| against(values[i], unseamed[i]));
        let cited = cited.iter().map(|(name, policy, values)| line(name, policy, theirs(values)));
        let halo = line("halo", "halo", ["-"; 3].map(str::to_owned));
        cited.chain([halo]).collect::<Vec<Vec<String>>>()
    });
    let headers =
        vec!["measure", "picture", "this shot", "San Miguel (cited)", "Sponza (cited)", "Bistro Ext. (cited)"];
    Table { headers, rows: lines.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(devices: usize, policy: &str, eye: Eye, psnr: f64) -> SeamRow {
        let errors = SeamErrors {
            psnr,
            flip: 0.1,
            cambi: 0.25,
            seam: None,
            seam_over_one: Some(1.0),
            psnr_one: f64::INFINITY,
            flip_one: 0.0,
            seam_rmse_one: Some(0.0),
        };
        let policy = policy.to_owned();
        SeamRow { devices, policy, eye, exposure_ev: 0.0, errors, same_bytes: true, time_ms: [1.0, 2.0, 4.0] }
    }

    #[test]
    fn leria_table_adds_the_published_numbers() {
        let rows = [
            row(1, "-", Eye::LEFT, 30.0),
            row(1, "-", Eye::RIGHT, 31.0),
            row(2, "none", Eye::LEFT, 10.0),
            row(4, "none", Eye::LEFT, 29.0),
            row(4, "none", Eye::RIGHT, 30.0),
        ];
        let found = leria_table(&rows).rows;
        assert_eq!(found[0], ["psnr", "no filter", "29.50 (-1.00)", "20.30 (-0.53)", "21.73 (-0.24)", "20.89 (-0.20)"]);
        assert_eq!(found[1][2..4], ["-", "19.90 (-0.93)"]);
        assert_eq!(found[2][2..4], ["30.50 (+0.00)", "20.83 (+0.00)"]);
        assert_eq!(found[3], ["psnr", "halo", "-", "-", "-", "-"]);
        assert_eq!(found[4][..4], ["cambi", "no filter", "0.25 (+0.00)", "0.06 (-0.01)"]);
    }

    #[test]
    fn equal_pictures_are_infinitely_near() {
        let rows = [row(2, "halo", Eye::LEFT, 30.0), row(1, "-", Eye::LEFT, 30.0)];
        let table = seam_csv(&rows);
        let found = ["psnr_to_one", "same_bytes", "seam_ratio", "time_ms_iqr"].map(|name| table.value(0, name));
        assert_eq!(found, ["inf", "true", "", "3.0000"]);
        assert_eq!((table.value(0, "seam_policy"), table.value(1, "seam_policy")), ("halo", "one_device"));
        let shown = seam_table(&rows).rows;
        assert_eq!((shown[0][9].as_str(), shown[0][12].as_str(), shown[1][1].as_str()), ("inf", "yes", "-"));
    }
}
