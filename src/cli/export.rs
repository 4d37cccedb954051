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
    #[command(flatten)]
    scene: SceneOptions,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let (shot, scene) = args.scene.load(&args.shot, &args.scene.budget())?;
    for warning in &scene.warnings {
        eprintln!("warning: {warning}");
    }
    output::prepare(&args.out, "--out")?;
    say!("{}", export(&shot, &scene, &args.out)?.display());
    Ok(())
}
