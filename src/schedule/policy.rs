//! The policy trait, and the policies that need no measurements: `even` and `static`.

use std::fmt;
use std::str::FromStr;

use super::cost::CostModel;
use crate::graph::{Assignment, Partition, Stripes, StripesError};
use crate::passes::{denoise, partitions};
use crate::scene::rig::Eye;

/// Method that divides frames into stripes, one for each device.
pub trait Policy: Send {
    fn name(&self) -> &'static str;

    /// Returns the stripes of the next frame, given a `model` that has learned from previous ones.
    fn assign(&mut self, model: &CostModel) -> Assignment;

    /// Removes a device that has failed. The numbers of the devices after it decrease by one. At least one device is
    /// left.
    fn remove_device(&mut self, device: usize);
}

/// Policy that gives every device the same number of rows.
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

    fn assign(&mut self, _model: &CostModel) -> Assignment {
        Assignment::uniform(Stripes::even(self.height, self.devices))
    }

    fn remove_device(&mut self, _device: usize) {
        self.devices -= 1;
    }
}

/// Ratios between the rows of the devices, such as `5,1,2`. They may be limited to a group of passes and a view, as in
/// `denoise=1,1,2` and `path_trace.left=5,1,2`.
#[derive(Clone, Debug, PartialEq)]
pub struct RatioRule {
    pub group: Option<Partition>,
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
        let (group, view) = match place.map(|p| p.split_once('.').unwrap_or((p, ""))) {
            None => (None, None),
            Some((group, view)) => (Some(parse_group(group)?), parse_view(view)?),
        };
        let ratios = numbers
            .split(',')
            .map(|n| n.trim().parse::<f64>().map_err(|_| format!("'{n}' in ratios '{text}' is not a number")))
            .collect::<Result<_, _>>()?;
        Ok(Self { group, view, ratios })
    }
}

impl fmt::Display for RatioRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(group) = self.group {
            let view = self.view.map_or(String::new(), |view| format!(".{view}"));
            write!(f, "{}{view}=", group.0)?;
        }
        let ratios: Vec<String> = self.ratios.iter().map(f64::to_string).collect();
        f.write_str(&ratios.join(","))
    }
}

/// Former names of groups, which are still accepted.
const FORMER: [(&str, Partition); 1] = [("atrous", denoise::PARTITION)];

fn parse_group(name: &str) -> Result<Partition, String> {
    if let Some((_, group)) = FORMER.iter().find(|(former, _)| *former == name) {
        return Ok(*group);
    }
    let known = partitions();
    known.iter().find(|g| g.0 == name).copied().ok_or_else(|| {
        let known: Vec<_> = known.iter().map(|g| g.0).collect();
        format!("'{name}' is not a group of passes with its own ratios: choose one of {}", known.join(", "))
    })
}

fn parse_view(name: &str) -> Result<Option<Eye>, String> {
    match name {
        "" => Ok(None),
        "left" => Ok(Some(Eye::LEFT)),
        "right" => Ok(Some(Eye::RIGHT)),
        other => Err(format!("'{other}' is no view: choose left or right")),
    }
}

/// Policy with fixed ratios. Rules may set them per group of passes and view; later rules take precedence.
pub struct Static {
    height: u32,
    devices: usize,
    rules: Vec<RatioRule>,
    assignment: Assignment,
}

impl Static {
    pub fn new(height: u32, devices: usize, rules: &[RatioRule]) -> Result<Self, StripesError> {
        let mut assignment = Assignment::uniform(Stripes::even(height, devices));
        let groups = partitions();
        for rule in rules {
            if rule.ratios.len() != devices {
                return Err(StripesError::Count { given: rule.ratios.len(), devices });
            }
            let stripes = Stripes::from_weights(height, &rule.ratios)?;
            for group in groups.iter().copied().filter(|g| rule.group.is_none_or(|r| r == *g)) {
                assignment.set(group, rule.view, stripes.clone());
            }
        }
        Ok(Self { height, devices, rules: rules.to_vec(), assignment })
    }
}

impl Policy for Static {
    fn name(&self) -> &'static str {
        "static"
    }

    fn assign(&mut self, _model: &CostModel) -> Assignment {
        self.assignment.clone()
    }

    /// Removes the device's ratios; the others stay. If only zeros are left, rows are divided evenly.
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
