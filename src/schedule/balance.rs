//! The policy `measured`: partitions frames into contiguous stripes of equal predicted cost, and moves the edges of the
//! current stripes towards this partition in small steps.

use super::cost::CostModel;
use super::cost::stripes::StripeCosts;
use super::policy::Policy;
use crate::graph::{Assignment, Stripes};

/// Returns the maximum number of rows by which an edge moves from one frame to the next: a sixteenth of the frame.
///
/// When an edge moves, the history of the rows that it crosses must be transferred to their new device. With a
/// sixteenth of a frame of up to 1000 rows, these are at most 62 rows, as many as five filter iterations fetch across
/// each edge anyway. An edge can still cross half of the frame within 8 frames.
pub(super) fn step_rows(height: u32) -> u32 {
    (height / 16).max(1)
}

/// Predicted gain, relative to the most expensive stripe, below which edges stay where they are.
const HYSTERESIS: f64 = 0.02;
/// Number of bisection steps in the search for the smallest possible cost of the most expensive stripe. They narrow the
/// interval to a millionth.
const HALVINGS: u32 = 20;

/// Returns contiguous stripes, one per device, that minimise the cost of the most expensive stripe.
///
/// The method is bisection with a greedy probe (Pınar & Aykanat 2004, "Fast optimal load balancing algorithms for 1D
/// partitioning", section 2.2), extended to costs that differ by device. Stripes follow the order of the devices.
fn balanced(costs: &StripeCosts<'_>) -> Stripes {
    let whole = 0..costs.height();
    let all_rows_ms = (0..costs.devices()).map(|device| costs.ms(device, &whole));
    // Despite rounding, the upper bound is at least the cost of all rows on any device.
    let (mut low, mut high) = (0.0, all_rows_ms.fold(0.0, f64::max) * (1.0 + 1e-9));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if probe(costs, middle).is_some() {
            high = middle;
        } else {
            low = middle;
        }
    }
    match probe(costs, high) {
        Some(edges) => Stripes::from_edges(costs.height(), &edges[..edges.len() - 1]),
        None => Stripes::even(costs.height(), costs.devices()),
    }
}

/// Gives each device in turn as many rows as cost at most `limit_ms`. Returns `None` if rows are left over.
fn probe(costs: &StripeCosts<'_>, limit_ms: f64) -> Option<Vec<u32>> {
    let height = costs.height();
    let mut edges = Vec::with_capacity(costs.devices());
    let mut start = 0;
    for device in 0..costs.devices() {
        let (mut fits, mut bound) = (start, height + 1);
        while bound - fits > 1 {
            let end = fits + (bound - fits) / 2;
            if costs.ms(device, &(start..end)) <= limit_ms {
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

/// Returns the cost of the most expensive stripe.
fn most_expensive_ms(costs: &StripeCosts<'_>, stripes: &Stripes) -> f64 {
    stripes.iter().map(|(device, rows)| costs.ms(device, &rows)).fold(0.0, f64::max)
}

/// Policy that gives every device a stripe of equal predicted time, so faster devices get more rows.
///
/// Each partition set ([`crate::graph::Program::partition_sets`]) has stripes of its own, whose edges move from frame
/// to frame by at most a sixteenth of the frame unless the gain is too small.
///
/// All views share a partition. The G-buffer, radiance and reprojection of a row then stay on one device, and separate
/// stripes for a view would not improve the balance of the sum of all. Without a filter, a row has one owner in
/// all passes.
pub struct Measured {
    height: u32,
    devices: usize,
    /// Stripes of each set, created once the sets are known.
    stripes: Vec<Stripes>,
}

impl Measured {
    /// Creates stripes that start out even.
    pub fn new(height: u32, devices: usize) -> Self {
        Self { height, devices, stripes: Vec::new() }
    }
}

impl Policy for Measured {
    fn name(&self) -> &'static str {
        "measured"
    }

    fn assign(&mut self, model: &CostModel) -> Assignment {
        let sets = model.program().partition_sets();
        self.stripes.resize(sets.len(), Stripes::even(self.height, self.devices));
        let mut assignment = Assignment::uniform(Stripes::even(self.height, self.devices));
        for (set, stripes) in sets.iter().zip(&mut self.stripes) {
            if self.devices > 1 && model.has_learned() {
                let costs = model.stripes_of(set);
                let target = balanced(&costs);
                if most_expensive_ms(&costs, &target) < most_expensive_ms(&costs, stripes) * (1.0 - HYSTERESIS) {
                    *stripes = step(stripes, &target);
                }
            }
            set.iter().for_each(|&group| assignment.set(group, None, stripes.clone()));
        }
        assignment
    }

    /// Removes a device. Stripes restart even, since the rows of all other devices move.
    fn remove_device(&mut self, _device: usize) {
        *self = Self::new(self.height, self.devices - 1);
    }
}

fn step(from: &Stripes, to: &Stripes) -> Stripes {
    let most = step_rows(from.height());
    let edges = from.inner_edges().iter().zip(to.inner_edges());
    let edges: Vec<u32> = edges.map(|(&old, &new)| new.clamp(old.saturating_sub(most), old + most)).collect();
    Stripes::from_edges(from.height(), &edges)
}
