//! Temporal accumulation by the published methods (Schied et al. 2017; West 1979), with the changes listed at the top
//! of the shader.

use glam::{DVec2, DVec3};

use super::moments::Moments;
use crate::kernels::camera::{Constants, Eye};
use crate::kernels::edges::Surface;
use crate::kernels::harness::Stripe;
use crate::kernels::inputs::Cases;
use crate::kernels::pack::{ABSENT, Light, MIRRORED, MISSING, MeanLight, UNKNOWN, UNSEEN_SQUARE, blended, is_finite};

/// Minimum sum of weights for history.
const LEAST_FOUND: f64 = 0.01;
/// Number of frames that the recent mean remembers, and from which temporal variance is known.
const FEW_FRAMES: f64 = 4.0;
/// Number of observations at which variance is doubled.
const FEW_OBSERVATIONS: f64 = 24.0;
/// Inflation of the variance of a single frame's samples.
const FEW_MEANS: f64 = 2.0;

/// An eye's images of the previous frame.
pub struct Before {
    pub eye: Eye,
    pub guide: Vec<Option<Surface>>,
    pub moments: Vec<Moments>,
    pub light: Vec<Light>,
}

/// History interpolated at an image point of the previous frame.
struct Past {
    light: Light,
    is_light_finite: bool,
    /// 1 for each lobe that it has.
    lobes: DVec2,
    moments: Moments,
}

impl Past {
    fn is_finite(&self) -> bool {
        let m = &self.moments;
        let rest = [DVec3::new(m.mean.x, m.mean.y, m.recent), DVec3::new(m.variance.x, m.variance.y, m.samples)];
        self.is_light_finite && rest.into_iter().all(is_finite)
    }
}

/// Inputs of a pixel in this frame.
pub struct Now {
    pub surface: Option<Surface>,
    /// Where the surface is seen: its position, or that of its mirror image.
    pub image: DVec3,
    pub material: u32,
    /// Roughness from 0 to 1. Specular radiance of smoother surfaces changes faster.
    pub roughness: f64,
    pub is_view_dependent: bool,
    /// Sampled light, with the variance of the samples, which is negative if unknown.
    pub light: Option<Light>,
}

impl Now {
    pub fn is_damaged(&self) -> bool {
        self.light.as_ref().is_some_and(|light| !is_sound(light))
    }
}

pub struct After {
    pub light: Light,
    /// Statistics before rounding of the frame count.
    pub moments: Moments,
    pub dropped: bool,
}

pub struct Twin<'a> {
    pub constants: &'a Constants,
    /// Samples per pixel of the previous frame.
    pub last_spp: u32,
    pub stripe: &'a Stripe,
    pub gloss: bool,
    pub view: usize,
    /// Previous images of the same eye, then of the left eye.
    pub before: &'a [Before],
}

/// Returns true if light is finite.
fn is_sound(light: &Light) -> bool {
    is_finite(light.matte) && is_finite(light.gloss)
}

impl Twin<'_> {
    /// Returns the weighted sum over the four pixels around an image point that show the same surface, with the sum of
    /// weights.
    fn past(&self, before: &Before, row: u32, surface: &Surface, now: &Now, cases: &mut Cases) -> (f64, Past) {
        let mut past =
            Past { light: Light::default(), is_light_finite: true, lobes: DVec2::ZERO, moments: Moments::default() };
        let (mut matte, mut gloss) = (MeanLight::default(), MeanLight::default());
        let Some((seen, z)) = before.eye.seen_at(now.image, self.constants.size()) else { return (0.0, past) };
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
            let is_same = moments.material == now.material
                && off < 0.005 * z
                && surface.normal.dot(then.normal) > 0.9
                && moments.samples != 0.0;
            if !is_same {
                continue;
            }
            let lobes = moments.mean.map(|mean| f64::from(mean >= 0.0));
            // Surfaces without a lobe are no history of one with it.
            if now.light.is_some_and(|light| is_sound(&light) && light.lobes().cmpgt(lobes).any()) {
                cases.meet("history without a lobe");
                continue;
            }
            let share = |d: i32, fraction: f64| if d == 0 { 1.0 - fraction } else { fraction };
            let w = share(dx, fraction.x) * share(dy, fraction.y);
            matte.add(before.light[tap].matte, w);
            gloss.add(before.light[tap].gloss, w);
            let of_lobes = |v: DVec2| DVec2::select(lobes.cmpgt(DVec2::ZERO), v * w, DVec2::ZERO);
            past.moments.mean += of_lobes(moments.mean);
            past.moments.variance += of_lobes(moments.variance);
            past.moments.recent += moments.recent * lobes.x * w;
            past.lobes += lobes * w;
            past.moments.samples += moments.samples * w;
            past.moments.frames += moments.frames * w;
            found += w;
        }
        past.is_light_finite = matte.is_finite() && gloss.is_finite();
        (past.light.matte, past.light.gloss) = (matte.above(LEAST_FOUND), gloss.above(LEAST_FOUND));
        let of_lobes =
            |sum: f64, lobe: usize| if past.lobes[lobe] > LEAST_FOUND { sum / past.lobes[lobe] } else { 0.0 };
        let m = &mut past.moments;
        m.mean = DVec2::new(of_lobes(m.mean.x, 0), of_lobes(m.mean.y, 1));
        m.variance = DVec2::new(of_lobes(m.variance.x, 0), of_lobes(m.variance.y, 1));
        m.recent = of_lobes(m.recent, 0);
        (found, past)
    }

    /// Returns the normalised history of the same eye, or else of the left one; whether any was not finite; and how far
    /// between pixels the last image point lies, from 0 to 1.
    fn history(&self, row: u32, surface: &Surface, now: &Now, cases: &mut Cases) -> (Option<Past>, bool, f64) {
        let (mut dropped, mut between) = (false, 0.0);
        for (i, before) in self.before.iter().enumerate() {
            let (found, mut past) = self.past(before, row, surface, now, cases);
            if let Some((seen, _)) = before.eye.seen_at(now.image, self.constants.size()) {
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
                cases.meet(if now.material & MIRRORED != 0 { "history in a mirror" } else { "history outside" });
                let m = &mut past.moments;
                (m.samples, m.frames) = (m.samples / found, m.frames / found);
                return (Some(past), dropped, between);
            }
        }
        (None, dropped, between)
    }

    /// Returns the pixel's result; none without a surface.
    pub fn pixel(&self, row: u32, now: &Now, cases: &mut Cases) -> Option<After> {
        let Some(surface) = &now.surface else {
            cases.meet("no surface");
            return None;
        };
        let black = Light { matte: DVec3::ZERO, gloss: DVec3::ZERO, variance: DVec2::splat(MISSING) };
        let nothing = Moments { material: now.material, ..Moments::default() };
        let (mut light, mut is_sampled, mut dropped) = (now.light.unwrap_or_default(), now.light.is_some(), false);
        let tells_variance = is_sampled && light.variance.x >= 0.0;
        if !is_sound(&light) {
            cases.meet("light that is not finite");
            (light, is_sampled, dropped) = (black, false, true);
        }
        let (past, past_dropped, between) = self.history(row, surface, now, cases);
        dropped |= past_dropped;
        let new_samples = if is_sampled { f64::from(self.constants.spp) } else { 0.0 };
        let nowhere = Light { matte: DVec3::splat(ABSENT), gloss: DVec3::splat(ABSENT), ..black };
        let none = Past { light: nowhere, is_light_finite: true, lobes: DVec2::ZERO, moments: Moments::default() };
        let past = past.unwrap_or(none);
        let lobes = if is_sampled { light.lobes() } else { DVec2::ZERO };
        if is_sampled && lobes.min_element() == 0.0 {
            cases.meet("light without a lobe");
        }
        let old = &past.moments;

        // History length is limited: resampling between pixels blurs it, and view-dependent light changes.
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
        // Update mean and variance by West's method, per sample.
        let share = new_samples / totals * lobes;
        let value = light.luminances();
        let difference = value - old.mean;
        let mean = old.mean + share * difference;
        let moved = difference * (value - mean);
        // Without history, use the variance of the samples.
        let fresh = if tells_variance && samples == 0.0 { light.variance } else { new_samples * moved };
        let variance = old.variance + share * (fresh - old.variance);
        let recent_share = if is_sampled { share.x.max(lobes.x / FEW_FRAMES) } else { share.x };
        let recent = old.recent + recent_share * (value.x - old.recent);
        frames += if is_sampled { 1.0 } else { 0.0 };

        // If the recent mean differs from the long-term mean by more than their variances explain, the light has
        // changed, and history counts less. Recent frames count with the samples of the smallest.
        let fewest = f64::from(self.constants.spp.min(self.last_spp)).min(total / frames);
        cases.meet(if fewest < total / frames {
            "recent frames of few samples"
        } else {
            "recent frames of as many samples as all"
        });
        let expected = 9.0 * variance.x * (1.0 / 7.0 / fewest + 1.0 / total);
        let off = (recent - mean.x).powi(2) / expected.max(UNSEEN_SQUARE);
        let mut trust = 1.0;
        if off > 1.0 && frames > FEW_FRAMES {
            cases.meet("light that has changed");
            trust = (1.0 / off).max(FEW_FRAMES / frames).min(1.0);
        }
        let observations = if tells_variance { total } else { frames };
        let of_all = variance / totals * observations;
        let means = if tells_variance { FEW_MEANS / frames.max(1.0).powi(2) } else { 0.0 };
        let known = of_all / (observations - 1.0).max(1.0) * (1.0 + FEW_OBSERVATIONS / observations + means);
        let is_known = observations > FEW_FRAMES - 0.5;
        cases.meet(if is_known { "variance that is known" } else { "variance that is unknown" });
        let after = Light {
            matte: blended(past.light.matte, light.matte, share.x),
            gloss: blended(past.light.gloss, light.gloss, share.y),
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
        let has_lobe = |i: usize| lobes[i] > 0.0 || past.lobes[i] > LEAST_FOUND;
        let moments = Moments {
            mean: DVec2::from_array([0, 1].map(|i| if has_lobe(i) { mean[i] } else { ABSENT })),
            variance,
            recent,
            samples: total * trust,
            frames: (frames * trust).clamp(1.0, 255.0),
            material: now.material,
        };
        Some(After { light: after, moments, dropped })
    }
}
