use std::time::{Duration, Instant};

use glam::{Affine3A, Vec3, Vec3A};
use obvhs::cwbvh::builder::build_cwbvh;

use super::*;
use crate::accel::limits::MAX_DEPTH;
use crate::accel::{Accel, Layout};
use crate::scene::{AlphaMode, Instance, Material, Mesh, Scene};

const PARAMS: BvhBuildParams = BvhBuildParams { max_prims_per_leaf: 3, ..BvhBuildParams::slow_build() };

/// Number of boxes that the builder of obvhs takes half a minute to join if they are at one place.
const MANY: u32 = 20_000;

fn cube(corner: Vec3A, size: f32) -> Aabb {
    Aabb::new(corner, corner + size)
}

/// Returns cubes of different sizes at different places.
fn strewn(count: u32) -> Vec<Aabb> {
    let part = |i: u32, k: f32| (i as f32 * k).fract();
    (0..count)
        .map(|i| cube(Vec3A::new(part(i, 0.618), part(i, 0.414), part(i, 0.732)), 0.01 * part(i, 0.271)))
        .collect()
}

/// Builds a tree within seconds, and returns its depth. All boxes must be in it.
fn levels(boxes: Vec<Aabb>) -> usize {
    let (count, begin) = (boxes.len(), Instant::now());
    let built = tree_over_boxes(boxes, (0..count as u32).collect(), &PARAMS, MAX_DEPTH);
    assert!(begin.elapsed() < Duration::from_secs(10), "{:?}", begin.elapsed());
    assert!(built.is_sound(count));
    let mut order = built.order;
    order.sort_unstable();
    assert!(order.into_iter().eq(0..count as u32));
    depth(&built.nodes)
}

#[test]
fn boxes_at_one_place_do_not_become_a_chain() {
    let one = cube(Vec3A::new(3.0, -2.0, 0.3), 1.0);
    let alike = (0..MANY).map(|_| one);
    let almost = (0..MANY).map(|i| cube(one.min + i as f32 * 1e-8, 1.0));
    let nested = (0..MANY).map(|i| Aabb::new(one.min - i as f32 * 1e-5, one.max + i as f32 * 1e-5));
    assert!(levels(alike.clone().collect()) <= 8);
    assert!(levels(almost.clone().collect()) <= 12);
    assert!(levels(nested.clone().collect()) <= 16);
    let flat = |b: Aabb| Aabb::new(b.min.with_z(0.0), b.max.with_z(0.0));
    assert!(levels(alike.chain(almost).chain(nested).map(flat).chain(strewn(MANY)).collect()) <= 20);
    assert!(levels(vec![Aabb::new(Vec3A::ZERO, Vec3A::ZERO); MANY as usize]) <= 16);
}

#[test]
fn boxes_build_the_same_tree_as_obvhs() {
    for count in [1, 2, 15, 1000, 5000] {
        let mut boxes = strewn(count);
        // A few boxes at one place are common: the two triangles of a rectangle have the same box.
        boxes.extend_from_within(..count as usize / 2);
        let order: Vec<_> = (0..boxes.len() as u32).collect();
        let expected = build_cwbvh(&boxes, PARAMS, &mut Duration::default());
        let built = tree_over_boxes(boxes, order, &PARAMS, MAX_DEPTH);
        assert!(built == Built { nodes: expected.nodes, order: expected.primitive_indices });
    }
}

#[test]
fn too_deep_tree_is_balanced() {
    // Each box is half as large as the next and shares a corner with it.
    let boxes: Vec<_> = (0..120).map(|i| cube(Vec3A::ZERO, (f32::from(i as u8) * 0.5 - 30.0).exp2())).collect();
    let order: Vec<_> = (0..boxes.len() as u32).collect();
    let most = |levels| tree_over_boxes(boxes.clone(), order.clone(), &PARAMS, levels);
    assert!(depth(&most(MAX_DEPTH).nodes) > 6);
    let balanced = most(6);
    assert!(depth(&balanced.nodes) <= 6 && balanced.is_sound(boxes.len()));
}

fn copies(alpha_mode: AlphaMode) -> Scene {
    let mesh = Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let instance = Instance { mesh: 0, world_from_local: Affine3A::IDENTITY };
    Scene {
        meshes: vec![mesh],
        instances: vec![instance; MANY as usize],
        materials: vec![Material { alpha_mode, ..Material::default() }],
        ..Scene::empty("copies")
    }
}

#[test]
fn instances_at_one_place_are_not_too_deep() {
    for layout in [Layout::Flat, Layout::TwoLevel] {
        let begin = Instant::now();
        // Each copy that light may pass counts.
        let accel = Accel::build_with(&copies(AlphaMode::Blend), layout).unwrap();
        // The first instance stands for the flattened triangles.
        assert_eq!(accel.triangles.len().max(accel.instances.len() - 1), MANY as usize);
        assert!(begin.elapsed() < Duration::from_secs(10), "{layout:?}: {:?}", begin.elapsed());
    }
}

#[test]
fn opaque_copies_of_an_instance_are_stored_once() {
    for layout in [Layout::Flat, Layout::TwoLevel] {
        assert_eq!(Accel::build_with(&copies(AlphaMode::Opaque), layout).unwrap().triangles.len(), 1);
    }
}
