//! Devices that fail, hang or lag change no byte while one device is left. The command reports it and writes all its
//! files.

use std::time::{Duration, Instant};

use crate::common::{self, Stage, Subject, devices_to_lose};
use diptych::device::{DevicePool, FailureKind, GpuDevice, Selection};
use diptych::exec::{ExecError, InjectedFaults, Injection, Stereo};
use diptych::image::RgbImage;
use diptych::schedule::{Even, Measured};

const WIDTH: u32 = 96;
const HEIGHT: u32 = 54;

fn injected(injections: &[&str], slowdown: &[u32]) -> InjectedFaults {
    let injections: Vec<Injection> = injections.iter().map(|i| i.parse().unwrap()).collect();
    InjectedFaults { injections, slowdown: slowdown.to_vec() }
}

/// Devices fail one after another in different ways while stripes move, each time in the next frame.
#[test]
fn same_bytes_until_no_device_is_left() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let time_s = |frame: u32| f64::from(frame) * 0.3;
    let one: Vec<_> = {
        let mut alone = Stage::alone(&subject, &settings);
        (0..5).map(|i| alone.frame_at(time_s(i), i).linear).collect()
    };
    let mut four = Stage::on(devices_to_lose(4), &subject, &settings, Box::new(Measured::new(HEIGHT, 4)));
    four.renderer().set_watchdog(Duration::from_secs(3));
    let fates = ["loss:dev0@frame1", "oom:dev2@frame2", "hang:dev1@frame3", "loss:dev3@frame5"];
    four.renderer().set_injected_faults(injected(&fates, &[]));
    let (mut rows, mut makespans_ms) = (Vec::new(), Vec::new());
    for (i, expected) in (0..5).zip(&one) {
        let frame = four.frame_at(time_s(i), i);
        makespans_ms.push(frame.report.makespan_ms);
        assert!(frame.linear == *expected, "frame {i} differs");
        let stripes =
            frame.report.assignment.stripes(diptych::passes::path_trace::PARTITION, diptych::scene::rig::Eye::Left);
        rows.push((0..4).map(|d| stripes.rows(d).len()).collect::<Vec<_>>());
    }
    let working = |frame: usize| rows[frame].iter().map(|r| *r > 0).collect::<Vec<_>>();
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
    let mut stage = Stage::on(devices_to_lose(2), &subject, &settings, policy());
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
    failing.renderer().set_injected_faults(injected(&["loss:dev1@frame0"], &[]));
    failing.frame(0);
    let left = failing.into_devices();
    assert_eq!(left.iter().map(|gpu| gpu.info.index).collect::<Vec<_>>(), [0]);
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
    let times_s: Vec<f64> = (0..8).map(|i| f64::from(i) * 0.3).collect();
    let alone = Stage::alone(&subject, &settings).frames_in_flight(&times_s);
    settings.execution.frames_in_flight = 3;
    let mut four = Stage::on(devices_to_lose(4), &subject, &settings, Box::new(Measured::new(HEIGHT, 4)));
    four.renderer().set_watchdog(Duration::from_secs(3));
    four.renderer().set_injected_faults(injected(&["loss:dev0@frame1", "hang:dev2@frame4", "oom:dev1@frame5"], &[]));
    let frames = four.frames_in_flight(&times_s);
    assert_eq!(frames.len(), alone.len());
    for (one, other) in alone.iter().zip(&frames) {
        assert_eq!(one.report.index, other.report.index);
        assert!(one.linear == other.linear, "frame {} differs", one.report.index);
    }
    let faults = four.renderer().faults();
    let mut failed: Vec<_> = faults.iter().map(|f| f.device).collect();
    failed.sort_unstable();
    assert_eq!(failed, [0, 1, 2]);
    assert!(faults.iter().all(|f| f.recovery_ms > 0.0 && f.attempts > 1), "{faults:?}");
}

/// With frames in flight, those behind the failed frame may have overwritten history. All rows restart without history,
/// like a run that begins there.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn history_restarts_when_a_device_fails_in_flight() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.accumulated(WIDTH, HEIGHT);
    let times_s: Vec<f64> = (0..6).map(|i| f64::from(i) * 0.02).collect();
    let before = Stage::alone(&subject, &settings).frames_in_flight(&times_s[..3]);
    let after: Vec<_> = {
        let mut alone = Stage::alone(&subject, &settings);
        (3..6).map(|i| alone.frame_at(times_s[i as usize], i)).collect()
    };
    settings.execution.frames_in_flight = 2;
    let mut three = Stage::on(devices_to_lose(3), &subject, &settings, Box::new(Measured::new(HEIGHT, 3)));
    three.renderer().set_injected_faults(injected(&["loss:dev1@frame3"], &[]));
    let frames = three.frames_in_flight(&times_s);
    for (one, other) in before.iter().chain(&after).zip(&frames) {
        assert!(one.linear == other.linear, "frame {} differs", one.report.index);
    }
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
        let mut three = Stage::on(devices_to_lose(3), &subject, &settings, Box::new(Even::new(HEIGHT, 3)));
        three.renderer().set_injected_faults(injected(faults, &[]));
        (0..5).map(|i| three.frame_at(f64::from(i) * 0.02, i).linear).collect::<Vec<_>>()
    };
    let whole = render(&[]);
    let is_as_before = |frames: &[Stereo<RgbImage>], frame: usize, row: u32| {
        let row = |image: &RgbImage| image.pixels[(row * WIDTH) as usize..][..WIDTH as usize].to_vec();
        row(&frames[frame].left) == row(&whole[frame].left) && row(&frames[frame].right) == row(&whole[frame].right)
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
    let mut three = Stage::on(devices_to_lose(3), &subject, &settings, Box::new(Even::new(HEIGHT, 3)));
    let fates = ["loss:dev0@frame0", "oom:dev0@frame0", "loss:dev1@frame0"];
    three.renderer().set_injected_faults(injected(&fates, &[]));
    let limit = Duration::from_secs(20);
    three.renderer().set_watchdog(limit);
    let begin = Instant::now();
    assert!(three.frame(0).linear == one);
    assert!(begin.elapsed() < limit / 2, "devices waited for rows that nobody was to send");
    let mut failed: Vec<_> = three.renderer().faults().iter().map(|f| f.device).collect();
    failed.sort_unstable();
    assert_eq!(failed, [0, 1]);
    // The time of failed attempts does not count as a device's lead time.
    assert_eq!(three.renderer().costs().lead_ms(2), 0.0);
    assert!(three.frame(0).linear == one, "the frame after");
}

#[test]
fn frame_is_rendered_again_if_its_primary_is_lost() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let mut two = Stage::on(devices_to_lose(2), &subject, &settings, Box::new(Even::new(HEIGHT, 2)));
    let expected = two.frame(0).linear;
    two.renderer().set_injected_faults(injected(&["loss:dev0@frame0"], &[]));
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
    let one = Stage::alone(&subject, &settings).frame(0);
    let mut two = Stage::on(devices_to_lose(2), &subject, &settings, Box::new(Even::new(HEIGHT, 2)));
    let mut busy_ms = |slowdown: &[u32], injections: &[&str]| {
        two.renderer().set_injected_faults(injected(injections, slowdown));
        let frame = two.frame(0);
        assert!(frame.linear == one.linear, "{slowdown:?} {injections:?}");
        assert_eq!(frame.report.tallies, one.report.tallies, "{slowdown:?} {injections:?}");
        let of = |t: &&diptych::exec::TaskTiming| t.device == 1 && t.transfer.is_none();
        frame.report.tasks.iter().filter(of).map(|t| t.end_ms - t.begin_ms).sum::<f64>()
    };
    busy_ms(&[1, 1], &["slow:dev1@frame0"]);
    // Other tests load the machine. The best of three is far below the factor.
    let mut least_ms = |slowdown: &[u32]| (0..3).map(|_| busy_ms(slowdown, &[])).fold(f64::INFINITY, f64::min);
    let (plain, slowed) = (least_ms(&[]), least_ms(&[1, 8]));
    assert!(slowed > 2.0 * plain, "{slowed} ms of work instead of {plain} take no longer");
}
