//! `diptych export -o FILE.toml`.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, anyhow};
use pathdiff::diff_paths;

use diptych::image::file::atomic_write;
use diptych::scene::shot::{SceneSource, Sky};

use super::export_args::Args;
use super::failure::Failure;
use super::{scene_loading, setup};

/// Writes a shot file that the user may edit.
pub fn write(args: &Args, file: &str) -> Result<(), Failure> {
    let out = &args.out;
    if out.exists() {
        let what = anyhow!("--out {}: the file exists and may have been edited: give another name", out.display());
        return Err(Failure::Input(what));
    }
    let (mut shot, scene) = scene_loading::load(&args.settings, file)?;
    setup::tell_remarks(&scene);
    let here = folder_of(out);
    std::fs::create_dir_all(here)
        .with_context(|| format!("cannot write into '{}': choose another --out", here.display()))?;
    let origin = folder_of(Path::new(file));
    let mut is_outside = false;
    let mut moved = |name: &mut String, from: &Path| -> Result<(), Failure> {
        *name = relative(&from.join(&*name), here).with_context(|| format!("cannot find '{name}'"))?;
        is_outside |= name.starts_with("..") || Path::new(name).is_absolute();
        Ok(())
    };
    if let SceneSource::File(name) = &mut shot.scene {
        moved(name, origin)?;
    }
    if let Some(Sky::Image(name)) = shot.environment.as_mut().map(|e| &mut e.sky) {
        moved(name, if args.settings.environment.is_some() { Path::new("") } else { origin })?;
    }
    atomic_write(out, |file| file.write_all(shot.text().as_bytes()))?;
    say!("{}", out.display());
    if is_outside {
        say!("it names files outside its folder: render it with --allow-outside, or move --out above these files");
    }
    Ok(())
}

/// Returns the folder that contains a file.
fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Returns the path of a file relative to a folder; both must exist.
fn relative(file: &Path, folder: &Path) -> std::io::Result<String> {
    let [file, folder] = [file.canonicalize()?, folder.canonicalize()?];
    let path = diff_paths(&file, folder).unwrap_or(file);
    let steps: Vec<_> = path.iter().map(|step| step.to_string_lossy()).collect();
    Ok(if path.is_absolute() { path.display().to_string() } else { steps.join("/") })
}
