//! The stage table: which passes a frame needs, in order, and what each reads and writes.
//!
//! A new stage is a new variant of [`Stage`], its sentences in [`passes`], and a room in [`crate::stages`].

use std::ops::Range;

use super::resource::Resource::{self, *};
use crate::image::Extent;
use crate::quality::Denoiser;
use crate::scene::rig::Eye;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    Gbuffer,
    Select,
    PathTrace,
    Reproject,
    HoleFill,
    Accumulate,
    Variance,
    Svgf,
    Atrous,
    SeamFilter,
    Compose,
    Resolve,
    Tonemap,
    Tally,
    Aov,
}

impl Stage {
    /// Stages whose stripes can be chosen on their own.
    pub const RATIO_GROUPS: [Self; 5] = [Self::Gbuffer, Self::PathTrace, Self::Reproject, Self::Atrous, Self::Tonemap];

    /// The stage whose stripes this one takes: lists of pixels, filter passes in recomputed halos and counters stay
    /// on the device that made them. All denoisers are one group.
    pub fn ratio_group(self) -> Self {
        match self {
            Self::Select => Self::PathTrace,
            Self::HoleFill => Self::Reproject,
            Self::Accumulate | Self::Variance | Self::Svgf | Self::SeamFilter => Self::Atrous,
            Self::Compose | Self::Resolve | Self::Tally | Self::Aov => Self::Tonemap,
            other => other,
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Gbuffer => "gbuffer",
            Self::Select => "select",
            Self::PathTrace => "path_trace",
            Self::Reproject => "reproject",
            Self::HoleFill => "hole_fill",
            Self::Accumulate => "accumulate",
            Self::Variance => "variance",
            Self::Svgf => "svgf",
            Self::Atrous => "atrous",
            Self::SeamFilter => "seam_filter",
            Self::Compose => "compose",
            Self::Resolve => "resolve",
            Self::Tonemap => "tonemap",
            Self::Tally => "tally",
            Self::Aov => "aov",
        }
    }
}

/// Which eyes are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Views {
    /// Both path traced.
    Traced,
    /// Left path traced, right reprojected from it with its holes traced.
    Reprojected,
}

/// How filtered rows come to agree with one device's: before which of the filter's passes rows come from neighbours. For
/// those in between, a device filters a margin around its stripe as well, as wide as they reach together. The first one
/// always receives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HaloPlan(u32);

impl HaloPlan {
    /// Receive a wide margin once and filter it oneself.
    pub const RECOMPUTE: Self = Self(1);
    /// Receive narrow margins before every iteration.
    pub const EXCHANGE: Self = Self(u32::MAX);

    /// All plans that differ for this many passes.
    pub fn all(passes: usize) -> impl Iterator<Item = Self> {
        (0..1 << passes.saturating_sub(1)).map(|later| Self(later << 1 | 1))
    }

    pub fn receives_before(self, pass: usize) -> bool {
        self.0 >> pass & 1 == 1
    }

    /// The passes in runs, each after rows were received.
    pub fn runs(self, passes: usize) -> Vec<Range<usize>> {
        let begins = (0..passes).filter(|i| *i == 0 || self.receives_before(*i));
        let end = |begin: usize| (begin + 1..passes).find(|i| self.receives_before(*i)).unwrap_or(passes);
        begins.map(|begin| begin..end(begin)).collect()
    }
}

/// What happens where stripes meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seam {
    /// Stripes are filtered apart.
    None,
    /// ... and smoothed across the seams afterwards.
    Filter,
    /// Filters read across: the same bytes as one device.
    Halo(HaloPlan),
}

/// What a frame must do.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSpec {
    pub extent: Extent,
    pub devices: usize,
    pub views: Views,
    /// Whether only listed pixels are path traced.
    pub sparse: bool,
    pub filter: Option<Denoiser>,
    /// Of the filter; 0: no denoising.
    pub iterations: u32,
    /// How many rows up and down a surface may have moved since the frame before for its history to be found; none:
    /// there is no history.
    pub history_rows: Option<u32>,
    pub seam: Seam,
    /// Auxiliary images asked for.
    pub aovs: u8,
    /// Whether anything can reflect light; without, only emission is seen.
    pub has_surfaces: bool,
}

/// One of the filter's passes that read rows around their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Link {
    stage: Stage,
    index: u32,
    reach_rows: u32,
    source: Resource,
    target: Resource,
}

impl FrameSpec {
    fn filter(&self) -> Option<Denoiser> {
        self.filter.filter(|_| self.has_surfaces && self.iterations > 0)
    }

    /// The filter's passes, one after another.
    fn chain(&self) -> Vec<Link> {
        let iterations = 0..self.iterations;
        match self.filter() {
            None => Vec::new(),
            Some(Denoiser::Atrous) => iterations
                .map(|index| Link {
                    stage: Stage::Atrous,
                    index,
                    reach_rows: 2 * atrous_step(index, self.iterations),
                    source: filtered(index),
                    target: filtered(index + 1),
                })
                .collect(),
            Some(Denoiser::Svgf) => {
                let (source, target) = (filtered(1), filtered(2));
                let variance =
                    Link { stage: Stage::Variance, index: 0, reach_rows: VARIANCE_REACH_ROWS, source, target };
                let iteration = |index| Link {
                    stage: Stage::Svgf,
                    index,
                    reach_rows: svgf_step(index),
                    source: if index == 1 { History } else { filtered(index + 2) },
                    target: if index == 0 { History } else { filtered(index + 3) },
                };
                std::iter::once(variance).chain(iterations.map(iteration)).collect()
            }
        }
    }

    /// How many passes of the filter read rows around their own.
    pub fn filter_passes(&self) -> usize {
        self.chain().len()
    }

    /// Rows that what comes after the filter reads beyond its own.
    fn last_reach_rows(&self) -> u32 {
        if self.filter() == Some(Denoiser::Svgf) { RESOLVE_REACH_ROWS } else { 0 }
    }

    /// The filter's passes in runs between which rows are exchanged; one run without any if nothing is filtered.
    fn runs(&self) -> Vec<Range<usize>> {
        let passes = self.filter_passes();
        match self.seam {
            Seam::Halo(plan) if passes > 0 => plan.runs(passes),
            _ => std::iter::once(0..passes).collect(),
        }
    }

    /// What a frame leaves for the next one, with the stage that made it.
    pub fn kept(&self) -> &'static [(Resource, Stage)] {
        match self.filter() {
            Some(Denoiser::Svgf) => &[
                (Guide, Stage::Gbuffer),
                (Moments, Stage::Accumulate),
                (History, Stage::Svgf),
                (Resolved, Stage::Resolve),
            ],
            None | Some(Denoiser::Atrous) => &[],
        }
    }
}

/// Rows of a resource around one's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Read {
    pub resource: Resource,
    pub view: Eye,
    /// Rows needed above and below.
    pub halo_rows: u32,
}

/// One stage on one view, for all devices.
#[derive(Clone, Debug, PartialEq)]
pub struct Pass {
    pub stage: Stage,
    pub view: Eye,
    /// Which of a stage's repetitions, from 0: the à-trous iteration, the auxiliary image.
    pub index: u32,
    pub reads: Vec<Read>,
    pub writes: Vec<Resource>,
    /// Rows around its own that a device computes as well, for its own later passes.
    pub margin_rows: u32,
    /// The image that a filter reads, and the one it writes.
    pub filter: Option<(Resource, Resource)>,
    /// Which of the filter's passes that read rows around their own, from 0.
    pub link: Option<usize>,
}

impl Pass {
    fn new(stage: Stage, view: Eye) -> Self {
        Self { stage, view, index: 0, reads: Vec::new(), writes: Vec::new(), margin_rows: 0, filter: None, link: None }
    }

    fn reads(self, resources: &[Resource]) -> Self {
        let view = self.view;
        self.reads_of(view, resources, 0)
    }

    fn reads_of(mut self, view: Eye, resources: &[Resource], halo_rows: u32) -> Self {
        self.reads.extend(resources.iter().map(|&resource| Read { resource, view, halo_rows }));
        self
    }

    fn writes(mut self, resources: &[Resource]) -> Self {
        self.writes.extend(resources);
        self
    }
}

/// Distance between the taps of à-trous iteration `index` of `count`: 2^(count-1) down to 1.
pub fn atrous_step(index: u32, count: u32) -> u32 {
    1 << (count - 1 - index)
}

/// Distance between the taps of iteration `index` of SVGF: it rises, so that the first one, which is kept for the next
/// frame, blurs least.
pub fn svgf_step(index: u32) -> u32 {
    1 << index
}

/// Rows that the estimate of variance reads beyond its own: `REACH` in its shader.
const VARIANCE_REACH_ROWS: u32 = 3;

/// The passes of a frame, in an order that respects every dependency; stages with nothing to do are left out.
pub fn passes(spec: &FrameSpec) -> Vec<Pass> {
    let mut out = Vec::new();
    const GBUFFER: [Resource; 5] = [Hit, Guide, Albedo, Emission, Tally];
    const SAMPLED: [Resource; 5] = [Hit, Albedo, Emission, Tally, Radiance];
    for view in Eye::ALL {
        out.push(Pass::new(Stage::Gbuffer, view).writes(&GBUFFER));
        if !spec.has_surfaces {
            continue;
        }
        if view == Eye::Left || spec.views == Views::Traced {
            let mut path_trace = Pass::new(Stage::PathTrace, view).reads(&GBUFFER).writes(&SAMPLED);
            if spec.sparse {
                let select = Pass::new(Stage::Select, view).reads(&[Hit, Guide, Tally]);
                out.push(select.writes(&[Radiance, Tally, Holes]));
                path_trace = path_trace.reads(&[Radiance, Holes]);
            }
            out.push(path_trace);
        } else {
            out.push(
                Pass::new(Stage::Reproject, view)
                    .reads_of(Eye::Left, &[Hit, Guide, Radiance], 0)
                    .reads(&[Hit, Guide, Tally])
                    .writes(&[Radiance, Tally, Holes]),
            );
            out.push(
                Pass::new(Stage::HoleFill, view)
                    .reads(&[Hit, Guide, Albedo, Emission, Tally, Radiance, Holes])
                    .writes(&SAMPLED),
            );
        }
    }
    if spec.filter() == Some(Denoiser::Svgf) {
        out.extend(Eye::ALL.map(|view| accumulate(spec, view)));
    }
    let chain = spec.chain();
    let runs = spec.runs();
    // The views take turns: while one's rows are on their way, the other is filtered.
    for run in &runs {
        for view in Eye::ALL {
            out.extend(run.clone().map(|link| filter(spec, view, &chain, link..run.end)));
            if Some(run) == runs.last() {
                finish(spec, view, &chain, &mut out);
            }
        }
    }
    out
}

/// Radiance after this many filter passes.
fn filtered(passes: u32) -> Resource {
    if passes == 0 { Radiance } else { Filtered(passes as u8) }
}

/// What this frame saw, joined with what the frame before left. What the right eye never saw, the left may have.
fn accumulate(spec: &FrameSpec, view: Eye) -> Pass {
    const LAST: [Resource; 3] = [LastGuide, LastMoments, LastHistory];
    let mut pass = Pass::new(Stage::Accumulate, view).reads(&[Hit, Guide, Radiance, Tally]);
    if let Some(rows) = spec.history_rows {
        let halo = match spec.seam {
            Seam::Halo(_) => rows,
            Seam::None | Seam::Filter => 0,
        };
        pass = pass.reads_of(view, &LAST, halo);
        if view == Eye::Right {
            pass = pass.reads_of(Eye::Left, &LAST, halo);
        }
    }
    pass.filter = Some((Radiance, filtered(1)));
    pass.writes(&[filtered(1), Moments, Tally])
}

/// The first of these links, whose results reach the last one without another exchange.
fn filter(spec: &FrameSpec, view: Eye, chain: &[Link], links: Range<usize>) -> Pass {
    let link = &chain[links.start];
    let after = if links.end == chain.len() { spec.last_reach_rows() } else { 0 };
    let later = after + chain[links.start + 1..links.end].iter().map(|l| l.reach_rows).sum::<u32>();
    let (halo, margin) = match spec.seam {
        Seam::Halo(_) => (link.reach_rows + later, later),
        Seam::None | Seam::Filter => (0, 0),
    };
    let mut pass = Pass::new(link.stage, view).reads_of(view, &[Guide, link.source], halo).writes(&[link.target]);
    pass.index = link.index;
    pass.margin_rows = margin;
    pass.filter = Some((link.source, link.target));
    pass.link = Some(links.start);
    pass
}

/// What follows the filter's last pass.
fn finish(spec: &FrameSpec, view: Eye, chain: &[Link], out: &mut Vec<Pass>) {
    let mut last = chain.last().map_or(Radiance, |link| link.target);
    if spec.seam == Seam::Filter && !chain.is_empty() && spec.devices > 1 {
        let next = after(last);
        let mut pass =
            Pass::new(Stage::SeamFilter, view).reads_of(view, &[Guide, last], SEAM_FILTER_REACH_ROWS).writes(&[next]);
        pass.filter = Some((last, next));
        out.push(pass);
        last = next;
    }
    if spec.filter() == Some(Denoiser::Svgf) {
        resolve(spec, view, last, out);
    } else {
        let tonemap = Pass::new(Stage::Tonemap, view).reads(&[last, Albedo, Emission, Tally]);
        let mut tonemap = tonemap.writes(&[Linear, Display, Tally]);
        tonemap.filter = Some((last, last));
        out.push(tonemap);
    }
    out.push(Pass::new(Stage::Tally, view).reads(&[Tally]).writes(&[RowTally]));
    for i in 0..spec.aovs {
        let mut pass = Pass::new(Stage::Aov, view).reads(&[Hit, Albedo, Emission, Tally]).writes(&[Aov(i)]);
        pass.index = u32::from(i);
        out.push(pass);
    }
}

/// Remodulation, also of the rows around a device's own, and antialiasing over frames.
fn resolve(spec: &FrameSpec, view: Eye, last: Resource, out: &mut Vec<Pass>) {
    let (reach, history) = match spec.seam {
        Seam::Halo(_) => (RESOLVE_REACH_ROWS, spec.history_rows),
        Seam::None | Seam::Filter => (0, spec.history_rows.map(|_| 0)),
    };
    let next = after(last);
    let mut compose = Pass::new(Stage::Compose, view).reads_of(view, &[last, Albedo, Emission], reach).writes(&[next]);
    compose.filter = Some((last, next));
    compose.margin_rows = reach;
    out.push(compose);
    let mut pass = Pass::new(Stage::Resolve, view).reads_of(view, &[next], reach).reads(&[Tally]);
    pass = pass.writes(&[Resolved, Linear, Display, Tally]);
    pass.filter = Some((next, next));
    if let Some(rows) = history {
        pass = pass.reads_of(view, &[LastResolved], rows);
    }
    out.push(pass);
}

/// Where the pass after the one that leaves `last` puts its image.
fn after(last: Resource) -> Resource {
    match last {
        Filtered(passes) => Filtered(passes + 1),
        _ => filtered(3),
    }
}

/// Rows that antialiasing reads beyond its own.
const RESOLVE_REACH_ROWS: u32 = 1;

/// Rows that the seam filter reads beyond its stripe: `REACH` in its shader.
const SEAM_FILTER_REACH_ROWS: u32 = 4;
