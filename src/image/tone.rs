//! Tone curves, from exposed linear radiance to linear display values between 0 and 1. `display.inc.wgsl` has the same
//! curves.

use serde::{Deserialize, Serialize};

/// Tone curve of displayed images. Image metrics always use [`ToneCurve::Reinhard`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToneCurve {
    /// c / (1 + c) per channel (Reinhard et al. 2002, eq. 3)
    #[default]
    Reinhard,
    /// Khronos PBR Neutral: base colours up to 0.8 stay as they are
    Neutral,
    /// AgX: filmic, and bright colours fade to white
    Agx,
    /// ACES filmic: high contrast
    Aces,
    /// No curve; brighter colours are clipped
    None,
}

pub const TONE_NEUTRAL: u32 = ToneCurve::Neutral as u32;
pub const TONE_AGX: u32 = ToneCurve::Agx as u32;
pub const TONE_ACES: u32 = ToneCurve::Aces as u32;
pub const TONE_NONE: u32 = ToneCurve::None as u32;

type Rgb = [f64; 3];

impl ToneCurve {
    /// Maps exposed radiance to linear display values. Negative radiance and NaN count as 0.
    pub fn apply(self, radiance: Rgb) -> Rgb {
        let c = radiance.map(|c| if c > 0.0 { c.min(1e18) } else { 0.0 });
        let shown = match self {
            Self::Reinhard => c.map(|c| c / (1.0 + c)),
            Self::Neutral => neutral(c),
            Self::Agx => agx(c),
            Self::Aces => aces(c),
            Self::None => c,
        };
        shown.map(|c| c.clamp(0.0, 1.0))
    }
}

/// Khronos PBR Neutral Tone Mapper (Khronos Group 2024, ToneMapping repository, `PBR_Neutral`).
fn neutral(c: Rgb) -> Rgb {
    const START: f64 = 0.8 - 0.04;
    const DESATURATION: f64 = 0.15;
    let least = c[0].min(c[1]).min(c[2]);
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let c = c.map(|c| c - offset);
    let peak = c[0].max(c[1]).max(c[2]);
    if peak < START {
        return c;
    }
    let d = 1.0 - START;
    let new_peak = 1.0 - d * d / (peak + d - START);
    let white = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    c.map(|c| c * new_peak / peak * (1.0 - white) + new_peak * white)
}

/// ACES RRT and ODT, fitted by Stephen Hill (BakingLab, `ACES.hlsl`), with the exposure that three.js adds.
fn aces(c: Rgb) -> Rgb {
    const INPUT: [Rgb; 3] = [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]];
    const OUTPUT: [Rgb; 3] =
        [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]];
    // Beyond this bound, the fit has reached its limit.
    let v = times(&INPUT, c.map(|c| c.min(1e6) / 0.6));
    let fit = |v: f64| (v * (v + 0.024_578_6) - 0.000_090_537) / (v * (0.983_729 * v + 0.432_951) + 0.238_081);
    times(&OUTPUT, v.map(fit))
}

/// AgX by Troy Sobotka, as in three.js: a log encoding in Rec. 2020 and a polynomial fit of its sigmoid by Benjamin
/// Wrensch.
fn agx(c: Rgb) -> Rgb {
    const REC2020_FROM_SRGB: [Rgb; 3] = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0113], [0.0164, 0.0880, 0.8956]];
    const SRGB_FROM_REC2020: [Rgb; 3] =
        [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]];
    const INSET: [Rgb; 3] = [
        [0.856_627_153, 0.095_121_241, 0.048_251_606],
        [0.137_318_973, 0.761_241_991, 0.101_439_036],
        [0.111_898_213, 0.076_799_419, 0.811_302_368],
    ];
    const OUTSET: [Rgb; 3] = [
        [1.127_100_582, -0.110_606_643, -0.016_493_939],
        [-0.141_329_763, 1.157_823_702, -0.016_493_939],
        [-0.141_329_763, -0.110_606_643, 1.251_936_407],
    ];
    const MIN_EV: f64 = -12.473_93;
    const MAX_EV: f64 = 4.026_069;
    let encoded = times(&INSET, times(&REC2020_FROM_SRGB, c))
        .map(|c| ((c.max(1e-10).log2() - MIN_EV) / (MAX_EV - MIN_EV)).clamp(0.0, 1.0));
    let curve = |x: f64| {
        let [x2, x4] = [x * x, x * x * x * x];
        15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232
    };
    times(&SRGB_FROM_REC2020, times(&OUTSET, encoded.map(curve)).map(|c| c.max(0.0).powf(2.2)))
}

fn times(rows: &[Rgb; 3], c: Rgb) -> Rgb {
    rows.map(|row| row[0] * c[0] + row[1] * c[1] + row[2] * c[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [ToneCurve; 5] =
        [ToneCurve::Reinhard, ToneCurve::Neutral, ToneCurve::Agx, ToneCurve::Aces, ToneCurve::None];

    #[test]
    fn tone_curves_rise_from_black_within_0_and_1() {
        for curve in ALL {
            let mut last = 0.0;
            for stop in -40..=120 {
                let [grey, ..] = curve.apply([f64::from(stop).mul_add(0.25, 0.0).exp2(); 3]);
                assert!((last - 1e-3..=1.0).contains(&grey), "{curve:?} at {stop}: {grey} after {last}");
                last = grey;
            }
            assert!(last > 0.9, "{curve:?}: white is {last}");
            for strange in [[f64::NAN, -1.0, f64::INFINITY], [f64::INFINITY; 3], [0.0; 3], [1e30, 0.0, 1e-30]] {
                let shown = curve.apply(strange);
                assert!(shown.iter().all(|c| (0.0..=1.0).contains(c)), "{curve:?} of {strange:?}: {shown:?}");
            }
            assert!(curve.apply([0.0; 3]).iter().all(|c| *c < 2e-3), "{curve:?}");
        }
    }

    /// The specification of PBR Neutral: colours that the 4 % reflection of a dielectric brightens are shown as its base
    /// colour, up to 0.8.
    #[test]
    fn neutral_keeps_base_colours() {
        for base in [[0.1, 0.2, 0.6], [0.76, 0.76, 0.76], [0.7, 0.3, 0.1]] {
            let shown = ToneCurve::Neutral.apply(base.map(|c| c + 0.04));
            assert!(shown.iter().zip(base).all(|(a, b)| (a - b).abs() < 1e-9), "{base:?}: {shown:?}");
        }
        let [red, green, _] = ToneCurve::Neutral.apply([8.0, 0.5, 0.5]);
        assert!(red > 0.95 && (0.3..red).contains(&green), "bright red is {red}, {green}");
    }

    /// Values of three.js r160 for a grey of 0.18.
    #[test]
    fn filmic_curves_show_mid_grey_as_published() {
        let grey = |curve: ToneCurve| curve.apply([0.18; 3])[1];
        assert!((grey(ToneCurve::Agx) - 0.18).abs() < 0.04, "{}", grey(ToneCurve::Agx));
        assert!((grey(ToneCurve::Aces) - 0.2).abs() < 0.05, "{}", grey(ToneCurve::Aces));
    }
}
