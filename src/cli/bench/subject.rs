//! Subjects of an experiment: its shots, each at its sizes.

use anyhow::ensure;

use super::args::Args;
use crate::cli::options::RunOptions;
use crate::report::experiment::{Experiment, Resolution, Shot, Texts};
use crate::report::once;

/// A shot at a size.
pub struct Subject {
    /// Options of the command line, with the shot and the size.
    pub options: RunOptions,
    /// Texts that its rows share, by label.
    pub texts: Texts,
    /// Name in progress messages and captions.
    pub name: String,
    /// Outer radii of the inner and the middle foveal layer, as fractions of the image width; `None` for the default.
    pub layer_radii: Option<[f64; 2]>,
}

/// Returns the subjects of an experiment: all shots at the first size, then at the next.
pub fn subjects(args: &Args, experiment: &Experiment) -> Result<Vec<Subject>, anyhow::Error> {
    let (options, factor) = (&args.options, args.of_study().size_factor);
    let shots = shots(args, experiment)?;
    let of = |(shot, resolution): (&Shot, Option<&Resolution>)| {
        let size = resolution.map_or(options.settings.size, |resolution| resolution.size(factor));
        let texts = [
            ("source", Some("measured".to_owned())),
            ("scene", Some(shot.name.clone())),
            ("shot", Some(shot.name.clone())),
            ("stands_for", shot.stands_for.clone()),
            ("resolution", resolution.map(|resolution| resolution.name.clone())),
            ("size", Some(size.to_string())),
        ];
        let mut options = RunOptions { shot: shot.name.clone(), ..options.clone() };
        options.settings.size = size;
        Subject {
            options,
            texts: texts.into_iter().filter_map(|(label, text)| Some((label.to_owned(), text?.into()))).collect(),
            name: resolution.map_or(shot.name.clone(), |_| format!("{} at {size}", shot.name)),
            layer_radii: resolution.and_then(|resolution| resolution.layer_radii()),
        }
    };
    Ok(match &experiment.resolutions[..] {
        [] => shots.iter().map(|shot| of((shot, None))).collect(),
        all => all.iter().flat_map(|one| shots.iter().map(move |shot| (shot, Some(one)))).map(of).collect(),
    })
}

/// Returns the shots to measure: those of `--shots` or of the file, or else the shot of the command line. Shots of
/// `--shots` stand for the same scenes as those of the file that they replace.
fn shots(args: &Args, experiment: &Experiment) -> Result<Vec<Shot>, anyhow::Error> {
    let (named, of_file) = (&args.of_study().shots, &experiment.shots);
    if named.is_empty() && !of_file.is_empty() {
        return Ok(of_file.clone());
    }
    let scenes: Vec<&str> = of_file.iter().filter_map(|shot| shot.stands_for.as_deref()).collect();
    let most = of_file.len();
    ensure!(
        scenes.is_empty() || named.len() <= most,
        "--shots: give at most {most}, in place of {}",
        scenes.join(", ")
    );
    let default = if named.is_empty() { vec![args.options.shot.clone()] } else { named.clone() };
    let stands_for = of_file.iter().map(|shot| shot.stands_for.clone()).chain(std::iter::repeat(None));
    Ok(once(default.into_iter().zip(stands_for).map(|(name, stands_for)| Shot { name, stands_for })))
}
