//! Options of `diptych export`.

use std::path::PathBuf;

use super::setting_flags::SettingFlags;
use diptych::image::Extent;

#[derive(clap::Args)]
#[command(after_help = "Examples:
  diptych export builtin:atrium -o atrium.glb
  diptych export house.glb --set position=2,1.6,3 -o house.toml
  diptych export models/*.glb -o sheet.png")]
pub struct Args {
    /// Shots (.toml), .gltf/.glb or builtin:NAME; several for a contact sheet
    #[arg(required = true, value_name = "SHOT")]
    pub(super) shots: Vec<String>,
    /// FILE.glb, FILE.toml, FILE.png or a folder, which is created if missing
    ///
    /// FILE.glb is the scene for other programs, with a shot beside it. FILE.toml is a commented shot to edit. FILE.png
    /// is a contact sheet. A folder gets NAME.glb and NAME.toml.
    #[arg(long, short, value_name = "FILE|DIR", default_value = "out/export")]
    pub(super) out: PathBuf,
    /// Size of a contact sheet's pictures in pixels, WIDTHxHEIGHT
    #[arg(long, default_value = "320x240")]
    pub(super) size: Extent,
    /// Pictures per row of a contact sheet
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    pub(super) columns: u8,
    /// Print no progress
    #[arg(long)]
    pub(super) quiet: bool,
    #[command(flatten)]
    pub(super) settings: SettingFlags,
}
