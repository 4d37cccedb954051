//! Temporal antialiasing.

mod twin;

use glam::{DVec3, Vec2};

use self::twin::{DROPPED, Twin};
use super::camera::Constants;
use super::harness::{Buffer, Kernel};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, stripes};
use super::pack::{Counts, floats, is_near, rgb};
use super::tonemap::{display_levels, shows};

/// Returns a colour, sometimes much brighter than white, and a depth: 0 for the sky, which is mostly on the left, or
/// `DROPPED`.
fn composed(random: &mut Random, x: usize) -> [f32; 4] {
    let sky = if x < 7 { 0.97 } else { 0.3 };
    let depth = if random.chance(sky) { 0.0 } else { random.within(2.0..6.0) };
    match random.bits() % 40 {
        0 => [0.0, 0.0, 0.0, DROPPED],
        1 => [1.0, f32::INFINITY, 1.0, depth as f32],
        _ => floats(random.color(1.0), depth),
    }
}

/// Returns a colour near or far from the colours of its neighbourhood, and its number of frames.
fn resolved(random: &mut Random, damaged: f64) -> [f32; 4] {
    let frames = random.pick(&[1.0, 2.0, 6.0, 14.0, 255.0]);
    if random.chance(damaged) {
        return [f32::INFINITY, 0.0, 0.0, frames];
    }
    floats(random.color(2.0), frames.into())
}

/// Motion and rotation of an eye since the previous frame.
type Turn = (DVec3, f64, f64);

/// Tolerance: image points have errors of about 1e-6 pixels, and so have the weights of pixels as bright as 60.
const TOLERANCE: f64 = 1e-4;
/// Tolerance for slow motion: motion of about 1e-3 pixels is a difference of image points and determines the history
/// length.
const SLOW_TOLERANCE: f64 = 5e-3;

fn compare(turn: Option<Turn>, has_history: bool, seed: u64, expected: &[&'static str]) {
    compare_within(TOLERANCE, turn, has_history, seed, expected);
}

fn compare_within(tolerance: f64, turn: Option<Turn>, has_history: bool, seed: u64, expected: &[&'static str]) {
    let mut random = Random::new(seed);
    let mut constants = Constants { exposure: 1.6, ..Constants::new(WIDTH, HEIGHT) };
    constants.history_rows = has_history.then_some(1);
    constants.centre = Vec2::new(0.7, 0.4);
    // If the eye does not turn, the sky does not move, except for rounding, which decides if a neighbour counts.
    let damaged = if matches!(turn, Some((_, 0.0, 0.0))) { 0.0 } else { 0.005 };
    let mut cases = Cases::default();
    for (round, stripe) in stripes().iter().enumerate() {
        let view = round % 2;
        constants.spp = [1, 4, 16][round / 2];
        let eyes = constants.eyes.map(|eye| turn.map_or(eye, |(way, yaw, pitch)| eye.moved(way, yaw, pitch)));
        let now: Vec<_> = (0..constants.area()).map(|at| composed(&mut random, at % WIDTH as usize)).collect();
        let last: Vec<_> = (0..constants.area()).map(|_| resolved(&mut random, damaged)).collect();
        let tally: Vec<u32> = (0..constants.area()).map(|_| random.bits()).collect();
        let words = [0, 1].map(|_| random.rubbish::<4>(constants.area()));
        let buffers = [
            ("composed", stripe.valid(WIDTH, &now)),
            ("last_resolved", stripe.valid(WIDTH, &last)),
            ("resolved", Buffer::image(&words[0])),
            ("linear", Buffer::image(&words[1])),
            ("display", Buffer::image(&tally)),
            ("previous", Buffer::whole(&Constants { eyes, ..constants.clone() }.as_previous())),
            ("tally_image", Buffer::image(&tally)),
            ("last_surface", Buffer::whole(&[[0u32; 4]])),
            ("last_guide", Buffer::whole(&[[0u32; 4]])),
            ("light_change", Buffer::whole(&[0.0f32])),
        ];
        let outputs = Kernel::new("taa", &[]).run(&constants, stripe.pass(view, [0; 3]), WIDTH, &buffers);
        let (kept, linear) = (outputs.get::<[f32; 4]>("resolved"), outputs.get::<[f32; 4]>("linear"));
        let (display, counted) = (outputs.get::<u32>("display"), outputs.get::<u32>("tally_image"));
        let twin = Twin { constants: &constants, stripe, view, eye: eyes[view], composed: &now, last: &last };
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let want = twin.pixel(x, y, &mut cases);
            let place =
                || format!("({x}, {y}) of {stripe:?}: {:?} instead of {} {}", kept[at], want.color, want.frames);
            let got = rgb(kept[at]);
            let near = (0..3).all(|c| got[c] == want.color[c] || is_near(got[c], want.color[c], tolerance, tolerance));
            assert!(near && is_near(kept[at][3].into(), want.frames, tolerance, 0.0), "{}", place());
            let [r, g, b, _] = kept[at];
            assert_eq!(linear[at], [r.max(0.0), g.max(0.0), b.max(0.0), 1.0], "{}", place());
            let levels = display_levels(rgb(kept[at]), constants.exposure.into());
            assert!(shows(display[at], levels), "{}: {:08x} instead of {levels}", place(), display[at]);
            let counts = Counts::unpack(tally[at]).with_dropped(u32::from(want.is_dropped));
            assert_eq!(Counts::unpack(counted[at]), counts, "{}", place());
        }
    }
    cases.assert_met(&["sky", "a surface", "a silhouette", "a pixel that was dropped", "a colour that is not finite"]);
    cases.assert_met(expected);
}

#[test]
fn taa_starts_history_with_the_first_frame() {
    compare(None, false, 121, &["no history"]);
}

#[test]
fn taa_averages_frames_while_the_eyes_are_still() {
    compare(None, true, 122, &["history of an eye that stands still", "history that is not finite"]);
}

#[test]
fn taa_history_follows_the_surface() {
    let way = DVec3::new(0.06, 0.09, -0.02);
    let expected = ["history that moved", "history that is not finite", "no history"];
    compare(Some((way, 0.02, 0.03)), true, 123, &expected);
    // Vertical motion near the limit, where interpolation of the second row needs two rows.
    compare(Some((way, 0.02, 0.09)), true, 126, &["history that moved", "no history"]);
    compare(Some((-way, -0.03, -0.09)), true, 128, &["history that moved", "no history"]);
    let expected = ["history that moved", "history that moved slowly"];
    compare_within(SLOW_TOLERANCE, Some((way, 0.0, 0.0)), true, 127, &expected);
}

#[test]
fn taa_keeps_longer_history_of_slow_motion() {
    let turn = (DVec3::new(2e-4, -1e-4, 1e-4), 1e-4, -5e-5);
    compare_within(SLOW_TOLERANCE, Some(turn), true, 124, &["history that moved slowly"]);
}

#[test]
fn taa_drops_history_from_behind_the_eye() {
    compare(Some((DVec3::ZERO, 2.5, 0.0)), true, 125, &["no history"]);
}
