//! The declared passes of a frame.

use crate::graph::{Pass, Stage};
use crate::scene::rig::Eye;

/// The passes of a frame, and the stages that the frame does not need.
#[derive(Clone, Debug, Default)]
pub struct Declared {
    /// The passes in an order that respects every dependency.
    pub passes: Vec<Pass>,
    /// For each stage that is not needed: the stage, the eye, and the reason.
    pub left_out: Vec<(Stage, Eye, &'static str)>,
}

impl Declared {
    pub fn add(&mut self, pass: Pass) {
        self.passes.push(pass);
    }

    /// Adds a pass if it is needed. Otherwise records its stage with the reason `why_not`.
    pub fn add_if(&mut self, is_needed: bool, why_not: &'static str, pass: Pass) {
        match is_needed {
            true => self.passes.push(pass),
            false => self.left_out.push((pass.stage, pass.view, why_not)),
        }
    }
}
