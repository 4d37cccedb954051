//! Views from inside a room.

use std::collections::HashSet;

use glam::{Vec3A, vec3a};

use super::surfaces::{Met, Surfaces, axes, direction, sphere};
use super::{INSIDE_YFOV_DEG, Room};
use crate::scene::rig::Rig;

/// Heights in metres: of the eyes above a floor, of rooms in which people stand, and of the lowest usable room.
const EYE_HEIGHT_M: f32 = 1.6;
const ROOM_HEIGHTS_M: std::ops::Range<f32> = 2.0..12.0;
const LEAST_HEIGHT_M: f32 = 1.0;

/// Minimum distance to the surfaces in the middle of the picture, metres.
const LEAST_AHEAD_M: f32 = 1.0;

/// A view from inside, and the number of distinct triangles whose front faces are hit by rays from its position.
#[derive(Clone, Copy)]
pub struct Stand {
    pub eye: Vec3A,
    ahead: Vec3A,
    pub seen: usize,
}

impl Surfaces {
    /// Returns the best view from a position that is above a floor and surrounded by surfaces.
    pub fn best_stand(&self) -> Option<Stand> {
        const COLUMNS: usize = 9;
        /// Number of most promising positions that are examined more closely.
        const LOOKED_FROM: usize = 24;
        let share = |i: usize| (i as f32 + 0.5) / COLUMNS as f32;
        let at = |i: usize| self.min + (self.max - self.min) * vec3a(share(i % COLUMNS), 0.0, share(i / COLUMNS));
        let eyes = (0..COLUMNS * COLUMNS).flat_map(|i| self.eyes_above_floors(at(i).x, at(i).z));
        let mut stands: Vec<_> = eyes.filter_map(|eye| Some((self.seen_around(eye, 128)?, eye))).collect();
        stands.sort_by_key(|(seen, _)| std::cmp::Reverse(*seen));
        stands.truncate(LOOKED_FROM);
        let stands = stands.into_iter().filter_map(|(_, eye)| Some((self.seen_around(eye, 1024)?, eye)));
        let views = stands.flat_map(|(seen, eye)| {
            let turns = (0..16).map(|i| direction(22.5 * i as f32, -5.0));
            turns.map(move |ahead| Stand { eye, ahead, seen })
        });
        let views = views.filter_map(|stand| Some((self.worth(&stand)?, stand)));
        views.max_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, stand)| stand)
    }

    /// Returns the number of distinct triangles whose front faces are hit by `rays` rays from `eye`. Returns `None`
    /// unless front faces form a room around `eye`, and light sources or openings to the outside can light it.
    fn seen_around(&self, eye: Vec3A, rays: usize) -> Option<usize> {
        let met: Vec<(Vec3A, Option<Met>)> = sphere(rays).map(|d| (d, self.meet(eye, d))).collect();
        let hits = met.iter().filter_map(|(_, met)| met.as_ref());
        let count = hits.clone().count();
        let fronts: Vec<u32> = hits.filter(|m| m.is_front).map(|m| m.triangle).collect();
        let is_within = 10 * count >= 7 * rays && 10 * fronts.len() >= 9 * count;
        let is_bright = self.is_lit || 50 * (rays - count) >= rays;
        (is_within && is_bright && is_room(&met)).then(|| fronts.into_iter().collect::<HashSet<_>>().len())
    }

    /// Returns positions at eye height above the floors that the vertical line at (`x`, `z`) hits.
    fn eyes_above_floors(&self, x: f32, z: f32) -> Vec<Vec3A> {
        const MOST_FLOORS: usize = 8;
        let mut eyes = Vec::new();
        let mut top = vec3a(x, self.max.y + 0.1, z);
        for _ in 0..MOST_FLOORS {
            let Some(met) = self.meet(top, Vec3A::NEG_Y) else { break };
            let floor = top - Vec3A::Y * met.t;
            let ceiling = self.meet(floor + Vec3A::Y * 1e-3, Vec3A::Y).map_or(self.max.y, |m| floor.y + 1e-3 + m.t);
            let free = ceiling - floor.y;
            let metres_per_unit = self.metres_per_unit as f32;
            let free_m = free * metres_per_unit;
            let is_room = ROOM_HEIGHTS_M.contains(&free_m);
            let height = if is_room { EYE_HEIGHT_M / metres_per_unit } else { 0.55 * free };
            if met.is_front && free > 0.05 && free_m >= LEAST_HEIGHT_M {
                eyes.push(floor + Vec3A::Y * height);
            }
            top = floor - Vec3A::Y * 1e-3;
        }
        eyes
    }

    /// Returns a view's score. Deep views of many triangles, with none too near, score best. Returns `None` if the
    /// middle of the picture is too near.
    fn worth(&self, stand: &Stand) -> Option<f32> {
        const RAYS: [usize; 2] = [20, 12];
        let [right, up, ahead] = axes(stand.ahead);
        let tan = (INSIDE_YFOV_DEG as f32 / 2.0).to_radians().tan();
        let least = LEAST_AHEAD_M / self.metres_per_unit as f32;
        let (mut seen, mut depth) = (HashSet::new(), 0.0);
        for i in 0..RAYS[0] * RAYS[1] {
            let at = |i: usize, n: usize| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
            let [x, y] = [at(i % RAYS[0], RAYS[0]) * 16.0 / 9.0, at(i / RAYS[0], RAYS[1])];
            let Some(met) = self.meet(stand.eye, (ahead + (right * x + up * y) * tan).normalize()) else { continue };
            if x.abs() < 0.4 && y.abs() < 0.4 && met.t < least {
                return None;
            }
            depth += if met.is_front && met.t > 0.05 { met.t.min(1.6) } else { -1.0 };
            seen.extend(met.is_front.then_some(met.triangle));
        }
        Some(depth.max(0.0) * (seen.len() as f32).sqrt())
    }

    pub fn rig_within(&self, stand: &Stand, yfov_rad: f64) -> Rig {
        self.rig(stand.eye, stand.eye + stand.ahead * 0.5, yfov_rad)
    }

    /// Describes the surroundings of a point.
    pub fn room(&self, eye: Vec3A) -> Room {
        const RAYS: usize = 1024;
        let distances: Vec<f32> = sphere(RAYS).filter_map(|d| self.meet(eye, d)).map(|met| met.t).collect();
        let mean = distances.iter().sum::<f32>() / distances.len().max(1) as f32;
        let headroom = self.meet(eye, Vec3A::Y).map_or(mean, |met| met.t);
        let [distance, headroom] = [mean, headroom].map(|t| t * self.radius as f32);
        Room { openness: 1.0 - distances.len() as f32 / RAYS as f32, distance, headroom }
    }
}

/// True if surfaces are on all sides: on all four sides and below, and some above, and the floor is flat, unlike the
/// inside of a ball or a wheel.
fn is_room(met: &[(Vec3A, Option<Met>)]) -> bool {
    let sides: [Vec3A; 6] = [Vec3A::X, Vec3A::NEG_X, Vec3A::Z, Vec3A::NEG_Z, Vec3A::NEG_Y, Vec3A::Y];
    let least = [0.5, 0.5, 0.5, 0.5, 0.8, 0.3];
    let is_closed = sides.into_iter().zip(least).all(|(side, least)| {
        let towards = met.iter().filter(|(d, _)| d.dot(side) > 0.7);
        let hit = towards.clone().filter(|(_, met)| met.is_some()).count();
        hit as f32 >= least * towards.count() as f32
    });
    let below = met.iter().filter(|(d, _)| d.y < -0.6).filter_map(|(d, met)| Some((d, met.as_ref()?)));
    let mut depths: Vec<f32> = below.clone().map(|(d, met)| -d.y * met.t).collect();
    depths.sort_by(f32::total_cmp);
    let Some(&depth) = depths.get(depths.len() / 2) else { return false };
    let flat = below.filter(|(d, met)| met.normal.y > 0.95 && (-d.y * met.t - depth).abs() < 0.05 * depth).count();
    is_closed && 2 * flat >= depths.len()
}
