//! Search for a viewpoint if a file has no camera: in front of an object, or inside a room.
//!
//! Ray casts tell a room from an object: a room has a flat floor, surrounds the viewer on all sides, and shows more
//! distinct triangles from inside than from outside.

mod inside;
mod outside;
mod surfaces;

use glam::DVec3;

use self::surfaces::Surfaces;
use super::budget::{Budget, Reserved};
use super::rig::{DEFAULT_BASELINE_M, Rig};
use super::{Bounds, Scene};

/// Default vertical fields of view in degrees: inside a room, and of an object seen from outside, which would look
/// distorted in a wider field of view.
const INSIDE_YFOV_DEG: f64 = 70.0;
const OUTSIDE_YFOV_DEG: f64 = 40.0;

/// Limit on triangles after instancing: the search flattens all instances and builds a BVH only for itself.
const MOST_TRIANGLES: usize = 1 << 20;

/// Memory that the search reserves per triangle, bytes.
const TRIANGLE_BYTES: usize = 640;

/// Direction from which an object is seen, and magnification.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// Angle from the object's front, which is +z, towards +x, degrees.
    pub azimuth_deg: f32,
    /// Angle above the horizon, degrees.
    pub elevation_deg: f32,
    /// Factor on the object's size in the picture, above 0.
    pub zoom: f32,
}

impl Orbit {
    pub const FRONT: Self = Self::from(0.0, 8.0);
    pub const THREE_QUARTER: Self = Self::from(30.0, 20.0);
    pub const TOP: Self = Self::from(0.0, 89.0);
    /// Views of the whole scene from outside, with their names.
    pub const NAMED: [(&str, Self); 3] =
        [("front", Self::FRONT), ("three-quarter", Self::THREE_QUARTER), ("top", Self::TOP)];

    const fn from(azimuth_deg: f32, elevation_deg: f32) -> Self {
        Self { azimuth_deg, elevation_deg, zoom: 1.0 }
    }
}

/// Constraints on the viewpoint.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    pub metres_per_unit: f64,
    pub yfov_rad: Option<f64>,
    /// Direction from which the scene is seen from outside; `None` leaves it to the search.
    pub orbit: Option<Orbit>,
    /// True if a closed room without lights gets light.
    pub lights_rooms: bool,
}

impl Default for Wanted {
    fn default() -> Self {
        Self { metres_per_unit: 1.0, yfov_rad: None, orbit: None, lights_rooms: false }
    }
}

/// Viewpoint found for a scene without a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    pub rig: Rig,
    /// Surroundings of a viewpoint inside a room.
    pub room: Option<Room>,
}

/// Surroundings of a viewpoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Room {
    /// Fraction of directions in which the room is open.
    pub openness: f32,
    /// Mean distance to the room's surfaces, scene units.
    pub distance: f32,
    /// Distance to the surface above, or the mean distance if there is none, scene units.
    pub headroom: f32,
}

/// Reserves memory for a search. Returns `None` for scenes with too many triangles or over the budget.
fn reserve<'a>(scene: &Scene, budget: &'a Budget) -> Option<Reserved<'a>> {
    let count = scene.triangle_count();
    (count <= MOST_TRIANGLES).then(|| budget.reserve((count * TRIANGLE_BYTES) as u64).ok()).flatten()
}

/// Returns the surroundings of a point that was not searched for. Returns `None` outside the scene's bounds, for scenes
/// without triangles, with too many, or over the budget.
pub fn room_around(scene: &Scene, position: DVec3, budget: &Budget) -> Option<Room> {
    let Bounds { min, max } = scene.bounds();
    let is_within = min.as_dvec3().cmple(position).all() && position.cmple(max.as_dvec3()).all();
    let _reserved = is_within.then(|| reserve(scene, budget)).flatten()?;
    let surfaces = Surfaces::of(scene, 1.0, true)?;
    Some(surfaces.room(surfaces.local(position)))
}

/// Finds a viewpoint. Returns that of [`Rig::framing`] for scenes without triangles, with too many, or over the budget.
pub fn find(scene: &Scene, wanted: &Wanted, budget: &Budget) -> Viewpoint {
    let Wanted { metres_per_unit, .. } = *wanted;
    let yfov_rad = |default_deg: f64| wanted.yfov_rad.unwrap_or(default_deg.to_radians());
    let reserved = reserve(scene, budget);
    let surfaces = reserved.as_ref().and_then(|_| Surfaces::of(scene, metres_per_unit, wanted.lights_rooms));
    let (room, rig) = match (surfaces, wanted.orbit) {
        (None, _) => (None, Rig::framing(scene.bounds(), yfov_rad(OUTSIDE_YFOV_DEG))),
        (Some(surfaces), Some(orbit)) => {
            let from = surfaces::direction(orbit.azimuth_deg, orbit.elevation_deg.clamp(-89.0, 89.0));
            (None, surfaces.rig_before(from, orbit.zoom, yfov_rad(OUTSIDE_YFOV_DEG)))
        }
        (Some(surfaces), None) => {
            let around = surfaces.best_side();
            match surfaces.best_stand().filter(|stand| stand.seen > around.seen) {
                Some(stand) => (Some(surfaces.room(stand.eye)), surfaces.rig_within(&stand, yfov_rad(INSIDE_YFOV_DEG))),
                None => (None, surfaces.rig_before(around.from, 1.0, yfov_rad(OUTSIDE_YFOV_DEG))),
            }
        }
    };
    // Limits the baseline, so that a viewer can fuse even scenes that are smaller than a head.
    let distance_m = (rig.keys[0].position - rig.keys[0].target).length() * metres_per_unit;
    let widest_m = distance_m / if room.is_some() { 15.0 } else { 30.0 };
    let rig = Rig { baseline_m: DEFAULT_BASELINE_M.min(widest_m), metres_per_unit, ..rig };
    Viewpoint { rig, room }
}

#[cfg(test)]
mod tests;
