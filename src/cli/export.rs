//! `diptych export`.

use std::path::PathBuf;

use diptych::scene::export::export;
use diptych::scene::load::load_shot;

use super::failure::Failure;
use super::output;

#[derive(clap::Args)]
pub struct Args {
    /// A shot (.toml), a .gltf/.glb, or builtin:NAME
    shot: String,
    /// Where NAME.glb and NAME.toml go; made if it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let (shot, scene) = load_shot(&args.shot)?;
    for warning in &scene.warnings {
        eprintln!("warning: {warning}");
    }
    output::prepare(&args.out, "--out")?;
    say!("{}", export(&shot, &scene, &args.out)?.display());
    Ok(())
}
