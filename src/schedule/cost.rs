//! Cost model: the time per unit of work for each stage, view and device, learned from previous frames.
//!
//! Passes that trace paths count rays and pixels, and a row of the next frame is assumed to need as many rays as it did
//! in the last one. Other passes count rows. The time per unit of a device is learned from its own stripes, so devices of
//! different speed need no description.

mod frame;
mod idle;
pub mod stripes;
mod transfer;

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

pub use self::frame::{FrameCosts, StageCost, TransferCost};
use self::idle::IdleRays;
use self::transfer::Transfer;
use super::learned::{Line, Mean};
use super::network::Network;
use super::relative_cost::RelativeCost;
use crate::graph::{Pass, Program, Stage, Work};
use crate::scene::rig::Eye;

#[derive(Clone, Debug)]
pub struct CostModel {
    /// Program of the frames being planned.
    program: Arc<Program>,
    /// All pairs of stage and view that were ever planned. Learned times are stored by the index of the pair.
    stages: Vec<StageOfView>,
    /// Fixed cost per pixel of passes that count rays, by index in `stages`. It is added for every pixel, since path
    /// tracing and hole filling visit even those that start no path.
    idle_rays: Vec<IdleRays>,
    /// The relative cost of the frames being planned.
    relative_cost: RelativeCost,
    devices: Vec<DeviceCost>,
    /// Prefix sums of rays over rows, for each eye: `height + 1` entries, divided by the relative cost of the frame in
    /// which the rays were counted.
    rays_above: Vec<Vec<f64>>,
    tail: Mean,
    frames: u32,
    /// Network between devices of different ranks.
    pub network: Network,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct StageOfView {
    stage: Stage,
    view: Eye,
    work: Work,
}

/// Time and work of a pass on one device in a frame.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    ms: f64,
    units: f64,
    /// Pixels that have a fixed cost.
    pixels: f64,
    /// First and last row.
    rows: Option<(u32, u32)>,
}

/// Learned times of one device.
#[derive(Clone, Debug, Default)]
struct DeviceCost {
    /// Time per unit of work, by index in [`CostModel::stages`].
    ms_per_unit: Vec<Mean>,
    /// First and last row of the last frame, by the same index.
    rows: Vec<Option<(u32, u32)>>,
    download: Transfer,
    upload: Transfer,
    lead: Mean,
    gap: Mean,
    wait: Mean,
}

impl CostModel {
    /// Creates a model that has learned nothing yet, for frames of this program on this many devices.
    pub fn new(program: &Arc<Program>, devices: usize) -> Self {
        let height = program.extent.height as usize;
        let mut model = Self {
            program: Arc::clone(program),
            stages: Vec::new(),
            idle_rays: Vec::new(),
            relative_cost: RelativeCost::default(),
            devices: vec![DeviceCost::default(); devices],
            rays_above: vec![vec![0.0; height + 1]; program.views()],
            tail: Mean::default(),
            frames: 0,
            network: Network::default(),
        };
        model.know_stages();
        model
    }

    /// Returns the number of devices.
    pub fn devices(&self) -> usize {
        self.devices.len()
    }

    /// Returns the program of the frames being planned.
    pub fn program(&self) -> &Arc<Program> {
        &self.program
    }

    /// Sets the program and the relative cost of the frames being planned.
    pub fn plan_for(&mut self, program: &Arc<Program>, relative_cost: &RelativeCost) {
        self.relative_cost.clone_from(relative_cost);
        if !Arc::ptr_eq(&self.program, program) {
            self.program = Arc::clone(program);
            self.know_stages();
        }
    }

    fn know_stages(&mut self) {
        for pass in self.program.passes().iter().map(|p| &p.pass) {
            let stage = StageOfView { stage: pass.stage, view: pass.view, work: pass.work };
            if !self.stages.contains(&stage) {
                self.stages.push(stage);
            }
        }
        self.idle_rays.resize_with(self.stages.len(), IdleRays::default);
        self.devices.iter_mut().for_each(|d| d.ms_per_unit.resize_with(self.stages.len(), Mean::default));
    }

    fn number_of(&self, stage: Stage, view: Eye) -> Option<usize> {
        self.stages.iter().position(|s| s.stage == stage && s.view == view)
    }

    /// Returns the stage that traces an eye's paths, whose work is counted in rays.
    fn traces(&self, eye: Eye) -> Option<Stage> {
        let counts = |p: &&Pass| p.view == eye && p.work == Work::Rays;
        self.program.passes().iter().map(|p| &p.pass).find(counts).map(|p| p.stage)
    }

    /// Returns true if the model has learned from at least one frame. Before that, all costs are 0.
    pub fn has_learned(&self) -> bool {
        self.frames > 0
    }

    pub fn learn(&mut self, costs: &FrameCosts) {
        for (eye, rays) in Eye::of_rig(self.program.views()).zip(&costs.rays) {
            let relative_cost = self.traces(eye).map_or(1.0, |stage| costs.relative_cost.of(stage));
            sum_rows(&mut self.rays_above[eye.index()], rays, self.program.extent.width, relative_cost);
        }
        self.learn_stages(costs);
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

    fn learn_stages(&mut self, costs: &FrameCosts) {
        let stages = self.stages.len();
        let mut sums = vec![Sums::default(); self.devices.len() * stages];
        for cost in &costs.stages {
            let Some(number) = self.number_of(cost.stage, cost.view) else { continue };
            let sum = &mut sums[cost.device * stages + number];
            sum.ms += cost.busy_ms;
            sum.units += self.units(number, &cost.rows) * costs.relative_cost.of(cost.stage);
            sum.pixels += self.pixels(number, &cost.rows);
            let (first, last) = sum.rows.unwrap_or((cost.rows.start, cost.rows.end));
            sum.rows = Some((first.min(cost.rows.start), last.max(cost.rows.end)));
        }
        for number in 0..stages {
            if self.stages[number].work == Work::Rays {
                self.learn_idle_rays(number, sums.iter().skip(number).step_by(stages));
            }
        }
        for (device, sums) in self.devices.iter_mut().zip(sums.chunks(stages.max(1))) {
            device.rows.resize(stages, None);
            let learned = device.ms_per_unit.iter_mut().zip(&mut device.rows).zip(&self.idle_rays);
            for (((mean, rows), idle), sum) in learned.zip(sums) {
                let ms_per_unit = sum.ms / (sum.units + idle.per_pixel() * sum.pixels);
                if std::mem::replace(rows, sum.rows) == sum.rows {
                    mean.learn(ms_per_unit);
                } else {
                    mean.learn_changed(ms_per_unit);
                }
            }
        }
    }

    /// Learns the fixed cost per pixel of a pass that counts rays, from the work of each device.
    fn learn_idle_rays<'a>(&mut self, number: usize, of_devices: impl Iterator<Item = &'a Sums>) {
        let (mut all, mut predicted_ms) = (Sums::default(), 0.0);
        for (device, sum) in self.devices.iter().zip(of_devices) {
            if let Some(ms_per_unit) = device.ms_per_unit[number].warm_value() {
                predicted_ms += ms_per_unit * (sum.units + self.idle_rays[number].per_pixel() * sum.pixels);
                (all.ms, all.units, all.pixels) = (all.ms + sum.ms, all.units + sum.units, all.pixels + sum.pixels);
            }
        }
        let ratio = (predicted_ms > 0.0).then(|| all.ms / predicted_ms);
        let factor = self.idle_rays[number].learn(all.units / all.pixels, ratio);
        self.devices.iter_mut().for_each(|device| device.ms_per_unit[number].scale(factor));
    }

    /// Learns from transfers. Those of the first frame, which create their buffers, are forgotten once the second frame
    /// arrives.
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

    /// Returns a model of frames of this program with one device per entry of `speeds`, all on one machine. The stages of
    /// a device take the mean time of the measured devices, divided by its speed. Transfers run on the host and cost the
    /// same at any speed.
    pub fn on_devices(&self, program: &Arc<Program>, speeds: &[f64]) -> Self {
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
            rows: Vec::new(),
            download: Transfer::of(down),
            upload: Transfer::of(up),
            lead,
            gap,
            wait,
        };
        let devices = speeds.iter().map(on).collect();
        let mut model = Self { network: Network::default(), devices, ..self.clone() };
        model.plan_for(program, &self.relative_cost);
        model
    }

    /// Returns the model of a subset of the devices, given by their numbers in increasing order. The devices are
    /// renumbered from 0 in this order.
    pub fn of_devices(&self, devices: &[usize]) -> Cow<'_, Self> {
        if devices.len() == self.devices.len() {
            return Cow::Borrowed(self);
        }
        let of_these = devices.iter().map(|&d| self.devices[d].clone()).collect();
        Cow::Owned(Self { network: self.network.of_devices(devices), devices: of_these, ..self.clone() })
    }

    /// Returns the mean of a learned time over all devices for which it is known; `None` if there are none.
    fn known_mean(&self, of: impl Fn(&DeviceCost) -> Mean) -> Option<f64> {
        let known = self.devices.iter().filter_map(|d| of(d).value());
        let (sum, count) = known.fold((0.0, 0u32), |(sum, count), ms| (sum + ms, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    fn mean_ms(&self, of: impl Fn(&DeviceCost) -> Mean) -> f64 {
        self.known_mean(of).unwrap_or(0.0)
    }

    /// Returns the work of a pass on these rows at a relative cost of 1: rays, rows or 1. Rays do not include the fixed
    /// cost of pixels.
    fn units(&self, number: usize, rows: &Range<u32>) -> f64 {
        let StageOfView { work, view, .. } = self.stages[number];
        self.units_of((work, view), rows)
    }

    fn units_of(&self, (work, view): (Work, Eye), rows: &Range<u32>) -> f64 {
        match work {
            Work::Once => 1.0,
            Work::Rows => f64::from(rows.end - rows.start),
            Work::Rays => {
                let above = &self.rays_above[view.index()];
                above[rows.end as usize] - above[rows.start as usize]
            }
        }
    }

    /// Returns the number of pixels that have a fixed cost in a pass on these rows.
    fn pixels(&self, number: usize, rows: &Range<u32>) -> f64 {
        match self.stages[number].work {
            Work::Rays => f64::from(rows.end - rows.start) * f64::from(self.program.extent.width),
            _ => 0.0,
        }
    }

    /// Returns the time per unit of a stage. A device that never ran it is assumed to match the mean of those that did.
    fn ms_per_unit(&self, number: usize, device: usize) -> f64 {
        let ms = self.devices[device].ms_per_unit[number].value();
        ms.unwrap_or_else(|| self.mean_ms(|d| d.ms_per_unit[number]))
    }

    /// Predicts the time of a pass on these rows in the frames being planned.
    pub fn pass_ms(&self, pass: &Pass, device: usize, rows: &Range<u32>) -> f64 {
        self.pass_ms_at(&self.relative_cost, pass, device, rows)
    }

    /// Predicts the time of a pass on these rows in a frame of another relative cost.
    pub fn pass_ms_at(&self, relative_cost: &RelativeCost, pass: &Pass, device: usize, rows: &Range<u32>) -> f64 {
        let Some(number) = self.number_of(pass.stage, pass.view) else { return 0.0 };
        let units = self.units(number, rows) * relative_cost.of(pass.stage);
        let idle = self.idle_rays[number].per_pixel() * self.pixels(number, rows);
        self.ms_per_unit(number, device) * (units + idle)
    }

    /// Predicts the time of a pass on rows that have `pixels` pixels, with caution: if the cost of the pass is counted
    /// in rays, each pixel counts as at least one ray, since this frame may need more rays than the last one. Returns
    /// `None` if this device has not run the stage yet.
    pub fn cautious_pass_ms(&self, pass: &Pass, device: usize, rows: &Range<u32>, pixels: f64) -> Option<f64> {
        let number = self.number_of(pass.stage, pass.view)?;
        let ms_per_unit = self.devices[device].ms_per_unit[number].value()?;
        let units = self.units(number, rows) * self.relative_cost.of(pass.stage);
        let idle = self.idle_rays[number].per_pixel() * self.pixels(number, rows);
        Some(ms_per_unit * if pass.work == Work::Rays { units.max(pixels) + idle } else { units })
    }

    /// The relative cost of the frames being planned.
    pub fn relative_cost(&self) -> &RelativeCost {
        &self.relative_cost
    }

    /// Predicts the host time to download rows from a device.
    pub fn download_ms(&self, device: usize, bytes: u64) -> f64 {
        self.devices[device].download.ms(bytes)
    }

    /// Predicts the host time to upload rows to a device.
    pub fn upload_ms(&self, device: usize, bytes: u64) -> f64 {
        self.devices[device].upload.ms(bytes)
    }

    /// Returns the time from the start of a frame to the device's first stage.
    pub fn lead_ms(&self, device: usize) -> f64 {
        self.devices[device].lead.value().unwrap_or_else(|| self.mean_ms(|d| d.lead))
    }

    /// Returns the gap between two consecutive stages of a device.
    pub fn gap_ms(&self, device: usize) -> f64 {
        self.devices[device].gap.value().unwrap_or_else(|| self.mean_ms(|d| d.gap))
    }

    /// Returns the time that a device waits for rows that it receives between the filter's iterations. It is 0 until
    /// two frames have measured it, since the first measurement is distorted by cold caches.
    pub fn wait_ms(&self, device: usize) -> f64 {
        self.devices[device].wait.warm_value().unwrap_or(0.0)
    }

    /// Returns the time from the primary's last task to the end of the frame.
    pub fn tail_ms(&self) -> f64 {
        self.tail.value().unwrap_or(0.0)
    }
}

/// Writes prefix sums over rows to `above`. A row counts its `rays` except the one per pixel that the G-buffer casts,
/// divided by `relative_cost`.
fn sum_rows(above: &mut [f64], rays: &[u32], width: u32, relative_cost: f64) {
    let mut sum = 0.0;
    for (entry, &rays) in above[1..].iter_mut().zip(rays) {
        sum += f64::from(rays.saturating_sub(width)) / relative_cost;
        *entry = sum;
    }
}
