//! Subjects of a study: its shots, each at its sizes.

use anyhow::anyhow;

use super::args::StudyArgs;
use super::definition::{Size, Study};
use crate::failure::Failure;
use crate::options::RunOptions;
use diptych::image::Extent;

/// A shot at a size.
pub struct Subject {
    /// Options of the command line, with the shot and the size.
    pub options: RunOptions,
    pub stands_for: String,
    /// Name of the published size.
    pub resolution: &'static str,
    /// Outer radii of the inner and the middle foveal layer, as fractions of the image width.
    pub layer_radii: Option<[f64; 2]>,
}

impl Subject {
    /// Returns the name in progress messages and captions.
    pub fn name(&self) -> String {
        format!("{} at {}", self.options.shot, self.options.settings.size)
    }
}

/// Returns the subjects of a study: all shots at the first size, then at the next. Shots of the command line stand for the
/// same scenes as those of the study that they replace.
pub fn subjects(study: &Study, args: &StudyArgs, has_shot: bool) -> Result<Vec<Subject>, Failure> {
    let scenes = study.shots.iter().map(|[_, scene]| *scene);
    let shots: Vec<String> = match (has_shot, &args.shots[..]) {
        (true, _) => vec![args.options.shot.clone()],
        (false, []) => study.shots.iter().map(|[shot, _]| (*shot).to_owned()).collect(),
        (false, shots) => shots.to_vec(),
    };
    if shots.len() > study.shots.len() {
        let scenes = scenes.collect::<Vec<_>>().join(", ");
        let (count, most) = (shots.len(), study.shots.len());
        return Err(Failure::Input(anyhow!("--shots: {count} shots are more than {most}, which stand for {scenes}")));
    }
    let shots: Vec<(String, &str)> = shots.into_iter().zip(scenes).collect();
    let is_sized = args.options.settings.is_given("size");
    let sizes = if is_sized { &study.sizes[..1] } else { study.sizes };
    let of = |size: &Size, (shot, scene): &(String, &str)| {
        let mut options = RunOptions { shot: shot.clone(), ..args.options.clone() };
        if !is_sized {
            let scaled = |length: u32| ((f64::from(length) * args.fraction).round() as u32).max(1);
            options.settings.size = Extent::new(scaled(size.width), scaled(size.height));
        }
        if let Some(row) = &study.views {
            options.settings.views.get_or_insert(row.count);
            options.settings.baseline.get_or_insert(row.baseline_m);
        }
        let layer_radii = size.layer_radii_px.map(|radii| radii.map(|px| px / f64::from(size.width)));
        Subject { options, stands_for: (*scene).to_owned(), resolution: size.name, layer_radii }
    };
    Ok(sizes.iter().flat_map(|size| shots.iter().map(move |shot| of(size, shot))).collect())
}
