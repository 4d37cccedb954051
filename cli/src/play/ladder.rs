//! The ladder of a run: the rungs of a file that match the run's options, or the built-in candidates, timed on the shot
//! itself.

use std::path::Path;

use anyhow::{Context, ensure};

use diptych::control::{
    BOUNCES, Ladder, Rung, candidates, guessed_paths, guessed_relative_cost, lack_path_times, relative_costs,
};
use diptych::passes::path_trace;
use diptych::quality::{Denoiser, DenoiserChoice, PolarSpace, Quality};
use diptych::schedule::RelativeCost;

use super::options::LoopOptions;
use crate::failure::Failure;
use diptych::frame::settings::Settings;

/// Settings that a run may use, before their costs are known.
pub struct Choice {
    pub denoiser: DenoiserChoice,
    /// Rungs of the ladder file that the run can use; `None`: the built-in candidates.
    pub ladder: Option<Ladder>,
    pub qualities: Vec<Quality>,
}

impl Choice {
    pub fn new(args: &LoopOptions) -> Result<Self, Failure> {
        let settings = &args.run.settings;
        let Some(path) = &args.ladder else {
            let denoiser = settings.denoiser;
            let polar = settings.polar_space();
            let all = candidates(denoiser, settings.layer_radii().is_some()).into_iter();
            let qualities = all.map(|quality| Quality { polar, ..quality }).collect();
            return Ok(Self { denoiser, ladder: None, qualities });
        };
        Self::from_file(args, path).map_err(Failure::Input)
    }

    /// Selects the rungs of a ladder file that the run can use. All frames of a run have the same denoiser.
    fn from_file(args: &LoopOptions, path: &Path) -> Result<Self, anyhow::Error> {
        let all = Ladder::read(path).context("cannot use --ladder")?;
        let settings = &args.run.settings;
        let (polar, is_layered) = (settings.polar_space(), settings.layer_radii().is_some());
        let of = |denoiser: DenoiserChoice| -> Vec<Rung> {
            let has = |q: &Quality| q.denoiser() == denoiser && q.polar == polar;
            all.rungs().iter().filter(|r| has(&r.quality)).cloned().collect()
        };
        let most = Denoiser::choices().into_iter().filter(|d| !of(*d).is_empty()).max_by_key(|d| of(*d).len());
        let is_asked = settings.is_given("denoiser");
        let denoiser = most.filter(|_| !is_asked).unwrap_or(settings.denoiser);
        let (path, name) = (path.display(), Denoiser::name_of(denoiser));
        let space = match polar {
            None => String::new(),
            Some(PolarSpace::Log(map)) => format!(" and --foveation log-polar --set polar={map}"),
            Some(space) => format!(" and --foveation {}", space.method().name()),
        };
        if !is_asked && all.denoisers().len() > 1 {
            let counts: Vec<String> =
                all.denoisers().iter().map(|(d, rungs)| format!("{rungs} of {}", Denoiser::name_of(*d))).collect();
            log!(
                "warning: the rungs of {path} have several denoisers, {}: those of {name} are played; --denoiser chooses \
                 others, and `diptych bench` makes a ladder of each",
                counts.join(", ")
            );
        }
        let (plain, foveated): (Vec<Rung>, _) = of(denoiser).into_iter().partition(|r| r.quality.fovea.is_none());
        ensure!(
            !(plain.is_empty() && foveated.is_empty()),
            "--ladder {path}: none of its {} rungs uses --denoiser {name}{space}: measure some with `diptych bench`",
            all.rungs().len(),
        );
        let rungs = if is_layered { of(denoiser) } else { plain };
        ensure!(!rungs.is_empty(), "--ladder {path}: all rungs for --denoiser {name} need --foveation layers");
        if !is_layered && !foveated.is_empty() {
            log!("warning: {} rungs of {path} are left out: they need --foveation layers", foveated.len());
        }
        if lack_path_times(&rungs) {
            let stage = path_trace::STAGE.name();
            log!("warning: not all rungs of {path} have a time of {stage}: their relative costs are estimated");
        }
        let ladder = Ladder::new(all.origin().clone(), rungs)?.refined();
        let qualities = ladder.rungs().iter().map(|r| r.quality).collect();
        Ok(Self { denoiser, ladder: Some(ladder), qualities })
    }

    /// Returns the quality and relative cost of a frame on the cheapest rung; `None` if there are no rungs. Among the
    /// built-in candidates, only those with the maximum bounces count, since the light that fewer bounces lose is not
    /// known yet.
    pub fn cheapest(&self, limits: &Settings) -> Option<(Quality, RelativeCost)> {
        if let Some(ladder) = &self.ladder {
            let costs = relative_costs(ladder.rungs());
            return ladder.rungs().iter().map(|rung| limits.limit(&rung.quality)).zip(costs).next();
        }
        let all_bounces = self.qualities.iter().filter(|q| q.bounces == BOUNCES[BOUNCES.len() - 1]);
        let fewest = all_bounces
            .min_by(|a, b| guessed_paths(a).total_cmp(&guessed_paths(b)).then(a.iterations().cmp(&b.iterations())));
        fewest.map(|quality| (limits.limit(quality), guessed_relative_cost(quality)))
    }
}
