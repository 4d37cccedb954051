//! Animation of a figure that walks around a circle. A foot does not slide while it is on the floor. The angles of hips
//! and knees are computed from the positions of hips and ankles (inverse kinematics by the law of cosines). The upper
//! body swings against the legs.

use glam::{DMat3, DQuat, DVec3};

use super::figure::{ANKLE, ARMS, CHEST, HEAD, JOINTS, LEGS, PELVIS, SPINE};
use super::staging::{PERIOD_S, turned, wave};
use std::f64::consts::TAU;

/// Centre and radius of the circle, metres.
pub const MIDDLE: DVec3 = DVec3::new(-0.1, 0.0, 0.25);
pub const RADIUS: f64 = 0.75;

/// Number of gait cycles (two steps each) per round of the circle.
const CYCLES: f64 = 5.0;

/// Fraction of a gait cycle during which a foot is on the floor.
const STANCE: f64 = 0.6;

/// Distance by which hips are lower than when standing, metres.
const STOOP: f64 = 0.05;

/// Points at which a foot touches the floor when its heel or its toes are lifted, in metres ahead of the ankle.
const TOES: f64 = 0.19;
const HEEL: f64 = -0.06;

/// Lateral distance from the circle to the centre line of a foot, metres.
const ASIDE: f64 = 0.08;

/// Keyframes of a foot's pitch: fraction of the foot's gait cycle, and angle in radians, positive with the toes down.
const PITCHES: [[f64; 2]; 7] =
    [[0.0, -0.2], [0.1, 0.0], [0.4, 0.0], [0.6, 0.55], [0.75, 0.45], [0.92, -0.2], [1.0, -0.2]];

/// Pose of the figure at one time.
pub struct Stride {
    /// Position of the figure on the floor, midway between its footprints.
    pub place: DVec3,
    pub heading: DQuat,
    /// Position of the pelvis relative to `place`, in the axes of `heading`; metres.
    pub pelvis: DVec3,
    /// Rotation of each joint relative to its parent.
    pub turns: [DQuat; JOINTS.len()],
}

impl Stride {
    pub fn at(time_s: f64) -> Self {
        let round = time_s / PERIOD_S;
        let cycle = round * CYCLES;
        let (place, heading) = on_circle(round);
        // A cycle begins when the left foot touches down.
        let (_, reach) = wave(cycle);
        let (_, lean) = wave(cycle - 0.5 * STANCE + 1.0);
        let (_, bob) = wave(2.0 * cycle - 0.1 + 1.0);
        let pelvis = JOINTS[PELVIS].at + DVec3::new(0.018 * lean, -STOOP - 0.016 * bob, 0.0);
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
        let mut turns = [DQuat::IDENTITY; JOINTS.len()];
        turns[PELVIS] = turned(y, -0.1 * reach) * turned(z, 0.04 * lean);
        turns[SPINE] = turned(y, 0.08 * reach) * turned(x, 0.05);
        turns[CHEST] = turned(y, 0.14 * reach) * turned(z, -0.04 * lean);
        turns[HEAD] = turned(y, -0.12 * reach) * turned(x, -0.03);
        for (arm, side) in ARMS.into_iter().zip([1.0, -1.0]) {
            turns[arm] = turned(z, side * 0.1) * turned(x, 0.5 * side * reach + 0.05);
            turns[arm + 1] = turned(x, -0.5 + 0.25 * side * reach);
        }
        let hips = heading * turns[PELVIS];
        for (leg, side) in LEGS.into_iter().zip([1.0, -1.0]) {
            let foot = Foot::at(cycle + if side > 0.0 { 0.0 } else { 0.5 }, side);
            let hip = place + heading * (pelvis + turns[PELVIS] * (JOINTS[leg].at - JOINTS[PELVIS].at));
            let [thigh, shin] = bent(hip, foot.ankle, heading);
            turns[leg] = hips.inverse() * thigh;
            turns[leg + 1] = thigh.inverse() * shin;
            turns[leg + 2] = shin.inverse() * foot.turn;
        }
        Self { place, heading, pelvis, turns }
    }
}

/// Returns position and heading after `round` rounds. The centre of the circle is to the left of the figure.
fn on_circle(round: f64) -> (DVec3, DQuat) {
    let (sin, cos) = wave(round);
    (MIDDLE + RADIUS * DVec3::new(-cos, 0.0, sin), turned(DVec3::Y, TAU * round.fract()))
}

struct Foot {
    ankle: DVec3,
    turn: DQuat,
}

impl Foot {
    /// Returns a foot's pose. `cycle` is the time in gait cycles; the foot touches down at each whole number. `side` is
    /// 1 for the left foot and −1 for the right one.
    fn at(cycle: f64, side: f64) -> Self {
        let phase = cycle.fract();
        // In the middle of the stance, the body is directly above the foot.
        let swing = smooth(((phase - STANCE) / (1.0 - STANCE)).clamp(0.0, 1.0));
        let behind = if side > 0.0 { 0.0 } else { 0.5 };
        let (place, heading) = on_circle((cycle - phase + 0.5 * STANCE + swing - behind + CYCLES) / CYCLES);
        let lift = 0.05 * 4.0 * swing * (1.0 - swing);
        let pitch = pitch(phase);
        let turn = heading * turned(DVec3::X, pitch);
        // The tip of the toes stays in place while the heel lifts.
        let sole = |along: f64| turn * DVec3::new(0.0, -ANKLE, along);
        let lowest = sole(TOES).y.min(sole(HEEL).y);
        let toes = place + heading * DVec3::new(side * ASIDE, 0.0, TOES);
        let mut ankle = toes - sole(TOES);
        ankle.y = lift - lowest;
        Self { ankle, turn }
    }
}

fn smooth(share: f64) -> f64 {
    share * share * (3.0 - 2.0 * share)
}

fn pitch(phase: f64) -> f64 {
    let next = PITCHES.iter().position(|[at, _]| *at > phase).unwrap_or(PITCHES.len() - 1);
    let ([from, a], [to, b]) = (PITCHES[next.saturating_sub(1)], PITCHES[next]);
    a + (b - a) * smooth(((phase - from) / (to - from)).clamp(0.0, 1.0))
}

/// Returns the world rotations of thigh and shin that bring the ankle to `ankle`, as far as the length of the leg
/// allows, with the knee bent towards the heading.
fn bent(hip: DVec3, ankle: DVec3, heading: DQuat) -> [DQuat; 2] {
    let [thigh, shin] = [JOINTS[LEGS[0]].at.y - JOINTS[LEGS[0] + 1].at.y, JOINTS[LEGS[0] + 1].at.y - ANKLE];
    let towards = ankle - hip;
    let distance = towards.length().clamp(0.3, 0.999 * (thigh + shin));
    let towards = towards.normalize_or(DVec3::NEG_Y);
    let forward = (heading * DVec3::Z).reject_from_normalized(towards).normalize();
    let along = (thigh * thigh - shin * shin + distance * distance) / (2.0 * distance);
    let knee = hip + towards * along + forward * (thigh * thigh - along * along).max(0.0).sqrt();
    let bone = |from: DVec3, to: DVec3| {
        let up = (from - to).normalize();
        let front = (heading * DVec3::X).cross(up).normalize();
        DQuat::from_mat3(&DMat3::from_cols(up.cross(front), up, front))
    };
    [bone(hip, knee), bone(knee, hip + towards * distance)]
}
