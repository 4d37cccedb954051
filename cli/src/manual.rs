//! `diptych generate`: shell completions and manual pages, generated from the command line's definition.

use std::path::PathBuf;

use anyhow::Context;
use clap::{Arg, Command, ValueEnum};
use clap_complete::Shell;
use diptych::frame::settings::{Setting, Settings};

use super::failure::Failure;
use super::{console, output};

#[derive(clap::Args)]
pub struct Args {
    /// man, or the shell to print completions for
    #[arg(value_parser = what)]
    what: What,
    /// Folder for the manual pages; created if missing
    #[arg(long, value_name = "DIR", default_value = "out/man")]
    out: PathBuf,
}

#[derive(Clone, Copy)]
enum What {
    Man,
    Completions(Shell),
}

fn what(text: &str) -> Result<What, String> {
    let shells = || Shell::value_variants().iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    match text {
        "man" => Ok(What::Man),
        shell => shell.parse().map(What::Completions).map_err(|_| format!("neither man nor one of {}", shells())),
    }
}

pub fn run(args: &Args, mut command: Command) -> Result<(), Failure> {
    match args.what {
        What::Completions(shell) => {
            let mut text = Vec::new();
            clap_complete::generate(shell, &mut command, "diptych", &mut text);
            console::print(format_args!("{}", String::from_utf8_lossy(&text)));
        }
        What::Man => {
            output::prepare(&args.out, "--out")?;
            let written = clap_mangen::generate_to(command, &args.out)
                .and_then(|()| clap_mangen::generate_to(settings(), &args.out));
            written.with_context(|| format!("cannot write into '{}'", args.out.display()))?;
            say!("manual pages: {} (read one with `man -l FILE`)", args.out.display());
        }
    }
    Ok(())
}

/// Returns a command whose manual page lists all settings.
fn settings() -> Command {
    let about = "Settings: --set KEY=VALUE, [render] of a shot, and keywords in Python";
    let setting = |setting: &'static Setting| {
        let help = format!("{} [default: {}]", setting.text(), setting.default());
        Arg::new(setting.key).value_name(format!("{}={}", setting.key, setting.form)).help(help)
    };
    Command::new("diptych-settings").about(about).disable_help_flag(true).args(Settings::TABLE.iter().map(setting))
}
