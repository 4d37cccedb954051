//! Reprojection by the published method (Adelson & Hodges 1993). A pixel of the right eye interpolates the two pixels
//! of its row where the left eye sees its surface, if they show the same surface. In mirrors, the left eye is searched
//! for the image of the surface, and points must be as far apart as their images.

use glam::{DVec2, DVec3};

use crate::kernels::camera::Constants;
use crate::kernels::edges::Surface;
use crate::kernels::inputs::Cases;
use crate::kernels::pack::{Light, MIRRORED, MeanLight, UNKNOWN};

/// Reason for a hole, as numbered by the shader.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Why {
    Outside = 1,
    Normal,
    Distance,
    Material,
    Mixed,
    View,
    /// The pixel was not sampled in the left eye.
    Skipped,
}

impl Why {
    pub fn name(self) -> &'static str {
        match self {
            Self::Outside => "outside",
            Self::Normal => "normal",
            Self::Distance => "distance",
            Self::Material => "material",
            Self::Mixed => "mixed",
            Self::View => "view",
            Self::Skipped => "skipped",
        }
    }
}

/// A pixel of either eye.
#[derive(Clone, Copy)]
pub struct Pixel {
    pub surface: Option<Surface>,
    /// Position of the surface or, in mirrors, the point of the pixel's ray at the length of the path.
    pub image: DVec3,
    pub is_mixed: bool,
    pub is_view_dependent: bool,
    pub material: u32,
    /// Sampled light; only for the left eye.
    pub light: Option<Light>,
}

/// Result for a pixel of the right eye.
#[derive(Debug)]
pub enum Fate {
    Sky,
    Gathered(Light),
    Hole(Why),
    LeftToFilter,
}

/// Returns the reason why `left` has no light for the pixel `right`, whose surface is `wanted` and whose image is at a
/// distance `reach` from the left eye. `accepts_mixed` is true if light of pixels that show several surfaces is accepted.
fn refusal(
    left: Option<&Pixel>,
    accepts_mixed: bool,
    right: &Pixel,
    wanted: &Surface,
    reach: f64,
    slack: f64,
) -> Option<Why> {
    let Some(left) = left else { return Some(Why::Outside) };
    if left.is_mixed && !accepts_mixed {
        return Some(Why::Mixed);
    }
    if left.is_view_dependent {
        return Some(Why::View);
    }
    let Some(seen) = left.surface.filter(|_| left.material == right.material) else { return Some(Why::Material) };
    if wanted.normal.dot(seen.position - wanted.position).abs() >= 0.005 * slack * reach {
        return Some(Why::Distance);
    }
    // 26 degrees in all layers: the filter blends light over such angles, too, and in seven scenes, wider angles than the
    // 8 degrees of before left FLIP within 0.5 %.
    if wanted.normal.dot(seen.normal) <= 0.9 {
        return Some(Why::Normal);
    }
    let apart = left.image.distance(right.image);
    let keeps_distance =
        (seen.position.distance(wanted.position) - apart).abs() <= slack * (0.05 * apart + 0.0005 * reach);
    if left.material & MIRRORED != 0 && !keeps_distance {
        return Some(Why::View);
    }
    left.light.is_none().then_some(Why::Skipped)
}

pub struct Twin<'a> {
    pub constants: &'a Constants,
    /// True if pixels may be left to the denoiser.
    pub sparse: bool,
    /// True if pixels that show several surfaces take over light.
    pub accepts_mixed: bool,
    pub left: &'a [Pixel],
}

impl Twin<'_> {
    pub fn fate(&self, (x, y): (u32, u32), right: &Pixel, cases: &mut Cases) -> Fate {
        let asked = !self.sparse || right.surface.is_none() || self.constants.is_sampled((x, y), 1);
        let hole = |why, is_wanted| if is_wanted { Fate::Hole(why) } else { Fate::LeftToFilter };
        if right.is_mixed && (!self.accepts_mixed || right.surface.is_none()) {
            return hole(Why::Mixed, asked);
        }
        let Some(surface) = right.surface else { return Fate::Sky };
        if right.is_view_dependent {
            return hole(Why::View, asked);
        }
        let (left_eye, size) = (&self.constants.eyes[0], self.constants.size());
        let Some((seen, _)) = left_eye.seen_at(right.image, size) else { return hole(Why::Outside, asked) };
        let column = seen.x - f64::from(self.constants.centre.x);
        let fraction = column - column.floor();
        let layer = self.constants.layer((x, y), 1);
        let reach = right.image.distance(left_eye.origin.as_dvec3());
        let slack = f64::from(1 << layer);
        let taps = [0, 1].map(|i| {
            let tap = (column.floor() + f64::from(i)) as i64;
            let within = (0..i64::from(self.constants.width)).contains(&tap);
            within.then(|| &self.left[self.constants.index(tap as u32, y)])
        });
        let refusals = taps.map(|tap| refusal(tap, self.accepts_mixed, right, &surface, reach, slack));
        let light = |i: usize| taps[i].and_then(|tap| tap.light).filter(|_| refusals[i].is_none());
        let weighted = [(light(0), 1.0 - fraction), (light(1), fraction)];
        let weight: f64 = weighted.iter().filter_map(|(light, w)| light.map(|_| w)).sum();
        if weight >= 1e-4 {
            let variance = |(light, w): &(Option<Light>, f64)| light.map(|light| light.variance * *w);
            let variance = weighted.iter().filter_map(variance).sum::<DVec2>() / weight;
            let of = |channel: fn(&Light) -> DVec3| -> DVec3 {
                let mut mean = MeanLight::default();
                weighted.iter().for_each(|(light, w)| light.iter().for_each(|light| mean.add(channel(light), *w)));
                mean.above(0.0)
            };
            let told = weighted.iter().all(|(light, w)| light.is_none_or(|l| *w == 0.0 || l.variance.x >= 0.0));
            let variance = if told { variance } else { DVec2::splat(UNKNOWN) };
            cases.meet(if right.material & MIRRORED != 0 { "gathered in a mirror" } else { "gathered outside" });
            return Fate::Gathered(Light { matte: of(|l| l.matte), gloss: of(|l| l.gloss), variance });
        }
        if refusals.contains(&Some(Why::Skipped)) {
            // The filter fills it from samples around it. If all pixels must have light, it is traced.
            let is_full = layer == 0 && self.constants.foveation.sampled_fraction >= 1.0;
            cases.meet(if is_full { "not sampled, but traced" } else { "not sampled" });
            return hole(Why::Outside, is_full);
        }
        let nearer = usize::from(fraction > 0.5);
        let why = refusals[nearer].or(refusals[1 - nearer]).expect("both taps are refused");
        if why == Why::View && right.material & MIRRORED != 0 {
            cases.meet("view in a mirror");
        }
        hole(why, asked)
    }
}
