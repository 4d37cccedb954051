//! The commands of `diptych` with a custom load-balancing policy, next to the built-in policies, which distribute rows
//! evenly or by measured cost.
//!
//! `cargo run --release --example own_policy -- scale --counts 1,2 --balance even,measured,halving --out out/own`

use std::process::ExitCode;

use diptych::graph::{Assignment, Stripes};
use diptych::schedule::{CostModel, Policy};
use diptych_cli::{Program, prepare_environment};

/// Gives the first device half of the rows, the second one half of the rest, and so on.
struct Halving {
    rows: u32,
    devices: usize,
}

impl Policy for Halving {
    fn name(&self) -> &'static str {
        "halving"
    }

    /// Distributes the rows. This policy ignores the cost model, which predicts how long rows take on each device.
    fn assign(&mut self, _model: &CostModel) -> Assignment {
        let edges: Vec<u32> = (1..self.devices).map(|device| self.rows - (self.rows >> device)).collect();
        Assignment::uniform(Stripes::from_edges(self.rows, &edges))
    }

    fn remove_device(&mut self, _device: usize) {
        self.devices -= 1;
    }
}

pub fn main() -> ExitCode {
    // SAFETY: the program has no other thread yet.
    unsafe { prepare_environment() };
    let help = "Half of the rows, then half of the rest";
    Program::new().policy("halving", help, |rows, devices| Box::new(Halving { rows, devices })).run()
}
