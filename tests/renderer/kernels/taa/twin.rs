//! Temporal antialiasing by the published methods (Karis 2014; Salvi 2016; Catmull & Rom 1974), with the changes listed
//! at the top of the shader.

use std::ops::Range;

use glam::{DVec2, DVec3, DVec4};

use crate::kernels::camera::{Constants, Eye, STORAGE_SCALE};
use crate::kernels::harness::Stripe;
use crate::kernels::inputs::Cases;
use crate::kernels::pack::{is_finite, luminance, rgb};

/// Value in place of a depth: the pixel's colour was not finite.
pub const DROPPED: f32 = -1.0;
/// Maximum history length in frames, for pixels that moved and for static ones.
const LONGEST_MOVED: f64 = 10.0;
const LONGEST_STILL: f64 = 255.0;
/// Maximum motion of slow pixels over their history, in pixels.
const LONGEST_WAY: f64 = 0.1;
/// Maximum difference of history from the neighbourhood's mean, in standard deviations.
const ALLOWED_DEVIATIONS: f64 = 2.5;

pub struct Twin<'a> {
    pub constants: &'a Constants,
    pub stripe: &'a Stripe,
    pub view: usize,
    /// Eye of the previous frame.
    pub eye: Eye,
    pub composed: &'a [[f32; 4]],
    pub last: &'a [[f32; 4]],
}

pub struct Resolved {
    pub color: DVec3,
    pub frames: f64,
    pub is_dropped: bool,
}

/// Neighbourhood of a pixel: mean and deviation of its colours, and place and depth of the nearest surface.
struct Surroundings {
    mean: DVec3,
    deviation: DVec3,
    front: (u32, u32),
    depth: f64,
}

/// Interpolates by Catmull–Rom between the second and third of four values, at `t`.
fn cubic(p: [DVec4; 4], t: f64) -> DVec4 {
    let tangents = [(p[2] - p[0]) * 0.5, (p[3] - p[1]) * 0.5];
    let (t2, t3) = (t * t, t * t * t);
    p[1] * (2.0 * t3 - 3.0 * t2 + 1.0)
        + p[2] * (3.0 * t2 - 2.0 * t3)
        + tangents[0] * (t3 - 2.0 * t2 + t)
        + tangents[1] * (t3 - t2)
}

impl Twin<'_> {
    /// Returns the pixel nearest to an image point's row and column, within these rows.
    fn held(&self, x: i64, y: i64, rows: &Range<u32>) -> (u32, u32) {
        let x = x.clamp(0, i64::from(self.constants.width) - 1);
        let y = y.clamp(i64::from(rows.start), i64::from(rows.end) - 1);
        (x as u32, y as u32)
    }

    fn surroundings(&self, x: u32, y: u32) -> Surroundings {
        let depth = self.composed[self.constants.index(x, y)][3].into();
        let mut around = Surroundings { mean: DVec3::ZERO, deviation: DVec3::ZERO, front: (x, y), depth };
        let mut square = DVec3::ZERO;
        for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
            let held = self.held(i64::from(x) + dx, i64::from(y) + dy, &self.stripe.valid);
            let texel = self.composed[self.constants.index(held.0, held.1)];
            let bounded = rgb(texel).min(DVec3::splat(1e18));
            around.mean += bounded / 9.0;
            square += bounded * bounded / 9.0;
            let depth = f64::from(texel[3]);
            if depth > 0.0 && (around.depth <= 0.0 || depth < around.depth) {
                (around.front, around.depth) = (held, depth);
            }
        }
        around.deviation = (square - around.mean * around.mean).max(DVec3::ZERO).map(f64::sqrt);
        around
    }

    /// Returns the motion of the front surface since the previous frame, in pixels; none if it was behind the eye.
    fn motion(&self, around: &Surroundings) -> Option<DVec2> {
        let (now, size) = (&self.constants.eyes[self.view], self.constants.size());
        let at = self.constants.through(around.front.0, around.front.1);
        let ray = now.ray(at, size);
        // The sky is infinitely far, so only rotation of the eye moves it.
        let point = match around.depth > 0.0 {
            true => now.origin.as_dvec3() + ray * around.depth,
            false => self.eye.origin.as_dvec3() + ray,
        };
        self.eye.seen_at(point, size).map(|(seen, _)| seen - at)
    }

    /// Returns colour and frame count of the previous frame, interpolated at an image point in whole pixels.
    fn history(&self, row: u32, at: DVec2) -> Option<DVec4> {
        let reach = self.constants.history_rows?;
        let size = self.constants.size();
        let (base, t) = (at.floor(), at - at.floor());
        let valid = &self.stripe.valid;
        let rows = valid.start.max(row.saturating_sub(reach))..valid.end.min(row + reach + 1);
        let is_inside = at.cmpgt(DVec2::splat(-0.5)).all() && at.cmplt(size - 0.5).all();
        let has_rows = (i64::from(rows.start) - 1..i64::from(rows.end)).contains(&(base.y as i64));
        if !is_inside || !has_rows {
            return None;
        }
        let texel = |dx: i64, dy: i64| {
            let (x, y) = self.held(base.x as i64 + dx, base.y as i64 + dy, &rows);
            let texel = self.last[self.constants.index(x, y)];
            rgb(texel).extend(texel[3].into())
        };
        let rows = [-1, 0, 1, 2].map(|dy| cubic([-1, 0, 1, 2].map(|dx| texel(dx, dy)), t.x));
        Some(cubic(rows, t.y))
    }

    pub fn pixel(&self, x: u32, y: u32, cases: &mut Cases) -> Resolved {
        let texel = self.composed[self.constants.index(x, y)];
        let (now, was_dropped) = (rgb(texel), texel[3] == DROPPED);
        let around = self.surroundings(x, y);
        cases.meet(match (around.depth > 0.0, around.front == (x, y)) {
            (false, _) => "sky",
            (true, true) => "a surface",
            (true, false) => "a silhouette",
        });
        let is_still = self.eye == self.constants.eyes[self.view];
        let motion = if is_still { Some(DVec2::ZERO) } else { self.motion(&around) };
        let old = motion.and_then(|m| self.history(y, DVec2::new(x.into(), y.into()) + m));
        let known = old.filter(|old| is_finite(old.truncate()) && (old.w as f32).is_finite());
        // The slower a pixel moves, the longer its history.
        let way = motion.unwrap_or_default().abs().max_element().max(LONGEST_WAY / LONGEST_STILL);
        let stillness = (LONGEST_WAY / way - LONGEST_MOVED).max(0.0) / (LONGEST_STILL - LONGEST_MOVED);
        // Frames with several samples are already antialiased.
        let deviation = luminance(around.deviation) * f64::from(STORAGE_SCALE);
        let moved = LONGEST_MOVED / f64::from(self.constants.spp).sqrt() / (1.0 + deviation);
        let longest = moved + stillness * (LONGEST_STILL - moved);
        let mut frames = 0.0;
        let mut past = DVec3::ZERO;
        if let Some(old) = known {
            cases.meet(match (is_still, stillness > 0.0) {
                (true, _) => "history of an eye that stands still",
                (false, true) => "history that moved slowly",
                (false, false) => "history that moved",
            });
            frames = old.w.round_ties_even().clamp(0.0, longest);
            let half = around.deviation * ALLOWED_DEVIATIONS;
            let color = old.truncate();
            let clamped = color.max(around.mean - half).min(around.mean + half);
            past = if is_still { color } else { clamped.lerp(color, stillness) };
        } else {
            cases.meet(if old.is_some() { "history that is not finite" } else { "no history" });
        }
        let total = frames + if was_dropped { 0.0 } else { 1.0 };
        let joined = if total > 0.0 { now + (past - now) * (frames / total) } else { now };
        let is_sound = is_finite(joined);
        if was_dropped {
            cases.meet("a pixel that was dropped");
        }
        if !is_sound {
            cases.meet("a colour that is not finite");
        }
        let is_dropped = was_dropped || (old.is_some() && known.is_none()) || !is_sound;
        Resolved { color: if is_sound { joined } else { now }, frames: total, is_dropped }
    }
}
