//! Compares the kernel `skin` with meshes that the host deforms in f64.

use diptych::scene::Mesh;
use diptych::scene::motion::bake::{deformed, is_mirrored};
use diptych::scene::motion::pose::Pose;
use glam::{DVec3, Vec3, Vec4};

use super::{Device, bodies, pose};
use crate::kernels::inputs::{Cases, Random};

/// Returns the deformed bodies in order, with the index of their first vertex.
fn shapes(scene: &diptych::scene::Scene, pose: &Pose) -> Vec<(usize, Mesh)> {
    let mut first = 0;
    let shape = |(number, body): (usize, &diptych::scene::motion::Body)| {
        let mesh = &scene.meshes[scene.instances[body.instance].mesh];
        let joints = scene.motion.joints(pose, number);
        let shape = deformed(mesh, &pose.weights[number], Some(&joints));
        let at = first;
        first += mesh.positions.len();
        (at, shape)
    };
    scene.motion.bodies.iter().enumerate().map(shape).collect()
}

fn xyz(row: [u32; 4]) -> Vec3 {
    Vec3::from_array([row[0], row[1], row[2]].map(f32::from_bits))
}

/// Tolerance for sums of a dozen products within 10 of 0.
const CLOSE: f32 = 2e-5;

#[test]
fn skinned_bodies_match_the_host_in_both_frames() {
    let scene = bodies();
    let device = Device::new(&scene);
    let skins = &device.accel.skins;
    let tables = device.frame.tables;
    let mut random = Random::new(71);
    let mut cases = Cases::default();
    for _ in 0..6 {
        let before = random.rubbish::<4>(device.rows);
        let poses = [0, 1].map(|_| pose(&scene, &mut random));
        let outputs = device.skin(&scene, [&poses[0], &poses[1]], &before);
        let rows = outputs.get::<[u32; 4]>("tables");
        let boxes = outputs.get::<[f32; 4]>("boxes");
        let [now, last] = [0, 1].map(|i| shapes(&scene, &poses[i]));
        let mut touched = vec![false; device.rows];
        for (i, triangle) in skins.triangles.iter().enumerate() {
            let body = now.iter().rposition(|(first, _)| *first <= triangle.corners.x as usize).unwrap();
            let (first, shape) = &now[body];
            let corners = triangle.corners.to_array().map(|v| v as usize - first);
            let row = skins.first_row as usize + i;
            let at = |table: u32, per: usize| table as usize + per * row;
            let last_at = tables.last_corners as usize + 3 * i;
            let [mut low, mut high] = [Vec3::INFINITY, Vec3::NEG_INFINITY];
            let found = [0, 1, 2].map(|k| xyz(rows[at(tables.triangles, 3) + k]));
            let flat = (found[1] - found[0]).cross(found[2] - found[0]).normalize();
            assert!(shape.triangles.contains(&corners.map(|c| c as u32)), "triangle {i} has other corners");
            for (k, &corner) in corners.iter().enumerate() {
                let close = |what: &str, a: Vec3, b: Vec3, by: f32| {
                    assert!(a.distance(b) <= by, "{what} of corner {k} of triangle {i} of body {body}: {a} is not {b}");
                };
                close("position", found[k], shape.positions[corner], CLOSE);
                close("last position", xyz(rows[last_at + k]), last[body].1.positions[corner], CLOSE);
                close("position on the host", skins.corners(i, &rows_of(&device, &scene, &poses))[k], found[k], CLOSE);
                let normal = xyz(rows[at(tables.shadings, 4) + k]);
                cases.meet(if shape.normals.is_empty() { "flat" } else { "normals" });
                close("normal", normal, *shape.normals.get(corner).unwrap_or(&flat), 20.0 * CLOSE);
                let tangent = Vec4::from_array(rows[at(tables.tangents, 3) + k].map(f32::from_bits));
                let expected = shape.tangents.get(corner).copied().unwrap_or(Vec4::ZERO);
                cases.meet(if expected.truncate() == Vec3::ZERO { "no tangent" } else { "tangent" });
                close("tangent", tangent.truncate(), expected.truncate(), 20.0 * CLOSE);
                if expected.truncate() != Vec3::ZERO {
                    assert_eq!(tangent.w, expected.w, "handedness of triangle {i} of body {body}");
                }
                (low, high) = (low.min(found[k]), high.max(found[k]));
            }
            let mirrors = is_mirrored(&scene.motion.joints(&poses[0], body));
            cases.meet(if mirrors { "mirrored" } else { "upright" });
            let first_box = 2 * (skins.nodes.len() + i);
            let found_box = [0, 1].map(|k| Vec4::from_array(boxes[first_box + k]).truncate());
            assert_eq!(found_box, [low, high], "box of triangle {i}");
            let words = [0, 1, 2].map(|k| rows[at(tables.triangles, 3) + k][3]);
            assert_eq!(words, [triangle.material, triangle.first_copy, triangle.light]);
            let uvs = [triangle.uv0, triangle.uv1, triangle.uv2];
            let shading = at(tables.shadings, 4);
            assert_eq!([0, 1].map(|k| rows[shading + k][3]), uvs[0].to_array().map(f32::to_bits));
            assert_eq!(rows[shading + 2][3], uvs[1].x.to_bits());
            assert_eq!(rows[shading + 3][..3], [uvs[1].y, uvs[2].x, uvs[2].y].map(f32::to_bits));
            touched[at(tables.triangles, 3)..][..3].fill(true);
            touched[at(tables.shadings, 4)..][..4].fill(true);
            touched[at(tables.tangents, 3)..][..3].fill(true);
            touched[last_at..][..3].fill(true);
        }
        let wrong = (0..device.rows).find(|&row| !touched[row] && rows[row] != before[row]);
        assert_eq!(wrong, None, "a row of something else was written");
    }
    cases.assert_met(&["flat", "normals", "tangent", "no tangent", "mirrored", "upright"]);
}

fn rows_of(device: &Device, scene: &diptych::scene::Scene, poses: &[Pose; 2]) -> Vec<Vec4> {
    device.accel.pose_rows(&scene.motion, [&poses[0], &poses[1]])
}

/// A body that is scaled to nothing is a point, and all its numbers are finite.
#[test]
fn bodies_scaled_to_zero_stay_finite() {
    let scene = bodies();
    let device = Device::new(&scene);
    let mut nothing = scene.motion.pose(0.0);
    nothing.world_from_node.iter_mut().for_each(|world| world.matrix3 *= 0.0);
    let outputs = device.skin(&scene, [&nothing, &nothing], &vec![[0; 4]; device.rows]);
    let rows = outputs.get::<[u32; 4]>("tables");
    let is_finite = |row: &[u32; 4]| xyz(*row).is_finite();
    assert!(rows.iter().all(is_finite));
    let shading = device.frame.tables.shadings as usize + 4 * device.accel.skins.first_row as usize;
    assert!((xyz(rows[shading]).as_dvec3().length() - DVec3::Z.length()).abs() < 1e-5, "a normal has no length");
}
