//! Recorded costs: measured times of stages for each frame of a shot on each rung of a ladder, which controllers replay.
//!
//! `tools/record-costs.py` records them. A recording is three files: the ladder, a description, and an image in which a
//! row holds one frame of one repeat, and a column one value of a rung. Values are stored as 128 log2(1 + value), in
//! microseconds or rays.

use std::path::{Path, PathBuf};

use diptych::control::{Ladder, relative_costs};
use diptych::graph::Stage;
use diptych::image::Extent;
use diptych::passes::{Declarations, FrameSpec};
use diptych::quality::Quality;
use diptych::scene::rig::Eye;
use diptych::schedule::{FrameCosts, RelativeCost, StageCost};
use serde::Deserialize;

/// Steps of stored values per octave.
const STEPS: f64 = 128.0;

#[derive(Deserialize)]
struct Description {
    width: u32,
    height: u32,
    frames: usize,
    /// Number of consecutive frames that were recorded on one rung before the next one.
    turn: usize,
    /// Names of the columns of each rung: `STAGE VIEW`, `overhead` and `rays`.
    columns: Vec<Vec<String>>,
}

/// The work of a frame on one rung.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    stages: Vec<(Stage, Eye, f64)>,
    /// Frame time besides the stages, in milliseconds.
    overhead_ms: f64,
    /// Number of rays of path tracing in both eyes.
    rays: f64,
}

impl Sample {
    pub fn ms(&self) -> f64 {
        self.overhead_ms + self.stages.iter().map(|(.., ms)| ms).sum::<f64>()
    }

    /// Multiplies all times.
    pub fn slowed(&self, factor: f64) -> Self {
        let stages = self.stages.iter().map(|&(stage, eye, ms)| (stage, eye, ms * factor)).collect();
        Self { stages, overhead_ms: self.overhead_ms * factor, rays: self.rays }
    }

    /// Multiplies the rays and the times of path tracing, as if a scene needed so many more rays.
    pub fn with_rays(&self, factor: f64) -> Self {
        let traces = |stage: Stage| matches!(stage.name(), "path_trace" | "hole_fill");
        let of = |&(stage, eye, ms): &(Stage, Eye, f64)| (stage, eye, if traces(stage) { ms * factor } else { ms });
        Self { stages: self.stages.iter().map(of).collect(), rays: self.rays * factor, ..self.clone() }
    }
}

pub struct Recording {
    pub name: String,
    pub ladder: Ladder,
    pub relative_costs: Vec<RelativeCost>,
    pub extent: Extent,
    /// Number of consecutive frames whose scatter is correlated: those recorded on one rung before the next one.
    pub turn: usize,
    /// By repeat, frame and rung.
    repeats: Vec<Vec<Vec<Sample>>>,
}

impl Recording {
    pub fn all() -> Vec<Self> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/models/control/recorded");
        let is_description = |path: &PathBuf| path.extension().is_some_and(|e| e == "toml") && !is_ladder(path);
        let mut paths: Vec<PathBuf> =
            std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).filter(is_description).collect();
        paths.sort();
        paths.iter().map(|path| Self::read(path)).collect()
    }

    fn read(path: &Path) -> Self {
        let Description { width, height, frames, turn, columns } =
            toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let ladder = Ladder::read(&path.with_extension("ladder.toml")).unwrap();
        let image = image::open(path.with_extension("png")).unwrap().into_luma16();
        assert_eq!(image.width() as usize, columns.iter().map(Vec::len).sum::<usize>());
        let extent = Extent::new(width, height);
        let stages = stages(&ladder, extent);
        let rows: Vec<Vec<Sample>> = image
            .rows()
            .map(|row| {
                let mut values = row.map(|v| (f64::from(v.0[0]) / STEPS).exp2() - 1.0);
                columns.iter().map(|names| sample(names, &mut values, &stages, extent)).collect()
            })
            .collect();
        Self {
            name: path.file_stem().unwrap().to_string_lossy().into_owned(),
            relative_costs: relative_costs(ladder.rungs()),
            ladder,
            extent,
            turn,
            repeats: rows.chunks(frames).map(<[_]>::to_vec).collect(),
        }
    }

    pub fn repeats(&self) -> usize {
        self.repeats.len()
    }

    pub fn frames(&self) -> usize {
        self.repeats[0].len()
    }

    pub fn sample(&self, repeat: usize, frame: usize, rung: usize) -> &Sample {
        &self.repeats[repeat][frame][rung]
    }

    /// Returns the spec of frames on a rung.
    pub fn spec(&self, rung: usize) -> FrameSpec {
        spec(&self.ladder.rungs()[rung].quality, self.extent)
    }

    /// Returns the measured costs of a frame, in the form from which a cost model learns.
    pub fn costs(&self, rung: usize, sample: &Sample) -> FrameCosts {
        let (width, height) = (self.extent.width, self.extent.height);
        let program = Declarations::default().program(&self.spec(rung));
        let cost = |&(stage, view, ms): &(Stage, Eye, f64)| {
            // The time of a filter is the sum over its iterations, each of which is a pass.
            let passes = program.passes().iter().map(|linked| &linked.pass);
            let count = passes.filter(|pass| (pass.stage, pass.view) == (stage, view)).count().max(1);
            std::iter::repeat_n(
                StageCost { stage, view, device: 0, rows: 0..height, busy_ms: ms / count as f64 },
                count,
            )
        };
        let per_pixel = |stage: &str| self.ladder.rungs()[rung].rays.get(stage).copied().unwrap_or(0.0);
        let usual = [per_pixel("path_trace"), per_pixel("hole_fill")];
        let scale = sample.rays / (usual[0] + usual[1]).max(1e-9) / f64::from(width * height);
        let row = |eye: usize| (f64::from(width) * (1.0 + usual[eye] * scale)).round() as u32;
        FrameCosts {
            stages: sample.stages.iter().flat_map(cost).collect(),
            rays: [0, 1].map(|eye| vec![row(eye); height as usize]).to_vec(),
            tail_ms: sample.overhead_ms,
            relative_cost: self.relative_costs[rung].clone(),
            ..FrameCosts::default()
        }
    }
}

fn is_ladder(path: &Path) -> bool {
    path.to_string_lossy().ends_with(".ladder.toml")
}

fn spec(quality: &Quality, extent: Extent) -> FrameSpec {
    FrameSpec {
        filter: quality.denoiser(),
        sparse: true,
        iterations: quality.most_iterations(),
        history_rows: Some(0),
        ..FrameSpec::new(extent, 1)
    }
}

/// Returns all stages of frames of the ladder.
fn stages(ladder: &Ladder, extent: Extent) -> Vec<Stage> {
    let of = |quality: &Quality| {
        let program = Declarations::default().program(&spec(quality, extent));
        program.passes().iter().map(|linked| linked.pass.stage).collect::<Vec<_>>()
    };
    ladder.rungs().iter().flat_map(|rung| of(&rung.quality)).collect()
}

fn sample(names: &[String], values: &mut impl Iterator<Item = f64>, stages: &[Stage], extent: Extent) -> Sample {
    // The G-buffer of each eye casts one ray per pixel.
    let first_hits = 2.0 * f64::from(extent.width * extent.height);
    let mut sample = Sample::default();
    for (name, value) in names.iter().zip(values) {
        match name.split_once(' ') {
            Some((stage, view)) => match stages.iter().find(|s| s.name() == stage) {
                Some(stage) => {
                    sample.stages.push((*stage, if view == "left" { Eye::LEFT } else { Eye::RIGHT }, value / 1e3));
                }
                // The replayed program is that of a static scene.
                None => sample.overhead_ms += value / 1e3,
            },
            None if name == "overhead" => sample.overhead_ms += value / 1e3,
            None => sample.rays = (value - first_hits).max(0.0),
        }
    }
    sample
}
