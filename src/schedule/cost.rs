//! What work costs: time per unit of counted work for each stage, view and device, learned from the frames before.
//!
//! Passes that trace paths count rays, which a row of the next frame is taken to need as many of as it did in the last
//! one; others count rows. A device's own time per unit is learned from its own stripes, so devices of
//! unequal speed need no description.

mod stripes;

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use super::effort::Effort;
use super::learned::{Line, Mean};
use crate::graph::{Pass, Program, Seam, Stage, Work};
use crate::passes::{Declarations, FrameSpec};
use crate::scene::rig::Eye;
pub use stripes::StripeCosts;

/// What one task of a stage cost one device in a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct StageCost {
    pub stage: Stage,
    pub view: Eye,
    pub device: usize,
    /// Rows computed, margins included.
    pub rows: Range<u32>,
    pub busy_ms: f64,
}

/// What one end of a transfer cost the host's thread of its device.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferCost {
    pub device: usize,
    pub is_upload: bool,
    pub bytes: u64,
    pub ms: f64,
}

/// What a frame cost.
#[derive(Clone, Debug, Default)]
pub struct FrameCosts {
    pub stages: Vec<StageCost>,
    pub transfers: Vec<TransferCost>,
    /// Rays counted, per eye and row of the frame.
    pub rays: [Vec<u32>; 2],
    /// Per device that computed anything, from the frame's begin to its first stage; none where that tells nothing.
    pub lead_ms: Vec<(usize, f64)>,
    /// Per device that computed several stages, between two of them that nothing held up.
    pub gap_ms: Vec<(usize, f64)>,
    /// Per device that received rows between the filter's iterations, for which it stood still, the mean of all times.
    pub wait_ms: Vec<(usize, f64)>,
    /// From the primary's last task to the frame's end; 0 tells nothing.
    pub tail_ms: f64,
    /// Of the quality that it had.
    pub effort: Effort,
}

/// A pixel that starts no path costs path tracing and hole filling this many rays: it is looked at.
const RAYS_PER_IDLE_PIXEL: f64 = 1.0 / 32.0;

#[derive(Clone, Debug)]
pub struct CostModel {
    spec: FrameSpec,
    declarations: Declarations,
    program: Arc<Program>,
    /// Stages on a view that were ever planned; what is learned of them stands by their numbers.
    stages: Vec<StageOfView>,
    /// Of the frames that are planned.
    effort: Effort,
    devices: Vec<DeviceCost>,
    /// Per eye, rays of all rows above, over the effort that they were traced with; `height + 1` entries.
    rays_above: [Vec<f64>; 2],
    tail: Mean,
    frames: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct StageOfView {
    stage: Stage,
    view: Eye,
    work: Work,
}

impl StageOfView {
    fn unit(self) -> (Work, Eye) {
        (self.work, self.view)
    }
}

/// One device's own times.
#[derive(Clone, Debug, Default)]
struct DeviceCost {
    /// By number of the stage.
    ms_per_unit: Vec<Mean>,
    download: Transfer,
    upload: Transfer,
    lead: Mean,
    gap: Mean,
    wait: Mean,
}

#[derive(Clone, Copy, Debug, Default)]
struct Transfer {
    line: Line,
    latency_ms: f64,
    ms_per_byte: f64,
}

impl Transfer {
    fn of(line: Line) -> Self {
        let (latency_ms, ms_per_byte) = line.fit();
        Self { line, latency_ms, ms_per_byte }
    }

    fn ms(&self, bytes: u64) -> f64 {
        self.latency_ms + self.ms_per_byte * bytes as f64
    }
}

impl CostModel {
    /// A model that has learned nothing yet, of frames with the passes that are declared for them.
    pub fn new(spec: &FrameSpec, declarations: &Declarations) -> Self {
        let height = spec.extent.height as usize;
        let mut model = Self {
            spec: spec.clone(),
            declarations: declarations.clone(),
            program: declarations.program(spec),
            stages: Vec::new(),
            effort: Effort::default(),
            devices: vec![DeviceCost::default(); spec.devices],
            rays_above: [vec![0.0; height + 1], vec![0.0; height + 1]],
            tail: Mean::default(),
            frames: 0,
        };
        model.know_stages();
        model
    }

    pub fn spec(&self) -> &FrameSpec {
        &self.spec
    }

    /// Of the frames that are planned.
    pub fn program(&self) -> &Arc<Program> {
        &self.program
    }

    /// Filters that come to agree in another way have other margins.
    pub fn set_seam(&mut self, seam: Seam) {
        self.spec.seam = seam;
        self.declare();
    }

    /// Frames are planned that have so many iterations and take this effort.
    pub fn set_quality(&mut self, iterations: u32, effort: &Effort) {
        self.effort.clone_from(effort);
        if iterations != self.spec.iterations {
            self.spec.iterations = iterations;
            self.declare();
        }
    }

    fn declare(&mut self) {
        self.program = self.declarations.program(&self.spec);
        self.know_stages();
    }

    fn know_stages(&mut self) {
        for pass in self.program.passes().iter().map(|p| &p.pass) {
            let stage = StageOfView { stage: pass.stage, view: pass.view, work: pass.work };
            if !self.stages.contains(&stage) {
                self.stages.push(stage);
            }
        }
        self.devices.iter_mut().for_each(|d| d.ms_per_unit.resize_with(self.stages.len(), Mean::default));
    }

    fn number_of(&self, stage: Stage, view: Eye) -> Option<usize> {
        self.stages.iter().position(|s| s.stage == stage && s.view == view)
    }

    /// The stage whose rays are counted of an eye, beside those of the G-buffer.
    fn traces(&self, eye: Eye) -> Option<Stage> {
        let counts = |p: &&Pass| p.view == eye && p.work == Work::Rays;
        self.program.passes().iter().map(|p| &p.pass).find(counts).map(|p| p.stage)
    }

    /// Whether a frame has been learned from; before, all costs are 0.
    pub fn has_learned(&self) -> bool {
        self.frames > 0
    }

    pub fn learn(&mut self, costs: &FrameCosts) {
        for (eye, rays) in Eye::ALL.into_iter().zip(&costs.rays) {
            let effort = self.traces(eye).map_or(1.0, |stage| costs.effort.of(stage));
            sum_rows(&mut self.rays_above[eye as usize], rays, self.spec.extent.width, effort);
        }
        let mut sums = vec![(0.0, 0.0); self.devices.len() * self.stages.len()];
        for cost in &costs.stages {
            let Some(number) = self.number_of(cost.stage, cost.view) else { continue };
            let (ms, units) = &mut sums[cost.device * self.stages.len() + number];
            *ms += cost.busy_ms;
            *units += self.units(self.stages[number].unit(), &cost.rows) * costs.effort.of(cost.stage);
        }
        for (device, sums) in self.devices.iter_mut().zip(sums.chunks(self.stages.len().max(1))) {
            device.ms_per_unit.iter_mut().zip(sums).for_each(|(mean, (ms, units))| mean.learn(ms / units));
        }
        self.learn_transfers(&costs.transfers);
        for &(device, ms) in &costs.lead_ms {
            self.devices[device].lead.learn(ms);
        }
        for &(device, ms) in &costs.gap_ms {
            self.devices[device].gap.learn(ms);
        }
        for &(device, ms) in &costs.wait_ms {
            self.devices[device].wait.learn_with_zero(ms);
        }
        self.tail.learn(costs.tail_ms);
        self.frames = self.frames.saturating_add(1);
    }

    /// The first frame's transfers, which make their buffers, count for nothing once the second is there.
    fn learn_transfers(&mut self, transfers: &[TransferCost]) {
        for (index, device) in self.devices.iter_mut().enumerate() {
            for (is_upload, transfer) in [(false, &mut device.download), (true, &mut device.upload)] {
                let mut new = transfers.iter().filter(|t| t.device == index && t.is_upload == is_upload).peekable();
                if new.peek().is_none() {
                    continue;
                }
                let mut line = if self.frames == 1 { Line::default() } else { transfer.line };
                line.fade();
                new.for_each(|t| line.learn(t.bytes as f64, t.ms));
                *transfer = Transfer::of(line);
            }
        }
    }

    /// A model of as many devices as there are `speeds`: each like the mean of the measured ones, times its speed.
    /// Transfers, which are the host's work, cost the same at any speed.
    pub fn on_devices(&self, speeds: &[f64]) -> Self {
        let (mut down, mut up) = (Line::default(), Line::default());
        for device in &self.devices {
            down.add(&device.download.line);
            up.add(&device.upload.line);
        }
        let means: Vec<Option<f64>> = (0..self.stages.len()).map(|n| self.known_mean(|d| d.ms_per_unit[n])).collect();
        let of: [fn(&DeviceCost) -> Mean; 3] = [|d| d.lead, |d| d.gap, |d| d.wait];
        let [lead, gap, wait] = of.map(|of| Mean::known(self.mean_ms(of)));
        let on = |speed: &f64| DeviceCost {
            ms_per_unit: means.iter().map(|m| m.map_or(Mean::default(), |ms| Mean::known(ms / speed))).collect(),
            download: Transfer::of(down),
            upload: Transfer::of(up),
            lead,
            gap,
            wait,
        };
        self.with_devices(speeds.iter().map(on).collect())
    }

    /// The model of these devices alone, numbered anew in this order, which rises.
    pub fn of_devices(&self, devices: &[usize]) -> Cow<'_, Self> {
        if devices.len() == self.devices.len() {
            return Cow::Borrowed(self);
        }
        Cow::Owned(self.with_devices(devices.iter().map(|&d| self.devices[d].clone()).collect()))
    }

    fn with_devices(&self, devices: Vec<DeviceCost>) -> Self {
        let spec = FrameSpec { devices: devices.len(), ..self.spec.clone() };
        Self { program: self.declarations.program(&spec), spec, devices, ..self.clone() }
    }

    /// Mean of the devices that it is known of.
    fn known_mean(&self, of: impl Fn(&DeviceCost) -> Mean) -> Option<f64> {
        let known = self.devices.iter().filter_map(|d| of(d).value());
        let (sum, count) = known.fold((0.0, 0u32), |(sum, count), ms| (sum + ms, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    fn mean_ms(&self, of: impl Fn(&DeviceCost) -> Mean) -> f64 {
        self.known_mean(of).unwrap_or(0.0)
    }

    fn units(&self, (work, view): (Work, Eye), rows: &Range<u32>) -> f64 {
        match work {
            Work::Once => 1.0,
            Work::Rows => f64::from(rows.end - rows.start),
            Work::Rays => {
                let above = &self.rays_above[view as usize];
                above[rows.end as usize] - above[rows.start as usize]
            }
        }
    }

    /// A device that never did this stage is taken to be like the mean of those that did.
    fn ms_per_unit(&self, number: usize, device: usize, effort: &Effort) -> f64 {
        let ms = self.devices[device].ms_per_unit[number].value();
        ms.unwrap_or_else(|| self.mean_ms(|d| d.ms_per_unit[number])) * effort.of(self.stages[number].stage)
    }

    /// Predicted time of a pass on these rows in frames that are planned.
    pub fn pass_ms(&self, pass: &Pass, device: usize, rows: &Range<u32>) -> f64 {
        self.pass_ms_at(&self.effort, pass, device, rows)
    }

    /// ... in a frame that takes another effort.
    pub fn pass_ms_at(&self, effort: &Effort, pass: &Pass, device: usize, rows: &Range<u32>) -> f64 {
        let number = self.number_of(pass.stage, pass.view);
        number.map_or(0.0, |n| self.ms_per_unit(n, device, effort) * self.units(self.stages[n].unit(), rows))
    }

    /// Of the frames that are planned.
    pub fn effort(&self) -> &Effort {
        &self.effort
    }

    /// Predicted host time to take rows off a device.
    pub fn download_ms(&self, device: usize, bytes: u64) -> f64 {
        self.devices[device].download.ms(bytes)
    }

    /// Predicted host time to hand rows to a device.
    pub fn upload_ms(&self, device: usize, bytes: u64) -> f64 {
        self.devices[device].upload.ms(bytes)
    }

    /// From a frame's begin to the device's first stage.
    pub fn lead_ms(&self, device: usize) -> f64 {
        self.devices[device].lead.value().unwrap_or_else(|| self.mean_ms(|d| d.lead))
    }

    /// Between two stages that a device runs one after the other.
    pub fn gap_ms(&self, device: usize) -> f64 {
        self.devices[device].gap.value().unwrap_or_else(|| self.mean_ms(|d| d.gap))
    }

    /// For which a device stands still when it receives rows between the filter's iterations; 0 before it did in two
    /// frames, as the first time everything is cold.
    pub fn wait_ms(&self, device: usize) -> f64 {
        self.devices[device].wait.warm_value().unwrap_or(0.0)
    }

    /// From the primary's last task to the frame's end.
    pub fn tail_ms(&self) -> f64 {
        self.tail.value().unwrap_or(0.0)
    }
}

/// Prefix sums of a frame's rays beyond those of the G-buffer, one a pixel, over their effort.
fn sum_rows(above: &mut [f64], rays: &[u32], width: u32, effort: f64) {
    let mut sum = 0.0;
    for (entry, &rays) in above[1..].iter_mut().zip(rays) {
        sum += f64::from(rays.saturating_sub(width)) / effort + f64::from(width) * RAYS_PER_IDLE_PIXEL;
        *entry = sum;
    }
}
