//! `diptych completions` and `diptych man`: what shells and readers of manuals get from the command line's definition.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap_complete::Shell;

use super::failure::Failure;
use super::output;

#[derive(clap::Args)]
pub struct CompletionArgs {
    /// Whose completions to print
    shell: Shell,
}

#[derive(clap::Args)]
pub struct ManArgs {
    /// Where diptych.1 and a page for each command go; made if it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub fn completions(args: &CompletionArgs) -> Result<(), Failure> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut super::command(), "diptych", &mut text);
    // A reader who has left is none of its concern.
    let _ = std::io::stdout().write_all(&text);
    Ok(())
}

pub fn man(args: &ManArgs) -> Result<(), Failure> {
    output::prepare(&args.out, "--out")?;
    clap_mangen::generate_to(super::command(), &args.out)
        .with_context(|| format!("cannot write into '{}'", args.out.display()))?;
    say!("manual pages: {} (read one with `man -l FILE`)", args.out.display());
    Ok(())
}
