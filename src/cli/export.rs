//! `diptych export`.

use std::path::PathBuf;

use diptych::scene::export::export;

use super::failure::Failure;
use super::output;
use super::scene_options::SceneOptions;

#[derive(clap::Args)]
pub struct Args {
    /// A shot (.toml), a .gltf/.glb, or builtin:NAME
    shot: String,
    /// Where NAME.glb and NAME.toml go; made if it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Of a scene that moves: when it is written, in seconds
    #[arg(long, default_value_t = 0.0, value_name = "T", allow_negative_numbers = true)]
    time: f64,
    #[command(flatten)]
    scene: SceneOptions,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let (shot, scene) = args.scene.load(&args.shot, args.time, &args.scene.budget())?;
    for warning in &scene.warnings {
        eprintln!("warning: {warning}");
    }
    output::prepare(&args.out, "--out")?;
    say!("{}", export(&shot, &scene.at(args.time), &args.out)?.display());
    Ok(())
}
