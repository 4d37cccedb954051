//! N devices give the same bytes as one for any distribution of rows. [`hold`] compares the runs of a case with one
//! device.

mod cases;
mod needs;
mod quality;

use crate::common::{Frame, Stage, Subject};
use diptych::RunConfig;
use diptych::exec::PerView;
use diptych::graph::{Assignment, HaloPlan, Seam};
use diptych::image::RgbImage;
use diptych::schedule::{CostModel, Even, Measured, Policy, Static};

pub const WIDTH: u32 = 64;
pub const HEIGHT: u32 = 72;

/// How a run distributes rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rows {
    Even,
    Measured,
    /// Ratios of every frame.
    Ratios(&'static [&'static str]),
    /// Ratios of one frame after the other, then from the start again.
    Turns(&'static [&'static str]),
}

impl Rows {
    pub fn policy(self, height: u32, devices: usize) -> Box<dyn Policy> {
        let ratios = |rules: &[&str]| {
            let rules: Vec<_> = rules.iter().map(|r| r.parse().unwrap()).collect();
            Static::new(height, devices, &rules).unwrap()
        };
        match self {
            Self::Even => Box::new(Even::new(height, devices)),
            Self::Measured => Box::new(Measured::new(height, devices)),
            Self::Ratios(rules) => Box::new(ratios(rules)),
            Self::Turns(turns) => Box::new(Turns(turns.iter().map(|rule| ratios(&[rule])).collect(), 0)),
        }
    }
}

/// A policy that assigns each frame by the next of several policies.
struct Turns(Vec<Static>, usize);

impl Policy for Turns {
    fn name(&self) -> &'static str {
        "turns"
    }

    fn assign(&mut self, model: &CostModel) -> Assignment {
        let turn = self.1 % self.0.len();
        self.1 += 1;
        self.0[turn].assign(model)
    }

    fn remove_device(&mut self, device: usize) {
        panic!("device {device} failed");
    }
}

/// A run of a case.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    pub devices: usize,
    pub rows: Rows,
    /// A halo plan that does not adapt; none for the one of the settings.
    pub plan: Option<HaloPlan>,
    pub in_flight: usize,
}

pub fn run(devices: usize, rows: Rows) -> Run {
    Run { devices, rows, plan: None, in_flight: 1 }
}

pub fn even(devices: usize) -> Run {
    run(devices, Rows::Even)
}

impl Run {
    pub fn with(self, plan: HaloPlan, in_flight: usize) -> Self {
        Self { plan: Some(plan), in_flight, ..self }
    }

    /// Renders frames at these times.
    pub fn frames(self, subject: &Subject, settings: &RunConfig, times_s: &[f64]) -> Vec<Frame> {
        let mut settings = settings.clone();
        if let Some(plan) = self.plan {
            (settings.execution.seam, settings.execution.adapts_halo) = (Seam::Halo(plan), false);
        }
        settings.execution.frames_in_flight = self.in_flight;
        let policy = self.rows.policy(settings.grid().height, self.devices);
        Stage::with(subject, &settings, self.devices, policy).frames_in_flight(times_s)
    }
}

/// Returns `count` times from 0 s.
pub fn every(step_s: f64, count: usize) -> Vec<f64> {
    (0..count).map(|i| i as f64 * step_s).collect()
}

/// Asserts that all runs have the bytes and counts of one device, whose frames it returns.
#[track_caller]
pub fn hold(case: &str, subject: &Subject, settings: &RunConfig, times_s: &[f64], runs: &[Run]) -> Vec<Frame> {
    let one = even(1).frames(subject, settings, times_s);
    for run in runs {
        assert_same_frames(&format!("{case}, {run:?}"), &one, &run.frames(subject, settings, times_s));
    }
    one
}

/// Asserts that a sequence has the bytes and counts of another, and no dropped sample.
#[track_caller]
pub fn assert_same_frames(what: &str, expected: &[Frame], found: &[Frame]) {
    assert_eq!(expected.len(), found.len(), "{what}");
    for (a, b) in expected.iter().zip(found) {
        let what = format!("{what}, frame {}", a.report.index);
        assert_eq!(a.report.index, b.report.index, "{what}");
        assert_same(&what, &a.linear, &b.linear);
        assert_eq!(a.report.tallies, b.report.tallies, "{what}");
        assert!(a.report.tallies.iter().all(|tally| tally.nonfinite == 0), "{what}");
    }
}

/// Asserts that the images are equal bit by bit, and show something.
#[track_caller]
pub fn assert_same(what: &str, expected: &PerView<RgbImage>, found: &PerView<RgbImage>) {
    assert_equal(what, expected, found);
    let lit = |image: &RgbImage| image.pixels.iter().filter(|p| **p != [0.0; 3]).count() * 4 > image.extent.area();
    assert!(expected.iter().all(lit), "{what}: there is nothing to see");
}

#[track_caller]
pub fn assert_equal(what: &str, expected: &PerView<RgbImage>, found: &PerView<RgbImage>) {
    assert_eq!(expected.iter().len(), found.iter().len());
    for ((eye, a), b) in expected.with_eyes().zip(found.iter()) {
        assert_eq!(a.extent, b.extent);
        let differs = |i: &usize| a.pixels[*i].map(f32::to_bits) != b.pixels[*i].map(f32::to_bits);
        let wrong: Vec<usize> = (0..a.extent.area()).filter(differs).collect();
        if let Some(&first) = wrong.first() {
            let width = a.extent.width as usize;
            let mut rows: Vec<usize> = wrong.iter().map(|i| i / width).collect();
            rows.dedup();
            panic!(
                "{what}: {} pixels of {eye} differ, the first at ({}, {}): {:?} is not {:?}; rows {rows:?}",
                wrong.len(),
                first % width,
                first / width,
                b.pixels[first],
                a.pixels[first]
            );
        }
    }
}
