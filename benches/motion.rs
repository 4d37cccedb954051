//! Measures the host time per frame of an animated scene: poses, the tree over instances, and the data sent to devices.
//!
//! `cargo bench --bench motion`

use std::hint::black_box;
use std::time::Instant;

use diptych::accel::Accel;
use diptych::layout::Frame;
use diptych::scene::motion::keys::{Interpolation, Keys};
use diptych::scene::motion::{Animation, Body, Channel, Motion, Node, Placement, Target};
use diptych::scene::{Instance, Scene, builtin};
use diptych::tables::SceneTables;
use glam::{Affine3A, DQuat, DVec3, Vec3};

const FRAMES: usize = 200;
const BODIES: usize = 1000;

/// Returns copies of a mesh that each move back and forth.
fn scene() -> Scene {
    let mut scene = builtin::find("cornell").expect("it is built in").build();
    let mesh = scene.instances.iter().map(|i| i.mesh).max_by_key(|m| scene.meshes[*m].triangles.len()).unwrap_or(0);
    scene.materials[scene.meshes[mesh].material].emissive = Vec3::ZERO;
    let mut motion = Motion { loops: true, ..Motion::default() };
    let mut channels = Vec::new();
    for i in 0..BODIES {
        let at = |k: f32| (i as f32 * k).fract() * 40.0 - 20.0;
        let (from, to) = (Vec3::new(at(0.618), at(0.414), at(0.732)), Vec3::new(at(0.317), at(0.865), at(0.124)));
        let values = [from, to, from].iter().flat_map(|p| p.to_array()).collect();
        let keys = Keys::new(vec![0.0, 1.0, 2.0], values, 3, Interpolation::Linear).expect("keys in order");
        channels.push(Channel { target: Target::Translation(i), keys });
        let rest = Placement::Parts { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE };
        motion.nodes.push(Node { name: String::new(), parent: None, rest });
        motion.bodies.push(Body { instance: scene.instances.len(), node: i, skin: None, weights: Vec::new() });
        scene.instances.push(Instance { mesh, world_from_local: Affine3A::from_translation(from) });
    }
    motion.animations.push(Animation { name: String::new(), channels, duration_s: 2.0 });
    Scene { motion, ..scene }
}

fn main() {
    let scene = scene();
    let accel = Accel::build(&scene).expect("the scene fits");
    let tables = SceneTables::new(&scene, accel).expect("the scene has tables");
    let mut times_ms: Vec<f64> = (0..FRAMES)
        .map(|frame| {
            let (now_s, last_s) = (frame as f64 / 60.0, (frame as f64 - 1.0) / 60.0);
            let begin = Instant::now();
            black_box(tables.update(&mut Frame::default(), now_s, last_s));
            begin.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times_ms.sort_by(f64::total_cmp);
    let at = |share: f64| times_ms[((times_ms.len() - 1) as f64 * share) as usize];
    println!("{BODIES} rigid bodies: {:.3} ms a frame, p95 {:.3}, most {:.3}", at(0.5), at(0.95), at(1.0));
}
