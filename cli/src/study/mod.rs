//! `diptych study`: the experiments of publications, repeated.
//!
//! A study is a file of this folder that lists arrangements of settings and columns of numbers. `settings.toml` fixes
//! all other settings, and `published.toml` has the published numbers.

mod andersson;
mod args;
mod arrangement;
mod bmfr;
mod columns;
mod definition;
mod instants;
mod koskela;
mod leria;
mod leria_lightfield;
mod locked;
mod measuring;
mod moving_gaze;
mod path;
mod peres;
mod results;
mod rows;
mod runner;
mod seams;
mod subject;
mod times;
mod turns;

use anyhow::anyhow;

use super::failure::Failure;
use super::settings::Given;
pub use args::StudyArgs;
use definition::{Camera, Study};

/// All studies but that of seams.
const STUDIES: [&Study; 6] =
    [&leria::STUDY, &leria_lightfield::STUDY, &bmfr::STUDY, &koskela::STUDY, &andersson::STUDY, &peres::STUDY];

pub fn run(args: &StudyArgs) -> Result<(), Failure> {
    let is_typed = |id: &str| Given::here().is_some_and(|given| given.typed(id).is_some());
    if is_typed("shot") && is_typed("shots") {
        return Err(Failure::Input(anyhow!("give either SHOT or --shots, not both")));
    }
    args.refuse_fixed()?;
    if args.name == "seams" {
        args.refuse(&["virtual_devices", "shots", "fraction", "simulate", "conditions"])?;
        return seams::run(args);
    }
    let Some(study) = STUDIES.iter().find(|study| study.name == args.name) else {
        let names: Vec<&str> = STUDIES.iter().map(|study| study.name).chain(["seams"]).collect();
        return Err(Failure::Input(anyhow!("there is no study '{}': give {}", args.name, names.join(", "))));
    };
    args.refuse(&["counts"])?;
    args.refuse(match study.cameras {
        [Camera::Following] => &["repeats", "reference_spp", "time_limit", "reference_dir"],
        _ => &["simulate", "ratios"],
    })?;
    runner::run(study, args, is_typed("shot"))
}
