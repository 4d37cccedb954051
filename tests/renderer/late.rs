//! Late reprojection: frames that are shown from a later head pose than they were rendered at.

use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::common::{Frame, Stage, Subject, project};
use diptych::RunConfig;
use diptych::exec::{PerView, PoseSource, TimedTask};
use diptych::image::{Extent, RgbImage};
use diptych::metrics::Pair;
use diptych::passes::Display;
use diptych::projection::{LogPolar, PolarSpace};
use diptych::scene::optics::Optics;
use diptych::scene::rig::{Rig, RigKey};
use glam::DVec3;

const SIZE: Extent = Extent { width: 64, height: 48 };

/// Returns a head that turns and moves, sideways and ahead, from 0 s to 1 s.
fn subject(spp: u32) -> (Subject, RunConfig) {
    let mut subject = Subject::load("builtin:cornell");
    let first = RigKey { time_s: 0.0, ..subject.rig.keys[0] };
    let position = first.position + DVec3::new(0.04, 0.01, -0.03);
    let target = first.target + DVec3::new(0.2, 0.05, 0.0);
    subject.rig.keys = vec![first, RigKey { time_s: 1.0, position, target, ..first }];
    let optics = Optics::with_border(&subject.rig, SIZE, 6.0);
    subject.rig.optics = Some(optics);
    let mut settings = subject.settings(SIZE.width, SIZE.height);
    let projection = optics.rectified(SIZE).unwrap();
    settings.buffers.display = Display::Resampled { projection, is_late: true };
    settings.envelope.most.spp = spp.into();
    (subject, settings)
}

/// Renders a frame at 0 s and shows it from the head pose at `later_s`.
fn shown_from(
    later_s: f64,
    index: u32,
    devices: usize,
    (subject, settings): &(Subject, RunConfig),
) -> PerView<RgbImage> {
    let mut stage = Stage::even(subject, settings, devices);
    stage.set(|params| params.shown_from = Some(subject.rig.at(later_s)));
    stage.frame(index).linear
}

#[test]
fn late_reprojection_corrects_poses_on_all_devices() {
    corrects(&subject(24), [5.0, 0.5], &[2, 3]);
}

/// Polar images have fewer pixels than the display image, so the margins are smaller.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn late_reprojection_corrects_polar_images() {
    for space in [PolarSpace::Visual, PolarSpace::Log(LogPolar::COMPOSITE)] {
        let mut seen = subject(24);
        project(&mut seen.1, Default::default(), space);
        corrects(&seen, [3.0, 0.8], &[2]);
    }
}

/// Asserts that corrected frames are closer to frames of the later pose than uncorrected ones: better by this many dB,
/// and with at most this fraction of their FLIP. All these numbers of devices must give the same image.
fn corrects(seen: &(Subject, RunConfig), [by_db, flip_share]: [f64; 2], counts: &[usize]) {
    let (subject, settings) = seen;
    let rendered_at = |time_s: f64| {
        let mut stage = Stage::even(subject, settings, 1);
        stage.frame_at(time_s, 0).linear
    };
    let corrected = shown_from(1.0, 0, 1, seen);
    let [right, late] = [1.0, 0.0].map(rendered_at);
    for (eye, right, late, corrected) in [
        ("left", right.left(), late.left(), corrected.left()),
        ("right", right.right(), late.right(), corrected.right()),
    ] {
        let errors = |image| Pair::new(right, image, 0.0).unwrap().errors();
        let [late, corrected] = [errors(late), errors(corrected)];
        println!("{eye}: {} and {} dB, FLIP {} and {}", late.psnr, corrected.psnr, late.flip, corrected.flip);
        assert!(corrected.psnr > late.psnr + by_db, "{eye}: {} and {} dB", late.psnr, corrected.psnr);
        assert!(corrected.flip < flip_share * late.flip, "{eye}: {} and {}", late.flip, corrected.flip);
    }
    for &devices in counts {
        assert!(shown_from(1.0, 0, devices, seen) == corrected, "{devices} devices");
    }
}

/// Returns a pose source that waits until the test sends a pose.
fn told() -> (Arc<PoseSource>, Sender<Option<Rig>>) {
    let (tell, poses) = channel();
    let poses = Mutex::new(poses);
    (Arc::new(move |_| poses.lock().unwrap().recv_timeout(Duration::from_secs(20)).unwrap()), tell)
}

/// Returns the end of the last task on which the late reprojection depends, or which the primary runs besides.
fn others_ended_ms(frame: &Frame) -> f64 {
    let others = frame.report.tasks.iter().filter(|task| task.stage != "to_later_eye");
    let waited_for = others.filter(|task| task.device == 0 || task.stage == "tonemap");
    let gpu = waited_for.filter(|task| matches!(task.kind, TimedTask::Gpu(_)));
    gpu.map(|task| task.end_ms).fold(0.0, f64::max)
}

/// A pose that arrives during the frame gives the same image as one known in advance. The source is asked only after
/// everything else of the frame is done.
#[test]
fn frames_are_reprojected_to_the_latest_pose() {
    let seen = subject(1);
    let known = [0.0, 0.7].map(|later_s| shown_from(later_s, 0, 1, &seen));
    let (subject, mut settings) = seen;
    assert!(known[0] != known[1]);
    for (devices, in_flight) in [(1, 1), (2, 1), (3, 2)] {
        settings.execution.frames_in_flight = in_flight;
        let mut stage = Stage::even(&subject, &settings, devices);
        let (source, tell) = told();
        stage.renderer().set_pose_source(Some(source));
        for (later_s, expected) in [(0.7, &known[1]), (0.0, &known[0])] {
            let params = stage.params(0.0, 0);
            stage.renderer().begin(&params, &[]).unwrap();
            let pose = subject.rig.at(later_s);
            tell.send(Some(pose.clone())).unwrap();
            let report = stage.renderer().finish().unwrap().unwrap();
            let frame = Frame { linear: stage.renderer().read_linear().unwrap(), report };
            assert!(frame.linear == *expected, "{devices} devices, {later_s} s");
            let asked = frame.report.shown_from.as_ref().unwrap();
            assert_eq!(asked.rig, pose);
            let off_ms = frame.report.clock_residuals_us.iter().map(|(_, us)| us / 1e3).fold(0.0, f64::max);
            let ended_ms = others_ended_ms(&frame);
            assert!(asked.at_ms >= ended_ms - off_ms, "{devices} devices: {} and {ended_ms} ms", asked.at_ms);
            let age_ms = frame.report.pose_age_ms().unwrap();
            assert!(age_ms > 0.0 && age_ms < frame.report.makespan_ms, "{age_ms} ms");
            let showing = frame.report.tasks.iter().filter(|task| task.stage == "to_later_eye");
            assert!(showing.clone().count() == 2 && showing.clone().all(|task| task.device == 0));
        }
        // The source has no newer pose than the frame's.
        stage.set(|params| params.shown_from = Some(subject.rig.at(0.7)));
        tell.send(None).unwrap();
        let frame = stage.frame(0);
        assert!(frame.linear == known[1] && frame.report.pose_age_ms().is_none(), "{devices} devices");
        // Without a source, all devices share the late reprojection.
        stage.renderer().set_pose_source(None);
        let frame = stage.frame(0);
        let showing = frame.report.tasks.iter().filter(|task| task.stage == "to_later_eye");
        assert!(frame.linear == known[1] && showing.count() == 2 * devices);
    }
}

/// Two frames are in flight, and each asks for a pose of its own.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn frames_in_flight_latch_separate_poses() {
    let seen = subject(1);
    let later_s = |frame: u32| 0.2 * f64::from(frame);
    let known: Vec<_> = (0..4).map(|index| shown_from(later_s(index), index, 1, &seen)).collect();
    let (subject, mut settings) = seen;
    settings.execution.frames_in_flight = 2;
    let mut stage = Stage::even(&subject, &settings, 2);
    let rig = subject.rig.clone();
    stage.renderer().set_pose_source(Some(Arc::new(move |frame| Some(rig.at(later_s(frame))))));
    for (frame, known) in stage.frames_in_flight(&[0.0; 4]).iter().zip(&known) {
        let asked = frame.report.shown_from.as_ref().unwrap();
        assert_eq!(asked.rig, subject.rig.at(later_s(frame.report.index)));
        assert!(frame.linear == *known, "frame {}", frame.report.index);
    }
}

/// The image has the pose of the last attempt.
#[test]
fn repeated_frame_latches_a_new_pose() {
    let seen = subject(1);
    let known = shown_from(0.7, 0, 1, &seen);
    let (subject, settings) = seen;
    let mut stage = Stage::even(&subject, &settings, 2);
    let (source, tell) = told();
    stage.renderer().set_pose_source(Some(source));
    [0.3, 0.7].into_iter().for_each(|later_s| tell.send(Some(subject.rig.at(later_s))).unwrap());
    let params = stage.params(0.0, 0);
    stage.renderer().render(&params).unwrap();
    stage.inject(&["loss:dev0@frame0"], &[]);
    assert!(stage.renderer().read_linear().unwrap() == known);
    assert_eq!(stage.renderer().faults().len(), 1);
}
