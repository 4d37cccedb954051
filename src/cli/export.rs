//! `diptych export`.

use std::path::PathBuf;

use crate::scene::export::export;

use super::failure::Failure;
use super::output;
use super::scene_options::SceneOptions;
use super::setup;

#[derive(clap::Args)]
pub struct Args {
    /// Shot (.toml), .gltf/.glb or builtin:NAME
    shot: String,
    /// Folder for NAME.glb and NAME.toml; created if missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Time of a dynamic scene, seconds
    #[arg(long, default_value_t = 0.0, value_name = "T", allow_negative_numbers = true)]
    time: f64,
    #[command(flatten)]
    scene: SceneOptions,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let (shot, scene) = args.scene.load(&args.shot, args.time, &args.scene.budget())?;
    setup::tell_remarks(&scene);
    output::prepare(&args.out, "--out")?;
    say!("{}", export(&shot, &scene.at(args.time), &args.out)?.display());
    Ok(())
}
