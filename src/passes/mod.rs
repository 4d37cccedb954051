//! The passes of the renderer, declared as plain data without wgpu.
//!
//! [`declare`] selects the passes of a frame. A new pass needs a module here that names its shader, the shader itself,
//! and one line in [`declare`].

mod aov;
mod auxiliary;
mod declared;
pub mod denoise;
pub mod gbuffer;
mod history_length;
mod motion;
mod moving;
pub mod path_trace;
mod polar;
mod radiance_cache;
mod reproject;
mod resources;
mod mask_compaction;
mod display_resampling;
mod spec;
mod tally;
pub mod tonemap;

use std::fmt;
use std::ops::RangeInclusive;
use std::sync::Arc;

pub use aov::Aov;
pub use auxiliary::{STAGES as AOVS, image as aov_image};
pub use declared::Declared;
pub use display_resampling::LATE_PARTITION;
pub use moving::Moving;
pub use resources::{HOLES, PREVIOUS};
pub use spec::{Display, FrameSpec, ImageChain, Views};
pub use tally::{HoleReason, ROW_TALLY, RowTally, SKIPPED};

use crate::graph::{Partition, Pass, Program, ProgramError, Scope, Seam};
use crate::image::Extent;
use crate::projection::PolarSpace;
use crate::scene::rig::Eye;
use denoise::{Denoiser, Light};
use history_length::Counted;

/// Declares the built-in passes of a frame.
pub fn declare(spec: &FrameSpec) -> Declared {
    let mut frame = Declared::default();
    if spec.imported {
        frame.passes = denoise::import::passes(spec);
        return frame;
    }
    motion::bring(spec, &mut frame);
    for view in spec.eyes() {
        frame.add(gbuffer::pass(spec, view));
        motion::follow(spec, view, &mut frame);
        let is_traced = spec.source(view).is_none();
        let surfaces = |frame: &mut Declared, is_needed: bool, why_not, pass| match spec.has_surfaces {
            true => frame.add_if(is_needed, why_not, pass),
            false => frame.add_if(false, "the scene has no surfaces", pass),
        };
        surfaces(&mut frame, is_traced && spec.sparse, "no pixel is left to the denoiser", mask_compaction::pass(view));
        surfaces(&mut frame, is_traced, "the view is reprojected", path_trace::pass(spec, view));
        if !view.is_source() {
            let why_not = "the view is path traced";
            surfaces(&mut frame, !is_traced, why_not, reproject::pass(spec, view));
            if let Some(partner) = view.partner() {
                let shares = spec.partner(view).is_some();
                surfaces(&mut frame, shares, "views share no holes", reproject::share_holes(spec, view, partner));
            }
            surfaces(&mut frame, !is_traced, why_not, path_trace::hole_fill(spec, view));
        }
    }
    let denoiser = denoise::of(spec.denoiser());
    let mut views: Vec<denoise::Denoised> = Vec::new();
    for view in spec.eyes() {
        let source = spec.source(view).filter(|_| spec.takes_over_filtered_light());
        let source_light = source.and_then(|source| views.iter().find(|v| v.view == source)).map(|v| v.light.image());
        views.push(denoise::Denoised::new(denoiser, spec, view, source_light));
    }
    views.iter_mut().for_each(|view| frame.passes.append(&mut view.before));
    let links = views[0].filter.len();
    let runs = match spec.seam {
        Seam::Halo(plan) if links > 0 => plan.runs(links),
        _ => std::iter::once(0..links).collect(),
    };
    if views.iter().any(|view| view.taken_over.is_some()) {
        // Reprojected views need the filtered light of their sources.
        for view in views.iter_mut().filter(|view| view.taken_over.is_none()) {
            frame.passes.append(&mut view.filter);
        }
        frame.passes.extend(views.iter_mut().filter_map(|view| view.taken_over.take()));
        for view in &mut views {
            frame.passes.append(&mut view.filter);
            finish(spec, denoiser, view.view, &mut view.light, &mut frame);
        }
        return in_order(spec, frame);
    }
    // The views alternate, so that devices filter one view while rows of the other are transferred.
    for run in &runs {
        for view in &mut views {
            frame.passes.extend(view.filter.drain(..run.len()));
            if run.end == links {
                finish(spec, denoiser, view.view, &mut view.light, &mut frame);
            }
        }
    }
    in_order(spec, frame)
}

/// Adds the passes of the radiance cache, and moves late reprojection to the end, so that both eyes use the same pose,
/// sampled as late as possible.
fn in_order(spec: &FrameSpec, mut frame: Declared) -> Declared {
    for pass in radiance_cache::passes(spec) {
        frame.add_if(spec.caches(), "paths do not end in a radiance cache", pass);
    }
    let (first, last): (Vec<_>, Vec<_>) = frame.passes.into_iter().partition(|pass| pass.partition != LATE_PARTITION);
    Declared { passes: [first, last].concat(), ..frame }
}

/// Adds the passes of a view that follow the denoiser's filter.
fn finish(spec: &FrameSpec, denoiser: &dyn denoise::Denoise, view: Eye, light: &mut Light, frame: &mut Declared) {
    let counted = denoiser.frame_counts().map(|counts| Counted { counts, light: light.image() });
    let aovs = |of_history: bool| {
        let all = (0..).zip(&spec.aovs).filter(move |(_, aov)| (**aov == Aov::History) == of_history);
        all.flat_map(move |(index, aov)| auxiliary::passes(spec, view, index, *aov, counted))
    };
    // The passes below overwrite the light that the image of history lengths reads.
    frame.passes.extend(aovs(true));
    let has_seams = spec.denoiser().is_some() && spec.seam == Seam::Filter && spec.devices > 1;
    let mut smoothed = *light;
    frame.add_if(has_seams, "no seams are smoothed", denoise::seam_filter::pass(view, &mut smoothed));
    if has_seams {
        *light = smoothed;
    }
    frame.passes.extend(denoiser.finish(spec, view, light));
    polar::show(spec, view, frame);
    frame.passes.extend(display_resampling::pass(spec, view));
    frame.add(tally::pass(view));
    frame.passes.extend(aovs(false));
}

type Declare = dyn Fn(&FrameSpec) -> Vec<Pass> + Send + Sync;

/// Function that declares the passes of a frame.
#[derive(Clone)]
pub struct Declarations(Arc<Declare>);

impl Default for Declarations {
    /// Returns the declarations of the built-in passes ([`declare`]).
    fn default() -> Self {
        Self::new(|spec| declare(spec).passes)
    }
}

impl fmt::Debug for Declarations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Declarations")
    }
}

impl Declarations {
    pub fn new(declare: impl Fn(&FrameSpec) -> Vec<Pass> + Send + Sync + 'static) -> Self {
        Self(Arc::new(declare))
    }

    /// Builds the program of a frame.
    ///
    /// # Errors
    /// [`ProgramError`] if passes contradict one another.
    pub fn check(&self, spec: &FrameSpec) -> Result<Program, ProgramError> {
        Program::new(spec.extent, spec.seam, (self.0)(spec))
    }

    /// Builds the program of a frame. The declarations must have been checked.
    ///
    /// # Panics
    /// If passes contradict one another.
    pub fn program(&self, spec: &FrameSpec) -> Arc<Program> {
        Arc::new(self.check(spec).unwrap_or_else(|e| panic!("passes contradict one another: {e}")))
    }

    /// Builds a program for each of these numbers of denoiser iterations. Together, the programs contain every pass and
    /// image of a run whose frames differ in iterations, history and seams.
    pub fn programs(&self, spec: &FrameSpec, iterations: RangeInclusive<u32>) -> Result<Vec<Program>, ProgramError> {
        iterations.map(|iterations| self.check(&FrameSpec { iterations, ..spec.clone() })).collect()
    }
}

/// Returns the passes of example frames that together contain every stage.
fn all_passes() -> impl Iterator<Item = Pass> {
    let one = Extent::new(1, 1);
    let resampled = |is_late| Display::Resampled { projection: one, is_late };
    let direct = ImageChain::direct(one);
    let of_spaces = PolarSpace::ALL.iter().map(|space| ImageChain { polar: Some(*space), ..direct });
    let of_displays = [false, true].map(|is_late| ImageChain { display: resampled(is_late), ..direct });
    let chains: Vec<_> = [direct].into_iter().chain(of_spaces).chain(of_displays).collect();
    let with = move |filter| chains.clone().into_iter().map(move |chain| (filter, chain));
    let kinds = Denoiser::choices().into_iter().flat_map(with);
    let traced = kinds.flat_map(move |(filter, chain)| {
        let (seam, aovs) = (Seam::Filter, vec![Aov::Albedo, Aov::History]);
        let moving = Some(Moving { triangles: 1, nodes: 1, levels: vec![1], ..Moving::default() });
        // The second of four views has a source and a partner.
        let small = FrameSpec { view_count: 4, ..FrameSpec::new(one, 2) };
        declare(&FrameSpec { chain, sparse: true, filter, iterations: 1, seam, aovs, moving, cache: true, ..small })
            .passes
    });
    traced.chain(denoise::import::passes(&FrameSpec::new(one, 1)))
}

/// Returns the partitions of all passes that have stripes (groups of passes with the same stripes), each once, in order
/// of first use.
pub fn partitions() -> Vec<Partition> {
    let mut groups = Vec::new();
    for pass in all_passes().filter(|pass| pass.scope == Scope::View) {
        if !groups.contains(&pass.partition) {
            groups.push(pass.partition);
        }
    }
    groups
}

/// Returns one pass of each kernel.
pub fn pass_of_each_kernel() -> Vec<Pass> {
    let mut passes: Vec<Pass> = Vec::new();
    for pass in all_passes() {
        if passes.iter().all(|known| known.kernel != pass.kernel) {
            passes.push(pass);
        }
    }
    passes
}

#[cfg(test)]
pub(crate) mod graph_tests;
#[cfg(test)]
pub(crate) mod tests;
