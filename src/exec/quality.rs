//! What may differ from frame to frame, and what a frame would take with it.

use std::collections::HashMap;
use std::sync::Arc;

use super::{ExecError, RenderSettings, Renderer};
use crate::graph::FrameGraph;
use crate::schedule::{CostModel, Effort, simulate};

/// The knobs of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    /// Samples per pixel.
    pub spp: u32,
    /// Light reaches the eye through at most max(bounces, 1) reflections.
    pub bounces: u32,
    /// Of the filter, in the inner, middle and outer foveal layer; alike without foveation.
    pub layer_iterations: [u32; 3],
    /// Render scale, of the image's edges, at most 1: paths are traced for its square's share of the pixels, and the
    /// filter brings light to the others, guided by surfaces at full size.
    pub scale: f64,
    /// Radii of the foveal layers, as in [`crate::stages::Foveation`]; none: all pixels are of the inner one.
    pub fovea: Option<[f64; 2]>,
    /// What its stages cost, held against other qualities.
    pub effort: Effort,
}

impl Quality {
    /// Of every frame, as long as nothing else is said.
    pub(super) fn of(settings: &RenderSettings) -> Self {
        let stages = &settings.stages;
        let layers = stages.foveation.as_ref().map_or([stages.iterations; 3], |f| f.iterations);
        let layer_iterations = layers.map(|n| n.min(stages.iterations));
        Self {
            spp: stages.spp,
            bounces: settings.bounces,
            layer_iterations,
            scale: settings.scale,
            fovea: stages.foveation.as_ref().map(|f| f.radii),
            effort: Effort::default(),
        }
    }

    /// Of the layer that has most.
    pub fn iterations(&self) -> u32 {
        self.layer_iterations.into_iter().fold(0, u32::max)
    }

    fn check(&self, settings: &RenderSettings) -> Result<(), String> {
        let stages = &settings.stages;
        if self.spp == 0 || self.spp > stages.spp {
            return Err(format!("{} samples per pixel, of 1 to {}", self.spp, stages.spp));
        }
        if (self.spp > 1) != stages.jitter(self.spp) {
            return Err("one sample per pixel, without the pipelines for it".to_owned());
        }
        if !(self.scale > 0.0 && self.scale <= 1.0) || (self.scale < 1.0 && !stages.leaves_pixels()) {
            return Err(format!("a render scale of {}, without the pipelines for it", self.scale));
        }
        if self.fovea.is_some() && stages.foveation.is_none() {
            return Err("foveal layers, without the pipelines for them".to_owned());
        }
        let least = u32::from(stages.filter.is_some() && stages.iterations > 0);
        if !(least..=stages.iterations).contains(&self.iterations()) {
            return Err(format!("{} iterations, of {least} to {}", self.iterations(), stages.iterations));
        }
        Ok(())
    }
}

impl Renderer {
    /// Sets the quality of frames that are begun from here on.
    ///
    /// # Errors
    /// [`ExecError::Quality`] for what the settings have no pipelines for: more samples or iterations, no iteration of a
    /// filter, one sample without [`crate::stages::StageSettings::mixes_spp`], fewer pixels without
    /// [`crate::stages::StageSettings::sparse`], layers without foveation.
    pub fn set_quality(&mut self, quality: Quality) -> Result<(), ExecError> {
        quality.check(&self.settings).map_err(ExecError::Quality)?;
        self.quality = quality;
        Ok(())
    }

    /// What frames would take on the stripes of the last one.
    pub fn foresight(&self) -> Foresight<'_> {
        Foresight { renderer: self, plans: HashMap::new() }
    }
}

/// Foretells makespans of one and the same frame at several qualities.
pub struct Foresight<'a> {
    renderer: &'a Renderer,
    /// By iterations: what graphs depend on.
    plans: HashMap<u32, (CostModel, Arc<FrameGraph>)>,
}

impl Foresight<'_> {
    /// The makespan that the cost model foretells, ms; none before it has learned from a frame.
    pub fn makespan_ms(&mut self, quality: &Quality) -> Option<f64> {
        let Renderer { planned, costs, .. } = self.renderer;
        let (plan, graph) = planned.as_ref().filter(|_| costs.has_learned())?;
        let iterations = quality.iterations();
        let (model, graph) = self.plans.entry(iterations).or_insert_with(|| {
            let mut model = costs.clone();
            model.set_quality(iterations, &quality.effort);
            if iterations == plan.iterations {
                return (model, Arc::clone(graph));
            }
            let history_rows = plan.history.as_ref().map(|(_, rows)| *rows);
            let before = history_rows.map(|_| &plan.assignment);
            let graph = FrameGraph::build(&model.program_with(history_rows), &plan.assignment, before);
            (model, Arc::new(graph))
        });
        model.set_quality(iterations, &quality.effort);
        simulate(graph, model).ok().map(|p| p.makespan_ms)
    }
}
