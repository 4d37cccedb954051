//! One file per command. Exit status: 0 done, 1 it failed, 2 the command line or an input file is wrong,
//! 130 Ctrl-C ended it, 143 SIGTERM did.

/// `println!` that does not mind a reader who has left, as `head` does.
macro_rules! say {
    ($($arg:tt)*) => {{
        use std::io::Write;
        let _ = writeln!(std::io::stdout(), $($arg)*);
    }};
}

mod bench;
mod compare;
mod devices;
mod export;
mod failure;
mod faults;
mod foveation;
mod graph;
mod interrupt;
mod manual;
mod options;
mod output;
mod page;
mod play;
mod progress;
mod ranks;
mod reference;
mod renamed;
mod render;
mod scale;
mod scene_options;
mod scenes;
mod sequence;
mod settings;
mod setup;
mod shot;
mod simulate;
mod stale;
mod trace;
#[cfg_attr(not(feature = "view"), path = "no_view.rs")]
mod view;

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use diptych::device;

use failure::Failure;
use options::RunOptions;

/// Real-time stereoscopic path tracing for virtual reality, image-parallel over several GPUs.
#[derive(Parser)]
#[command(name = "diptych", version, about, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Render frames at fixed quality
    Render(render::Args),
    /// Render a sequence inside a frame budget: quality follows what devices can do
    Play(play::Args),
    /// Look around in a window, inside a frame budget [needs a program built with `--features view`]
    View(view::Args),
    /// Render the same frames at several device counts: table, CSV, plot
    Scale(scale::Args),
    /// Measure run time against error over a grid of settings: table, CSV, plot
    Bench(bench::Args),
    /// Compare an image with a reference: RMSE, relMSE, PSNR, SSIM, FLIP, mean ratio; by ring and by seam; or a sequence
    Compare(compare::Args),
    /// Check a trace-file and sum it up: busy, transfer, idle per device, critical path; or compare two
    Trace(trace::Args),
    /// Print the passes of a frame, what they read and write, and what crosses between devices
    Graph(graph::Args),
    /// List adapters and drivers, their limits, and what each lacks
    Devices(devices::Args),
    /// List the built-in scenes, or say what a scene is made of and what of it moves
    Scenes(scenes::Args),
    /// Write a shot file, complete and with comments, for a scene: to edit
    Shot(shot::Args),
    /// Write a shot as plain glTF that other programs read, with the shot beside it
    Export(export::Args),
    /// Print completions for a shell
    Completions(manual::CompletionArgs),
    /// Write manual pages
    Man(manual::ManArgs),
}

/// Tells drivers by the environment what they take nowhere else. Call it before the program starts threads.
fn prepare_environment() {
    // SAFETY: the program has no other thread yet.
    let set = |name: &str, value: &str| unsafe { std::env::set_var(name, value) };
    // Mesa's layer that chooses among GPUs asks the Wayland server, and complains on every start where none can be found,
    // as in containers: there, it is left out.
    if cfg!(target_os = "linux") && std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        set("NODEVICE_SELECT", "1");
    }
    // Errors of our own say what the loader of OpenXR would write to stderr.
    const LOADER_LOG: &str = "XR_LOADER_DEBUG";
    if cfg!(feature = "xr") && std::env::var_os(LOADER_LOG).is_none() {
        set(LOADER_LOG, "none");
    }
    // SAFETY: while the library opens a device, no other thread of the program reads the environment but by `std::env`.
    unsafe { device::set_environment_hook(|name, value| std::env::set_var(name, value)) };
}

/// The command line's definition.
fn command() -> clap::Command {
    Cli::command()
}

impl Command {
    /// Of commands that render.
    fn run_options(&self) -> Option<&RunOptions> {
        match self {
            Self::Render(args) => Some(&args.options),
            Self::Play(args) => Some(&args.options.run),
            Self::View(args) => args.run_options(),
            Self::Scale(args) => Some(&args.options),
            Self::Bench(args) => Some(&args.options),
            _ => None,
        }
    }

    fn run(&self) -> Result<(), Failure> {
        match self {
            Self::Render(args) => render::run(args),
            Self::Play(args) => play::run(args),
            Self::View(args) => view::run(args),
            Self::Scale(args) => scale::run(args),
            Self::Bench(args) => bench::run(args),
            Self::Compare(args) => compare::run(args),
            Self::Trace(args) => trace::run(args),
            Self::Graph(args) => graph::run(args),
            Self::Devices(args) => devices::run(args),
            Self::Scenes(args) => scenes::run(args),
            Self::Shot(args) => shot::run(args),
            Self::Export(args) => export::run(args),
            Self::Completions(args) => manual::completions(args),
            Self::Man(args) => manual::man(args),
        }
    }
}

pub fn run() -> ExitCode {
    prepare_environment();
    let result = ranks::join().and_then(|()| if ranks::serves() { serve() } else { Ok(run_command()) });
    let status = result.unwrap_or_else(|failure| {
        eprint!("{}", failure.message());
        failure.exit_status()
    });
    ranks::end(status);
    ExitCode::from(status)
}

/// The command as it was typed, with notes on names that have changed.
fn parse() -> (Result<Cli, clap::Error>, Vec<String>) {
    let (args, notes) = renamed::translate(std::env::args_os().collect());
    let matches = command().try_get_matches_from(args);
    let cli = matches.and_then(|matches| {
        settings::keep(&matches);
        Cli::from_arg_matches(&matches)
    });
    (cli, notes)
}

/// Returns the exit status.
fn run_command() -> u8 {
    let (cli, notes) = parse();
    for note in notes {
        eprintln!("note: {note}");
    }
    let cli = match cli {
        Ok(cli) => cli,
        Err(error) => {
            // Nobody may be there to read it.
            let _ = error.print();
            return error.exit_code() as u8;
        }
    };
    let checked = cli.command.run_options().map_or(Ok(()), |_| ranks::check_alone());
    checked.and_then(|()| cli.command.run()).map_or_else(
        |failure| {
            eprint!("{}", failure.message());
            failure.exit_status()
        },
        |()| 0,
    )
}

/// Serves rank 0, which runs the command; returns its exit status.
fn serve() -> Result<u8, Failure> {
    let (cli, _) = parse();
    ranks::serve(cli.ok().as_ref().and_then(|cli| cli.command.run_options()))
}
