//! `diptych export -o FILE.png`: a contact sheet of files, each with its name, its size and its warnings.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, anyhow};

use diptych::exec::ranks::Devices;
use diptych::image::display::{DisplayImage, write_png};
use diptych::image::key::with_caption;
use diptych::image::sheet;
use diptych::quality::Quality;
use diptych::scene::studio;

use super::export_args::Args;
use super::failure::Failure;
use super::options::{RenderOptions, RunOptions};
use super::output::FrameImages;
use super::progress::Progress;
use super::{interrupt, metering, setup};

/// Frames of a picture; all but the last give the denoiser a history. Together they have 16 samples per pixel.
const FRAMES: u32 = 4;
const SPP: u32 = 4;

/// Writes a contact sheet.
pub fn write(args: &Args) -> Result<(), Failure> {
    interrupt::watch()?;
    let progress = Progress::new(args.shots.len() as u64, args.quiet, false);
    let (mut gpus, mut shown, mut failed) = (None, Vec::new(), 0);
    for file in &args.shots {
        if interrupt::is_set() {
            break;
        }
        let (picture, caption) = match show(args, file, &mut gpus, &progress) {
            Err(Failure::Interrupted) => break,
            Err(failure) => {
                failed += 1;
                progress.warn(&format!("{file}: {}", failure.line()));
                (DisplayImage::filled(args.size, [0; 3]), vec![name_of(file), "cannot be shown".to_owned()])
            }
            Ok(shown) => shown,
        };
        shown.push(with_caption(&picture, &caption));
        progress.step(name_of(file), &serde_json::Value::Null);
    }
    let _writing = interrupt::writing();
    progress.finish();
    if shown.is_empty() {
        return interrupt::check();
    }
    if let Some(folder) = args.out.parent() {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot write into '{}'", folder.display()))?;
    }
    write_png(&args.out, &sheet::contact_sheet(&shown, args.columns.into())?)?;
    if !args.quiet {
        say!("{}", args.out.display());
    }
    interrupt::check()?;
    if failed > 0 {
        let count = args.shots.len();
        return Err(Failure::Input(anyhow!("{failed} of {count} file(s) cannot be shown: the warnings above say why")));
    }
    Ok(())
}

/// Renders a file and returns its picture and caption. Takes the devices and puts them back, so that they keep their
/// compiled pipelines.
fn show(
    args: &Args,
    file: &str,
    gpus: &mut Option<Devices>,
    progress: &Progress,
) -> Result<(DisplayImage, Vec<String>), Failure> {
    let mut run = RunOptions::of(file.to_owned(), args.settings.clone());
    run.settings.size = args.size;
    let options = RenderOptions::new(run, Quality { spp: SPP.into(), ..Quality::default() });
    let mut loaded = setup::load(&options)?;
    let warnings = loaded.scene.warnings.len();
    let count =
        loaded.scene.triangle_count() - if studio::has_ground(&loaded.scene) { studio::GROUND_TRIANGLES } else { 0 };
    let devices = match gpus.take() {
        Some(devices) => devices,
        None => setup::open_devices(&options, 1)?,
    };
    let devices = metering::meter(&options, &mut loaded, devices, progress)?;
    let mut renderer = setup::renderer(&options, &loaded, devices, Instant::now())?;
    for index in 0..FRAMES {
        let params = renderer.frame(&loaded.shot.rig, options.settings.time, index);
        let part = |fraction| progress.part((f64::from(index) + fraction) / f64::from(FRAMES), &name_of(file));
        renderer.render_watched(&params, None, part)?;
    }
    let picture = FrameImages::read(&mut renderer, &[])?.display.into_left();
    *gpus = Some(renderer.into_devices());
    let plural = |count: usize| if count == 1 { "" } else { "s" };
    let sizes = format!("{} triangle{}, {warnings} warning{}", grouped(count), plural(count), plural(warnings));
    Ok((picture, vec![name_of(file), sizes]))
}

fn name_of(file: &str) -> String {
    Path::new(file).file_name().map_or_else(|| file.to_owned(), |name| name.to_string_lossy().into_owned())
}

/// Returns a number with a comma between groups of three digits.
fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let groups = digits.as_bytes().rchunks(3).rev().map(String::from_utf8_lossy);
    groups.collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_in_groups_of_three() {
        assert_eq!([0, 999, 1000, 1_234_567].map(grouped), ["0", "999", "1,000", "1,234,567"]);
    }
}
