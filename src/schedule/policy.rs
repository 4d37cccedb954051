//! `even`, `static` and `measured` stripes.

use std::str::FromStr;

use super::StageCost;
use crate::graph::{Assignment, Stage, Stripes, StripesError};
use crate::scene::rig::Eye;

/// Cuts frames into stripes.
pub trait Policy: Send {
    fn name(&self) -> &'static str;

    /// Stripes of the next frame.
    fn assign(&mut self) -> Assignment;

    /// Device `device` is out; those above it move down by one. At least one is left.
    fn remove_device(&mut self, device: usize);

    /// What the last frame cost.
    fn learn(&mut self, _costs: &[StageCost]) {}
}

/// The same number of rows for every device.
pub struct Even {
    height: u32,
    devices: usize,
}

impl Even {
    pub fn new(height: u32, devices: usize) -> Self {
        Self { height, devices }
    }
}

impl Policy for Even {
    fn name(&self) -> &'static str {
        "even"
    }

    fn assign(&mut self) -> Assignment {
        Assignment::uniform(Stripes::even(self.height, self.devices))
    }

    fn remove_device(&mut self, _device: usize) {
        self.devices -= 1;
    }
}

/// Ratios of one rule: `5,1,2`, or narrowed to a stage and a view as in `atrous=1,1,2`, `path_trace.left=5,1,2`.
#[derive(Clone, Debug, PartialEq)]
pub struct RatioRule {
    pub stage: Option<Stage>,
    pub view: Option<Eye>,
    pub ratios: Vec<f64>,
}

impl FromStr for RatioRule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (place, numbers) = match text.split_once('=') {
            Some((place, numbers)) => (Some(place), numbers),
            None => (None, text),
        };
        let (stage, view) = match place.map(|p| p.split_once('.').unwrap_or((p, ""))) {
            None => (None, None),
            Some((stage, view)) => (Some(parse_stage(stage)?), parse_view(view)?),
        };
        let ratios = numbers
            .split(',')
            .map(|n| n.trim().parse::<f64>().map_err(|_| format!("'{n}' in ratios '{text}' is not a number")))
            .collect::<Result<_, _>>()?;
        Ok(Self { stage, view, ratios })
    }
}

fn parse_stage(name: &str) -> Result<Stage, String> {
    let found = Stage::RATIO_GROUPS.into_iter().find(|s| s.name() == name);
    found.ok_or_else(|| {
        let known: Vec<_> = Stage::RATIO_GROUPS.iter().map(|s| s.name()).collect();
        format!("'{name}' is no stage with ratios of its own: choose one of {}", known.join(", "))
    })
}

fn parse_view(name: &str) -> Result<Option<Eye>, String> {
    match name {
        "" => Ok(None),
        "left" => Ok(Some(Eye::Left)),
        "right" => Ok(Some(Eye::Right)),
        other => Err(format!("'{other}' is no view: choose left or right")),
    }
}

/// Fixed ratios, per stage and view where rules say so; later rules win.
pub struct Static {
    height: u32,
    devices: usize,
    rules: Vec<RatioRule>,
    assignment: Assignment,
}

impl Static {
    pub fn new(height: u32, devices: usize, rules: &[RatioRule]) -> Result<Self, StripesError> {
        let mut assignment = Assignment::uniform(Stripes::even(height, devices));
        for rule in rules {
            if rule.ratios.len() != devices {
                return Err(StripesError::Count { given: rule.ratios.len(), devices });
            }
            let stripes = Stripes::from_weights(height, &rule.ratios)?;
            for stage in Stage::RATIO_GROUPS.into_iter().filter(|s| rule.stage.is_none_or(|r| r == *s)) {
                for view in Eye::ALL.into_iter().filter(|v| rule.view.is_none_or(|r| r == *v)) {
                    assignment.set(stage, view, stripes.clone());
                }
            }
        }
        Ok(Self { height, devices, rules: rules.to_vec(), assignment })
    }
}

impl Policy for Static {
    fn name(&self) -> &'static str {
        "static"
    }

    fn assign(&mut self) -> Assignment {
        self.assignment.clone()
    }

    /// The others keep their ratios; where only zeros are left, rows are shared out evenly.
    fn remove_device(&mut self, device: usize) {
        self.devices -= 1;
        for rule in &mut self.rules {
            rule.ratios.remove(device);
            if rule.ratios.iter().all(|r| *r == 0.0) {
                rule.ratios.fill(1.0);
            }
        }
        if let Ok(fewer) = Self::new(self.height, self.devices, &self.rules) {
            *self = fewer;
        }
    }
}

/// Stripes cut so that what past frames measured, spread over the rows it was measured on, is shared evenly.
///
/// The tracing stages are cut together by their whole cost, so that a row's G-buffer, radiance and reprojection stay on
/// one device. The filter, whose rows all cost alike, is cut evenly on its own: its stripes cost a transfer of the rows
/// between the two cuts, but every device then ends it at the same time.
pub struct Measured {
    height: u32,
    devices: usize,
    /// Milliseconds per row of the tracing stages, per unit of a device's speed.
    row_cost: Vec<f64>,
    tracing: Stripes,
}

/// Share of a new measurement in the running mean of a row's cost.
const LEARNING_RATE: f64 = 0.5;
/// Predicted gain below which edges stay where they are.
const HYSTERESIS: f64 = 0.01;

impl Measured {
    pub fn new(height: u32, devices: usize) -> Self {
        Self { height, devices, row_cost: Vec::new(), tracing: Stripes::even(height, devices) }
    }

    /// Edges that share the predicted cost evenly.
    fn cut(&self) -> Stripes {
        let total: f64 = self.row_cost.iter().sum();
        let mut edges = Vec::with_capacity(self.devices - 1);
        let (mut sum, mut device) = (0.0, 1);
        for (row, cost) in self.row_cost.iter().enumerate() {
            let share = total * device as f64 / self.devices as f64;
            if device < self.devices && sum + 0.5 * cost >= share {
                edges.push(row as u32);
                device += 1;
            }
            sum += cost;
        }
        Stripes::from_edges(self.height, &edges)
    }

    /// Cost of the dearest stripe over the mean.
    fn imbalance(&self, stripes: &Stripes) -> f64 {
        let cost = |d| self.row_cost[stripes.rows(d).start as usize..stripes.rows(d).end as usize].iter().sum::<f64>();
        let dearest = (0..self.devices).map(cost).fold(0.0, f64::max);
        dearest * self.devices as f64 / self.row_cost.iter().sum::<f64>().max(1e-12)
    }
}

impl Policy for Measured {
    fn name(&self) -> &'static str {
        "measured"
    }

    fn assign(&mut self) -> Assignment {
        if self.devices > 1 && !self.row_cost.is_empty() {
            let cut = self.cut();
            if cut.devices() == self.devices && self.imbalance(&cut) < self.imbalance(&self.tracing) - HYSTERESIS {
                self.tracing = cut;
            }
        }
        let mut assignment = Assignment::uniform(self.tracing.clone());
        let even = Stripes::even(self.height, self.devices);
        for view in Eye::ALL {
            assignment.set(Stage::Atrous, view, even.clone());
            assignment.set(Stage::Tonemap, view, even.clone());
        }
        assignment
    }

    /// What rows cost is still known.
    fn remove_device(&mut self, _device: usize) {
        self.devices -= 1;
        let cut = self.cut();
        let is_whole = !self.row_cost.is_empty() && cut.devices() == self.devices;
        self.tracing = if is_whole { cut } else { Stripes::even(self.height, self.devices) };
    }

    fn learn(&mut self, costs: &[StageCost]) {
        let mut now = vec![0.0; self.height as usize];
        for cost in costs {
            let is_tracing = matches!(cost.stage.ratio_group(), Stage::Gbuffer | Stage::PathTrace | Stage::Reproject);
            if is_tracing && !cost.rows.is_empty() {
                let per_row = cost.busy_ms / f64::from(cost.rows.end - cost.rows.start);
                now[cost.rows.start as usize..cost.rows.end as usize].iter_mut().for_each(|r| *r += per_row);
            }
        }
        if self.row_cost.is_empty() {
            self.row_cost = now;
        } else {
            for (old, new) in self.row_cost.iter_mut().zip(now) {
                *old += (new - *old) * LEARNING_RATE;
            }
        }
    }
}

#[cfg(test)]
mod tests;
