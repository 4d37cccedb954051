//! The cost of stripes for passes that share a partition.

use std::ops::Range;

use super::CostModel;
use crate::graph::{Partition, Work};
use crate::scene::rig::Eye;

impl CostModel {
    /// Returns a model of the cost of stripes, summed over all passes of these groups on both views.
    pub fn stripes_of(&self, groups: &[Partition]) -> StripeCosts<'_> {
        let mut parts: Vec<Part> = Vec::new();
        for linked in self.program.passes().iter().filter(|p| groups.contains(&p.pass.partition)) {
            let Some(number) = self.number_of(linked.pass.stage, linked.pass.view) else { continue };
            let (stage, margin_rows) = (self.stages[number], linked.margin_rows);
            let mut add = |unit: (Work, Eye), units: f64| {
                let ms = (0..self.devices()).map(|d| self.ms_per_unit(number, d) * units);
                match parts.iter_mut().find(|p| p.unit == unit && p.margin_rows == margin_rows) {
                    Some(part) => part.ms_per_unit.iter_mut().zip(ms).for_each(|(sum, ms)| *sum += ms),
                    None => parts.push(Part { unit, margin_rows, ms_per_unit: ms.collect() }),
                }
            };
            // Only rays differ by view; rows count the same on both.
            let view = if stage.work == Work::Rays { stage.view } else { stage.view.main() };
            add((stage.work, view), self.relative_cost.of(stage.stage));
            if stage.work == Work::Rays {
                let pixels_per_row = f64::from(self.program.extent.width);
                add((Work::Rows, stage.view.main()), self.idle_rays[number].per_pixel() * pixels_per_row);
            }
        }
        StripeCosts { model: self, parts }
    }
}

/// Predicted costs of stripes for several stages together.
pub struct StripeCosts<'a> {
    model: &'a CostModel,
    parts: Vec<Part>,
}

/// Passes that count the same unit and have the same margin.
struct Part {
    unit: (Work, Eye),
    margin_rows: u32,
    /// Time per unit, for each device.
    ms_per_unit: Vec<f64>,
}

impl StripeCosts<'_> {
    pub fn devices(&self) -> usize {
        self.model.devices()
    }

    pub fn height(&self) -> u32 {
        self.model.program.extent.height
    }

    /// Returns the time that a device takes for a stripe, including the margins that it computes around its own rows.
    pub fn ms(&self, device: usize, rows: &Range<u32>) -> f64 {
        if rows.is_empty() {
            return 0.0;
        }
        let part_ms = |part: &Part| {
            let margin = part.margin_rows;
            let rows = rows.start.saturating_sub(margin)..(rows.end + margin).min(self.height());
            part.ms_per_unit[device] * self.model.units_of(part.unit, &rows)
        };
        self.parts.iter().map(part_ms).sum()
    }

    /// Returns the time that each device would take for these rows, without margins and without passes whose time does
    /// not depend on the rows.
    pub fn own_ms(&self, rows: &Range<u32>) -> Vec<f64> {
        let mut sums = vec![0.0; self.devices()];
        for part in self.parts.iter().filter(|part| part.unit.0 != Work::Once) {
            let units = self.model.units_of(part.unit, rows);
            sums.iter_mut().zip(&part.ms_per_unit).for_each(|(sum, ms)| *sum += ms * units);
        }
        sums
    }
}
