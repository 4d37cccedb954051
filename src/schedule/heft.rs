//! `heft` stripes, by list scheduling of blocks of rows with upward rank and earliest finish time.
//!
//! The method is that of Topcuoglu, Hariri & Wu 2002, "Performance-effective and low-complexity task scheduling for
//! heterogeneous computing", with these departures:
//! - The tasks are blocks of rows, finer than stripes, of each set of groups that is cut together (tracing, filter).
//! - A device owns contiguous rows. HEFT places blocks anywhere, so it decides what share of a set each device gets.
//!   The stripes are then cut to the time that its blocks took there.
//! - Blocks are appended, not inserted into gaps, since a device has no gaps before its last tracing block.

use std::ops::Range;

use super::cost::{CostModel, StripeCosts};
use super::cut::{MovingStripes, cut};
use super::policy::Policy;
use crate::graph::{Assignment, Program, Stripes};

pub struct Heft {
    stripes: MovingStripes,
}

impl Heft {
    pub fn new(height: u32, devices: usize) -> Self {
        Self { stripes: MovingStripes::new(height, devices) }
    }
}

impl Policy for Heft {
    fn name(&self) -> &'static str {
        "heft"
    }

    fn assign(&mut self, model: &CostModel) -> Assignment {
        let shares = if model.has_learned() && model.spec().devices > 1 { place(model) } else { Vec::new() };
        self.stripes.follow(model, |group, costs| cut(costs, &shares[group]))
    }

    fn remove_device(&mut self, _device: usize) {
        self.stripes.remove_device();
    }
}

/// Blocks per device and set: finer than the balance that is asked for, but few enough to be placed in little time.
const BLOCKS_PER_DEVICE: usize = 16;
const LEAST_BLOCKS: usize = 64;

/// A block of one group.
struct Block {
    group: usize,
    /// The time that it takes on each device.
    ms: Vec<f64>,
    /// Mean time from its begin to the end of the frame, along the longest path.
    rank_ms: f64,
    /// The device that it is on and when it ends, once it is placed.
    placed: Option<(usize, f64)>,
}

impl Block {
    fn mean_ms(&self) -> f64 {
        self.ms.iter().sum::<f64>() / self.ms.len() as f64
    }
}

/// Milliseconds that the blocks of each set take on each device, by HEFT.
fn place(model: &CostModel) -> Vec<Vec<f64>> {
    let spec = model.spec();
    let costs: Vec<StripeCosts<'_>> = model.program().cut_sets().iter().map(|s| model.stripes_of(s)).collect();
    let count = (spec.devices * BLOCKS_PER_DEVICE).max(LEAST_BLOCKS).min(spec.extent.height as usize);
    let reach_rows = filter_reach_rows(model.program());
    let reach = (reach_rows as usize * count).div_ceil(spec.extent.height as usize);
    let transfer_ms = crossing_ms(model, reach_rows);
    let mut blocks = ranked(&costs, count, reach, transfer_ms);
    let mut order: Vec<usize> = (0..blocks.len()).collect();
    // The sort is stable: equal ranks keep their order, from the first row of the first set on.
    order.sort_by(|&a, &b| blocks[b].rank_ms.total_cmp(&blocks[a].rank_ms));
    let (mut free_ms, mut ready) = (vec![0.0; spec.devices], vec![0.0; spec.devices]);
    let mut shares = vec![vec![0.0; spec.devices]; costs.len()];
    for index in order {
        ready_ms(&blocks, index, count, reach, transfer_ms, &mut ready);
        let end = |d: usize| f64::max(free_ms[d], ready[d]) + blocks[index].ms[d];
        // There is at least one device.
        let device = (0..spec.devices).min_by(|&a, &b| end(a).total_cmp(&end(b))).unwrap_or(0);
        let end_ms = end(device);
        blocks[index].placed = Some((device, end_ms));
        free_ms[device] = end_ms;
        shares[blocks[index].group][device] += blocks[index].ms[device];
    }
    shares
}

/// All blocks, set by set, with their upward ranks: the mean time of a block plus the largest rank of the blocks that
/// must follow it.
fn ranked(costs: &[StripeCosts<'_>], count: usize, reach: usize, transfer_ms: f64) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::with_capacity(costs.len() * count);
    for (group, costs) in costs.iter().enumerate() {
        let rows = Stripes::even(costs.height(), count);
        blocks.extend((0..count).map(|b| {
            let rows = rows.rows(b);
            let ms = (0..costs.devices()).map(|d| costs.own_ms(d, &rows)).collect();
            Block { group, ms, rank_ms: 0.0, placed: None }
        }));
    }
    for index in (0..blocks.len()).rev() {
        let after = |i: usize| transfer_ms + blocks[i].rank_ms;
        let next = neighbours(index + count, count, reach).filter(|&i| i < blocks.len()).map(after);
        blocks[index].rank_ms = blocks[index].mean_ms() + next.fold(0.0, f64::max);
    }
    blocks
}

/// The blocks of one set within `reach` of block `index`. The set may be one beyond the last.
fn neighbours(index: usize, count: usize, reach: usize) -> Range<usize> {
    let first = index / count * count;
    index.saturating_sub(reach).max(first)..(index + reach + 1).min(first + count)
}

/// The time at which everything that a block reads has arrived, for each device.
fn ready_ms(blocks: &[Block], index: usize, count: usize, reach: usize, transfer_ms: f64, ready: &mut [f64]) {
    ready.fill(0.0);
    if index < count {
        return;
    }
    let mut ends = vec![f64::NEG_INFINITY; ready.len()];
    for (device, end_ms) in neighbours(index - count, count, reach).filter_map(|i| blocks[i].placed) {
        ends[device] = f64::max(ends[device], end_ms);
    }
    for (d, ready) in ready.iter_mut().enumerate() {
        let there = |(device, end_ms): (usize, &f64)| if d == device { *end_ms } else { end_ms + transfer_ms };
        *ready = ends.iter().enumerate().map(there).fold(*ready, f64::max);
    }
}

/// The number of rows that the filter reads beyond its own.
fn filter_reach_rows(program: &Program) -> u32 {
    let links = program.passes().iter().filter(|p| p.link.is_some());
    links.map(|p| p.pass.halo_rows() + p.margin_rows).max().unwrap_or(0)
}

/// Mean time to bring this many rows of what the filter's first pass reads from one device to another.
fn crossing_ms(model: &CostModel, rows: u32) -> f64 {
    let spec = model.spec();
    let first = model.program().passes().iter().find(|p| p.link == Some(0));
    let images = first.iter().flat_map(|p| p.pass.uses.iter().filter(|u| u.is_read()));
    let image_ms = |bytes: u64| {
        let ends_ms = |d| model.download_ms(d, bytes) + model.upload_ms(d, bytes);
        (0..spec.devices).map(ends_ms).sum::<f64>() / spec.devices as f64
    };
    images.map(|u| image_ms(u.image.resource.row_bytes(spec.extent) * u64::from(rows))).sum()
}
