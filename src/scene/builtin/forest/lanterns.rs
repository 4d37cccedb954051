//! Writes the wood's default shot: a walk along the path, a dim sky and eighty small lights.

use super::super::maths::Dice;
use super::terrain::{height, off_path, path_x};
use super::tree_spots;
use glam::Vec3;
use std::fmt::Write;

const LIGHTS: usize = 80;
const START_Z: f32 = 19.0;

struct Lantern {
    position: Vec3,
    color: [f32; 3],
    intensity: f32,
}

/// Returns the lights: three of four are fireflies low over the ground, and every fourth is a brighter lamp nearer to
/// the path.
fn lanterns() -> Vec<Lantern> {
    let trunks: Vec<_> = tree_spots().iter().map(|s| s.foot).collect();
    let mut dice = Dice::new(8080);
    let mut found = Vec::new();
    while found.len() < LIGHTS {
        let lamp = found.len() % 4 == 0;
        let z = dice.range(-33.0, 16.0);
        let x = path_x(z) + dice.range(-1.0, 1.0) * if lamp { 6.5 } else { 10.0 };
        let y = height(x, z) + if lamp { dice.range(1.4, 2.6) } else { dice.range(0.35, 2.0) };
        let position = Vec3::new(x, y, z);
        let clear_of = |p: &Vec3, reach: f32| (p.x - x) * (p.x - x) + (p.z - z) * (p.z - z) > reach * reach;
        if off_path(x, z) < 0.9 || !trunks.iter().all(|t| clear_of(t, 0.7)) {
            continue;
        }
        found.push(match lamp {
            true => Lantern { position, color: [1.0, 0.58, 0.22], intensity: dice.range(1.6, 3.0) },
            false => Lantern { position, color: [0.72, 1.0, 0.3], intensity: dice.range(0.3, 0.9) },
        });
    }
    found
}

/// Returns the TOML text of the shot.
fn shot() -> String {
    let mut text = String::from(
        "# Written by this crate's test `write_the_forest_shot`; do not edit.\n\
         name = \"forest\"\nscene = \"builtin:forest\"\n\n\
         [rig]\nyfov_deg = 60.0\nbaseline_m = 0.064\n",
    );
    let mut line = |args: std::fmt::Arguments| text.write_fmt(args).expect("strings take any text");
    for step in 0..=4 {
        let z = START_Z - 0.7 * step as f32;
        let (x, ahead) = (path_x(z), z - 9.0);
        let (eye, aim) = (height(x, z) + 1.6, height(path_x(ahead), ahead) + 1.7);
        line(format_args!("\n[[rig.key]]\ntime_s = {step}.0\nposition = [{x:.3}, {eye:.3}, {z:.3}]\n"));
        line(format_args!("target = [{:.3}, {aim:.3}, {ahead:.3}]\n", path_x(ahead) * 0.6 + x * 0.4));
    }
    line(format_args!("\n[environment]\nradiance = [0.012, 0.018, 0.03]\n\n[exposure]\nev = 2.0\n"));
    for Lantern { position: p, color: [r, g, b], intensity } in lanterns() {
        line(format_args!("\n[[light]]\nkind = \"point\"\nposition = [{:.3}, {:.3}, {:.3}]\n", p.x, p.y, p.z));
        line(format_args!("color = [{r:.2}, {g:.2}, {b:.2}]\nintensity = {intensity:.2}\nradius_m = 0.0\n"));
    }
    text
}

const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/forest.toml");

#[test]
fn the_forest_shot_is_as_generated() {
    let hint = "run `cargo test write_the_forest_shot -- --ignored` if the wood has changed";
    assert!(crate::scene::builtin::find("forest").unwrap().shot == shot(), "{hint}");
}

#[test]
#[ignore = "rewrites scenes/forest.toml"]
fn write_the_forest_shot() {
    std::fs::write(PATH, shot()).unwrap();
}

#[test]
fn eighty_lights_hang_above_the_ground() {
    let lanterns = lanterns();
    assert_eq!(lanterns.len(), 80);
    for l in &lanterns {
        assert!(l.position.y > height(l.position.x, l.position.z) + 0.3);
        assert!((0.3..=3.0).contains(&l.intensity));
    }
    let shot: toml::Table = shot().parse().unwrap();
    assert_eq!(shot["light"].as_array().unwrap().len(), 80);
}
