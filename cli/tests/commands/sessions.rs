//! The record of an hour-long session: memory does not grow with the number of frames, and sums cover all frames.

use std::collections::BTreeMap;

use diptych::control::Measure;
use diptych::exec::{PerView, TaskTiming, TimedTask};
use diptych::quality::FrameQuality;
use diptych::scene::projection::Matrices;
use diptych::scene::rig::{Eye, Rig};
use diptych_cli::report::headset::HeadsetRow;
use diptych_cli::report::play::{ControlRow, Excursion, Play, PlayTally, SETTLING_FRAMES};
use diptych_cli::report::record::{FrameRecord, Unfinished};
use diptych_cli::report::run::{FrameRow, FrameRows, StageSum};
use diptych_cli::report::samples::FrameSamples;

use crate::memory;

const BUDGET_MS: [f64; 2] = [11.0, 20.0];
/// Number of frames in an hour at 50 Hz.
const HOUR: u32 = 180_000;

/// Returns makespans scattered around 15 ms, with each 64th frame far above the budget and each 77th below.
fn makespan_ms(index: u32) -> f64 {
    let scatter = f64::from(index.wrapping_mul(2_654_435_761) >> 16) / 65_536.0;
    match index {
        _ if index % 64 == 63 => 30.0 + 300.0 * scatter,
        _ if index % 77 == 76 => 10.0 * scatter + 0.5,
        _ => 12.0 + 6.0 * scatter,
    }
}

/// Returns a frame of two devices in a headset.
fn row(index: u32) -> FrameRow {
    let matrices = Matrices { world_to_camera: [[0.25; 4]; 4], world_to_ndc: [[-0.75; 4]; 4] };
    let makespan_ms = makespan_ms(index);
    let in_band = (BUDGET_MS[0]..=BUDGET_MS[1]).contains(&makespan_ms);
    let rung = (index / 50 % 3) as usize;
    let stage = |device| StageSum { stage: "path_trace", view: Eye::LEFT, device, busy_ms: 7.25, bytes: None };
    FrameRow {
        index,
        time_s: f64::from(index) / 50.0,
        cameras: PerView::both(matrices, matrices),
        devices: 2,
        makespan_ms,
        interval_ms: (index > 0).then_some(20.0),
        predicted_ms: Some(15.0),
        aov_ms: 0.0,
        plan_ms: 0.125,
        quality: FrameQuality { spp: (1 + rung as u32).into(), scale: 1.0, ..FrameQuality::default() },
        rays: 1_000_000,
        right_eye: None,
        nonfinite_samples: 0,
        clipped_pixels: 0,
        bodies_left_out: 0,
        spp_done: None,
        stripes: vec![180, 180],
        stage_stripes: BTreeMap::from([("path_trace.left".to_owned(), vec![180, 180])]),
        transferred_bytes: 4096,
        bytes_between_ranks: None,
        history_rows: Some(3),
        halo_exchanges: Vec::new(),
        stages: vec![stage(0), stage(1)],
        tasks: Vec::new(),
        control: Some(ControlRow {
            rung,
            expected_ms: 14.0 + rung as f64,
            fits: true,
            in_band,
            late_ms: if index.is_multiple_of(10) { 2.0 } else { 0.0 },
            decide_ms: 0.01,
            missed_periods: index % 7 / 5,
        }),
        deadline: None,
        headset: Some(HeadsetRow {
            display_s: f64::from(index) / 50.0,
            period_ms: 20.0,
            motion_to_photon_ms: Some(makespan_ms + 5.0),
            corrected_ms: None,
            ahead_ms: Some(10.0 - makespan_ms),
            missed: 0,
        }),
    }
}

fn task(device: usize) -> TaskTiming {
    TaskTiming {
        stage: "path_trace".into(),
        kind: TimedTask::Upload,
        view: Eye::LEFT,
        device,
        rows: 0..180,
        begin_ms: 0.0,
        end_ms: 7.25,
        bytes: Some(1),
        predicted_ms: None,
        submissions: 1,
        transfer: None,
        number: 0,
        after: Vec::new(),
    }
}

fn play() -> Play {
    let (ladder, measure) = ("built in".to_owned(), Measure::Estimate);
    Play { denoiser: "svgf", ladder, measure, rungs: Vec::new(), fps: 50.0, fit: None }
}

/// Neither the record nor the page's samples grow, and rows are written to `run.json` without holding all of them.
#[test]
fn sessions_hold_constant_memory_for_an_hour() {
    let folder = crate::common::Folder::new();
    let mut record = FrameRecord::create(&folder.path(""), 2, BUDGET_MS).unwrap();
    let mut samples = FrameSamples::default();
    let (mut early, mut most) = (0, 0);
    for index in 0..HOUR {
        let row = row(index);
        record.add(&row).unwrap();
        samples.add(&row, vec![task(0), task(1)]);
        drop(row);
        if index == 20_000 {
            let writer = Probe(memory::held() + 65_536);
            record.rows().serialize(&mut serde_json::Serializer::new(writer)).unwrap();
        }
        match index {
            // The page's samples are halved whenever there are 4096, so each cycle has the same maximum.
            0..20_000 => early = early.max(memory::held()),
            _ => most = most.max(memory::held()),
        }
    }
    assert!(early > 100_000, "nothing was counted: {early} bytes");
    assert!(most < early + 16_384, "{most} bytes after {early}");
    assert_eq!(folder.text("frames.csv").lines().count(), 1 + HOUR as usize);
    let summary = record.play.summary(&play()).unwrap();
    assert_eq!(summary.judged_frames, HOUR as usize - SETTLING_FRAMES);
    let mut judged: Vec<f64> = (SETTLING_FRAMES as u32..HOUR).map(makespan_ms).collect();
    judged.sort_by(f64::total_cmp);
    let found = [summary.makespan_ms_p50, summary.makespan_ms_p95, summary.makespan_ms_p99];
    for (fraction, found) in [0.5, 0.95, 0.99].into_iter().zip(found) {
        let exact = judged[(fraction * (judged.len() - 1) as f64).round() as usize];
        assert!((found / exact - 1.0).abs() <= 0.0025, "{fraction}: {found} instead of {exact}");
    }
    let above = judged.iter().filter(|ms| **ms > BUDGET_MS[1]).count() as f64 / judged.len() as f64;
    assert_eq!(summary.above_share, above);
}

/// A sink that fails once the thread holds more bytes than this.
struct Probe(isize);

impl std::io::Write for Probe {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        assert!(memory::held() < self.0, "{} bytes of {}", memory::held(), self.0);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn sums_are_those_of_all_frames_but_the_first() {
    for count in [1, 29, 30, 31, 95, 700, 5000] {
        let rows: Vec<FrameRow> = (0..count).map(row).collect();
        let mut tally = PlayTally::new(BUDGET_MS);
        rows.iter().for_each(|row| tally.add(row));
        let found = tally.summary(&play()).unwrap();
        let skipped = if rows.len() > SETTLING_FRAMES { SETTLING_FRAMES } else { 0 };
        let judged: Vec<(&FrameRow, ControlRow)> =
            rows[skipped..].iter().map(|row| (row, row.control.unwrap())).collect();
        let share = |is: &dyn Fn(&FrameRow, &ControlRow) -> bool| {
            judged.iter().filter(|(row, control)| is(row, control)).count() as f64 / judged.len() as f64
        };
        assert_eq!(found.judged_frames, judged.len());
        assert_eq!(found.in_band_share, share(&|_, c| c.in_band));
        assert_eq!(found.above_share, share(&|r, _| r.makespan_ms > BUDGET_MS[1]));
        assert_eq!(found.below_share, share(&|r, _| r.makespan_ms < BUDGET_MS[0]));
        assert_eq!(found.late_share, share(&|_, c| c.late_ms > 1.0));
        let missed: u32 = judged.iter().map(|(_, c)| c.missed_periods).sum();
        assert_eq!(found.missed_fraction, f64::from(missed) / (f64::from(missed) + judged.len() as f64));
        let changes = judged.windows(2).filter(|pair| pair[0].1.rung != pair[1].1.rung).count();
        assert_eq!(found.rung_changes, changes);
        let rungs: Vec<(usize, f64, f64)> = found.rung_uses.iter().map(|u| (u.rung, u.expected_ms, u.share)).collect();
        let used = (0..3).map(|rung| (rung, 14.0 + rung as f64, share(&|_, c| c.rung == rung)));
        assert_eq!(rungs, used.filter(|(_, _, share)| *share > 0.0).collect::<Vec<_>>());
        let mut times_ms: Vec<f64> = judged.iter().map(|(row, _)| row.makespan_ms).collect();
        times_ms.sort_by(f64::total_cmp);
        let exact = [0.5, 0.95, 0.99].map(|q| times_ms[(q * (times_ms.len() - 1) as f64).round() as usize]);
        let found = [found.makespan_ms_p50, found.makespan_ms_p95, found.makespan_ms_p99];
        assert!(found.iter().zip(exact).all(|(found, exact)| (found / exact - 1.0).abs() <= 0.0025), "{count}");
        assert!(count >= 4096 || found == exact, "{count}: {found:?} instead of {exact:?}");
    }
    assert!(PlayTally::new(BUDGET_MS).summary(&play()).is_none());
}

#[test]
fn longest_excursion_is_the_first_of_its_length() {
    let mut tally = PlayTally::new(BUDGET_MS);
    for index in 0..100 {
        // Short frames are no excursions.
        let makespan_ms = match index {
            40..43 | 50..55 | 60..65 | 98.. => BUDGET_MS[1] + 1.0,
            70..90 => 0.5 * BUDGET_MS[0],
            _ => BUDGET_MS[1],
        };
        tally.add(&FrameRow { makespan_ms, ..row(index) });
    }
    let found = tally.summary(&play()).unwrap().longest_excursion;
    assert!(matches!(found, Some(Excursion { first_frame: 50, frames: 5 })), "{found:?}");
}

#[test]
fn page_shows_the_slowest_frames_of_a_long_run() {
    let mut samples = FrameSamples::default();
    let normal = |index| FrameRow { makespan_ms: 15.0, ..row(index) };
    (0..4096).for_each(|index| samples.add(&normal(index), Vec::new()));
    assert_eq!((samples.frames().len(), samples.stride()), (4096, 1));
    let peaks = [4097, 9_999, 123_456, 149_999];
    for index in 4096..150_000 {
        let makespan_ms = if peaks.contains(&index) { 500.0 } else { 15.0 };
        samples.add(&FrameRow { makespan_ms, ..normal(index) }, Vec::new());
    }
    let frames = samples.frames();
    assert_eq!(samples.stride(), 64);
    let slow: Vec<u32> = frames.iter().filter(|f| f.makespan_ms == 500.0).map(|f| f.index).collect();
    assert_eq!(slow, peaks);
    let buckets = frames.iter().map(|f| f.index as usize / samples.stride());
    assert!(buckets.eq(0..frames.len()), "each stands for frames of its own");
}

#[test]
fn rows_in_a_file_are_the_rows() {
    let folder = crate::common::Folder::new();
    let mut record = FrameRecord::create(&folder.path(""), 2, BUDGET_MS).unwrap();
    let rig = Rig::of_keys(vec![diptych::scene::rig::RigKey {
        time_s: 0.0,
        position: glam::DVec3::new(0.1, 1e-9, 12_345.678),
        target: glam::DVec3::new(3.0, 2.0, 1.0),
        up: glam::DVec3::Y,
    }]);
    let matrices = rig.matrices(0.0, Eye::LEFT, diptych::image::Extent::new(640, 360));
    let rows: Vec<FrameRow> = (0..5)
        .map(|index| FrameRow { cameras: PerView::both(matrices, matrices), ..row(index) })
        .map(|row| FrameRow { predicted_ms: None, makespan_ms: 1.0 / 3.0, rays: u64::MAX, ..row })
        .collect();
    rows.iter().for_each(|row| record.add(row).unwrap());
    let mut text = Vec::new();
    record.rows().serialize(&mut serde_json::Serializer::new(&mut text)).unwrap();
    assert_eq!(text, serde_json::to_vec(&rows).unwrap());
    // A run that is killed here leaves the files; the next run keeps them.
    drop(record);
    let Unfinished { frames, kept } = Unfinished::keep(&folder.path("")).unwrap().unwrap();
    assert_eq!((frames, kept.len()), (5, 2));
    assert!(Unfinished::keep(&folder.path("")).unwrap().is_none());
    // A run that finishes leaves only its frames.csv.
    let record = FrameRecord::create(&folder.path(""), 2, BUDGET_MS).unwrap();
    record.finish().unwrap();
    assert!(Unfinished::keep(&folder.path("")).unwrap().is_none());
    assert_eq!(folder.names(""), ["frames.csv", "frames.unfinished.csv", "run.unfinished.jsonl"]);
}
