//! Writes `frames.csv`, with a line per frame and the same columns for every command. Frames of a control loop have
//! further columns.

use serde::{Deserialize, Serialize};

use super::csv::{self, Column, Csv, number, optional};
use super::frame_row::{ControlRow, DeadlineRow, FrameRow};
use diptych::exec::RightEye;
use diptych::quality::FrameQuality;

/// Line of a frame in `frames.csv`. The times of each stage are only in `run.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameLine {
    pub index: u32,
    /// Scene time of the frame.
    pub time_s: f64,
    /// Number of devices that rendered the frame.
    pub devices: usize,
    pub makespan_ms: f64,
    pub interval_ms: Option<f64>,
    pub predicted_ms: Option<f64>,
    pub plan_ms: f64,
    pub aov_ms: f64,
    /// Time in stages, without transfers, summed over all devices.
    pub busy_ms: f64,
    #[serde(flatten)]
    pub quality: FrameQuality,
    pub rays: u64,
    /// Fractions of the right eye's pixels by origin, if that eye is reprojected.
    pub right_eye: Option<RightEye>,
    pub nonfinite_samples: u64,
    pub transferred_bytes: u64,
    /// Decision of the control loop, for frames with a time budget.
    pub control: Option<ControlRow>,
    /// Number of rows of the left eye that each device path traced.
    #[serde(default)]
    pub stripes: Vec<u32>,
    #[serde(default)]
    pub deadline: Option<DeadlineRow>,
}

impl From<&FrameRow> for FrameLine {
    fn from(row: &FrameRow) -> Self {
        Self {
            index: row.index,
            time_s: row.time_s,
            devices: row.devices,
            makespan_ms: row.makespan_ms,
            interval_ms: row.interval_ms,
            predicted_ms: row.predicted_ms,
            plan_ms: row.plan_ms,
            aov_ms: row.aov_ms,
            busy_ms: row.stages.iter().filter(|sum| sum.bytes.is_none()).map(|sum| sum.busy_ms).sum(),
            quality: row.quality,
            rays: row.rays,
            right_eye: row.right_eye.clone(),
            nonfinite_samples: row.nonfinite_samples,
            transferred_bytes: row.transferred_bytes,
            control: row.control,
            stripes: row.stripes.clone(),
            deadline: row.deadline.clone(),
        }
    }
}

const COLUMNS: [Column<FrameLine>; 21] = [
    ("frame", |l| l.index.to_string()),
    ("time_s", |l| l.time_s.to_string()),
    ("devices", |l| l.devices.to_string()),
    ("makespan_ms", |l| format!("{:.4}", l.makespan_ms)),
    ("interval_ms", |l| number(l.interval_ms, 4)),
    ("predicted_ms", |l| number(l.predicted_ms, 4)),
    ("plan_ms", |l| format!("{:.4}", l.plan_ms)),
    ("aov_ms", |l| format!("{:.4}", l.aov_ms)),
    ("busy_ms", |l| format!("{:.4}", l.busy_ms)),
    ("spp", |l| l.quality.spp.to_string()),
    ("bounces", |l| l.quality.bounces.to_string()),
    ("iterations", |l| l.quality.iterations.to_string()),
    ("scale", |l| l.quality.scale.to_string()),
    ("fovea_inner", |l| optional(l.quality.fovea.map(|[inner, _]| inner))),
    ("fovea_outer", |l| optional(l.quality.fovea.map(|[_, outer]| outer))),
    ("rays", |l| l.rays.to_string()),
    ("reprojected_fraction", |l| number(l.right_eye.as_ref().map(|r| r.reprojected_fraction), 6)),
    ("antialiasing_fraction", |l| number(l.right_eye.as_ref().map(|r| r.antialiasing_fraction), 6)),
    ("hole_fraction", |l| number(l.right_eye.as_ref().map(|r| r.hole_fraction), 6)),
    ("nonfinite_samples", |l| l.nonfinite_samples.to_string()),
    ("transferred_bytes", |l| l.transferred_bytes.to_string()),
];

const CONTROL: [Column<FrameLine>; 7] = [
    ("rung", |l| optional(l.control.as_ref().map(|c| c.rung))),
    ("expected_ms", |l| number(l.control.as_ref().map(|c| c.expected_ms), 4)),
    ("fits", |l| optional(l.control.as_ref().map(|c| c.fits))),
    ("in_band", |l| optional(l.control.as_ref().map(|c| c.in_band))),
    ("late_ms", |l| number(l.control.as_ref().map(|c| c.late_ms), 4)),
    ("decide_ms", |l| number(l.control.as_ref().map(|c| c.decide_ms), 4)),
    ("missed_periods", |l| optional(l.control.as_ref().map(|c| c.missed_periods))),
];

const DEADLINE: [Column<FrameLine>; 6] = [
    ("whole_ms", |l| number(l.deadline.as_ref().map(|d| d.whole_ms), 4)),
    ("host_before_ms", |l| number(l.deadline.as_ref().map(|d| d.host_before_ms), 4)),
    ("host_after_ms", |l| number(l.deadline.as_ref().map(|d| d.host_after_ms), 4)),
    ("over_deadline_ms", |l| number(l.deadline.as_ref().map(|d| d.over_deadline_ms), 4)),
    ("cause", |l| optional(l.deadline.as_ref().and_then(|d| d.cause.as_ref()))),
    ("others_share", |l| number(l.deadline.as_ref().and_then(|d| d.others_share), 4)),
];

impl FrameLine {
    /// Returns the contents of `frames.csv`. The control loop's columns, with the rows of each device, are left out if
    /// no line has a decision.
    pub fn csv(lines: &[Self]) -> Csv {
        if lines.iter().all(|l| l.control.is_none()) {
            return Csv::new(&COLUMNS, lines);
        }
        let devices = lines.iter().map(|l| l.stripes.len()).max().unwrap_or(0);
        Csv { columns: names(devices).collect(), lines: lines.iter().map(|l| l.cells(devices).collect()).collect() }
    }

    /// Returns the header line, with the control loop's columns, for a file that is written line by line. `devices` is
    /// the number of devices at the start of the run.
    pub fn header(devices: usize) -> Vec<u8> {
        csv::line(names(devices))
    }

    /// Returns the frame's line in a file that begins with [`Self::header`] of as many devices.
    pub fn text(&self, devices: usize) -> Vec<u8> {
        csv::line(self.cells(devices))
    }

    fn cells(&self, devices: usize) -> impl Iterator<Item = String> {
        let rows = (0..devices).map(|device| optional(self.stripes.get(device)));
        let [all, control, deadline] =
            [&COLUMNS[..], &CONTROL, &DEADLINE].map(move |columns| columns.iter().map(move |(_, cell)| cell(self)));
        all.chain(control).chain(rows).chain(deadline)
    }

    /// Returns the contents of `frames.csv` for the rows of `run.json`.
    pub fn csv_of(rows: &[FrameRow]) -> Csv {
        Self::csv(&rows.iter().map(Self::from).collect::<Vec<_>>())
    }
}

/// Returns the names of all columns, with one for the rows of each device.
fn names(devices: usize) -> impl Iterator<Item = String> {
    let rows = (0..devices).map(|device| format!("rows_dev{device}"));
    let [all, control, deadline] =
        [&COLUMNS[..], &CONTROL, &DEADLINE].map(|columns| columns.iter().map(|(name, _)| (*name).to_owned()));
    all.chain(control).chain(rows).chain(deadline)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::samples::Samples;

    /// Programs also read columns by position, so the order stays and new columns come last.
    #[test]
    fn every_column_has_its_own_number_at_its_own_place() {
        let line = FrameLine {
            index: 1,
            time_s: 0.25,
            devices: 2,
            makespan_ms: 3.0,
            interval_ms: Some(4.0),
            predicted_ms: Some(5.0),
            plan_ms: 6.0,
            aov_ms: 7.0,
            busy_ms: 8.0,
            quality: FrameQuality {
                spp: Samples::of_mean(9.25),
                bounces: 10,
                iterations: 11,
                scale: 0.5,
                fovea: Some([0.12, 0.13]),
            },
            rays: 14,
            right_eye: Some(RightEye {
                reprojected_fraction: 0.15,
                antialiasing_fraction: 0.16,
                hole_fraction: 0.17,
                hole_fractions: Default::default(),
                unsampled_fraction: 0.52,
            }),
            nonfinite_samples: 18,
            transferred_bytes: 19,
            control: Some(ControlRow {
                rung: 20,
                expected_ms: 21.0,
                fits: true,
                in_band: false,
                late_ms: 22.0,
                decide_ms: 23.0,
                missed_periods: 24,
            }),
            stripes: vec![25, 0, 27],
            deadline: Some(DeadlineRow {
                whole_ms: 28.0,
                host_before_ms: 29.0,
                host_after_ms: 30.0,
                over_deadline_ms: -31.0,
                cause: Some("late start".into()),
                others_share: Some(0.25),
            }),
        };
        let header = "frame,time_s,devices,makespan_ms,interval_ms,predicted_ms,plan_ms,aov_ms,busy_ms,spp,bounces,\
            iterations,scale,fovea_inner,fovea_outer,rays,reprojected_fraction,antialiasing_fraction,hole_fraction,\
            nonfinite_samples,transferred_bytes,rung,expected_ms,fits,in_band,late_ms,decide_ms,missed_periods,rows_dev0,rows_dev1,rows_dev2,\
            whole_ms,host_before_ms,host_after_ms,over_deadline_ms,cause,others_share\n";
        let numbers = "1,0.25,2,3.0000,4.0000,5.0000,6.0000,7.0000,8.0000,9.25,10,11,0.5,0.12,0.13,14,0.150000,0.160000,\
            0.170000,18,19,20,21.0000,true,false,22.0000,23.0000,24,25,0,27,28.0000,29.0000,30.0000,-31.0000,late start,0.2500\n";
        assert_eq!(String::from_utf8(FrameLine::header(3)).unwrap(), header);
        assert_eq!(String::from_utf8(line.text(3)).unwrap(), numbers);
    }

    #[test]
    fn control_columns_have_values_only_with_a_controller() {
        let (expected_ms, late_ms, decide_ms) = (12.0, 0.5, 0.1);
        let control =
            ControlRow { rung: 3, expected_ms, fits: true, in_band: false, late_ms, decide_ms, missed_periods: 0 };
        let quality = FrameQuality { fovea: Some([0.15, 0.3]), ..FrameQuality::default() };
        let free = FrameLine { index: 7, makespan_ms: 20.5, quality, ..FrameLine::default() };
        let table = FrameLine::csv(std::slice::from_ref(&free));
        assert_eq!((table.columns.len(), table.lines[0].len()), (21, 21));
        let found = ["frame", "makespan_ms", "interval_ms", "fovea_inner", "fovea_outer"];
        assert_eq!(found.map(|name| table.value(0, name)), ["7", "20.5000", "", "0.15", "0.3"]);
        let line = FrameLine { control: Some(control), stripes: vec![9, 7], ..free };
        let table = FrameLine::csv(std::slice::from_ref(&line));
        let found = ["rung", "expected_ms", "fits", "in_band", "late_ms"];
        assert_eq!(found.map(|name| table.value(0, name)), ["3", "12.0000", "true", "false", "0.5000"]);
        assert_eq!(["rows_dev0", "rows_dev1"].map(|name| table.value(0, name)), ["9", "7"]);
        // A file that is written line by line has the same contents.
        let folder = tempfile::tempdir().unwrap();
        table.write(&folder.path().join("frames.csv")).unwrap();
        let grown = [FrameLine::header(2), line.text(2)].concat();
        assert_eq!(std::fs::read(folder.path().join("frames.csv")).unwrap(), grown);
    }
}
