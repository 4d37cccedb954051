//! Accumulation as the method has it (Schied et al. 2017; West 1979), with the departures that the shader's head names.

use glam::{DVec2, DVec3};

use super::moments::Moments;
use crate::kernels::camera::{Constants, Eye};
use crate::kernels::edges::Surface;
use crate::kernels::harness::Stripe;
use crate::kernels::inputs::Cases;
use crate::kernels::pack::{Light, MISSING, UNKNOWN, is_finite};

/// Least sum of weights that counts as history.
const LEAST_FOUND: f64 = 0.01;
/// Frames that the recent mean remembers, and from which on variance over time is known.
const FEW_FRAMES: f64 = 4.0;
/// Observations by which variance counts twice.
const FEW_OBSERVATIONS: f64 = 24.0;

/// What an eye has left of the frame before.
pub struct Before {
    pub eye: Eye,
    pub guide: Vec<Option<Surface>>,
    pub moments: Vec<Moments>,
    pub light: Vec<Light>,
}

/// History that was found around an image point of the frame before.
struct Past {
    light: Light,
    moments: Moments,
}

impl Past {
    fn is_finite(&self) -> bool {
        let m = &self.moments;
        let rest = [DVec3::new(m.mean.x, m.mean.y, m.recent), DVec3::new(m.variance.x, m.variance.y, m.samples)];
        [self.light.matte, self.light.gloss].into_iter().chain(rest).all(is_finite)
    }
}

/// What a pixel has in this frame.
pub struct Now {
    pub surface: Option<Surface>,
    pub material: u32,
    /// Of 0 to 1; gloss of smoother surfaces changes faster.
    pub roughness: f64,
    pub is_view_dependent: bool,
    /// What was sampled, with the variance of samples, which is below 0 unless it is told.
    pub light: Option<Light>,
}

pub struct After {
    pub light: Light,
    /// Frames are not rounded.
    pub moments: Moments,
    pub dropped: bool,
}

pub struct Twin<'a> {
    pub constants: &'a Constants,
    /// Samples per pixel of the frame before.
    pub last_spp: u32,
    pub stripe: &'a Stripe,
    pub gloss: bool,
    pub view: usize,
    /// The own eye's first, then the left one's.
    pub before: &'a [Before],
}

impl Twin<'_> {
    /// A mean over the four pixels around an image point, of those that show the same surface. With the sum of weights.
    fn past(&self, before: &Before, row: u32, surface: &Surface, material: u32) -> (f64, Past) {
        let mut past = Past {
            light: Light { matte: DVec3::ZERO, gloss: DVec3::ZERO, variance: DVec2::ZERO },
            moments: Moments::default(),
        };
        let Some((seen, z)) = before.eye.seen_at(surface.position, self.constants.size()) else { return (0.0, past) };
        let corner = seen - self.constants.centre.as_dvec2();
        let (base, fraction) = (corner.floor(), corner - corner.floor());
        let reach = self.constants.history_rows.expect("there is history");
        let valid = &self.stripe.valid;
        let rows = valid.start.max(row.saturating_sub(reach))..valid.end.min(row + reach + 1);
        let mut found = 0.0;
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let offset = ((base.x as i32).saturating_add(dx), (base.y as i32).saturating_add(dy));
            let Some(tap) = self.constants.tap((0, 0), offset, &rows) else { continue };
            let (Some(then), moments) = (&before.guide[tap], &before.moments[tap]) else { continue };
            let off = surface.normal.dot(then.position - surface.position).abs();
            let is_same = moments.material == material
                && off < 0.005 * z
                && surface.normal.dot(then.normal) > 0.9
                && moments.samples != 0.0;
            if !is_same {
                continue;
            }
            let share = |d: i32, fraction: f64| if d == 0 { 1.0 - fraction } else { fraction };
            let w = share(dx, fraction.x) * share(dy, fraction.y);
            past.light.matte += before.light[tap].matte * w;
            past.light.gloss += before.light[tap].gloss * w;
            past.moments.mean += moments.mean * w;
            past.moments.variance += moments.variance * w;
            past.moments.recent += moments.recent * w;
            past.moments.samples += moments.samples * w;
            past.moments.frames += moments.frames * w;
            found += w;
        }
        (found, past)
    }

    /// The history of the own eye, or else of the left one, divided by its weights; whether any was not finite; and how
    /// far the image point that was looked at last lies between pixels, 0 to 1.
    fn history(&self, row: u32, surface: &Surface, material: u32, cases: &mut Cases) -> (Option<Past>, bool, f64) {
        let (mut dropped, mut between) = (false, 0.0);
        for (i, before) in self.before.iter().enumerate() {
            let (found, mut past) = self.past(before, row, surface, material);
            if let Some((seen, _)) = before.eye.seen_at(surface.position, self.constants.size()) {
                let fraction = (seen - self.constants.centre.as_dvec2()).map(|v| v - v.floor());
                between = 4.0 * (fraction * (1.0 - fraction)).max_element();
            }
            if !past.is_finite() {
                cases.meet("history that is not finite");
                dropped = true;
                continue;
            }
            if found >= LEAST_FOUND {
                cases.meet(if i == 0 { "own history" } else { "the left eye's history" });
                past.light.matte /= found;
                past.light.gloss /= found;
                let m = &mut past.moments;
                (m.mean, m.variance) = (m.mean / found, m.variance / found);
                (m.recent, m.samples, m.frames) = (m.recent / found, m.samples / found, m.frames / found);
                return (Some(past), dropped, between);
            }
        }
        (None, dropped, between)
    }

    /// Nothing where there is no surface.
    pub fn pixel(&self, row: u32, now: &Now, cases: &mut Cases) -> Option<After> {
        let Some(surface) = &now.surface else {
            cases.meet("no surface");
            return None;
        };
        let black = Light { matte: DVec3::ZERO, gloss: DVec3::ZERO, variance: DVec2::splat(MISSING) };
        let nothing = Moments { material: now.material, ..Moments::default() };
        let (mut light, mut is_sampled, mut dropped) = (now.light.unwrap_or_default(), now.light.is_some(), false);
        let tells_variance = is_sampled && light.variance.x >= 0.0;
        if !is_finite(light.matte) || !is_finite(light.gloss) {
            cases.meet("light that is not finite");
            (light, is_sampled, dropped) = (black, false, true);
        }
        let (past, past_dropped, between) = self.history(row, surface, now.material, cases);
        dropped |= past_dropped;
        let new_samples = if is_sampled { f64::from(self.constants.spp) } else { 0.0 };
        let past = past.unwrap_or(Past { light: black, moments: Moments::default() });
        let old = &past.moments;

        // History is bounded: resampling between pixels blurs it, and what depends on the eye's position changes.
        let eye_moved = self.before.first().is_some_and(|b| b.eye.origin != self.constants.eyes[self.view].origin);
        let blurred = (2.0 * between).min(1.0);
        let mut longest = 255.0 * (1.0 - blurred) + 32.0 * blurred;
        if !self.gloss && now.is_view_dependent && eye_moved {
            cases.meet("view-dependent history");
            longest = 6.0;
        }
        let keep = (longest / old.frames.max(1.0)).min(1.0);
        if keep < 1.0 {
            cases.meet("history that is cut short");
        }
        let (samples, mut frames) = (old.samples * keep, old.frames * keep);
        let total = samples + new_samples;
        if total <= 0.0 {
            cases.meet("nothing");
            return Some(After { light: black, moments: nothing, dropped });
        }
        cases.meet(if is_sampled { "sampled" } else { "not sampled" });
        let mut totals = DVec2::splat(total);
        if self.gloss && eye_moved {
            let smooth = (2.0 * now.roughness).min(1.0);
            let gloss_longest = 6.0 * (1.0 - smooth) + 32.0 * smooth;
            totals.y = samples * (gloss_longest / frames.max(1.0)).min(1.0) + new_samples;
        }
        // West's update of mean and variance by samples.
        let share = new_samples / totals;
        let value = light.luminances();
        let difference = value - old.mean;
        let mean = old.mean + share * difference;
        let moved = difference * (value - mean);
        // Samples tell their variance where there are no frames to do so.
        let fresh = if tells_variance && samples == 0.0 { light.variance } else { new_samples * moved };
        let variance = old.variance + share * (fresh - old.variance);
        let recent_share = if is_sampled { share.x.max(1.0 / FEW_FRAMES) } else { share.x };
        let recent = old.recent + recent_share * (value.x - old.recent);
        frames += if is_sampled { 1.0 } else { 0.0 };

        // Where the recent mean is off the long one by more than both vary, light has changed: less of it is trusted.
        // Recent frames count as many samples as the one of them with fewest.
        let fewest = f64::from(self.constants.spp.min(self.last_spp)).min(total / frames);
        cases.meet(if fewest < total / frames {
            "recent frames of few samples"
        } else {
            "recent frames of as many samples as all"
        });
        let expected = 9.0 * variance.x * (1.0 / 7.0 / fewest + 1.0 / total);
        let unseen = (1e-10 / f64::from(self.constants.exposure)).powi(2);
        let off = (recent - mean.x).powi(2) / expected.max(unseen);
        let mut trust = 1.0;
        if off > 1.0 && frames > FEW_FRAMES {
            cases.meet("light that has changed");
            trust = (1.0 / off).max(FEW_FRAMES / frames).min(1.0);
        }
        let observations = if tells_variance { total } else { frames };
        let of_all = variance / totals * observations;
        let known = of_all / (observations - 1.0).max(1.0) * (1.0 + FEW_OBSERVATIONS / observations);
        let is_known = observations > FEW_FRAMES - 0.5;
        cases.meet(if is_known { "variance that is known" } else { "variance that is unknown" });
        let after = Light {
            matte: past.light.matte + share.x * (light.matte - past.light.matte),
            gloss: past.light.gloss + share.y * (light.gloss - past.light.gloss),
            variance: if is_known { known } else { DVec2::splat(UNKNOWN) },
        };
        let is_sound = is_finite(after.matte)
            && is_finite(after.gloss)
            && is_finite(variance.extend(recent))
            && (!is_known || (is_finite(of_all.extend(0.0)) && is_finite(known.extend(0.0))));
        if !is_sound {
            cases.meet("a sum that is not finite");
            return Some(After { light: black, moments: nothing, dropped: true });
        }
        let moments = Moments {
            mean,
            variance,
            recent,
            samples: total * trust,
            frames: (frames * trust).clamp(1.0, 255.0),
            material: now.material,
        };
        Some(After { light: after, moments, dropped })
    }
}
