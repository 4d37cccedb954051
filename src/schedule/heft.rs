//! The policy `heft`: list scheduling of blocks of rows by upward rank and earliest finish time.
//!
//! The method is that of Topcuoglu, Hariri & Wu 2002, "Performance-effective and low-complexity task scheduling for
//! heterogeneous computing", with these departures:
//! - The tasks are blocks of rows, which are finer than stripes. Groups of passes that share a partition form a set
//!   (such as tracing, or the filter), and each set has its own blocks.
//! - A device owns contiguous rows, but HEFT places blocks anywhere. It therefore only decides the fraction of a set
//!   that each device gets. Stripes are then sized to the time that the device's blocks take.
//! - Blocks are appended, not inserted into gaps, since a device has no gaps before its last tracing block.
//! - Ranks order the blocks within a set, and sets follow one another. Global ranks would only differ if a filter block
//!   took longer than a tracing block and its successors.

use std::collections::VecDeque;

use super::balance::{MovingStripes, balanced};
use super::cost::CostModel;
use super::cost::stripes::StripeCosts;
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
        let shares = if model.has_learned() && model.devices() > 1 { place(model) } else { Vec::new() };
        self.stripes.follow(model, |group, costs| balanced(costs, &shares[group]))
    }

    fn remove_device(&mut self, _device: usize) {
        self.stripes.remove_device();
    }
}

/// Number of blocks of a set per device, and minimum number of blocks of a set. They are enough for a good balance, and
/// few enough to be placed quickly.
const BLOCKS_PER_DEVICE: usize = 16;
const LEAST_BLOCKS: usize = 64;

/// Time of each block of a set on each device in milliseconds, by block, then by device.
type Blocks = Vec<Vec<f64>>;

/// Returns the total time in milliseconds of the blocks that HEFT places on each device, by set, then by device.
fn place(model: &CostModel) -> Vec<Vec<f64>> {
    let (devices, height) = (model.devices(), model.program().extent.height);
    let count = (devices * BLOCKS_PER_DEVICE).max(LEAST_BLOCKS).min(height as usize);
    let rows = Stripes::even(height, count);
    let blocks_of = |costs: StripeCosts<'_>| (0..count).map(|b| costs.own_ms(&rows.rows(b))).collect();
    let sets: Vec<Blocks> = model.program().partition_sets().iter().map(|s| blocks_of(model.stripes_of(s))).collect();
    let reach_rows = filter_reach_rows(model.program());
    let reach = (reach_rows as usize * count).div_ceil(height as usize);
    let transfer_ms = crossing_ms(model, reach_rows);
    let ranks = ranked(&sets, reach, transfer_ms);
    let mut free_ms = vec![0.0; devices];
    // Time at which a block's inputs have arrived, for each device and block.
    let mut ready_ms = vec![vec![0.0; count]; devices];
    let mut shares = Vec::with_capacity(sets.len());
    for (blocks, ranks) in sets.iter().zip(&ranks) {
        let mut order: Vec<usize> = (0..count).collect();
        // The sort is stable: blocks of equal ranks keep their order.
        order.sort_by(|&a, &b| ranks[b].total_cmp(&ranks[a]));
        let mut share = vec![0.0; devices];
        let mut ends_ms = vec![vec![f64::NEG_INFINITY; count]; devices];
        for index in order {
            let end = |d: usize| f64::max(free_ms[d], ready_ms[d][index]) + blocks[index][d];
            // There is at least one device.
            let device = (0..devices).min_by(|&a, &b| end(a).total_cmp(&end(b))).unwrap_or(0);
            free_ms[device] = end(device);
            ends_ms[device][index] = free_ms[device];
            share[device] += blocks[index][device];
        }
        ready_ms = arrivals(&ends_ms, reach, transfer_ms);
        shares.push(share);
    }
    shares
}

/// Returns upward ranks, by set, then by block: a block's mean time over the devices, plus the transfer time and the
/// largest rank of its successors, which are at most `reach` blocks away. This is the mean length of the longest path
/// from the block's start to the end of the frame.
fn ranked(sets: &[Blocks], reach: usize, transfer_ms: f64) -> Vec<Vec<f64>> {
    let mut ranks: Vec<Vec<f64>> = Vec::with_capacity(sets.len());
    for blocks in sets.iter().rev() {
        let mean_ms = |ms: &Vec<f64>| ms.iter().sum::<f64>() / ms.len() as f64;
        let mut own: Vec<f64> = blocks.iter().map(mean_ms).collect();
        if let Some(next) = ranks.last() {
            own.iter_mut().zip(largest_around(next, reach)).for_each(|(rank, after)| *rank += transfer_ms + after);
        }
        ranks.push(own);
    }
    ranks.reverse();
    ranks
}

/// Returns the time at which a block of the next set would have all its inputs on a device, by device, then by block.
/// `ends_ms` holds, in the same layout, the times at which the blocks of this set end; −∞ on all other devices.
fn arrivals(ends_ms: &[Vec<f64>], reach: usize, transfer_ms: f64) -> Vec<Vec<f64>> {
    let latest: Vec<Vec<f64>> = ends_ms.iter().map(|ends| largest_around(ends, reach)).collect();
    let on_device = |device: usize| {
        let mut ready = vec![0.0; latest[device].len()];
        for (from, latest) in latest.iter().enumerate() {
            let way_ms = if from == device { 0.0 } else { transfer_ms };
            ready.iter_mut().zip(latest).for_each(|(ready, end)| *ready = f64::max(*ready, end + way_ms));
        }
        ready
    };
    (0..latest.len()).map(on_device).collect()
}

/// Returns the largest of the values within `reach` of each index.
fn largest_around(values: &[f64], reach: usize) -> Vec<f64> {
    let mut largest = Vec::with_capacity(values.len());
    // Indices of values that exceed all later values so far.
    let mut candidates: VecDeque<usize> = VecDeque::with_capacity(values.len());
    let mut seen = 0;
    for index in 0..values.len() {
        while seen < (index + reach + 1).min(values.len()) {
            while candidates.back().is_some_and(|&c| values[c] <= values[seen]) {
                candidates.pop_back();
            }
            candidates.push_back(seen);
            seen += 1;
        }
        while candidates.front().is_some_and(|&c| c + reach < index) {
            candidates.pop_front();
        }
        largest.push(candidates.front().map_or(f64::NEG_INFINITY, |&c| values[c]));
    }
    largest
}

/// Returns the largest number of rows beyond a device's stripe that a filter pass reads, including its margin.
fn filter_reach_rows(program: &Program) -> u32 {
    let links = program.passes().iter().filter(|p| p.link.is_some());
    links.map(|p| p.pass.halo_rows() + p.margin_rows).max().unwrap_or(0)
}

/// Returns the mean time to transfer this many rows of all inputs of the filter's first pass between two devices.
fn crossing_ms(model: &CostModel, rows: u32) -> f64 {
    let devices = model.devices();
    let first = model.program().passes().iter().find(|p| p.link == Some(0));
    let images = first.iter().flat_map(|p| p.pass.uses.iter().filter(|u| u.is_read()));
    let image_ms = |bytes: u64| {
        let ends_ms = |d| model.download_ms(d, bytes) + model.upload_ms(d, bytes);
        (0..devices).map(ends_ms).sum::<f64>() / devices as f64
    };
    images.map(|u| image_ms(u.image.resource.row_bytes(model.program().extent) * u64::from(rows))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn largest_value_within_reach_is_found() {
        let values: Vec<f64> = (0..40).map(|i| f64::from(i * 17 % 23)).collect();
        for reach in [0, 1, 5, 39, 100] {
            let around = |i: usize| i.saturating_sub(reach)..(i + reach + 1).min(values.len());
            let expected =
                (0..values.len()).map(|i| values[around(i)].iter().copied().fold(f64::NEG_INFINITY, f64::max));
            assert_eq!(largest_around(&values, reach), expected.collect::<Vec<_>>(), "{reach}");
        }
    }

    #[test]
    fn rows_of_the_same_device_need_no_transfer() {
        let none = f64::NEG_INFINITY;
        let ends = [vec![1.0, none, none], vec![none, 2.0, 4.0]];
        assert_eq!(arrivals(&ends, 1, 0.5), [[2.5, 4.5, 4.5], [2.0, 4.0, 4.0]]);
    }
}
