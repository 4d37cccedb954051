//! `diptych export`: scenes for other programs, shots to edit and contact sheets.

use std::path::{Path, PathBuf};

use anyhow::anyhow;

use crate::image::Extent;
use crate::scene::export::{export, file_name};

use super::failure::Failure;
use super::setting_flags::SettingFlags;
use super::{output, scene_loading, setup, sheet, shot};

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
    /// With FILE.png: size of each picture in pixels, WIDTHxHEIGHT
    #[arg(long, default_value = "320x240")]
    pub(super) size: Extent,
    /// With FILE.png: pictures per row
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    pub(super) columns: u8,
    /// Print no progress
    #[arg(long)]
    pub(super) quiet: bool,
    #[command(flatten)]
    pub(super) settings: SettingFlags,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    args.settings.check_scene().map_err(|error| Failure::Input(error.into()))?;
    let ending = args.out.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    if ending.as_deref() == Some("png") {
        return sheet::write(args);
    }
    let [file] = &args.shots[..] else {
        return Err(Failure::Input(anyhow!("several scenes make a contact sheet: name it with --out FILE.png")));
    };
    let folder = args.out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let stem = args.out.file_stem().unwrap_or_default().to_string_lossy();
    match ending.as_deref() {
        Some("toml") => shot::write(args, file),
        Some("glb") => scene(args, file, folder, Some(&stem)),
        None => scene(args, file, &args.out, None),
        Some(other) => {
            let out = args.out.display();
            Err(Failure::Input(anyhow!("--out {out}: cannot write .{other}: give .glb, .toml, .png or a folder")))
        }
    }
}

/// Writes a scene, and a shot beside it with the same name: `name`, or else the name of the shot.
fn scene(args: &Args, file: &str, folder: &Path, name: Option<&str>) -> Result<(), Failure> {
    let (shot, scene) = scene_loading::load(&args.settings, file)?;
    setup::tell_remarks(&scene);
    output::prepare(folder, "--out")?;
    let name = name.map_or_else(|| file_name(&shot.name), str::to_owned);
    say!("{}", export(&shot, &scene.at(args.settings.time), folder, &name)?.display());
    Ok(())
}
