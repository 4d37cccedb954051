//! `diptych export`: scenes for other programs, shots to edit and contact sheets.

use std::path::Path;

use anyhow::anyhow;

use diptych::frame::settings::CONTACT_SHEET;
use diptych::scene::export::{export, file_name};

pub use super::export_args::Args;
use super::failure::Failure;
use super::{output, scene_loading, setup, sheet, shot};

pub fn run(args: &Args) -> Result<(), Failure> {
    let ending = args.out.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let is_sheet = ending.as_deref() == Some("png");
    let read = args.settings.check_command(if is_sheet { CONTACT_SHEET } else { "export" });
    read.and_then(|()| args.settings.check()).map_err(|error| Failure::Input(error.into()))?;
    if is_sheet {
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
