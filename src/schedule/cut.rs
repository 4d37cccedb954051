//! Finds contiguous stripes of even predicted cost, and moves edges towards them in small steps.

use super::cost::CostModel;
use super::cost::stripes::StripeCosts;
use crate::graph::{Assignment, Stripes};
use crate::scene::rig::Eye;

/// The largest number of rows by which an edge moves from one frame to the next: a sixteenth of the frame.
///
/// History that the last frame left on a device must follow a stripe's edge. With a sixteenth, these rows are fewer
/// than the 62 that five filter iterations fetch across each edge anyway, for frames of up to 1000 rows, and an edge
/// can still cross half of the frame within 8 frames.
pub fn step_rows(height: u32) -> u32 {
    (height / 16).max(1)
}

/// The predicted gain, as a share of the most expensive stripe, below which edges stay where they are.
const HYSTERESIS: f64 = 0.02;
/// The number of bisections of the interval that holds the cost of the most expensive stripe, down to a millionth.
const HALVINGS: u32 = 20;

/// Stripes of which the most expensive one, relative to its device's weight, is as cheap as contiguous stripes allow.
///
/// They are found by bisection with a greedy probe (Pınar & Aykanat 2004, "Fast optimal load balancing algorithms for
/// 1D partitioning", section 2.2), here with costs that differ by device in a given order of devices.
pub fn cut(costs: &StripeCosts<'_>, weights: &[f64]) -> Stripes {
    let whole = 0..costs.height();
    let devices = 0..costs.devices();
    let dearest = |d: usize| if weights[d] > 0.0 { costs.ms(d, &whole) / weights[d] } else { 0.0 };
    // The bound is above what one device takes for all rows, rounding included.
    let (mut low, mut high) = (0.0, devices.map(dearest).fold(0.0, f64::max) * (1.0 + 1e-9));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if probe(costs, weights, middle).is_some() {
            high = middle;
        } else {
            low = middle;
        }
    }
    match probe(costs, weights, high) {
        Some(edges) => Stripes::from_edges(costs.height(), &edges[..edges.len() - 1]),
        None => Stripes::even(costs.height(), costs.devices()),
    }
}

/// Gives each device in turn as many rows as cost at most `limit` times its weight. The result is none if rows are left
/// over.
fn probe(costs: &StripeCosts<'_>, weights: &[f64], limit: f64) -> Option<Vec<u32>> {
    let height = costs.height();
    let mut edges = Vec::with_capacity(weights.len());
    let mut start = 0;
    for (device, weight) in weights.iter().enumerate() {
        let (mut fits, mut bound) = (start, height + 1);
        while bound - fits > 1 {
            let end = fits + (bound - fits) / 2;
            if costs.ms(device, &(start..end)) <= limit * weight {
                fits = end;
            } else {
                bound = end;
            }
        }
        edges.push(fits);
        start = fits;
    }
    (start == height).then_some(edges)
}

/// The cost of the most expensive stripe.
fn dearest_ms(costs: &StripeCosts<'_>, stripes: &Stripes) -> f64 {
    stripes.iter().map(|(device, rows)| costs.ms(device, &rows)).fold(0.0, f64::max)
}

/// The stripes of each set of groups that are cut together ([`crate::graph::Program::cut_sets`]), from frame to frame.
///
/// Left and right eye are cut together. The G-buffer, radiance and reprojection of a row then stay on one device, and
/// separate stripes for the right eye could even out nothing that the sum of both eyes does not. Without a filter, a
/// row has one owner in all passes.
pub struct MovingStripes {
    height: u32,
    devices: usize,
    /// One for each set, made when the sets are known.
    stripes: Vec<Stripes>,
}

impl MovingStripes {
    /// Stripes that are even at first.
    pub fn new(height: u32, devices: usize) -> Self {
        Self { height, devices, stripes: Vec::new() }
    }

    /// Removes a device. Stripes are even again, since no rows of the others are where they were.
    pub fn remove_device(&mut self) {
        *self = Self::new(self.height, self.devices - 1);
    }

    /// Moves a set's edges towards `target` by at most [`step_rows`], unless that is not worth it.
    pub fn follow(&mut self, model: &CostModel, target: impl Fn(usize, &StripeCosts<'_>) -> Stripes) -> Assignment {
        let sets = model.program().cut_sets();
        self.stripes.resize(sets.len(), Stripes::even(self.height, self.devices));
        let mut assignment = Assignment::uniform(Stripes::even(self.height, self.devices));
        for (index, (set, stripes)) in sets.iter().zip(&mut self.stripes).enumerate() {
            if self.devices > 1 && model.has_learned() {
                let costs = model.stripes_of(set);
                let target = target(index, &costs);
                if dearest_ms(&costs, &target) < dearest_ms(&costs, stripes) * (1.0 - HYSTERESIS) {
                    *stripes = step(stripes, &target);
                }
            }
            for &group in set {
                for view in Eye::ALL {
                    assignment.set(group, view, stripes.clone());
                }
            }
        }
        assignment
    }
}

fn step(from: &Stripes, to: &Stripes) -> Stripes {
    let most = step_rows(from.height());
    let edges = from.inner_edges().iter().zip(to.inner_edges());
    let edges: Vec<u32> = edges.map(|(&old, &new)| new.clamp(old.saturating_sub(most), old + most)).collect();
    Stripes::from_edges(from.height(), &edges)
}
