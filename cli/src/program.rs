//! Your own program that extends the commands of `diptych` and runs them.

use std::process::ExitCode;

use diptych::passes::Declarations;
use diptych::passes::denoise::{Denoise, Denoiser};
use diptych::schedule::{Balance, Policy};

use super::commands::run_from;
use super::console::Console;
use super::registry::register;
use super::{interrupt, signals};

/// The commands of `diptych`, with your own policies, denoisers and passes. The setting `balance` selects a registered
/// policy by its name in every command that renders. `scale --balance even,measured,NAME` compares it with built-in
/// ones in one table.
///
/// ```no_run
/// use diptych_cli::{Program, prepare_environment};
/// use diptych::graph::{Assignment, Stripes};
/// use diptych::schedule::{CostModel, Policy};
///
/// /// Gives each device twice the rows of the one after it.
/// struct Halving { rows: u32, devices: usize }
///
/// impl Policy for Halving {
///     fn name(&self) -> &'static str { "halving" }
///
///     fn assign(&mut self, _: &CostModel) -> Assignment {
///         let weights: Vec<f64> = (0..self.devices).map(|device| 0.5f64.powi(device as i32)).collect();
///         let stripes = Stripes::from_weights(self.rows, &weights);
///         Assignment::uniform(stripes.unwrap_or_else(|_| Stripes::even(self.rows, self.devices)))
///     }
///
///     fn remove_device(&mut self, _: usize) { self.devices -= 1; }
/// }
///
/// fn main() -> std::process::ExitCode {
///     // SAFETY: the program has no other thread yet.
///     unsafe { prepare_environment() };
///     let help = "Twice the rows of the next device";
///     Program::new().policy("halving", help, |rows, devices| Box::new(Halving { rows, devices })).run()
/// }
/// ```
#[derive(Default)]
pub struct Program {
    passes: Declarations,
}

impl Program {
    /// Creates a program with the commands of `diptych` and no extensions.
    pub fn new() -> Self {
        Self::default()
    }

    /// Registers a policy, which the setting `balance` selects. Each renderer calls `make` with the rows of an image
    /// and the number of devices. `--help` shows `help`.
    ///
    /// # Panics
    /// If a policy has this name already.
    #[must_use]
    pub fn policy(
        self,
        name: &'static str,
        help: &'static str,
        make: impl Fn(u32, usize) -> Box<dyn Policy> + Send + Sync + 'static,
    ) -> Self {
        if let Err(what) = Balance::register(name, help, make) {
            panic!("{what}");
        }
        self
    }

    /// Registers a denoiser, which `--denoiser NAME` selects.
    ///
    /// # Panics
    /// If a denoiser has this name already.
    #[must_use]
    pub fn denoiser(self, method: &'static dyn Denoise) -> Self {
        if let Err(what) = Denoiser::register(method) {
            panic!("{what}");
        }
        self
    }

    /// Sets the passes of frames, in place of the renderer's own. With MPI every rank runs this program, so all ranks
    /// have the same passes.
    #[must_use]
    pub fn passes(mut self, passes: Declarations) -> Self {
        self.passes = passes;
        self
    }

    /// Runs the command that this process was started with and returns its exit status. If another `Program` of this
    /// process has run before, its passes stay in force instead of these.
    pub fn run(self) -> ExitCode {
        register(self.passes);
        let status = run_from(std::env::args_os(), Console::process());
        if signals::is_set() {
            interrupt::end(status);
        }
        ExitCode::from(status)
    }
}
