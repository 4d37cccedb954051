//! The auxiliary image `history`: how many frames the denoiser accumulated in each pixel.

use crate::common::{Stage, Subject, still_rig, with};
use crate::pictures::board_before_wall;
use crate::same_bytes::assert_same;
use diptych::exec::PerView;
use diptych::passes::Aov;
use diptych::quality::{Denoiser, Filter};
use diptych::scene::rig::RigKey;
use diptych::{RunConfig, scene};
use glam::{DVec3, Vec3};

const WIDTH: usize = 96;
const HEIGHT: usize = 64;

/// Distances of the board and of the wall behind it, and half the width of the board, in metres.
const BOARD: f32 = 2.0;
const WALL: f32 = 6.0;
const HALF: f32 = 0.4;
/// Step of the eyes to the right, at 1 s. The board moves by 6.4 pixels more to the left than the wall.
const STEP: f64 = 0.3;
/// Distance of the eyes. Disparity is 6 pixels on the board and 2 on the wall.
const BASELINE: f64 = 0.1875;

/// Returns a lit board before a lit wall.
fn board() -> Subject {
    let mut scene = board_before_wall([BOARD, HALF], [WALL, 40.0]);
    scene.environment = scene::Environment::Constant(Vec3::ONE);
    let mut rig = still_rig(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y, 0.5);
    rig.baseline_m = BASELINE;
    let position = DVec3::X * STEP;
    rig.keys.push(RigKey { time_s: 1.0, position, target: position - DVec3::Z, ..rig.keys[0] });
    Subject::new("board before a wall", scene, rig)
}

fn settings(subject: &Subject, aovs: &[Aov]) -> RunConfig {
    with(subject.accumulated(WIDTH as u32, HEIGHT as u32), |config| config.buffers.aovs = aovs.to_vec())
}

/// Returns the auxiliary images of the frame after `frames` frames at rest and a step to the right.
fn after_the_step(subject: &Subject, settings: &RunConfig, frames: u32) -> Vec<PerView<Vec<f32>>> {
    let mut stage = Stage::alone(subject, settings);
    (0..frames).for_each(|i| drop(stage.frame(i)));
    stage.frame_at(1.0, frames);
    let mut plane = |i| {
        let [left, right] = stage.aov(i).into_outer();
        PerView::both(left[0].clone(), right[0].clone())
    };
    (0..settings.buffers.aovs.len()).map(&mut plane).collect()
}

#[test]
fn history_of_a_still_camera_counts_its_frames() {
    let subject = Subject::load("builtin:cornell");
    for (denoiser, iterations, per_frame) in [(Denoiser::SVGF, 5, 1), (Denoiser::BMFR, 1, 1), (Denoiser::ATROUS, 5, 0)]
    {
        let settings = with(settings(&subject, &[Aov::History, Aov::Depth]), |config| {
            config.envelope.most.filter = Some(Filter::new(denoiser, iterations));
        });
        let mut stage = Stage::alone(&subject, &settings);
        for i in 0..4 {
            stage.frame(i);
            let [counts, depths] = [stage.aov(0), stage.aov(1)];
            for (counts, depths) in [(&counts.left()[0], &depths.left()[0]), (&counts.right()[0], &depths.right()[0])] {
                let expected = ((i + 1) * per_frame) as f32;
                let surfaces: Vec<usize> = (0..depths.len()).filter(|&p| depths[p] > 0.0).collect();
                let equal = surfaces.iter().filter(|&&p| counts[p] == expected).count();
                assert!(counts.iter().all(|&n| n <= expected), "{denoiser:?}: more than {expected} frames");
                let sky = (0..depths.len()).filter(|&p| depths[p] == 0.0);
                assert!(sky.clone().all(|p| counts[p] == 0.0) && sky.count() > 500, "the sky has frames");
                // Pixels at silhouettes show another surface in some frames.
                assert!(equal * 5 > surfaces.len() * 4, "{denoiser:?}: {equal} of {} pixels", surfaces.len());
            }
        }
    }
}

#[test]
fn disoccluded_pixels_have_one_frame_of_history() {
    const FRAMES: u32 = 3;
    let subject = board();
    let found = after_the_step(&subject, &settings(&subject, &[Aov::History, Aov::Depth]), FRAMES);
    let [counts, depths] = &found[..] else { panic!("two images") };
    for (eye, counts, depths) in [("left", counts.left(), depths.left()), ("right", counts.right(), depths.right())] {
        let row = HEIGHT / 2 * WIDTH;
        let is_board = |x: &usize| depths[row + *x] < 0.5 * (BOARD + WALL);
        let right_of_board = (0..WIDTH).filter(is_board).max().unwrap() + 1;
        let left_of_board = (0..WIDTH).find(|x| is_board(x)).unwrap();
        // Samples are not at the pixels' centres, so a pixel at either side of the strip may be of either kind.
        for x in 1..5 {
            assert_eq!(counts[row + right_of_board + x], 1.0, "{eye} eye, {x} pixels right of the board");
        }
        let others = [left_of_board + 2..right_of_board - 2, 4..left_of_board - 2, right_of_board + 10..WIDTH - 8];
        for x in others.into_iter().flatten() {
            assert_eq!(counts[row + x], (FRAMES + 1) as f32, "{eye} eye, column {x}");
        }
    }
}

/// Where the right eye takes over the left eye's light, it has the left eye's count, and elsewhere its own.
#[test]
fn right_eye_has_the_history_of_the_light_it_shows() {
    let subject = board();
    let settings = settings(&subject, &[Aov::History, Aov::Depth, Aov::Holes]);
    let taken_over = after_the_step(&subject, &settings, 3);
    let own = after_the_step(&subject, &with(settings, |config| config.filter_once = false), 3);
    let [counts, depths, holes] = &taken_over[..] else { panic!("three images") };
    let (mut compared, mut differing) = (0, 0);
    for at in (0..WIDTH * HEIGHT).filter(|&at| holes.right()[at] == 0.0) {
        let disparity = if depths.right()[at] < 0.5 * (BOARD + WALL) { 6 } else { 2 };
        if at % WIDTH + disparity < WIDTH {
            assert_eq!(counts.right()[at], counts.left()[at + disparity], "column {}", at % WIDTH);
            compared += 1;
            differing += usize::from(own[0].right()[at] != counts.right()[at]);
        }
    }
    assert!(compared > WIDTH * HEIGHT / 2, "{compared} pixels are reprojected");
    assert!(differing > 50, "only {differing} pixels would have another count of their own");
    // Holes keep the right eye's count.
    let filled: Vec<usize> = (0..WIDTH * HEIGHT).filter(|&at| holes.right()[at] > 0.0).collect();
    assert!(filled.len() > 50, "{} holes", filled.len());
    assert!(filled.iter().all(|&at| counts.right()[at] == own[0].right()[at]), "holes have another count");
}

/// The image has the same bytes on any number of devices, and a frame is the same with and without it.
#[test]
fn same_bytes_of_history_lengths_on_three_devices() {
    let subject = Subject::load("builtin:checker");
    let frames = |devices: usize, aovs: &[Aov]| {
        let settings = settings(&subject, aovs);
        let mut stage = Stage::even(&subject, &settings, devices);
        let frame = (0..4).map(|i| stage.frame_at(0.1 * f64::from(i), i)).last().unwrap();
        (frame.linear, aovs.first().map(|_| stage.aov(0)))
    };
    let [(alone, counts), (on_three, counts_on_three)] = [1, 3].map(|devices| frames(devices, &[Aov::History]));
    let [counts, counts_on_three] = [counts, counts_on_three].map(Option::unwrap);
    assert_same("three devices", &alone, &on_three);
    assert_same("without the auxiliary image", &frames(1, &[]).0, &alone);
    assert!(counts.left() == counts_on_three.left(), "the left eye's history lengths differ");
    assert!(counts.right() == counts_on_three.right(), "the right eye's history lengths differ");
    for counts in [&counts.left()[0], &counts.right()[0]] {
        assert!([1.0, 4.0].iter().all(|n| counts.iter().filter(|count| *count == n).count() > 20), "too few pixels");
    }
}
