//! Devices that fail, hang or lag change no byte while one device is left. The command reports it and writes all its
//! files.

use std::time::{Duration, Instant};

use crate::common::{self, Stage, Subject, devices_to_lose};
use crate::moving;
use crate::reference::scenes::moving::everything;
use crate::same_bytes::{Rows, assert_same, assert_same_frames, even, every, hold};
use diptych::RunConfig;
use diptych::device::{DevicePool, FailureKind, GpuDevice, Selection};
use diptych::exec::ranks::Devices;
use diptych::exec::{ExecError, PerView};
use diptych::image::RgbImage;
use diptych::passes::path_trace::PARTITION;
use diptych::scene::rig::Eye;
use diptych::schedule::Even;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 54;

/// Returns a stage on devices that fail as `injections` say.
fn failing<'a>(
    subject: &'a Subject,
    settings: &RunConfig,
    devices: usize,
    rows: Rows,
    injections: &[&str],
) -> Stage<'a> {
    let policy = rows.policy(settings.grid().height, devices);
    let mut stage = Stage::on(devices_to_lose(devices), subject, settings, policy);
    stage.inject(injections, &[]);
    stage
}

/// Returns the devices that failed, in order.
fn failed(stage: &mut Stage) -> Vec<usize> {
    let mut failed: Vec<_> = stage.renderer().faults().iter().map(|f| f.device).collect();
    failed.sort_unstable();
    failed
}

/// Devices fail one after another in different ways while stripes move, each time in the next frame.
#[test]
fn same_bytes_until_no_device_is_left() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let times_s = every(0.3, 5);
    let one = even(1).frames(&subject, &settings, &times_s);
    let fates = ["loss:dev0@frame1", "oom:dev2@frame2", "hang:dev1@frame3", "loss:dev3@frame5"];
    let mut four = failing(&subject, &settings, 4, Rows::Measured, &fates);
    four.renderer().set_watchdog(Duration::from_secs(3));
    let found = four.frames_in_flight(&times_s);
    assert_same_frames("four devices", &one, &found);
    let makespans_ms: Vec<_> = found.iter().map(|frame| frame.report.makespan_ms).collect();
    let stripes = found.iter().map(|frame| frame.report.assignment.stripes(PARTITION, Eye::LEFT));
    let rows: Vec<_> = stripes.map(|stripes| [0, 1, 2, 3].map(|d| stripes.rows(d).len())).collect();
    let working = |frame: usize| rows[frame].map(|r| r > 0);
    assert_eq!(working(0), [true, true, true, true]);
    assert_eq!(working(1), [false, true, true, true]);
    assert_eq!(working(2), [false, true, false, true]);
    assert_eq!(rows[3], [0, 0, 0, HEIGHT as usize]);
    assert_eq!(rows[4], rows[3]);
    let faults = four.renderer().faults();
    let seen: Vec<_> = faults.iter().map(|f| (f.frame, f.device, f.kind, f.attempts)).collect();
    let expected = [(1, 0, FailureKind::Loss, 2), (2, 2, FailureKind::Oom, 2), (3, 1, FailureKind::Hang, 2)];
    assert_eq!(seen, expected, "{faults:?}");
    // A viewer waits for a frame until it is complete, however late the fault was noticed.
    assert!(faults.iter().all(|f| f.recovery_ms == makespans_ms[f.frame as usize]), "{makespans_ms:?}: {faults:?}");
    let hang_ms = faults[2].recovery_ms;
    assert!(hang_ms > 1000.0, "the watchdog waits for seconds, but {hang_ms} ms are reported");
    let params = four.params(0.0, 5);
    match four.renderer().render(&params) {
        Err(ExecError::NoneLeft { device: 3, what }) => assert!(what.contains("lost"), "{what}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn surviving_devices_return_with_their_pipelines() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.settings(32, 18);
    let policy = || Box::new(Even::new(18, 2));
    let mut stage = failing(&subject, &settings, 2, Rows::Even, &[]);
    stage.frame(0);
    let gpus = stage.into_devices();
    let compiled = |gpus: &[GpuDevice]| gpus.iter().map(|gpu| gpu.pipelines.len()).collect::<Vec<_>>();
    let before = compiled(&gpus);
    assert!(before.len() == 2 && before.iter().all(|n| *n > 0), "{before:?}");

    let mut again = Stage::on(gpus, &subject, &settings, policy());
    again.frame(0);
    let gpus = again.into_devices();
    assert_eq!(compiled(&gpus), before);

    let mut failing = Stage::on(gpus, &subject, &settings, policy());
    failing.inject(&["loss:dev1@frame0"], &[]);
    failing.frame(0);
    let left = failing.into_devices();
    assert_eq!(left.iter().map(|gpu| gpu.info.index).collect::<Vec<_>>(), [0]);
}

/// Two renderers take turns on shared devices. The second one compiles nothing.
#[test]
fn renderers_in_turns_share_devices_and_pipelines() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(32, 18);
    let own = devices_to_lose(2);
    // The last device belongs to both renderers.
    let pipelines = own[1].pipelines.clone();
    let own = Devices::from(own);
    let shared = |count: usize| {
        let gpus = own.shared(|device| device >= 2 - count).unwrap();
        let indices: Vec<usize> = gpus.infos().iter().map(|info| info.index).collect();
        assert_eq!(indices, (0..count).collect::<Vec<_>>());
        Stage::on(gpus, &subject, &settings, Box::new(Even::new(18, count)))
    };
    let mut two = shared(2);
    let compiled = pipelines.len();
    let mut one = shared(1);
    for index in 0..3 {
        assert_same("turns", &one.frame(index).linear, &two.frame(index).linear);
    }
    // Other tests must not take the same device twice.
    drop([one, two].map(Stage::into_devices));
    assert!(compiled > 0 && pipelines.len() == compiled, "{compiled}, then {}", pipelines.len());
}

#[test]
fn pool_keeps_devices_that_have_not_failed() {
    let selection = Selection { pool: Some(DevicePool::default()), ..Selection::default() };
    let open = || common::open(&selection).remove(0);
    let subject = Subject::load("builtin:checker");
    let mut stage = Stage::on(vec![open()], &subject, &subject.settings(32, 18), Box::new(Even::new(18, 1)));
    stage.frame(0);
    let compiled = stage.into_devices()[0].pipelines.len();
    let again = open();
    assert!(compiled > 0 && again.pipelines.len() == compiled);
    again.report_out_of_memory();
    drop(again);
    assert_eq!(open().pipelines.len(), 0);
}

/// Frames in flight behind a failed frame restart as well.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_in_flight_when_devices_fail() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    let times_s = every(0.3, 8);
    let one = even(1).frames(&subject, &settings, &times_s);
    settings.execution.frames_in_flight = 3;
    let fates = ["loss:dev0@frame1", "hang:dev2@frame4", "oom:dev1@frame5"];
    let mut four = failing(&subject, &settings, 4, Rows::Measured, &fates);
    four.renderer().set_watchdog(Duration::from_secs(3));
    assert_same_frames("four devices", &one, &four.frames_in_flight(&times_s));
    assert_eq!(failed(&mut four), [0, 1, 2]);
    let faults = four.renderer().faults();
    assert!(faults.iter().all(|f| f.recovery_ms > 0.0 && f.attempts > 1), "{faults:?}");
}

/// The scene has the frame's time, however often the frame restarts.
#[test]
fn same_bytes_of_moving_scenes_after_device_loss() {
    let subject = moving::watched(everything());
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    let times_s = moving::times_s();
    let one = even(1).frames(&subject, &settings, &times_s);
    for in_flight in [1, 3] {
        settings.execution.frames_in_flight = in_flight;
        let mut three = failing(&subject, &settings, 3, Rows::Measured, &["loss:dev1@frame3"]);
        assert_same_frames(&format!("{in_flight} in flight"), &one, &three.frames_in_flight(&times_s));
        assert_eq!(failed(&mut three), [1]);
    }
}

/// With frames in flight, those behind the failed frame may have overwritten history. All rows restart without history,
/// like a run that begins there.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn history_restarts_when_a_device_fails_in_flight() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.accumulated(WIDTH, HEIGHT);
    let times_s = every(0.02, 6);
    let before = even(1).frames(&subject, &settings, &times_s[..3]);
    let after: Vec<_> = {
        let mut alone = Stage::alone(&subject, &settings);
        (3..6).map(|i| alone.frame_at(times_s[i as usize], i)).collect()
    };
    settings.execution.frames_in_flight = 2;
    let mut three = failing(&subject, &settings, 3, Rows::Measured, &["loss:dev1@frame3"]);
    let frames = three.frames_in_flight(&times_s);
    assert_same_frames("before", &before, &frames[..3]);
    assert_same_frames("after", &after, &frames[3..]);
    assert_eq!(frames[3].report.spec.history_rows, None);
    assert!(frames[4].report.spec.history_rows.is_some());
}

/// Only the rows of the failed device lose their history, whichever device it was. Other rows are unaffected, and a run
/// with the same fault has the same bytes.
#[test]
fn history_of_other_devices_survives_a_fault() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.accumulated(WIDTH, HEIGHT);
    let render = |faults: &[&str]| {
        let mut three = failing(&subject, &settings, 3, Rows::Even, faults);
        (0..5).map(|i| three.frame_at(f64::from(i) * 0.02, i).linear).collect::<Vec<_>>()
    };
    let whole = render(&[]);
    let is_as_before = |frames: &[PerView<RgbImage>], frame: usize, row: u32| {
        let row = |image: &RgbImage| image.pixels[(row * WIDTH) as usize..][..WIDTH as usize].to_vec();
        row(frames[frame].left()) == row(whole[frame].left()) && row(frames[frame].right()) == row(whole[frame].right())
    };
    for (fault, lost, kept) in [("loss:dev0@frame3", 0..18, HEIGHT - 1), ("loss:dev2@frame3", 36..HEIGHT, 0)] {
        let frames = render(&[fault]);
        assert!((0..3).all(|frame| frames[frame] == whole[frame]), "{fault}");
        assert!(lost.clone().all(|row| !is_as_before(&frames, 3, row)), "{fault}");
        assert!(is_as_before(&frames, 3, kept), "{fault}");
        assert!(render(&[fault]) == frames, "{fault}");
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_when_two_devices_fail_in_one_frame() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let one = Stage::alone(&subject, &settings).frame(0).linear;
    let fates = ["loss:dev0@frame0", "oom:dev0@frame0", "loss:dev1@frame0"];
    let mut three = failing(&subject, &settings, 3, Rows::Even, &fates);
    let limit = Duration::from_secs(20);
    three.renderer().set_watchdog(limit);
    let begin = Instant::now();
    assert_same("three devices", &one, &three.frame(0).linear);
    assert!(begin.elapsed() < limit / 2, "devices waited for rows that nobody was to send");
    assert_eq!(failed(&mut three), [0, 1]);
    // The time of failed attempts does not count as a device's lead time.
    assert_eq!(three.renderer().costs().lead_ms(2), 0.0);
    assert_same("the frame after", &one, &three.frame(0).linear);
}

#[test]
fn frame_is_rendered_again_if_its_primary_is_lost() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let mut two = failing(&subject, &settings, 2, Rows::Even, &[]);
    let expected = two.frame(0).linear;
    two.inject(&["loss:dev0@frame0"], &[]);
    let begin = Instant::now();
    assert!(two.renderer().read_linear().unwrap() == expected);
    let elapsed_ms = begin.elapsed().as_secs_f64() * 1e3;
    let seen: Vec<_> = two.renderer().faults().iter().map(|f| (f.device, f.kind, f.attempts)).collect();
    assert_eq!(seen, [(0, FailureKind::Loss, 2)]);
    let recovery_ms = two.renderer().faults()[0].recovery_ms;
    assert!(recovery_ms > 0.0 && recovery_ms <= elapsed_ms, "{recovery_ms} of {elapsed_ms} ms");
    assert!(two.frame(0).linear == expected, "the frame after");
}

#[test]
fn same_bytes_and_counts_with_slow_devices() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    settings.envelope.most.spp = 5.into(); // Two dispatches; the second one accumulates.
    let one = hold("two devices", &subject, &settings, &[0.0], &[even(2)]);
    let mut two = failing(&subject, &settings, 2, Rows::Even, &[]);
    let mut busy_ms = |slowdown: &[u32], injections: &[&str]| {
        two.inject(injections, slowdown);
        let frame = [two.frame(0)];
        assert_same_frames(&format!("{slowdown:?} {injections:?}"), &one, &frame);
        let of = |t: &&diptych::exec::TaskTiming| t.device == 1 && t.transfer.is_none();
        frame[0].report.tasks.iter().filter(of).map(|t| t.end_ms - t.begin_ms).sum::<f64>()
    };
    busy_ms(&[1, 1], &["slow:dev1@frame0"]);
    // Other tests load the machine. The best of three is far below the factor.
    let mut least_ms = |slowdown: &[u32]| (0..3).map(|_| busy_ms(slowdown, &[])).fold(f64::INFINITY, f64::min);
    let (plain, slowed) = (least_ms(&[]), least_ms(&[1, 8]));
    assert!(slowed > 2.0 * plain, "{slowed} ms of work instead of {plain} take no longer");
}
