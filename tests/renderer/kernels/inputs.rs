//! Random images of surfaces and light, and a record of the cases that a test covered.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

use glam::{DVec2, DVec3};

use super::camera::{Constants, Eye};
use super::harness::Stripe;
use super::pack::{ABSENT, Light, NO_NORMAL, pack_guide};
use crate::reference::sampling::{Rng, tangents};

/// Size of most images, which is not a multiple of the workgroups' edge.
pub const WIDTH: u32 = 21;
pub const HEIGHT: u32 = 19;

/// Returns the whole image, and stripes at its borders and inside, with and without rows around them.
pub fn stripes() -> [Stripe; 6] {
    [(0..19, 0..19), (5..14, 2..18), (9..10, 9..10), (12..19, 10..19), (0..4, 0..8), (1..7, 0..9)]
        .map(|(rows, valid)| Stripe { rows, valid })
}

pub struct Random(Rng);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(Rng::new(seed, 0))
    }

    pub fn bits(&mut self) -> u32 {
        self.0.bits() as u32
    }

    pub fn within(&mut self, range: Range<f64>) -> f64 {
        range.start + (range.end - range.start) * self.0.uniform()
    }

    pub fn chance(&mut self, probability: f64) -> bool {
        self.0.uniform() < probability
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.0.bits() as usize % from.len()]
    }

    /// Returns a colour whose components are below `most`, and rarely much brighter.
    pub fn color(&mut self, most: f64) -> DVec3 {
        let most = if self.chance(0.05) { 30.0 * most } else { most };
        DVec3::from_array(std::array::from_fn(|_| self.within(0.0..most)))
    }

    /// Returns a unit vector at an angle of at most `angle` from the unit vector `n`.
    pub fn tilted(&mut self, n: DVec3, angle: f64) -> DVec3 {
        let ((t, b), tilt, turn) = (tangents(n), self.within(0.0..angle), self.within(0.0..TAU));
        (n * tilt.cos() + (t * turn.cos() + b * turn.sin()) * tilt.sin()).normalize()
    }

    pub fn light(&mut self, most: f64) -> Light {
        Light { matte: self.color(most), gloss: self.color(0.5 * most), variance: DVec2::ZERO }
    }

    /// Returns the light, in which one channel of a lobe or all of them may be absent.
    pub fn with_absent(&mut self, light: Light) -> Light {
        let mut lobe = |light: DVec3| match self.bits() % 10 {
            0 => DVec3::splat(ABSENT),
            1 => light.with_x(ABSENT),
            2 => light.with_y(ABSENT).with_z(ABSENT),
            _ => light,
        };
        Light { matte: lobe(light.matte), gloss: lobe(light.gloss), ..light }
    }

    /// Returns random words for an image that a kernel must overwrite.
    pub fn rubbish<const N: usize>(&mut self, count: usize) -> Vec<[u32; N]> {
        (0..count).map(|_| std::array::from_fn(|_| self.bits())).collect()
    }
}

/// A plane that fills the view, with deviations of its pixels.
#[derive(Clone, Copy)]
pub struct Wall {
    pub point: DVec3,
    pub normal: DVec3,
    /// Maximum distance of a pixel's surface from the plane, relative to its distance from the eye.
    pub bumps: f64,
    /// Maximum angle between a pixel's normal and the plane's.
    pub tilt: f64,
    /// Fraction of pixels with a random normal.
    pub stray: f64,
    /// Fraction of pixels without a surface.
    pub sky: f64,
}

impl Wall {
    pub fn new(bumps: f64, tilt: f64, sky: f64) -> Self {
        let normal = DVec3::new(0.2, 0.1, 1.0).normalize();
        Self { point: DVec3::new(0.0, 0.0, -4.0), normal, bumps, tilt, stray: 0.05, sky }
    }

    /// Returns the intersection of a ray with the plane.
    pub fn met_by(&self, eye: &Eye, direction: DVec3) -> DVec3 {
        let origin = eye.origin.as_dvec3();
        origin + direction * ((self.point - origin).dot(self.normal) / direction.dot(self.normal))
    }

    /// Returns a pixel of the guide image.
    pub fn guide(&self, random: &mut Random, constants: &Constants, view: usize, (x, y): (u32, u32)) -> [u32; 4] {
        if random.chance(self.sky) {
            return [0, 0, 0, NO_NORMAL];
        }
        let eye = &constants.eyes[view];
        let on = self.met_by(eye, eye.ray(constants.through(x, y), constants.size()));
        let off = random.within(-self.bumps..self.bumps) * on.distance(eye.origin.as_dvec3());
        let tilt = if random.chance(self.stray) { PI } else { self.tilt };
        pack_guide(on + self.normal * off, random.tilted(self.normal, tilt))
    }

    pub fn guides(&self, random: &mut Random, constants: &Constants, view: usize) -> Vec<[u32; 4]> {
        let pixels = (0..constants.height).flat_map(|y| (0..constants.width).map(move |x| (x, y)));
        pixels.map(|pixel| self.guide(random, constants, view, pixel)).collect()
    }
}

/// Counts of a kernel's cases that a test covered.
#[derive(Default)]
pub struct Cases(BTreeMap<&'static str, usize>);

impl Cases {
    pub fn meet(&mut self, case: &'static str) {
        *self.0.entry(case).or_default() += 1;
    }

    pub fn count(&self, case: &'static str) -> usize {
        self.0.get(case).copied().unwrap_or(0)
    }

    #[track_caller]
    pub fn assert_met(&self, cases: &[&'static str]) {
        let missing: Vec<_> = cases.iter().filter(|case| !self.0.contains_key(**case)).collect();
        assert!(missing.is_empty(), "the inputs have no case of {missing:?}; they have {:?}", self.0);
    }
}
