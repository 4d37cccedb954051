//! Options that the rendering commands share.

use std::fs::File;
use std::io::Read;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use clap::Parser;

use crate::report::once;
use diptych::passes::Aov;
use diptych::quality::{Envelope, Quality, SettingError};
use diptych::samples::Samples;
use diptych::scene::shot::{self, Gaze};
use diptych::schedule::Balance;

use super::disturbances;
use super::failure::Failure;
pub use super::headings::{DEVICES, OUTPUT, QUALITY, SCENE};
use super::setting_flags::SettingFlags;

/// Options of every command that renders.
#[derive(Parser, Clone, Debug)]
pub struct RunOptions {
    /// A shot (.toml), a .gltf/.glb, or builtin:NAME
    #[arg(default_value = "builtin:atrium")]
    pub shot: String,
    #[command(flatten)]
    pub settings: SettingFlags,
    /// Value of [`diptych::device::Selection::most_virtual_devices`].
    #[arg(skip)]
    pub most_virtual_devices: u16,
    /// Send the files of the scene from rank 0 to all other ranks
    #[cfg(feature = "mpi")]
    #[arg(hide_short_help = true, long, help_heading = DEVICES)]
    pub broadcast_scene: bool,
    /// Folder for all output files; created if missing
    #[arg(long, value_name = "DIR", help_heading = OUTPUT)]
    pub out: PathBuf,
    /// Write a trace for Perfetto (Chrome trace events)
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    pub trace: Option<PathBuf>,
    /// Print no progress
    #[arg(long, help_heading = OUTPUT)]
    pub quiet: bool,
    /// Print progress and results as JSON lines
    #[arg(hide_short_help = true, long, help_heading = OUTPUT)]
    pub json: bool,
    /// True if the command makes scene cuts.
    #[arg(skip)]
    pub makes_cuts: bool,
}

impl RunOptions {
    /// Returns the options of a quiet run in this process.
    pub fn of(shot: String, settings: SettingFlags) -> Self {
        Self {
            shot,
            settings,
            most_virtual_devices: 0,
            #[cfg(feature = "mpi")]
            broadcast_scene: false,
            out: ".".into(),
            trace: None,
            quiet: true,
            json: false,
            makes_cuts: false,
        }
    }

    /// Sets the folder for output files to `out/` and the name of the shot, followed by that of a command other than
    /// render.
    pub fn choose_out(&mut self, command: &str) {
        let name = self.shot.strip_prefix("builtin:").unwrap_or(&self.shot);
        let mut folder = Path::new(name).file_stem().unwrap_or("scene".as_ref()).to_owned();
        if command != "render" {
            folder.push(format!("-{command}"));
        }
        self.out = Path::new("out").join(folder);
    }

    /// Prints the path of the trace, if there is one.
    pub fn say_trace(&self) {
        let say = |trace: &PathBuf| say!("trace: {} (open it in https://ui.perfetto.dev)", trace.display());
        self.trace.iter().for_each(say);
    }

    /// True if rank 0 sends the scene's files to the other ranks.
    pub fn broadcasts_scene(&self) -> bool {
        #[cfg(feature = "mpi")]
        return self.broadcast_scene;
        #[cfg(not(feature = "mpi"))]
        false
    }

    /// Takes over those settings of the shot that the command line leaves open and the command reads.
    pub fn complete(&mut self, command: &str) -> Result<(), Failure> {
        let is_shot = Path::new(&self.shot).extension().is_some_and(|name| name.eq_ignore_ascii_case("toml"));
        let mut text = String::new();
        if is_shot && File::open(&self.shot).and_then(|file| file.take(MOST_BYTES).read_to_string(&mut text)).is_ok() {
            self.complete_from(&text, command)?;
        }
        Ok(())
    }

    /// Takes over settings of the shot with this text.
    pub fn complete_from(&mut self, text: &str, command: &str) -> Result<(), Failure> {
        let origin = || format!("{}: [render]", self.shot);
        let taken = self.settings.default_to(&shot::settings_of(text), command);
        taken.with_context(origin).map_err(Failure::Input)
    }

    /// Checks constraints that clap cannot express.
    pub fn check(&self) -> Result<(), anyhow::Error> {
        let policies = self.settings.balances();
        ensure!(policies.len() == 1, "balance: give one policy; `diptych scale` compares several");
        let has_effect = self.settings.ratios.is_empty() || policies == [Balance::Static];
        ensure!(has_effect, SettingError::NoEffect { key: "ratios", needs: "balance=static" });
        Ok((**self.settings).check()?)
    }
}

/// Flags of commands that render all frames at the same quality.
#[derive(Parser, Clone, Debug)]
pub struct RenderFlags {
    /// Frames to render
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000_000), help_heading = SCENE)]
    pub frames: u32,
    #[command(flatten)]
    pub run: RunOptions,
}

impl RenderFlags {
    /// Checks the flags and returns the options that they ask for.
    pub fn options(&self) -> Result<RenderOptions, anyhow::Error> {
        let settings = &self.run.settings;
        ensure!(
            settings.spp.least <= MAX_FRAME_SPP,
            "spp {} exceeds the limit of {MAX_FRAME_SPP} per frame: `diptych render --reference` accumulates more",
            settings.spp
        );
        settings.check()?;
        let options = RenderOptions {
            frames: self.frames,
            fps: settings.fps.unwrap_or(DEFAULT_FPS),
            aovs: once(settings.aov.iter().copied()),
            ..RenderOptions::new(self.run.clone(), settings.quality())
        };
        options.check()?;
        Ok(options)
    }
}

/// Options of a run, and the settings that all its frames share.
#[derive(Clone, Debug)]
pub struct RenderOptions {
    pub run: RunOptions,
    /// Bounds of the qualities of frames. Most commands render all frames at the upper bound.
    pub envelope: Envelope,
    /// Gaze of the left and the right eye, in place of the shot's.
    pub gaze: Option<[Gaze; 2]>,
    pub frames: u32,
    pub fps: f64,
    /// Auxiliary images, without duplicates.
    pub aovs: Vec<Aov>,
    /// True if late reprojection shows frames from a later pose than the one they were rendered from.
    pub is_late: bool,
}

impl RenderOptions {
    /// Returns the options of one frame.
    pub fn new(run: RunOptions, envelope: impl Into<Envelope>) -> Self {
        let gaze = run.settings.gaze();
        Self { run, envelope: envelope.into(), gaze, frames: 1, fps: 1.0, aovs: Vec::new(), is_late: false }
    }

    /// Returns the time of a frame on the camera path, seconds.
    pub fn time_s(&self, frame: u32) -> f64 {
        self.settings.time + f64::from(frame) / self.fps
    }

    /// Returns the highest quality of frames, which is that of all frames unless they vary.
    pub fn quality(&self) -> Quality {
        self.envelope.most
    }

    /// Checks constraints that clap cannot express.
    pub fn check(&self) -> Result<(), anyhow::Error> {
        disturbances::check(&self.settings, self.frames, self.makes_cuts)?;
        self.quality().check()?;
        self.run.check()
    }
}

impl Deref for RenderOptions {
    type Target = RunOptions;

    fn deref(&self) -> &RunOptions {
        &self.run
    }
}

/// Parses a number of samples per pixel that a single frame may have.
pub fn frame_spp(text: &str) -> Result<Samples, String> {
    let spp: Samples = text.parse()?;
    spp.check().map(|()| spp).map_err(|error| error.to_string())
}

/// Default frames per second of the camera path.
pub const DEFAULT_FPS: f64 = 72.0;
/// Maximum bytes of a shot whose settings are read.
const MOST_BYTES: u64 = 1 << 24;
/// Maximum samples per pixel of one frame; --reference accumulates more in passes.
const MAX_FRAME_SPP: u32 = *Samples::VALID.end();
