//! Splitting work into several submissions gives the bytes of whole frames.

use crate::common::{Frame, Stage, Subject, foveate, is_thorough, with};
use crate::same_bytes::{Rows, Run, assert_same_frames, run};
use diptych::RunConfig;
use diptych::exec::TimedTask;
use diptych::frame::Foveation;
use diptych::quality::{Denoiser, Filter};
use diptych::scene::shot::Gaze;

const WIDTH: u32 = 40;
const HEIGHT: u32 = 60;

/// Times along the camera's path. Later frames are split according to the learned costs.
const TIMES_S: [f64; 3] = [0.0, 0.05, 0.1];

fn frames(subject: &Subject, settings: &RunConfig, devices: usize) -> Vec<Frame> {
    let in_flight = settings.execution.frames_in_flight;
    Run { in_flight, ..run(devices, Rows::Measured) }.frames(subject, settings, &TIMES_S)
}

/// Returns the largest number of submissions of any task in the frame.
fn most_submissions(frame: &Frame) -> u32 {
    frame.report.tasks.iter().map(|t| t.submissions).max().unwrap()
}

fn hold_split_frames_against_whole_ones(what: &str, subject: &Subject, settings: &RunConfig) {
    let whole = frames(subject, settings, 1);
    assert!(whole.iter().all(|f| most_submissions(f) == 1), "{what}: software devices need no bound");
    // The bounds mean the smallest possible portions, parts of a frame, and all of it.
    for (bound_ms, devices) in [(1e-6, 1), (2.0, 2), (1e9, 1)] {
        let settings = with(settings.clone(), |config| config.execution.max_dispatch_ms = Some(bound_ms));
        let found = frames(subject, &settings, devices);
        assert_same_frames(&format!("{what}, {bound_ms} ms"), &whole, &found);
        for (frame, split) in found.iter().enumerate() {
            match bound_ms {
                1e-6 => assert!(most_submissions(split) >= HEIGHT / 8, "{what}, frame {frame}"),
                1e9 => assert_eq!(most_submissions(split), 1, "{what}, frame {frame}"),
                _ => {}
            }
            let is_timed = |t: &diptych::exec::TaskTiming| t.begin_ms < t.end_ms || t.kind == TimedTask::Upload;
            assert!(split.report.tasks.iter().all(is_timed), "{what}, {bound_ms} ms, frame {frame}");
        }
    }
}

#[test]
fn same_bytes_with_split_submissions() {
    let subject = Subject::load("builtin:atrium");
    let mut settings = subject.accumulated(WIDTH, HEIGHT);
    hold_split_frames_against_whole_ones("over frames", &subject, &settings);
    settings.execution.frames_in_flight = 2;
    if is_thorough() {
        hold_split_frames_against_whole_ones("in flight", &subject, &settings);
    }
    settings.envelope.most.filter = Some(Filter::new(Denoiser::BMFR, 1));
    hold_split_frames_against_whole_ones("fitted in flight", &subject, &settings);
}

/// Path tracing takes three dispatches over lists of pixels.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_with_split_pixel_lists() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    settings.envelope.most.spp = 9.into();
    foveate(&mut settings, [0, 1].map(|_| Gaze { path: vec![[0.0, 0.4, 0.5]] }), Foveation::default(), [2, 3, 5]);
    hold_split_frames_against_whole_ones("layers", &subject, &settings);
    settings.buffers.reproject = false;
    settings.envelope.most.fovea = None;
    hold_split_frames_against_whole_ones("traced", &subject, &settings);
}

#[test]
fn same_bytes_with_split_work_on_slow_devices() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    settings.envelope.most.spp = 5.into();
    let whole = Stage::alone(&subject, &settings).frame(0);
    settings.execution.max_dispatch_ms = Some(1e-6);
    let mut two = Stage::even(&subject, &settings, 2);
    two.inject(&[], &[2, 1]);
    assert_same_frames("slow", &[whole], &[two.frame(0)]);
}
