//! Where to cut: contiguous stripes of even predicted cost, and edges that move towards them little by little.

use super::cost::{CostModel, StripeCosts};
use crate::graph::{Assignment, Stripes};
use crate::scene::rig::Eye;

/// Most rows that an edge moves from one frame to the next: a sixteenth of the frame.
///
/// What the last frame left on a device (history, when stages keep one) must follow a stripe's edge. A sixteenth keeps
/// those rows fewer than the 62 that five filter iterations fetch across each edge anyway, up to frames of 1000 rows,
/// and still lets an edge cross half of the frame within 8 frames.
pub fn step_rows(height: u32) -> u32 {
    (height / 16).max(1)
}

/// Predicted gain, as a share of the dearest stripe, below which edges stay where they are.
const HYSTERESIS: f64 = 0.02;
/// Halvings of the interval that holds the dearest stripe's cost: to a millionth.
const HALVINGS: u32 = 20;

/// Stripes of which the one that is dearest over its device's weight is as cheap as contiguous stripes allow.
///
/// Bisection with a greedy probe (Pınar & Aykanat 2004, "Fast optimal load balancing algorithms for 1D partitioning",
/// section 2.2), with costs that differ by device, whose order is given.
pub fn cut(costs: &StripeCosts<'_>, weights: &[f64]) -> Stripes {
    let whole = 0..costs.height();
    let devices = 0..costs.devices();
    let dearest = |d: usize| if weights[d] > 0.0 { costs.ms(d, &whole) / weights[d] } else { 0.0 };
    // Above what one device takes for all, rounding included.
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

/// Gives each device in turn as many rows as cost at most `limit` times its weight; none if rows are left over.
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

/// Cost of the dearest stripe.
fn dearest_ms(costs: &StripeCosts<'_>, stripes: &Stripes) -> f64 {
    stripes.iter().map(|(device, rows)| costs.ms(device, &rows)).fold(0.0, f64::max)
}

/// Stripes per set of groups that are cut together ([`crate::graph::Program::cut_sets`]), from frame to frame.
///
/// Left and right eye are cut together: a row's G-buffer, radiance and reprojection stay on one device, and stripes of
/// their own for the right eye could even out nothing that the sum of both eyes does not. Without a filter a row has one
/// owner from first to last.
pub struct MovingStripes {
    height: u32,
    devices: usize,
    /// One for each set; made when the sets are known.
    stripes: Vec<Stripes>,
}

impl MovingStripes {
    /// Even at first.
    pub fn new(height: u32, devices: usize) -> Self {
        Self { height, devices, stripes: Vec::new() }
    }

    /// One device less: even again, since nothing on the others is where it was.
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
