//! Calibration of the built-in quality ladder: times a few of its settings, and extrapolates to the others.

use std::collections::{BTreeMap, HashMap};
use std::time::{Duration, Instant};

use crate::control::{
    BOUNCES, BlurErrors, Ladder, LadderError, Origin, Rung, TRACING, guessed_error, guessed_paths,
    guessed_relative_cost, mix, relative_costs,
};
use crate::exec::{ExecError, FrameParams, FrameReport, PerView, Renderer};
use crate::graph::Stage;
use crate::image::RgbImage;
use crate::passes::gbuffer;
use crate::quality::Quality;
use crate::samples::Samples;
use crate::scene::rig::Rig;
use crate::schedule::RelativeCost;

/// Time limit of calibration. Once it has passed, only the qualities with the fewest bounces are still timed: every
/// extrapolation can fall back on them.
const TIME_LIMIT: Duration = Duration::from_secs(2);
/// Number of timed frames per quality. The minimum busy time of each stage counts, since longer times include delays by
/// other work on the machine.
const FRAMES: u32 = 3;
/// Number of untimed frames before the first timed one. Caches are cold and GPU clocks are low during these.
const WARM_UP: u32 = 2;
/// Maximum number of untimed frames of a quality in which the radiance cache fills. At 320x180, frames of the Cornell box
/// trace 0.72 of the rays of the first one from the seventh on. Slow devices have no time for these frames, and then the
/// times are those of a cache that is still empty: too long rather than too short.
const CACHE_FRAMES: u32 = 6;
/// Index of the first calibration frame of each quality. It is above the frame indices of any run.
pub const FIRST_FRAME: u32 = 1 << 24;

/// View that the timed frames show: a camera and a time in seconds.
pub struct View<'a> {
    pub rig: &'a Rig,
    pub time_s: f64,
}

/// An error of [`calibrate`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    #[error(transparent)]
    Exec(#[from] ExecError),
    #[error("the calibration could not time any quality setting")]
    Ladder(#[from] LadderError),
    /// `stop` returned true.
    #[error("interrupted")]
    Stopped,
}

/// Builds a ladder from `qualities`. Renders and times a few of them, and extrapolates the times of the others.
/// Estimates each error from noise, blur, and the indirect light that is missing with few bounces. On devices that are
/// fast enough, measures how the error changes with the filter's iterations. `limit` maps a quality of the ladder to the
/// one that frames are rendered with. If `stop` returns true, calibration ends before the next frame.
///
/// # Errors
/// [`CalibrationError::Exec`] if a frame fails, [`CalibrationError::Ladder`] if no quality could be timed,
/// [`CalibrationError::Stopped`] if `stop` returned true.
pub fn calibrate(
    renderer: &mut Renderer,
    view: &View,
    qualities: &[Quality],
    limit: &dyn Fn(&Quality) -> Quality,
    origin: Origin,
    stop: &dyn Fn() -> bool,
) -> Result<Ladder, CalibrationError> {
    let ladder = Calibration::new(renderer, view, limit, stop).ladder(qualities, origin);
    // The first frame after calibration must not use the timed frames as its history.
    renderer.begin_anew();
    ladder
}

pub(super) struct Calibration<'a> {
    pub renderer: &'a mut Renderer,
    pub view: &'a View<'a>,
    pub limit: &'a dyn Fn(&Quality) -> Quality,
    stop: &'a dyn Fn() -> bool,
    begin: Instant,
    /// Index of the first frame of each quality. All have the same random numbers, so that their light differs only in
    /// the paths' lengths.
    pub first_frame: u32,
    /// Measurements by samples per pixel and bounces.
    pub timed: HashMap<(u32, u32), Timed>,
}

/// The measurements of a quality.
pub(super) struct Timed {
    pub quality: Quality,
    /// Minimum makespan of the timed frames.
    pub makespan_ms: f64,
    /// Busy time of each stage in milliseconds: the minimum over the timed frames.
    stage_ms: BTreeMap<String, f64>,
    /// Rays per pixel by stage, for stages that trace paths.
    rays: BTreeMap<String, f64>,
    /// Mean radiance of both eyes in frame [`FRAMES`].
    light: f64,
}

impl<'a> Calibration<'a> {
    pub fn new(
        renderer: &'a mut Renderer,
        view: &'a View<'a>,
        limit: &'a dyn Fn(&Quality) -> Quality,
        stop: &'a dyn Fn() -> bool,
    ) -> Self {
        let (begin, timed) = (Instant::now(), HashMap::new());
        Self { renderer, view, limit, stop, begin, first_frame: FIRST_FRAME, timed }
    }

    fn ladder(mut self, qualities: &[Quality], mut origin: Origin) -> Result<Ladder, CalibrationError> {
        let quality = |spp, bounces| {
            let is_it = |q: &&Quality| (q.spp, q.bounces, q.scale) == (Samples::from(spp), bounces, 1.0);
            qualities.iter().find(is_it)
        };
        let [few, most] = [BOUNCES[0], BOUNCES[BOUNCES.len() - 1]];
        let between = BOUNCES[1..BOUNCES.len() - 1].iter().flat_map(|&b| [(2, b), (1, b)]);
        let all = [(2, most), (1, most)].into_iter().chain(between).chain([(2, few), (1, few)]);
        let share = TIME_LIMIT / 2 / (2 * BOUNCES.len() as u32);
        for (i, (spp, bounces)) in (1..).zip(all) {
            if self.begin.elapsed() < TIME_LIMIT || bounces == few {
                self.time(quality(spp, bounces), share * i)?;
            }
        }
        let missing = self.missing_light();
        let blur = self.blur_errors()?;
        let rung = |q: &Quality| self.rung(q, missing[&q.bounces], blur);
        let mut rungs: Vec<Rung> = qualities.iter().map(rung).collect();
        let relative_costs = relative_costs(&rungs);
        // Relative costs now come from measurements instead of guesses. Render one more frame, so that the cost model
        // learns times per unit of the new costs.
        if let Some((quality, relative_cost)) = qualities.first().zip(relative_costs.first()) {
            self.render(quality, relative_cost, self.first_frame, self.view.time_s)?;
        }
        for (rung, relative_cost) in rungs.iter_mut().zip(relative_costs) {
            let quality = (self.limit)(&rung.quality);
            rung.time_ms = self.renderer.predicted_ms(&quality, &relative_cost).unwrap_or(f64::NAN);
        }
        origin.devices = self.renderer.devices().iter().map(|d| d.name.clone()).collect();
        Ok(Ladder::of_measured(origin, &rungs)?)
    }

    /// Times a quality. Its cache fills in untimed frames until the calibration has lasted `fill_until`.
    fn time(&mut self, quality: Option<&Quality>, fill_until: Duration) -> Result<(), CalibrationError> {
        let Some(quality) = quality else { return Ok(()) };
        let relative_cost = guessed_relative_cost(quality);
        self.renderer.begin_anew();
        let mut stage_ms: BTreeMap<String, f64> = BTreeMap::new();
        let (mut rays, mut light, mut makespan_ms) = (BTreeMap::new(), 0.0, f64::INFINITY);
        let mut untimed = if self.timed.is_empty() { WARM_UP } else { 0 };
        for i in 0.. {
            if i == untimed + FRAMES {
                break;
            }
            let frame = self.render(quality, &relative_cost, self.first_frame + i, self.view.time_s)?;
            rays = frame.stage_rays();
            if i + 1 == FRAMES {
                light = mean_light(&self.renderer.read_linear()?);
            }
            if i == untimed && i < CACHE_FRAMES && frame.spec.caches() && self.begin.elapsed() < fill_until {
                untimed += 1;
            } else if i >= untimed {
                makespan_ms = makespan_ms.min(frame.makespan_ms);
                for (stage, ms) in frame.stage_ms() {
                    stage_ms.entry(stage).and_modify(|least| *least = least.min(ms)).or_insert(ms);
                }
            }
        }
        let timed = Timed { quality: *quality, makespan_ms, stage_ms, rays, light };
        self.timed.insert((quality.spp.least, quality.bounces), timed);
        Ok(())
    }

    pub fn render(
        &mut self,
        quality: &Quality,
        relative_cost: &RelativeCost,
        index: u32,
        time_s: f64,
    ) -> Result<FrameReport, CalibrationError> {
        if (self.stop)() {
            return Err(CalibrationError::Stopped);
        }
        let frame = self.renderer.frame(self.view.rig, time_s, index);
        let (quality, relative_cost) = ((self.limit)(quality), relative_cost.clone());
        Ok(self.renderer.render(&FrameParams { quality, relative_cost, ..frame })?)
    }

    /// Returns, for each number of bounces, the fraction of all light that is missing because paths end there. Where the
    /// fraction was not measured, it is extrapolated from that of the fewest bounces and halves with each further bounce.
    fn missing_light(&self) -> HashMap<u32, f64> {
        let [few, most] = [BOUNCES[0], BOUNCES[BOUNCES.len() - 1]];
        // Only frames of the same samples have the same random numbers.
        let share = |bounces: u32| {
            let light = |spp, bounces| self.timed.get(&(spp, bounces)).map(|timed| f64::from(spp) * timed.light);
            let pairs = [1, 2].into_iter().filter_map(|spp| Some([light(spp, bounces)?, light(spp, most)?]));
            let [some, all] = pairs.fold([0.0; 2], |[a, b], [some, all]| [a + some, b + all]);
            (all > 0.0).then(|| (1.0 - some / all).max(0.0))
        };
        let mut missing = HashMap::new();
        let mut least: f64 = 0.0;
        for bounces in BOUNCES.into_iter().rev() {
            let halved = || share(few).unwrap_or(0.0) * 0.5f64.powi((bounces - few) as i32);
            // The denoiser must not make fewer bounces brighter than more.
            least = least.max(share(bounces).unwrap_or_else(halved));
            missing.insert(bounces, least);
        }
        missing
    }

    /// Makes a rung from a quality, with estimated error and stage times. The frame time of the rung is not known yet.
    fn rung(&self, quality: &Quality, missing_light: f64, blur: Option<BlurErrors>) -> Rung {
        let error = guessed_error(quality, missing_light, blur);
        let (quality, stage_ms, rays) = (*quality, self.stage_ms(quality), self.rays(quality));
        let (time_ms, is_estimated) = (f64::NAN, true);
        Rung { time_ms, error, flip: None, flicker: None, relmse: None, is_estimated, quality, stage_ms, rays }
    }

    /// Returns the measurement with as many bounces as `quality`, or else with the fewest.
    fn near(&self, quality: &Quality) -> Option<&Timed> {
        let spp = quality.spp.least.min(2);
        [quality.bounces, BOUNCES[0]].into_iter().find_map(|b| self.timed.get(&(spp, b)))
    }

    /// Returns an estimate between those for one sample per pixel, at the centre, and for two, which are jittered.
    fn between(
        &self,
        quality: &Quality,
        estimate: fn(&Self, &Quality) -> BTreeMap<String, f64>,
    ) -> BTreeMap<String, f64> {
        let [one, two] = [1, 2].map(|spp| estimate(self, &Quality { spp: Samples::from(spp), ..*quality }));
        mix(&one, &two, quality.spp.fraction())
    }

    /// Estimates the rays per pixel of stages that trace paths, in proportion to [`guessed_paths`].
    fn rays(&self, quality: &Quality) -> BTreeMap<String, f64> {
        if quality.spp.is_between_one_and_two() {
            return self.between(quality, Self::rays);
        }
        let Some(near) = self.near(quality) else { return BTreeMap::new() };
        let paths = guessed_paths(quality) / guessed_paths(&near.quality);
        near.rays.iter().map(|(stage, rays)| (stage.clone(), rays * paths)).collect()
    }

    /// Estimates the times of the tracing stages in milliseconds. Extrapolates from a measurement with the same number
    /// of bounces if there is one, otherwise from one with the fewest bounces. Path tracing times are scaled by
    /// [`guessed_paths`]. If the G-buffer averages several samples per pixel, its time is that of one sample plus a
    /// time proportional to the number of samples.
    fn stage_ms(&self, quality: &Quality) -> BTreeMap<String, f64> {
        if quality.spp.is_between_one_and_two() {
            return self.between(quality, Self::stage_ms);
        }
        let spp = quality.spp.least.min(2);
        let Some(Timed { quality: near, stage_ms: timed, .. }) = self.near(quality) else { return BTreeMap::new() };
        let paths = guessed_paths(quality) / guessed_paths(near);
        let centre_ms = self.timed.get(&(1, near.bounces)).and_then(|t| t.stage_ms.get(gbuffer::STAGE.name())).copied();
        let ms = |stage: Stage| {
            let ms = *timed.get(stage.name())?;
            Some((
                stage.name().to_owned(),
                match stage {
                    gbuffer::STAGE => {
                        let centre_ms = centre_ms.unwrap_or(ms).min(ms);
                        centre_ms + (ms - centre_ms) * quality.spp.mean() / f64::from(spp)
                    }
                    _ => ms * paths,
                },
            ))
        };
        TRACING.into_iter().filter_map(ms).collect()
    }
}

/// Returns the mean radiance of both eyes.
fn mean_light(images: &PerView<RgbImage>) -> f64 {
    let pixels = images.iter().flat_map(|image| &image.pixels);
    let sum: f64 = pixels.flatten().filter(|c| c.is_finite()).map(|c| f64::from(*c)).sum();
    sum / images.iter().map(|image| image.pixels.len()).sum::<usize>().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::LoadedScene;
    use crate::control::candidates;
    use crate::quality::{Denoiser, Envelope};

    /// Returns the missing light of a calibration whose frames begin at `first_frame`.
    fn missing(renderer: &mut Renderer, scene: &LoadedScene, qualities: &[Quality], first_frame: u32) -> Vec<f64> {
        let view = View { rig: &scene.shot.rig, time_s: 0.0 };
        let mut calibration =
            Calibration { first_frame, ..Calibration::new(renderer, &view, &|quality| *quality, &|| false) };
        for quality in qualities {
            calibration.time(Some(quality), Duration::ZERO).unwrap();
        }
        let missing = calibration.missing_light();
        BOUNCES.map(|bounces| missing[&bounces]).to_vec()
    }

    /// The fractions of this room are means over the five seeds and the three sizes, of which single ones differ by up to
    /// 10 %. With other random numbers for each number of bounces, they differ by several times the smallest fraction.
    #[test]
    fn missing_light_does_not_depend_on_the_seed() {
        const MISSING: [f64; 5] = [0.213, 0.100, 0.0455, 0.0195, 0.0];
        let scene = LoadedScene::load("builtin:cornell").unwrap();
        let all = candidates(Some(Denoiser::SVGF), false);
        let is_timed = |q: &&Quality| q.spp.least <= 2 && !q.spp.varies() && (q.scale, q.most_iterations()) == (1.0, 1);
        let qualities: Vec<Quality> = all.iter().filter(is_timed).copied().collect();
        for (width, height) in [(48, 32), (64, 36), (96, 54)] {
            let builder = Renderer::builder(&scene).size(width, height).envelope(Envelope::of(&qualities));
            let mut renderer = builder.build().unwrap();
            for seed in 0..5 {
                let found = missing(&mut renderer, &scene, &qualities, FIRST_FRAME + 1000 * seed);
                eprintln!("{width}x{height}, seed {seed}: {found:.4?}");
                let is_right = found.iter().zip(MISSING).all(|(found, right)| (found - right).abs() <= 0.2 * right);
                assert!(is_right, "{width}x{height}, seed {seed}: {found:.4?}");
            }
        }
    }
}
