//! `diptych scenes`.

use serde_json::json;

use crate::scene::builtin::BUILTINS;
use crate::scene::motion::Moves;

use super::failure::Failure;
use super::scene_options::SceneOptions;
use super::setup;

#[derive(clap::Args)]
pub struct Args {
    /// Shot (.toml), .gltf/.glb or builtin:NAME to describe
    shot: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    scene: SceneOptions,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if let Some(shot) = &args.shot {
        return describe(shot, args);
    }
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

fn describe(shot: &str, args: &Args) -> Result<(), Failure> {
    let (shot, scene) = args.scene.load(shot, 0.0, &args.scene.budget())?;
    let moves = scene.motion.moves();
    let [triangles, instances, lights] = [scene.triangle_count(), scene.instances.len(), scene.lights.len()];
    if args.json {
        let scene = json!({
            "name": shot.name, "triangles": triangles, "instances": instances, "lights": lights, "moves": moves,
            "warnings": scene.warnings, "notes": scene.notes,
        });
        say!("{scene}");
        return Ok(());
    }
    setup::tell_remarks(&scene);
    say!("{}: {triangles} triangles, {instances} instances, {lights} lights", shot.name);
    match &moves {
        None => say!("the scene is static"),
        Some(moves) => say!("{}", text(moves)),
    }
    Ok(())
}

fn text(moves: &Moves) -> String {
    let animation = |(i, name, s): (usize, &str, f64)| match name {
        "" => format!("animation {i}: {s:.3} s\n"),
        name => format!("animation {i} '{name}': {s:.3} s\n"),
    };
    let played = moves.animations.iter().enumerate();
    let animations: String = played.map(|(i, a)| animation((i, &a.name, a.duration_s))).collect();
    let counts = [
        (moves.rigid_instances, "rigid instances"),
        (moves.skinned_instances, "skinned instances"),
        (moves.morphing_instances, "morphing instances"),
        (moves.skins, "skins"),
        (moves.nodes, "nodes"),
        (moves.lights, "lights"),
        (moves.cameras, "cameras"),
        (moves.materials, "materials"),
    ];
    let counts = counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    format!("{animations}moving: {}", counts.collect::<Vec<_>>().join(", "))
}
