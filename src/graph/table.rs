//! The stage table: which passes a frame needs, in order, and what each reads and writes.
//!
//! A new stage is a new variant of [`Stage`], its sentences in [`passes`], and a room in [`crate::stages`].

use std::ops::Range;

use super::resource::Resource::{self, *};
use crate::image::Extent;
use crate::scene::rig::Eye;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    Gbuffer,
    Select,
    PathTrace,
    Reproject,
    HoleFill,
    Atrous,
    SeamFilter,
    Tonemap,
    Tally,
    Aov,
}

impl Stage {
    /// Stages whose stripes can be chosen on their own.
    pub const RATIO_GROUPS: [Self; 5] = [Self::Gbuffer, Self::PathTrace, Self::Reproject, Self::Atrous, Self::Tonemap];

    /// The stage whose stripes this one takes: lists of pixels, filter passes in recomputed halos and counters stay
    /// on the device that made them.
    pub fn ratio_group(self) -> Self {
        match self {
            Self::Select => Self::PathTrace,
            Self::HoleFill => Self::Reproject,
            Self::SeamFilter => Self::Atrous,
            Self::Tally | Self::Aov => Self::Tonemap,
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
            Self::Atrous => "atrous",
            Self::SeamFilter => "seam_filter",
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

/// How filtered rows come to agree with one device's: before which iterations rows come from neighbours. For those in
/// between, a device filters a margin around its stripe as well, as wide as they reach together. The first one always
/// receives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HaloPlan(u32);

impl HaloPlan {
    /// Receive a wide margin once and filter it oneself.
    pub const RECOMPUTE: Self = Self(1);
    /// Receive narrow margins before every iteration.
    pub const EXCHANGE: Self = Self(u32::MAX);

    /// All plans that differ for this many iterations.
    pub fn all(iterations: u32) -> impl Iterator<Item = Self> {
        (0..1 << iterations.saturating_sub(1)).map(|later| Self(later << 1 | 1))
    }

    pub fn receives_before(self, iteration: u32) -> bool {
        self.0 >> iteration & 1 == 1
    }

    /// The iterations in runs, each after rows were received.
    pub fn runs(self, iterations: u32) -> Vec<Range<u32>> {
        let begins = (0..iterations).filter(|i| *i == 0 || self.receives_before(*i));
        let end = |begin: u32| (begin + 1..iterations).find(|i| self.receives_before(*i)).unwrap_or(iterations);
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
    pub foveated: bool,
    /// À-trous iterations; 0: no denoising.
    pub iterations: u32,
    pub seam: Seam,
    /// Auxiliary images asked for.
    pub aovs: u8,
    /// Whether anything can reflect light; without, only emission is seen.
    pub has_surfaces: bool,
}

impl FrameSpec {
    /// The filter's iterations in runs between which rows are exchanged; one run without any if nothing is filtered.
    fn runs(&self) -> Vec<Range<u32>> {
        let iterations = if self.has_surfaces { self.iterations } else { 0 };
        match self.seam {
            Seam::Halo(plan) if iterations > 0 => plan.runs(iterations),
            _ => std::iter::once(0..iterations).collect(),
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
}

impl Pass {
    fn new(stage: Stage, view: Eye) -> Self {
        Self { stage, view, index: 0, reads: Vec::new(), writes: Vec::new(), margin_rows: 0, filter: None }
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
            if spec.foveated {
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
    let runs = spec.runs();
    // The views take turns: while one's rows are on their way, the other is filtered.
    for run in &runs {
        for view in Eye::ALL {
            out.extend(run.clone().map(|index| atrous(spec, view, index, run.end)));
            if Some(run) == runs.last() {
                finish(spec, view, &mut out);
            }
        }
    }
    out
}

/// Radiance after this many filter passes.
fn filtered(passes: u32) -> Resource {
    if passes == 0 { Radiance } else { Filtered(passes as u8) }
}

fn atrous(spec: &FrameSpec, view: Eye, index: u32, run_end: u32) -> Pass {
    let reach = |i: u32| 2 * atrous_step(i, spec.iterations);
    let later: u32 = (index + 1..run_end).map(reach).sum();
    let (halo, margin) = match spec.seam {
        Seam::Halo(_) => (reach(index) + later, later),
        Seam::None | Seam::Filter => (0, 0),
    };
    let (source, target) = (filtered(index), filtered(index + 1));
    let mut pass = Pass::new(Stage::Atrous, view).reads_of(view, &[Guide, source], halo).writes(&[target]);
    pass.index = index;
    pass.margin_rows = margin;
    pass.filter = Some((source, target));
    pass
}

/// What follows the filter's last iteration.
fn finish(spec: &FrameSpec, view: Eye, out: &mut Vec<Pass>) {
    let iterations = spec.runs().last().map_or(0, |run| run.end);
    let mut last = filtered(iterations);
    if spec.seam == Seam::Filter && iterations > 0 && spec.devices > 1 {
        let next = filtered(iterations + 1);
        let mut pass =
            Pass::new(Stage::SeamFilter, view).reads_of(view, &[Guide, last], SEAM_FILTER_REACH_ROWS).writes(&[next]);
        pass.filter = Some((last, next));
        out.push(pass);
        last = next;
    }
    let mut tonemap = Pass::new(Stage::Tonemap, view).reads(&[last, Albedo, Emission]).writes(&[Linear, Display]);
    tonemap.filter = Some((last, last));
    out.push(tonemap);
    out.push(Pass::new(Stage::Tally, view).reads(&[Tally]).writes(&[RowTally]));
    for i in 0..spec.aovs {
        let mut pass = Pass::new(Stage::Aov, view).reads(&[Hit, Albedo, Emission, Tally]).writes(&[Aov(i)]);
        pass.index = u32::from(i);
        out.push(pass);
    }
}

/// Rows that the seam filter reads beyond its stripe: `REACH` in its shader.
const SEAM_FILTER_REACH_ROWS: u32 = 4;
