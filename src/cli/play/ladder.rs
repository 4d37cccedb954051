//! The ladder of a run: those of a file's rungs that fit the run, or the built-in candidates, timed on the shot itself.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};

use diptych::control::{
    BOUNCES, Ladder, Origin, Rung, TRACING, candidates, efforts, guessed_effort, guessed_error, guessed_paths,
};
use diptych::exec::{FrameReport, Renderer, Stereo};
use diptych::graph::Stage;
use diptych::image::RgbImage;
use diptych::passes::gbuffer;
use diptych::quality::{Denoiser, PolarSpace, Quality};
use diptych::scene::rig::Rig;
use diptych::schedule::Effort;

use super::Failure;
use super::options::LoopOptions;
use crate::cli::foveation::FoveationOptions;
use crate::cli::interrupt;
use crate::cli::options::DenoiserChoice;

/// Settings that a run may use, before it is known what they cost.
pub struct Choice {
    pub denoiser: DenoiserChoice,
    /// Those of a file that the run can have; none: the built-in candidates.
    pub ladder: Option<Ladder>,
    qualities: Vec<Quality>,
}

impl Choice {
    pub fn new(args: &LoopOptions) -> Result<Self, Failure> {
        let Some(path) = &args.ladder else {
            let denoiser = args.denoiser.unwrap_or(Some(Denoiser::Svgf));
            let polar = args.foveated.space();
            let all = candidates(denoiser, args.foveated.is_on()).into_iter();
            let qualities = all.map(|quality| Quality { polar, ..quality }).collect();
            return Ok(Self { denoiser, ladder: None, qualities });
        };
        Self::from_file(args, path).map_err(Failure::Input)
    }

    /// The filter is the same for all frames of a run.
    fn from_file(args: &LoopOptions, path: &Path) -> Result<Self, anyhow::Error> {
        let all = Ladder::read(path).context("cannot use --ladder")?;
        let polar = args.foveated.space();
        let of = |denoiser: DenoiserChoice| -> Vec<Rung> {
            let has = |q: &Quality| {
                let is_filtered = q.iterations != [0; 3];
                q.denoiser == denoiser && is_filtered == denoiser.is_some() && q.polar == polar
            };
            all.rungs().iter().filter(|r| has(&r.quality)).cloned().collect()
        };
        let most = Denoiser::CHOICES.into_iter().filter(|d| !of(*d).is_empty()).max_by_key(|d| of(*d).len());
        let denoiser = args.denoiser.or(most).unwrap_or(Some(Denoiser::Svgf));
        let (path, name) = (path.display(), Denoiser::name_of(denoiser));
        let space = match polar {
            None => String::new(),
            Some(PolarSpace::Visual) => " and --foveation visual-polar".to_owned(),
            Some(PolarSpace::Log(map)) => format!(" and --foveation log-polar --polar {map}"),
        };
        if args.denoiser.is_none() && all.denoisers().len() > 1 {
            let counts: Vec<String> =
                all.denoisers().iter().map(|(d, rungs)| format!("{rungs} of {}", Denoiser::name_of(*d))).collect();
            eprintln!(
                "warning: the rungs of {path} have several denoisers, {}: those of {name} are played; --denoiser chooses \
                 others, and `diptych bench` makes a ladder of each",
                counts.join(", ")
            );
        }
        let (plain, foveated): (Vec<Rung>, _) = of(denoiser).into_iter().partition(|r| r.quality.fovea.is_none());
        ensure!(
            !(plain.is_empty() && foveated.is_empty()),
            "--ladder {path}: none of its {} rungs is for --denoiser {name}{space}: measure some with `diptych bench`",
            all.rungs().len(),
        );
        let rungs = if args.foveated.is_on() { of(denoiser) } else { plain };
        ensure!(!rungs.is_empty(), "--ladder {path}: all rungs for --denoiser {name} need --foveation layers");
        if !args.foveated.is_on() && !foveated.is_empty() {
            eprintln!("warning: {} rungs of {path} are left out: they need --foveation layers", foveated.len());
        }
        let qualities = rungs.iter().map(|r| r.quality).collect();
        Ok(Self { denoiser, ladder: Some(Ladder::new(all.origin().clone(), rungs)?), qualities })
    }

    /// What a frame of the cheapest rung is rendered with; none without any. Of the built-in candidates one with all
    /// bounces, as it is not known yet how much light fewer would leave out.
    pub fn cheapest(&self, limits: &FoveationOptions) -> Option<(Quality, Effort)> {
        if let Some(ladder) = &self.ladder {
            return qualities(ladder, limits).into_iter().next();
        }
        let all_bounces = self.qualities.iter().filter(|q| q.bounces == BOUNCES[BOUNCES.len() - 1]);
        let fewest = all_bounces
            .min_by(|a, b| guessed_paths(a).total_cmp(&guessed_paths(b)).then(a.iterations.cmp(&b.iterations)));
        fewest.map(|quality| (limits.limit(quality), guessed_effort(quality)))
    }

    /// The most of any frame, and the lowest render scale.
    pub fn most(&self) -> Quality {
        let most = |number: fn(&Quality) -> u32| self.qualities.iter().map(number).fold(0, u32::max);
        let (spp, bounces, iterations) = (most(|q| q.spp), most(|q| q.bounces), [most(Quality::most_iterations); 3]);
        let scale = self.qualities.iter().map(|q| q.scale).fold(1.0, f64::min);
        let polar = self.qualities.iter().find_map(|q| q.polar);
        Quality { spp, bounces, denoiser: self.denoiser, iterations, fovea: None, polar, scale }
    }

    /// Whether both kinds of pipelines are needed.
    pub fn mixes_spp(&self) -> bool {
        self.qualities.iter().any(|q| q.spp == 1) && self.qualities.iter().any(|q| q.spp > 1)
    }
}

/// What frames are rendered with, rung by rung, and what their stages cost, held against one another.
pub fn qualities(ladder: &Ladder, limits: &FoveationOptions) -> Vec<(Quality, Effort)> {
    let rungs = ladder.rungs();
    rungs.iter().map(|rung| limits.limit(&rung.quality)).zip(efforts(rungs)).collect()
}

/// When no further setting is timed, those without which nothing is known excepted.
const TIME_LIMIT: Duration = Duration::from_secs(2);
/// Frames of each setting; the least busy times count, as others were disturbed.
const FRAMES: u32 = 3;
/// Frames before the first: all is cold.
const WARM_UP: u32 = 2;
/// Numbers of the frames, beyond those of any run.
pub const FIRST_FRAME: u32 = 1 << 24;

/// Times settings on a renderer, and what they tell of the others.
pub struct Calibration<'a> {
    renderer: &'a mut Renderer,
    rig: &'a Rig,
    time_s: f64,
    /// Of an eye's image.
    rows: u32,
    limits: &'a FoveationOptions,
    begin: Instant,
    frames: u32,
    /// By samples per pixel and bounces.
    timed: HashMap<(u32, u32), Timed>,
}

/// What frames of a setting told.
struct Timed {
    quality: Quality,
    /// The least busy times by stage.
    stage_ms: BTreeMap<String, f64>,
    /// Mean radiance of both eyes.
    light: f64,
}

impl<'a> Calibration<'a> {
    pub fn new(renderer: &'a mut Renderer, rig: &'a Rig, time_s: f64, rows: u32, limits: &'a FoveationOptions) -> Self {
        Self { renderer, rig, time_s, rows, limits, begin: Instant::now(), frames: 0, timed: HashMap::new() }
    }

    /// The built-in ladder. Its times follow from those of some settings, as the light that bounces bring does; its noise
    /// is a guess.
    pub fn ladder(mut self, choice: &Choice, mut origin: Origin) -> Result<Ladder, Failure> {
        let quality =
            |spp, bounces| choice.qualities.iter().find(|q| (q.spp, q.bounces, q.scale) == (spp, bounces, 1.0));
        let [few, most] = [BOUNCES[0], BOUNCES[BOUNCES.len() - 1]];
        let between = BOUNCES[1..BOUNCES.len() - 1].iter().flat_map(|&b| [(2, b), (1, b)]);
        for (spp, bounces) in [(2, most), (1, most)].into_iter().chain(between).chain([(2, few), (1, few)]) {
            if self.begin.elapsed() < TIME_LIMIT || bounces == few {
                self.time(quality(spp, bounces))?;
            }
        }
        let missing = self.missing_light();
        let mut rungs: Vec<Rung> = choice.qualities.iter().map(|q| self.rung(q, missing[&q.bounces])).collect();
        let efforts = efforts(&rungs);
        // Efforts are told apart from here on by what was measured: a frame more puts what the next ones are held against
        // into their terms.
        if let Some((quality, effort)) = choice.qualities.first().zip(efforts.first()) {
            self.renderer.set_quality(self.limits.limit(quality), effort.clone())?;
            self.render()?;
        }
        for (rung, effort) in rungs.iter_mut().zip(efforts) {
            let quality = self.limits.limit(&rung.quality);
            rung.time_ms = self.renderer.predicted_ms(&quality, &effort).unwrap_or(f64::NAN);
        }
        origin.devices = self.renderer.devices().iter().map(|d| d.name.clone()).collect();
        Ok(Ladder::of_measured(origin, &rungs).context("no setting could be timed")?)
    }

    fn time(&mut self, quality: Option<&Quality>) -> Result<(), Failure> {
        let Some(quality) = quality else { return Ok(()) };
        let warm_up = if self.frames == 0 { WARM_UP } else { 0 };
        self.renderer.set_quality(self.limits.limit(quality), guessed_effort(quality))?;
        self.renderer.begin_anew();
        let mut least: BTreeMap<String, f64> = BTreeMap::new();
        for i in 0..warm_up + FRAMES {
            let frame = self.render()?;
            if i >= warm_up {
                for (stage, ms) in frame.stage_ms() {
                    least.entry(stage).and_modify(|least| *least = least.min(ms)).or_insert(ms);
                }
            }
        }
        let light = mean_light(&self.renderer.read_linear()?);
        self.timed.insert((quality.spp, quality.bounces), Timed { quality: *quality, stage_ms: least, light });
        Ok(())
    }

    fn render(&mut self) -> Result<FrameReport, Failure> {
        interrupt::check()?;
        let frame = self.renderer.render(self.rig, self.time_s, FIRST_FRAME + self.frames)?;
        self.frames += 1;
        Ok(frame)
    }

    /// By bounces, the share of the light that more of them bring. Where it was not measured, it halves with each.
    fn missing_light(&self) -> HashMap<u32, f64> {
        let light = |bounces: u32| {
            let of = self.timed.iter().filter(|((_, b), _)| *b == bounces);
            let sums =
                of.fold([0.0; 2], |[sum, spp], ((s, _), t)| [sum + f64::from(*s) * t.light, spp + f64::from(*s)]);
            (sums[1] > 0.0).then(|| sums[0] / sums[1])
        };
        let [few, most] = [BOUNCES[0], BOUNCES[BOUNCES.len() - 1]];
        let all = light(most).filter(|all| *all > 0.0);
        let share = |bounces: u32| Some((1.0 - light(bounces)? / all?).max(0.0));
        let mut missing = HashMap::new();
        let mut least: f64 = 0.0;
        for bounces in BOUNCES.into_iter().rev() {
            let halved = || share(few).unwrap_or(0.0) * 0.5f64.powi((bounces - few) as i32);
            // Noise must not make more light of fewer bounces.
            least = least.max(share(bounces).unwrap_or_else(halved));
            missing.insert(bounces, least);
        }
        missing
    }

    /// A candidate with what its stages are taken to cost; its own time is not known yet.
    fn rung(&self, quality: &Quality, missing_light: f64) -> Rung {
        let error = guessed_error(quality, missing_light, self.rows);
        let (quality, stage_ms, time_ms) = (*quality, self.stage_ms(quality), f64::NAN);
        Rung { time_ms, error, flip: None, flicker: None, relmse: None, is_estimated: true, quality, stage_ms }
    }

    /// Path tracing goes with the samples, from the same number of bounces if they were timed. The G-buffer takes a ray
    /// more for each sample where it averages.
    fn stage_ms(&self, quality: &Quality) -> BTreeMap<String, f64> {
        let spp = quality.spp.min(2);
        let near = [quality.bounces, BOUNCES[0]].into_iter().find_map(|b| self.timed.get(&(spp, b)));
        let Some(Timed { quality: near, stage_ms: timed, .. }) = near else { return BTreeMap::new() };
        let paths = guessed_paths(quality) / guessed_paths(near);
        let centre_ms = self.timed.get(&(1, near.bounces)).and_then(|t| t.stage_ms.get(gbuffer::STAGE.name())).copied();
        let ms = |stage: Stage| {
            let ms = *timed.get(stage.name())?;
            Some((
                stage.name().to_owned(),
                match stage {
                    gbuffer::STAGE => {
                        let centre_ms = centre_ms.unwrap_or(ms).min(ms);
                        centre_ms + (ms - centre_ms) * f64::from(quality.spp) / f64::from(spp)
                    }
                    _ => ms * paths,
                },
            ))
        };
        TRACING.into_iter().filter_map(ms).collect()
    }
}

/// Mean of both eyes' radiance.
fn mean_light(images: &Stereo<RgbImage>) -> f64 {
    let pixels = images.left.pixels.iter().chain(&images.right.pixels);
    let sum: f64 = pixels.flatten().filter(|c| c.is_finite()).map(|c| f64::from(*c)).sum();
    sum / (images.left.pixels.len() + images.right.pixels.len()).max(1) as f64
}
