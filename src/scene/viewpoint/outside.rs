//! Views of an object from outside.

use std::collections::HashSet;

use glam::Vec3A;

use super::Orbit;
use super::surfaces::{Surfaces, axes, direction};
use crate::scene::rig::Rig;

/// Fraction of the smaller side of the picture that the object fills.
const FILLED: f32 = 0.7;

/// The best view from outside, and the number of distinct triangles whose front faces are hit by rays from any of the
/// tested outside views.
pub struct Side {
    /// Unit vector from the object to the eyes.
    pub from: Vec3A,
    pub seen: usize,
}

impl Surfaces {
    /// Returns the view from outside in which the number of rays that hit front faces, minus that of rays that hit back
    /// faces, is largest. Prefers [`Orbit::THREE_QUARTER`], unless another one is much better, and views from above the
    /// horizon.
    pub fn best_side(&self) -> Side {
        const RAYS: usize = 18;
        let Orbit { azimuth_deg: yaw, elevation_deg: pitch, .. } = Orbit::THREE_QUARTER;
        let mut seen = HashSet::new();
        let mut best: Option<(f32, Vec3A)> = None;
        for (yaw_deg, pitch_deg) in
            [(yaw, pitch), (-yaw, pitch), (180.0 - yaw, pitch), (yaw - 180.0, pitch), (0.0, 80.0), (0.0, -60.0)]
        {
            let from = direction(yaw_deg, pitch_deg);
            let ([right, up, _], reach) = (axes(-from), 3.0f32.sqrt());
            let mut share = 0.0;
            for i in 0..RAYS * RAYS {
                let at = |i: usize| 2.0 * (i as f32 + 0.5) / RAYS as f32 - 1.0;
                let origin = (right * at(i % RAYS) + up * at(i / RAYS)) * reach + from * 2.0 * reach;
                if let Some(met) = self.meet(origin, -from) {
                    share += if met.is_front { 1.0 } else { -1.0 };
                    seen.extend(met.is_front.then_some(met.triangle));
                }
            }
            if best.is_none_or(|(most, _)| share > 1.5 * most.max(0.0)) {
                best = Some((share, from));
            }
        }
        Side { from: best.map_or(Vec3A::Z, |(_, from)| from), seen: seen.len() }
    }

    /// Returns a rig of which a square picture shows the whole object, [`FILLED`] times `zoom` as large as the picture.
    pub fn rig_before(&self, from: Vec3A, zoom: f32, yfov_rad: f64) -> Rig {
        let [right, up, _] = axes(-from);
        let tan = (yfov_rad / 2.0).tan() as f32 * FILLED * zoom;
        // An eye at x = c sees a point if |x − c| ≤ (distance − depth) tan. The two extremes of depth ± x / tan over
        // all points give the smallest distance and the x at which it is reached.
        let mut most = [f32::NEG_INFINITY; 4];
        for p in self.triangles.iter().flat_map(|t| [t.v0, t.v1, t.v2]) {
            let (depth, x, y) = (p.dot(from), p.dot(right) / tan, p.dot(up) / tan);
            for (most, v) in most.iter_mut().zip([depth + x, depth - x, depth + y, depth - y]) {
                *most = most.max(v);
            }
        }
        let [x_right, x_left, y_up, y_down] = most;
        let distance = ((x_right + x_left) / 2.0).max((y_up + y_down) / 2.0);
        let target = right * (x_right - x_left) / 2.0 * tan + up * (y_up - y_down) / 2.0 * tan;
        self.rig(target + from * distance, target, yfov_rad)
    }
}
