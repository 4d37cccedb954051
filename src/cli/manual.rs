//! `diptych completions` and `diptych man`: shell completions and manual pages, generated from the command line's
//! definition.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Command;
use clap_complete::Shell;

use super::failure::Failure;
use super::{output, stdout};

#[derive(clap::Args)]
pub struct CompletionArgs {
    /// Shell to complete for
    shell: Shell,
}

#[derive(clap::Args)]
pub struct ManArgs {
    /// Folder for the manual pages; created if missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub fn completions(args: &CompletionArgs, mut command: Command) -> Result<(), Failure> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut command, "diptych", &mut text);
    stdout::keep(std::io::stdout().write_all(&text));
    Ok(())
}

pub fn man(args: &ManArgs, command: Command) -> Result<(), Failure> {
    output::prepare(&args.out, "--out")?;
    clap_mangen::generate_to(command, &args.out)
        .with_context(|| format!("cannot write into '{}'", args.out.display()))?;
    say!("manual pages: {} (read one with `man -l FILE`)", args.out.display());
    Ok(())
}
