//! `diptych view` in a program that was built without its window.

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
    pub fn run_options(&self) -> Option<&RunOptions> {
        None
    }
}

pub fn run(_: &Args) -> Result<(), Failure> {
    let how = "this diptych was built without its window: `cargo build --release --features view` builds it with one";
    Err(Failure::Input(anyhow::anyhow!(how)))
}
