//! The command line: one subcommand per file.

use std::ffi::OsString;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use super::console::{self, Console};
use super::failure::Failure;
use super::given::Given;
use super::options::RunOptions;
use super::setting_flags::{FLAGS, with_flags};
use super::{bench, compare, export, graph, info, manual, play, ranks, render, scale, study, trace, view};
use diptych::frame::settings::Setting;
use diptych::stages::check_shaders;

/// Real-time stereoscopic path tracing for virtual reality, image-parallel over several GPUs.
///
/// `diptych FILE` is short for `diptych render FILE`.
#[derive(Parser)]
#[command(name = "diptych", version, about, max_term_width = 110)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Subcommand)]
pub enum Command {
    /// Render frames at fixed quality
    Render(render::Args),
    /// Render a sequence inside a frame budget
    Play(play::Args),
    /// Look around in a window or a headset [needs the feature `view`]
    View(view::Args),
    /// Render the same frames at several device counts and policies
    Scale(scale::Args),
    /// Measure time against error over a grid of settings
    Bench(bench::Args),
    /// Repeat the experiments of publications
    Study(study::StudyArgs),
    /// Compare images or sequences with a reference: RMSE, PSNR, SSIM, FLIP, …
    Compare(compare::Args),
    /// Summarise a trace file, or compare two
    Trace(trace::Args),
    /// Print the passes of a frame, their images and transfers
    Graph(graph::Args),
    /// List adapters, scenes and settings, describe a shot, or measure what fits
    Info(info::Args),
    /// Export a scene for other programs, a shot to edit, or a contact sheet
    Export(export::Args),
    /// Print shell completions, or write manual pages
    #[command(hide = true)]
    Generate(manual::Args),
}

/// Commands whose output folder is named after the scene, unless they are given one.
const WITH_FOLDER: [&str; 5] = ["render", "play", "scale", "bench", "study"];

/// Returns the definition of the command line.
pub fn command() -> clap::Command {
    let out = |out: clap::Arg| {
        let help = "Folder for output files [default: out/ and the name of the scene]";
        out.required(false).default_value("out").hide_default_value(true).help(help)
    };
    let command = WITH_FOLDER
        .into_iter()
        .fold(Cli::command(), |command, name| command.mut_subcommand(name, |sub| sub.mut_arg("out", out)));
    FLAGS.into_iter().fold(command, |command, (name, keys)| command.mut_subcommand(name, |sub| with_flags(sub, keys)))
}

/// Inserts `render` if a line has a scene, and options or the scene in place of a command. Scenes that diptych cannot read
/// count, so that `render` says so.
fn with_command(mut args: Vec<OsString>) -> Vec<OsString> {
    const ENDINGS: [&str; 11] =
        [".gltf", ".glb", ".toml", ".obj", ".fbx", ".blend", ".usd", ".usdz", ".stl", ".ply", ".dae"];
    let is_scene = |arg: &OsString| {
        let arg = arg.to_string_lossy().to_ascii_lowercase();
        arg.starts_with("builtin:") || ENDINGS.iter().any(|ending| arg.ends_with(ending))
    };
    let has_no_command = |first: &OsString| is_scene(first) || first.to_string_lossy().starts_with("--");
    if args.get(1).is_some_and(has_no_command) && args[1..].iter().any(is_scene) {
        args.insert(1, "render".into());
    }
    args
}

impl Command {
    /// Returns the name and the run options of commands that render.
    fn run_options(&mut self) -> Option<(&'static str, &mut RunOptions)> {
        Some(match self {
            Self::Render(args) => ("render", &mut args.flags.run),
            Self::Play(args) => ("play", &mut args.options.run),
            Self::View(args) => ("view", args.run_options()?),
            Self::Scale(args) => ("scale", &mut args.flags.run),
            Self::Bench(args) => ("bench", &mut args.options),
            Self::Study(args) => ("study", &mut args.options),
            _ => return None,
        })
    }

    /// Prepares commands that render: checks that the command reads the settings given, and takes over those of the
    /// shot that are left open.
    fn prepare(&mut self) -> Result<(), Failure> {
        let Some((name, run)) = self.run_options() else { return Ok(()) };
        ranks::check_alone()?;
        run.settings.check_command(name).map_err(|error| Failure::Input(error.into()))?;
        run.complete(name)?;
        check_shaders().map_err(|error| Failure::Input(error.into()))
    }

    fn run(&self) -> Result<(), Failure> {
        match self {
            Self::Render(args) => render::run(args),
            Self::Play(args) => play::run(args),
            Self::View(args) => view::run(args),
            Self::Scale(args) => scale::run(args),
            Self::Bench(args) => bench::run(args),
            Self::Study(args) => study::run(args),
            Self::Compare(args) => compare::run(args),
            Self::Trace(args) => trace::run(args),
            Self::Graph(args) => graph::run(args),
            Self::Info(args) => info::run(args),
            Self::Export(args) => export::run(args),
            Self::Generate(args) => manual::run(args, command()),
        }
    }
}

/// Runs a command and returns its exit status. `args` begins with the name of the program. Several threads may run
/// commands at once. Call [`prepare_environment`](super::prepare_environment) before.
///
/// ```
/// use diptych_cli::{Console, run_from};
///
/// assert_eq!(run_from(["diptych", "render", "missing.glb"], Console::new(std::io::sink(), std::io::sink())), 2);
/// ```
pub fn run_from(args: impl IntoIterator<Item = impl Into<OsString>>, console: Console) -> u8 {
    let _run = console::begin(args.into_iter().map(Into::into).collect(), console);
    let joined = ranks::join();
    let result = joined.and_then(|()| if ranks::serves() { serve() } else { Ok(run_command()) });
    let status = result.unwrap_or_else(|failure| failure.tell());
    ranks::end(status);
    status
}

/// Adds how to give a setting that has no flag in `command`, if the command reads it. Removes clap's tip to pass an
/// unknown option as a file after `--`.
fn with_tip(mut error: clap::Error, command: Option<&clap::Command>) -> clap::Error {
    let flag = error.get(ContextKind::InvalidArg).map(ToString::to_string).unwrap_or_default();
    let key = flag.trim_start_matches('-').replace('-', "_");
    let takes_settings = |of: &&clap::Command| of.get_arguments().any(|arg| arg.get_id() == "set");
    let is_read = |setting: &Setting| command.filter(takes_settings).is_some_and(|of| setting.is_of(of.get_name()));
    if error.kind() != ErrorKind::UnknownArgument {
        return error;
    }
    error.remove(ContextKind::Suggested);
    if Setting::of_key(&key).is_some_and(is_read) {
        error.remove(ContextKind::SuggestedArg);
        error.remove(ContextKind::Usage);
        let tip = format!("give this setting with --set {key}=VALUE");
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
    error
}

/// Parses the command line and keeps its options for reports.
fn parse() -> Result<Cli, clap::Error> {
    let mut command = command();
    if !console::is_of_process() {
        command = command.term_width(100);
    }
    let args = with_command(console::args());
    let matches = command.clone().try_get_matches_from(&args);
    let matches =
        matches.map_err(|error| with_tip(error, args.get(1).and_then(|name| command.find_subcommand(name))))?;
    Given::of(&command, &matches).into_iter().for_each(console::keep_options);
    let mut cli = Cli::from_arg_matches(&matches)?;
    let (name, given) = matches.subcommand().unwrap_or(("", &matches));
    if WITH_FOLDER.contains(&name) && given.value_source("out") == Some(ValueSource::DefaultValue) {
        cli.command.run_options().into_iter().for_each(|(_, run)| run.choose_out(name));
    }
    if let Command::Scale(args) = &mut cli.command {
        args.share_cores();
    }
    Ok(cli)
}

/// Runs the command and returns its exit status.
fn run_command() -> u8 {
    let result = match parse() {
        Ok(mut cli) => cli.command.prepare().and_then(|()| cli.command.run()),
        Err(error) => {
            console::print_parsed(&error);
            if error.use_stderr() {
                return error.exit_code() as u8;
            }
            Ok(())
        }
    };
    result.and_then(|()| console::finish()).map_or_else(|failure| failure.tell(), |()| 0)
}

/// Serves rank 0, which runs the command. Returns the exit status that rank 0 sends at the end.
fn serve() -> Result<u8, Failure> {
    let mut cli = parse().ok();
    ranks::serve(cli.as_mut().and_then(|cli| cli.command.run_options()).map(|(_, run)| &*run))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_help_fits_on_a_line() {
        let command = command();
        for sub in command.get_subcommands() {
            let about = (sub.get_name().to_owned(), sub.get_about().map(ToString::to_string).unwrap_or_default());
            let options = sub.get_arguments().map(|arg| {
                let name = format!("{} {}", sub.get_name(), arg.get_long().unwrap_or(arg.get_id().as_str()));
                (name, arg.get_help().map(ToString::to_string).unwrap_or_default())
            });
            for (name, help) in options.chain([about]) {
                assert!((1..=80).contains(&help.chars().count()), "{name}: '{help}'");
            }
        }
    }

    #[test]
    fn short_help_of_render_fits_on_two_screens() {
        let mut command = command().term_width(100);
        command.build();
        let render = command.find_subcommand_mut("render").expect("there is such a command");
        let text = render.render_help().to_string();
        assert!(text.lines().count() <= 60, "{} lines: {text}", text.lines().count());
    }

    #[test]
    fn tips_appear_only_for_settings_of_the_command() {
        let command = command();
        for (line, has_tip) in [
            (["diptych", "render", "--hard-shadows"], true),
            (["diptych", "play", "--exposure"], true),
            (["diptych", "play", "--spp"], false),
            (["diptych", "export", "--spp"], false),
            (["diptych", "export", "--yfov"], true),
            (["diptych", "compare", "--spp"], false),
            (["diptych", "trace", "--seed"], false),
        ] {
            let error = command.clone().try_get_matches_from(line).unwrap_err();
            let text = with_tip(error, command.find_subcommand(line[1])).to_string();
            assert_eq!(text.contains("give this setting with --set"), has_tip, "{text}");
            assert!(!text.contains("as a value, use"), "{text}");
            assert!(!has_tip || !text.contains("a similar argument"), "{text}");
        }
    }

    #[test]
    fn scene_without_a_command_is_rendered() {
        let with = |args: &[&str]| with_command(args.iter().map(Into::into).collect());
        for scene in ["a.glb", "b/c.GLTF", "shot.toml", "builtin:cornell"] {
            assert_eq!(with(&["diptych", scene, "--quiet"]), ["diptych", "render", scene, "--quiet"]);
        }
        assert_eq!(with(&["diptych", "--spp", "4", "a.glb"]), ["diptych", "render", "--spp", "4", "a.glb"]);
        for args in [&["diptych"][..], &["diptych", "info", "a.glb"], &["diptych", "--help"]] {
            assert_eq!(with(args), args);
        }
    }
}
