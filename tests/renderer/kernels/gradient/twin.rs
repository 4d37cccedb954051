//! Temporal gradients by definition (Schied et al. 2018, section 4), under a single sun without indirect light.

use std::f64::consts::PI;
use std::ops::Range;

use diptych::accel::SPHERE;
use glam::{DVec2, DVec3};

use crate::kernels::camera::{Constants, Eye};
use crate::kernels::edges::Surface;
use crate::kernels::harness::Stripe;
use crate::kernels::inputs::Cases;
use crate::kernels::pack::luminance;

/// Edge of a tile, pixels.
pub const TILE: u32 = 3;

/// A hit on a triangle.
pub struct Met {
    pub triangle: usize,
    /// Weights of the second and the third corner.
    pub weights: [f64; 2],
    pub position: DVec3,
}

/// Triangles lit by a sun.
pub struct World {
    pub triangles: Vec<[DVec3; 3]>,
    /// Unit vector in the direction of the light.
    pub sun: DVec3,
    /// Irradiance of a surface that faces the sun, in the unit of stored light.
    pub strength: DVec3,
}

impl World {
    fn normal(&self, triangle: usize) -> DVec3 {
        let [a, b, c] = self.triangles[triangle];
        (b - a).cross(c - a).normalize()
    }

    /// Returns a triangle's normal on the side of a viewer who looks along `direction`.
    pub fn normal_towards(&self, triangle: usize, direction: DVec3) -> DVec3 {
        let normal = self.normal(triangle);
        if normal.dot(direction) > 0.0 { -normal } else { normal }
    }

    /// Returns the first hit along a ray at a distance of at least `from` (Möller & Trumbore 1997).
    pub fn meets(&self, origin: DVec3, direction: DVec3, from: f64) -> Option<Met> {
        let mut nearest = f64::INFINITY;
        let mut found = None;
        for (triangle, [a, b, c]) in self.triangles.iter().enumerate() {
            let (e1, e2, s) = (*b - *a, *c - *a, origin - *a);
            let (p, q) = (direction.cross(e2), s.cross(e1));
            let det = e1.dot(p);
            let (u, v, t) = (s.dot(p) / det, direction.dot(q) / det, e2.dot(q) / det);
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > from && t < nearest {
                nearest = t;
                found = Some(Met { triangle, weights: [u, v], position: origin + direction * t });
            }
        }
        found
    }

    /// Returns the luminance of demodulated light that a point of a Lambertian surface reflects; none at a shadow's
    /// edge, where rounding decides.
    /// rounding decides.
    pub fn light_at(&self, position: DVec3, normal: DVec3) -> Option<f64> {
        let cosine = -normal.dot(self.sun);
        let aside = normal.any_orthonormal_vector() * 0.002;
        let around = [DVec3::ZERO, aside, -aside, normal.cross(aside), -normal.cross(aside)];
        let is_hidden = around.map(|off| self.meets(position + off, -self.sun, 1e-4).is_some());
        let is_clear = is_hidden.iter().all(|hidden| *hidden == is_hidden[0]);
        let lit = if is_hidden[0] { 0.0 } else { luminance(self.strength) * cosine.max(0.0) / PI };
        (is_clear || cosine <= 0.0).then_some(lit)
    }
}

/// The previous frame, by pixel.
pub struct Before {
    pub eye: Eye,
    /// Frame number and probes, by tile and negative where there is none; `None` if pixels had one sample.
    pub probes: Option<(u32, Vec<f32>)>,
    pub guide: Vec<Option<Surface>>,
    /// Contents of the hit image: the visible triangle, and weights of its corners.
    pub hit: Vec<[u32; 4]>,
    /// Luminance of demodulated light; none if the pixel was not sampled.
    pub then: Vec<Option<f64>>,
}

pub struct Twin<'a> {
    pub world: &'a World,
    /// Constants of the frame, in pixels instead of tiles.
    pub constants: &'a Constants,
    /// Rows of tiles.
    pub stripe: &'a Stripe,
    pub lost: Range<u32>,
    /// Surfaces of this frame at their positions in the previous frame.
    pub last_surface: &'a [Option<Surface>],
    pub before: &'a Before,
}

/// Hashes by a permuted congruential generator (Jarzynski & Olano, JCGT 9(3), 2020).
fn pcg(value: u32) -> u32 {
    let state = value.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

fn combined(a: u32, b: u32) -> u32 {
    pcg(a ^ pcg(b.wrapping_add(0x9e37_79b9)))
}

impl Twin<'_> {
    /// Returns the pixel that represents a tile in frame number `index`.
    fn pick(&self, index: u32, (x, y): (u32, u32)) -> (u32, u32) {
        let place = combined(combined(index, x), y) % (TILE * TILE);
        let (x, y) = (x * TILE + place % TILE, y * TILE + place / TILE);
        (x.min(self.constants.width - 1), y.min(self.constants.height - 1))
    }

    /// Returns the change of light, and the larger of the old and new light; none if rounding decides.
    pub fn tile(&self, tile: (u32, u32), cases: &mut Cases) -> Option<DVec2> {
        let nothing = |cases: &mut Cases, case| {
            cases.meet(case);
            Some(DVec2::ZERO)
        };
        let (constants, before) = (self.constants, self.before);
        let (x, y) = self.pick(constants.index, tile);
        let Some(surface) = &self.last_surface[constants.index(x, y)] else { return nothing(cases, "no surface") };
        let Some(reach) = constants.history_rows else { return nothing(cases, "no history") };
        let Some((seen, z)) = before.eye.seen_at(surface.position, constants.size()) else {
            return nothing(cases, "behind the eye");
        };
        let between = (seen - seen.round()).abs().min_element();
        if between < 1e-4 {
            return None;
        }
        if seen.cmplt(DVec2::ZERO).any() || seen.cmpge(constants.size()).any() {
            return nothing(cases, "outside the image");
        }
        let (column, row) = (seen.x as u32, seen.y as u32);
        let valid = self.stripe.valid.start * TILE..self.stripe.valid.end * TILE;
        if row.abs_diff(y) > reach || !valid.contains(&row) {
            return nothing(cases, if valid.contains(&row) { "beyond the reach" } else { "rows that are not there" });
        }
        let (mut column, mut row, mut probe) = (column, row, None);
        if let Some((index, probes)) = &before.probes {
            let there = (column / TILE, row / TILE);
            let light = probes[(there.1 * constants.width.div_ceil(TILE) + there.0) as usize];
            if light < 0.0 {
                return nothing(cases, "no probe");
            }
            (column, row) = self.pick(*index, there);
            let around = (tile.1 * TILE).saturating_sub(reach)..(tile.1 + 1) * TILE + reach;
            if !valid.contains(&row) || !around.contains(&row) {
                return nothing(cases, "a probe beyond the reach");
            }
            probe = Some(f64::from(light));
        }
        if self.lost.contains(&row) {
            return nothing(cases, "lost rows");
        }
        let at = constants.index(column, row);
        let is_same = |then: &&Surface| {
            let off = surface.normal.dot(then.position - surface.position).abs();
            off < 0.01 * z && surface.normal.dot(then.normal) > 0.9
        };
        let Some(then) = before.guide[at].as_ref().filter(is_same) else { return nothing(cases, "another surface") };
        let Some(light) = probe.or(before.then[at]) else { return nothing(cases, "not sampled") };
        let [prim, u, v, _] = before.hit[at];
        if prim & SPHERE != 0 {
            return nothing(cases, "a lamp");
        }
        let [a, b, c] = self.world.triangles[prim as usize];
        let [u, v] = [u, v].map(|bits| f64::from(f32::from_bits(bits)));
        let direction = then.position - before.eye.origin.as_dvec3();
        let normal = self.world.normal_towards(prim as usize, direction);
        let now = self.world.light_at(a * (1.0 - u - v) + b * u + c * v, normal)?;
        cases.meet(match now {
            0.0 if light == 0.0 => "dark as before",
            0.0 => "dark",
            _ if light == 0.0 => "lit",
            _ => "lit as well",
        });
        Some(DVec2::new(now - light, now.max(light)))
    }
}
