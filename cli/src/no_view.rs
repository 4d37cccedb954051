//! Stub of `diptych view` for programs that were built without the feature `view`.

use std::ffi::OsString;

use super::failure::Failure;
use super::options::RunOptions;

#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Arguments of `view`, ignored
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    _all: Vec<OsString>,
}

impl Args {
    pub fn run_options(&mut self) -> Option<&mut RunOptions> {
        None
    }
}

pub fn run(_: &Args) -> Result<(), Failure> {
    let how = "this build of diptych has no `view`: build it with `cargo build --release --features view`";
    Err(Failure::Input(anyhow::anyhow!(how)))
}
