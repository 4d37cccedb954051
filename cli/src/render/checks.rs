//! Constraints of the arguments, and defaults that depend on other arguments.

use anyhow::{anyhow, bail, ensure};
use diptych::scene::rig::Rig;

use super::Args;
use crate::failure::Failure;
use crate::output::Also;

/// Most samples per pixel, by default, of frames with a time limit or a wanted noise.
const LIMITED_SPP: u32 = 4096;

impl Args {
    /// Checks constraints that clap cannot express.
    pub fn check(&self) -> Result<(), anyhow::Error> {
        let settings = &self.flags.run.settings;
        for key in ["pass_spp", "passes_out"].into_iter().filter(|key| settings.is_given(key)) {
            ensure!(self.reference, "{key} has no effect without --reference");
        }
        if settings.is_given("time_limit") && !self.reference {
            ensure!(self.flags.frames == 1, "--time-limit is for a single picture, or for --reference");
            let can_end = settings.spp.least > 1 && !settings.spp.varies();
            ensure!(can_end, "--time-limit needs a whole number of at least 2 samples, not --spp {}", settings.spp);
        }
        if let Some((quilt, views)) = self.quilt.zip(settings.views).filter(|(quilt, views)| quilt.views() != *views) {
            bail!("--quilt {quilt} has {} tiles for {views} views: drop --views", quilt.views());
        }
        let is_whole = settings.noise.is_none() || !settings.spp.varies();
        ensure!(is_whole, "--noise needs a whole number of samples at most, not --spp {}", settings.spp);
        for what in [Also::Sheet, Also::Tev].into_iter().filter(|what| self.has(*what)) {
            ensure!(!self.reference, "--reference cannot be combined with --also {what:?}");
        }
        Ok(())
    }

    /// Refuses what only two views have, unless the rig has two.
    pub fn check_views(&self, rig: &Rig) -> Result<(), Failure> {
        let of_eyes = [("--also anaglyph", self.has(Also::Anaglyph)), ("--also over-under", self.has(Also::OverUnder))];
        let by_eye = self.flags.run.settings.ratios.iter().any(|rule| rule.view.is_some());
        let asked = of_eyes.into_iter().chain([("a ratio of one eye", by_eye)]).find(|(_, is_asked)| *is_asked);
        match asked.filter(|_| rig.views != 2) {
            None => Ok(()),
            Some((what, _)) => Err(Failure::Input(anyhow!("{what} needs two views: the rig has {}", rig.views))),
        }
    }

    /// Chooses the views of a quilt, and the most samples for a time limit or a wanted noise, if the command line gives
    /// none.
    pub fn with_defaults(&self) -> Self {
        let mut args = self.clone();
        let settings = &mut args.flags.run.settings;
        if let Some(quilt) = self.quilt.filter(|_| !settings.is_given("views")) {
            settings.views = Some(quilt.views());
        }
        let is_limited = settings.time_limit.is_some() || settings.noise.is_some();
        if is_limited && !settings.is_given("spp") && !args.reference {
            settings.spp = LIMITED_SPP.into();
        }
        args
    }
}
