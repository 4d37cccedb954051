//! Bounds of the counts and times of a frame. A driver that drops work reports no failure: what is read back is then
//! whatever memory holds.

use super::Tally;
use crate::layout::Frame;

/// Most mirrors and glass surfaces that a first surface is seen in (`MOST_LINKS` of `mirror.inc.wgsl`).
const MOST_LINKS: u64 = 8;
/// Most panes that a shadow ray passes (`MOST_PANES` of `hits.inc.wgsl`), with a ray behind each.
const MOST_PANES: u64 = 64;
/// Most rays that are counted at a pixel (`add_tally` of `pack.inc.wgsl`).
const MOST_COUNTED: u64 = 0xfffff;

/// Returns an upper bound of the number of rays of a pixel. With n samples, r reflections and h lights with hard shadows:
///
/// - `shadow` = 1 + `MOST_PANES` rays to a light,
/// - `first` = 1 + `MOST_LINKS` + 2 + 3 h `shadow`: a ray to the first surface and one behind each mirror, what polish
///   and what glass reflects, and the hard lights of these three surfaces,
/// - `path` = r (1 + `shadow`): each reflection traces one ray, and one to a light.
///
/// The bound is (n + 1) (2 `first` + `path`), since the G-buffer traces the first surfaces of samples too, and one ray
/// through the pixel's centre.
fn most_rays(constants: &Frame) -> u64 {
    let Frame { sampling, lights, .. } = constants;
    let samples = u64::from(sampling.samples.most());
    let suns = if lights.has_hard_suns == 0 { 0 } else { lights.directional_count };
    let shadow = 1 + MOST_PANES;
    let first = 1 + MOST_LINKS + 2 + 3 * (u64::from(lights.hard_count) + u64::from(suns)) * shadow;
    let path = u64::from(sampling.reflections) * (1 + shadow);
    ((samples + 1) * (2 * first + path)).min(MOST_COUNTED)
}

/// Checks the totals of all views, with their numbers of pixels, and the times of a frame.
///
/// # Errors
/// The first value that no working device returns.
pub fn check(
    constants: &Frame,
    pixels: &[u64],
    tallies: &[Tally],
    mut times_ms: impl Iterator<Item = f64>,
) -> Result<(), String> {
    let most = most_rays(constants);
    for (pixels, Tally { rays, .. }) in pixels.iter().zip(tallies) {
        if *rays > pixels.saturating_mul(most) {
            return Err(format!("{rays} rays of {pixels} pixels, of which each has at most {most}"));
        }
    }
    match times_ms.find(|time| !time.is_finite()) {
        Some(time) => Err(format!("a time of {time} ms")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{Lights, Sampling};
    use crate::samples::PixelSamples;
    use crate::stages::shader_text_of;

    fn frame(spp: u32, reflections: u32, hard_count: u32) -> Frame {
        let sampling = Sampling { samples: PixelSamples::own(0..spp, true), reflections, ..Default::default() };
        Frame { sampling, lights: Lights { hard_count, ..Default::default() }, ..Default::default() }
    }

    fn checked(constants: &Frame, rays: [u64; 2], times_ms: &[f64]) -> Result<(), String> {
        let tallies = rays.map(|rays| Tally { rays, ..Default::default() });
        check(constants, &[100, 50], &tallies, times_ms.iter().copied())
    }

    #[test]
    fn rejects_more_rays_than_paths_can_have() {
        let constants = frame(1, 4, 0);
        let most = 2 * (2 * 11 + 4 * 66);
        assert_eq!(checked(&constants, [100 * most, 50 * most], &[]), Ok(()));
        for rays in [[100 * most + 1, 0], [0, 50 * most + 1], [133_000_000_000, 0]] {
            let error = checked(&constants, rays, &[]).unwrap_err();
            assert!(error.contains(&format!("at most {most}")), "{error}");
        }
        assert!(most_rays(&frame(2, 4, 0)) > most && most_rays(&frame(1, 5, 0)) > most);
        assert_eq!(most_rays(&frame(1, 4, 2)), most + 2 * 2 * 3 * 2 * 65);
        assert_eq!(most_rays(&frame(u32::MAX, 4, 0)), MOST_COUNTED);
    }

    #[test]
    fn rejects_non_finite_times() {
        for time in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(checked(&frame(1, 1, 0), [0, 0], &[1.0, time]).unwrap_err().contains("ms"), "{time}");
        }
        assert_eq!(checked(&frame(1, 1, 0), [0, 0], &[-1.0, 0.0, 1e9]), Ok(()));
    }

    #[test]
    fn bounds_equal_those_in_shaders() {
        let text = shader_text_of("path_trace", crate::device::SceneAccess::default());
        for line in [
            format!("const MOST_LINKS: u32 = {MOST_LINKS}u;"),
            format!("const MOST_PANES: u32 = {MOST_PANES}u;"),
            format!("+ rays, {MOST_COUNTED:#x}u)"),
        ] {
            assert!(text.contains(&line), "{line}");
        }
    }
}
