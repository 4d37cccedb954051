//! Tests that the studio loops, and that its figure holds together and stays on the floor.

use super::staging::PERIOD_S;
use super::*;

#[test]
fn studio_has_every_kind_of_motion() {
    let scene = build();
    let moves = scene.motion.moves().unwrap();
    assert_eq!((moves.skins, moves.skinned_instances, moves.morphing_instances), (1, 1, 1));
    // Counts three meshes of each lamp, and the fan's motor, hub and blades.
    assert_eq!((moves.rigid_instances, moves.lights, moves.materials), (12, 1, 1));
    // Counts two channels of the root, one of each joint, and those of pelvis, sign, lamps, fan (2) and banner.
    assert_eq!(scene.motion.animations[0].channels.len(), 2 + JOINTS.len() + 1 + 1 + 2 + 2 + 1);
    assert_eq!((moves.animations.len(), moves.animations[0].duration_s), (1, PERIOD_S));
    let sign = |time_s| scene.at(time_s).materials.iter().find(|m| m.name == "sign").map(|m| m.emissive.y);
    assert_eq!((sign(1.999), sign(2.001).map(|y| (100.0 * y).round())), (Some(4.8), Some(8.0)));
}

#[test]
fn studio_animation_loops_seamlessly() {
    let mut scene = build();
    let [start, next] = [0.0, PERIOD_S].map(|time_s| scene.motion.pose(time_s));
    assert_eq!(start, next);
    scene.motion.loops = false;
    let end = scene.motion.pose(PERIOD_S);
    for (a, b) in start.world_from_node.iter().zip(&end.world_from_node) {
        assert!(a.abs_diff_eq(*b, 1e-6), "{a} {b}");
    }
    assert_eq!(start.weights, end.weights);
}

/// Returns the vertices of the skinned mesh at a time.
fn walker_at(scene: &Scene, time_s: f64) -> Vec<Vec3> {
    let body = scene.motion.bodies.iter().find(|b| b.skin.is_some()).unwrap();
    let still = scene.at(time_s);
    still.meshes[still.instances[body.instance].mesh].positions.clone()
}

#[test]
fn walker_vertices_stay_near_their_joints() {
    let scene = build();
    let (index, body) = scene.motion.bodies.iter().enumerate().find(|(_, b)| b.skin.is_some()).unwrap();
    let mesh = &scene.meshes[scene.instances[body.instance].mesh];
    let joints = &scene.motion.skins[0].joints;
    for step in 0..80 {
        let time_s = PERIOD_S * f64::from(step) / 80.0;
        let pose = scene.motion.pose(time_s);
        assert_eq!(scene.motion.joints(&pose, index).len(), JOINTS.len());
        let positions = walker_at(&scene, time_s);
        for (i, influence) in mesh.influences.iter().enumerate() {
            assert!((influence.weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            let joint = usize::from(influence.joints[usize::from(influence.weights[1] > influence.weights[0])]);
            let at_rest = mesh.positions[i].as_dvec3().distance(JOINTS[joint].at);
            let now = positions[i].as_dvec3().distance(pose.world_from_node[joints[joint]].translation);
            assert!((now - at_rest).abs() < 0.05, "{time_s} s: vertex {i} of {}", JOINTS[joint].name);
        }
        for &[a, b, _] in &mesh.triangles {
            let [rest, now] = [&mesh.positions, &positions].map(|p| p[a as usize].distance(p[b as usize]));
            assert!(now < 2.5 * rest + 0.02, "{time_s} s: {rest} m is {now} m");
        }
    }
}

#[test]
fn walker_feet_stay_on_the_floor_without_sliding() {
    let scene = build();
    let soles: Vec<Vec<Vec3>> = (0..=160).map(|i| walker_at(&scene, PERIOD_S * f64::from(i) / 160.0)).collect();
    let lowest = |positions: &Vec<Vec3>| positions.iter().map(|p| p.y).fold(f32::MAX, f32::min);
    for (i, positions) in soles.iter().enumerate() {
        let y = lowest(positions);
        assert!((-0.008..0.012).contains(&y), "{i}: {y} m");
    }
    // The lowest vertex stays in place while it is on the floor, except for the foot's rolling. A sliding foot would
    // move it by 29 mm.
    for pair in soles.windows(2) {
        let y = lowest(&pair[0]);
        let at = pair[0].iter().position(|p| p.y == y).unwrap();
        if pair[1][at].y > lowest(&pair[1]) + 0.004 {
            continue;
        }
        let slid = (pair[1][at] - pair[0][at]).with_y(0.0).length();
        assert!(slid < 0.015, "{slid} m");
    }
}
