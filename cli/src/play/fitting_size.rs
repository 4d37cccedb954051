//! Checks that the cheapest rung fits the budget at the requested size. If it does not, smaller sizes of the same shape
//! are timed until one fits.

use std::time::{Duration, Instant};

use crate::report::median_of;
use crate::report::play::SizeFit;
use diptych::control::Budget;
use diptych::exec::Renderer;
use diptych::exec::ranks::Devices;
use diptych::image::Extent;
use diptych::loaded::LoadedScene;
use diptych::session::FIRST_FRAME;

use super::prepared::Prepared;
use crate::failure::Failure;
use crate::faults::refuse_faults;
use crate::interrupt;

use crate::progress::Progress;
use crate::setup::{self, Tracing};

/// Maximum number of timed frames per size, after a first frame that is not timed.
const FRAMES: u32 = 5;
/// Time after which no further frame of a size is timed; at least one is.
const TIME_LIMIT: Duration = Duration::from_millis(500);
/// Maximum number of sizes to try.
const PROBES: usize = 6;
/// Target time of the cheapest rung at a size that fits, as a fraction of the budget's upper end: frames may then take
/// twice as long before no rung fits. Better rungs use the rest.
const TARGET: f64 = 0.5;
/// Fraction of the target time from which a size is accepted without trying larger ones.
const GOOD_ENOUGH: f64 = 0.85;
/// Multiple of the budget's upper end. If a frame takes longer than this, the run's estimated duration is reported.
const FAR: f64 = 2.0;
/// Name of the search in messages.
const LOOKING: &str = "looking for a size that fits";

/// Creates a renderer of the requested size. If no rung fits the budget there, finds a smaller size and reports it.
/// If [`Prepared::fits_size`] is `Some(true)`, the renderer has the smaller size instead, which is stored in
/// `prepared`; an error if no size fits.
pub fn start(
    prepared: &mut Prepared,
    loaded: &LoadedScene,
    gpus: Devices,
    tracing: &Tracing,
    progress: &Progress,
) -> Result<(Renderer, Option<SizeFit>), Failure> {
    let of_size = |prepared: &Prepared, size: Extent, gpus: Devices| {
        let mut options = prepared.render.clone();
        options.run.settings.size = size;
        setup::renderer(&options, loaded, gpus, tracing.recorder.origin())
    };
    let (asked, budget) = (prepared.render.settings.size, prepared.options.budget_ms);
    let timing = format!("timing {asked}");
    progress.phase_part(&timing, 0.0);
    let mut renderer = of_size(prepared, asked, gpus)?;
    let cheapest_ms = cheapest_ms(prepared, loaded, &mut renderer, &|fraction| progress.phase_part(&timing, fraction))?;
    if cheapest_ms <= budget.hi_ms() {
        return Ok((renderer, None));
    }
    progress.phase(LOOKING);
    let mut gpus = renderer.into_devices();
    let limits_ms = [TARGET * budget.hi_ms(), budget.hi_ms()];
    let mut tried = 0.0;
    let fitting = search(asked, cheapest_ms, limits_ms, |size| -> Result<f64, Failure> {
        let part = |fraction: f64| progress.phase_part(LOOKING, (tried + fraction) / PROBES as f64);
        let mut renderer = of_size(prepared, size, std::mem::take(&mut gpus))?;
        let ms = self::cheapest_ms(prepared, loaded, &mut renderer, &part)?;
        tried += 1.0;
        refuse_faults(&renderer)?;
        gpus = renderer.into_devices();
        Ok(ms)
    })?;
    if prepared.fits_size == Some(true) {
        let nothing = || {
            let [lo_ms, hi_ms] = [budget.lo_ms(), budget.hi_ms()];
            anyhow::anyhow!(
                "--fit: no size with the aspect ratio of {asked} fits the budget of {lo_ms} to {hi_ms} ms: raise it"
            )
        };
        prepared.render.run.settings.size = fitting.ok_or_else(nothing)?.0;
    }
    let played = prepared.render.settings.size;
    let fit = SizeFit {
        asked_size: asked.to_string(),
        asked_ms: cheapest_ms,
        fitting_size: fitting.map(|(size, _)| size.to_string()),
        fitting_ms: fitting.map(|(_, ms)| ms),
        played_size: played.to_string(),
    };
    tell(&fit, prepared, progress);
    Ok((of_size(prepared, played, gpus)?, Some(fit)))
}

/// Returns the median makespan of frames of the cheapest rung. Afterwards, discards their history. Calls `part` with the
/// fraction that is done.
fn cheapest_ms(
    prepared: &Prepared,
    loaded: &LoadedScene,
    renderer: &mut Renderer,
    part: &dyn Fn(f64),
) -> Result<f64, Failure> {
    let cheapest = prepared.choice.cheapest(&prepared.options.run.settings);
    let (begin, mut makespans_ms) = (Instant::now(), Vec::new());
    for i in 0..=FRAMES {
        if i > 1 && begin.elapsed() > TIME_LIMIT {
            break;
        }
        interrupt::check()?;
        let mut params = renderer.frame(&loaded.shot.rig, prepared.render.settings.time, FIRST_FRAME + i);
        if let Some((quality, relative_cost)) = &cheapest {
            (params.quality, params.relative_cost) = (*quality, relative_cost.clone());
        }
        // A slow frame is the last but one.
        let is_slow = begin.elapsed() > TIME_LIMIT;
        let all = f64::from(if is_slow { i + 1 } else { FRAMES + 1 });
        let report = match i == 0 || is_slow {
            true => renderer.render_watched(&params, None, |fraction| part((f64::from(i) + fraction) / all))?,
            false => renderer.render(&params)?,
        };
        makespans_ms.push(report.makespan_ms);
    }
    renderer.begin_anew();
    Ok(median_of(makespans_ms.split_off(1)))
}

/// Searches for the largest size below `asked` at which frames take at most `target_ms`. Returns the size and its time in
/// milliseconds. If all tried sizes take longer, returns the fastest of those that take at most `most_ms`, if there is
/// one. `time` measures frames of a size, in milliseconds.
pub fn search<E>(
    asked: Extent,
    asked_ms: f64,
    [target_ms, most_ms]: [f64; 2],
    mut time: impl FnMut(Extent) -> Result<f64, E>,
) -> Result<Option<(Extent, f64)>, E> {
    let mut sizes = smaller(asked);
    let mut timed = vec![(asked.area() as f64, asked_ms)];
    let mut best: Option<(Extent, f64)> = None;
    for _ in 0..PROBES {
        let area = fitting_area(&timed, target_ms);
        let within = sizes.iter().rposition(|size| size.area() as f64 <= area).unwrap_or(0);
        let Some(&size) = sizes.get(within) else { break };
        let ms = time(size)?;
        timed.push((size.area() as f64, ms));
        if ms > target_ms {
            if ms <= most_ms && best.is_none_or(|(_, least_ms)| least_ms > ms) {
                best = Some((size, ms));
            }
            sizes.truncate(within);
            continue;
        }
        best = Some((size, ms));
        if ms >= GOOD_ENOUGH * target_ms {
            break;
        }
        sizes.drain(..=within);
    }
    Ok(best)
}

/// Estimates the number of pixels that take `target_ms`, linearly through the two samples (pixels, ms) closest to the
/// target time. With one sample, assumes that time is proportional to pixels.
fn fitting_area(timed: &[(f64, f64)], target_ms: f64) -> f64 {
    let mut timed = timed.to_vec();
    timed.sort_by(|a, b| (a.1 - target_ms).abs().total_cmp(&(b.1 - target_ms).abs()));
    let (near, far) = (timed[0], timed.get(1).copied().unwrap_or((0.0, 0.0)));
    let slope = (near.1 - far.1) / (near.0 - far.0);
    if slope > 0.0 { near.0 + (target_ms - near.1) / slope } else { near.0 * target_ms / near.1 }
}

/// Estimates the largest smaller size at which a frame leaves headroom in the budget, from its time at the size `asked`.
pub fn estimate(asked: Extent, asked_ms: f64, budget: Budget) -> Option<Extent> {
    let area = fitting_area(&[(asked.area() as f64, asked_ms)], TARGET * budget.hi_ms());
    smaller(asked).into_iter().rfind(|size| size.area() as f64 <= area)
}

/// Returns smaller sizes of the same aspect ratio, in ascending order. If the ratio has small terms, as 16:9, the sizes
/// are multiples of it; else the widths are multiples of 8 pixels.
fn smaller(asked: Extent) -> Vec<Extent> {
    let Extent { width, height } = asked;
    let divisor = gcd(width, height);
    let (columns, rows) = (width / divisor, height / divisor);
    let size = |i: u32| match columns.max(rows) <= 64 {
        true => {
            let step = 8u32.div_ceil(columns.min(rows));
            Extent::new(i * step * columns, i * step * rows)
        }
        false => {
            let columns = 8 * i;
            let rows = (f64::from(columns) * f64::from(height) / f64::from(width)).round() as u32;
            Extent::new(columns, rows)
        }
    };
    (1..)
        .map(size)
        .take_while(|s| s.width < width && s.height < height)
        .filter(|s| s.width.min(s.height) >= 8)
        .collect()
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a.max(1) } else { gcd(b, a % b) }
}

/// Reports the fit, with the run's estimated duration if that is long.
fn tell(fit: &SizeFit, prepared: &Prepared, progress: &Progress) {
    let budget = prepared.options.budget_ms;
    progress.event(|| serde_json::json!({ "event": "fit", "fit": fit }));
    let is_taken = fit.played_size != fit.asked_size;
    let mut text = format!(
        "at {} the cheapest rung takes {}, above the budget of {} to {} ms",
        fit.asked_size,
        duration(fit.asked_ms),
        budget.lo_ms(),
        budget.hi_ms()
    );
    match (&fit.fitting_size, fit.fitting_ms) {
        (Some(size), Some(ms)) if is_taken => {
            text += &format!(": playing at {size} instead, where it takes {}", duration(ms));
        }
        (Some(size), Some(_)) => {
            let takes_it = if prepared.fits_size.is_some() { "; --fit takes it" } else { "" };
            text += &format!(": --size {size} should fit{takes_it}");
        }
        _ => text += ", and no smaller size of this aspect ratio fits it",
    }
    if let Some(frames) = prepared.frames.filter(|_| !is_taken && fit.asked_ms > FAR * budget.hi_ms()) {
        text += &format!("; {frames} frames will take about {}", duration(f64::from(frames) * fit.asked_ms));
    }
    match is_taken {
        true if prepared.render.quiet || prepared.render.json => {}
        true => progress.tell(&text),
        false => progress.warn(&text),
    }
}

/// Formats a duration in a suitable unit.
pub fn duration(ms: f64) -> String {
    match ms / 1e3 {
        s if s < 0.1 => format!("{ms:.1} ms"),
        s if s < 1.0 => format!("{ms:.0} ms"),
        s if s < 10.0 => format!("{s:.1} s"),
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} minutes", s / 60.0),
        s => format!("{:.1} hours", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    /// Returns the size that is found if a frame takes `fixed_ms` plus `ms_per_pixel` per pixel, and how many sizes
    /// were timed.
    fn found(asked: Extent, fixed_ms: f64, ms_per_pixel: f64, budget: &str) -> (Option<Extent>, usize) {
        let ms = |size: Extent| fixed_ms + ms_per_pixel * size.area() as f64;
        let mut probes = 0;
        let time = |size: Extent| {
            probes += 1;
            Ok::<_, Infallible>(ms(size))
        };
        let budget: Budget = budget.parse().unwrap();
        let Ok(fitting) = search(asked, ms(asked), [TARGET * budget.hi_ms(), budget.hi_ms()], time);
        (fitting.map(|(size, _)| size), probes)
    }

    #[test]
    fn largest_size_within_the_budget_is_found() {
        let hd = Extent::new(640, 360);
        // A full-size frame takes 1.7 s; 10 ms allow 1355 pixels.
        assert_eq!(found(hd, 0.0, 1.7e3 / 230_400.0, "11..20").0, Some(Extent::new(48, 27)));
        // The same with a fixed cost of 5 ms.
        assert_eq!(found(hd, 5.0, 1.7e3 / 230_400.0, "11..20").0, Some(Extent::new(32, 18)));
        for fixed_ms in [0.0, 2.0, 8.0] {
            for per_pixel in [1e-4, 1e-3, 7e-3] {
                let (size, probes) = found(Extent::new(1280, 720), fixed_ms, per_pixel, "11..20");
                let took_ms = fixed_ms + per_pixel * size.unwrap().area() as f64;
                assert!((0.7 * 10.0..=10.0).contains(&took_ms) || per_pixel > 5e-3, "{size:?}: {took_ms}");
                assert!(probes <= PROBES);
            }
        }
        // The lower end of the budget does not matter.
        assert_eq!(found(hd, 0.0, 1e-3, "0.01..20").0, Some(Extent::new(128, 72)));
        assert_eq!(found(hd, 0.0, 1e-3, "19.9..20").0, Some(Extent::new(128, 72)));
        assert_eq!(found(hd, 30.0, 1e-3, "11..20").0, None);
        // If no size leaves headroom, one that just fits is found.
        assert_eq!(found(hd, 15.0, 1e-3, "11..20").0, Some(Extent::new(16, 9)));
        assert_eq!(found(Extent::new(16, 9), 0.0, 1.0, "11..20"), (None, 0));
    }

    #[test]
    fn size_is_estimated_from_one_frame_time() {
        let budget = || "11..20".parse().unwrap();
        assert_eq!(estimate(Extent::new(640, 360), 1700.0, budget()), Some(Extent::new(48, 27)));
        assert_eq!(estimate(Extent::new(32, 18), 1e6, budget()), None);
    }

    #[test]
    fn smaller_sizes_keep_the_aspect_ratio() {
        let sizes = smaller(Extent::new(640, 360));
        assert_eq!((sizes[0], sizes[2], sizes.len()), (Extent::new(16, 9), Extent::new(48, 27), 39));
        assert_eq!(smaller(Extent::new(96, 64))[0], Extent::new(12, 8));
        assert_eq!(smaller(Extent::new(48, 48))[1], Extent::new(16, 16));
        // 1000:701 has no small terms.
        let odd = smaller(Extent::new(1000, 701));
        assert!(odd.iter().all(|s| s.width % 8 == 0 && s.height.abs_diff(s.width * 701 / 1000) <= 1), "{odd:?}");
        assert!(smaller(Extent::new(8, 8)).is_empty() && smaller(Extent::new(1, 4000)).is_empty());
    }

    #[test]
    fn durations_are_written_in_suitable_units() {
        let said = [9.96, 250.0, 1700.0, 59_000.0, 1_020_000.0, 9e6].map(duration);
        assert_eq!(said, ["10.0 ms", "250 ms", "1.7 s", "59 s", "17 minutes", "2.5 hours"]);
    }
}
