//! `diptych scenes`.

use serde_json::json;

use diptych::scene::builtin::BUILTINS;

use super::failure::Failure;

#[derive(clap::Args)]
pub struct Args {
    /// As JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if args.json {
        let scenes: Vec<_> = BUILTINS.iter().map(|b| json!({ "name": b.name, "about": b.about })).collect();
        say!("{}", json!(scenes));
        return Ok(());
    }
    for builtin in BUILTINS {
        say!("builtin:{:<10} {}", builtin.name, builtin.about);
    }
    Ok(())
}
