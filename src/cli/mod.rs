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

/// Mesa's layer that chooses among GPUs asks the Wayland server, and complains on every start where none can be found, as
/// in containers: there, it is left out.
fn quiet_mesa() {
    const LEAVES_LAYER_OUT: &str = "NODEVICE_SELECT";
    if cfg!(target_os = "linux") && std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: the program has no other thread yet.
        unsafe { std::env::set_var(LEAVES_LAYER_OUT, "1") };
    }
}

/// The command line's definition.
fn command() -> clap::Command {
    Cli::command()
}

pub fn run() -> ExitCode {
    quiet_mesa();
    let (args, notes) = renamed::translate(std::env::args_os().collect());
    for note in notes {
        eprintln!("note: {note}");
    }
    let matches = command().get_matches_from(args);
    settings::keep(&matches);
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    let result = match cli.command {
        Command::Render(args) => render::run(&args),
        Command::Play(args) => play::run(&args),
        Command::View(args) => view::run(&args),
        Command::Scale(args) => scale::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Trace(args) => trace::run(&args),
        Command::Graph(args) => graph::run(&args),
        Command::Devices(args) => devices::run(&args),
        Command::Scenes(args) => scenes::run(&args),
        Command::Shot(args) => shot::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Completions(args) => manual::completions(&args),
        Command::Man(args) => manual::man(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprint!("{}", failure.message());
            failure.exit_code()
        }
    }
}
