//! Two-level scenes look like flattened ones, and allow scenes that are too large to flatten.

use std::sync::Arc;

use crate::common::{Stage, Subject, is_thorough, still_rig};
use crate::pictures::mean;
use crate::reference::scenes::pictures::painted;
use crate::reference::scenes::quad;
use diptych::accel::{Accel, Layout};
use diptych::image::{Extent, Image, RgbImage};
use diptych::passes::Aov;
use diptych::scene::{
    AlphaMode, Environment, Instance, Light, LightKind, Material, Mesh, NormalMap, Scene, Texture, TextureRef, Wrap,
};
use glam::{Affine2, Affine3A, Quat, Vec2, Vec3, Vec4};

const EXTENT: Extent = Extent::new(96, 64);

/// Returns a ball of radius 1 with `rings` x `2 * rings` quads and tangent frames along the parallels.
fn ball(rings: usize, material: usize) -> Mesh {
    let mut mesh = Mesh { material, ..Mesh::default() };
    let columns = 2 * rings;
    for ring in 0..=rings {
        for column in 0..=columns {
            let (u, v) = (column as f32 / columns as f32, ring as f32 / rings as f32);
            let ((sin_phi, cos_phi), (sin, cos)) =
                ((u * std::f32::consts::TAU).sin_cos(), (v * std::f32::consts::PI).sin_cos());
            let p = Vec3::new(sin * cos_phi, cos, -sin * sin_phi);
            mesh.positions.push(p);
            mesh.normals.push(p.normalize());
            mesh.tangents.push(Vec4::new(-sin_phi, 0.0, -cos_phi, 1.0));
            mesh.uvs[0].push(Vec2::new(u, v));
        }
    }
    let at = |ring: usize, column: usize| (ring * (columns + 1) + column) as u32;
    for (ring, column) in (0..rings).flat_map(|r| (0..columns).map(move |c| (r, c))) {
        let [a, b, c, d] = [at(ring, column), at(ring + 1, column), at(ring + 1, column + 1), at(ring, column + 1)];
        // Those at the poles have no area.
        mesh.triangles.extend((ring + 1 < rings).then_some([a, b, c]));
        mesh.triangles.extend((ring > 0).then_some([a, c, d]));
    }
    mesh
}

/// Returns a square from (-1, -1, 0) to (1, 1, 0) that faces +z, without vertex normals.
fn square(material: usize) -> Mesh {
    Mesh {
        uvs: [vec![Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO], vec![]],
        ..quad(Vec3::new(-1.0, -1.0, 0.0), 2.0 * Vec3::X, 2.0 * Vec3::Y, material)
    }
}

/// Returns 8x8 texels as a function of column and row.
fn texels(of: impl Fn(u32, u32) -> [u8; 4]) -> Arc<Image<[u8; 4]>> {
    Arc::new(painted(Extent::new(8, 8), of))
}

fn empty_scene(name: &str) -> Scene {
    Scene {
        materials: vec![Material::default()],
        environment: Environment::Constant(Vec3::new(0.4, 0.5, 0.6)),
        ..Scene::empty(name)
    }
}

fn placed(scale: Vec3, turn: Quat, at: Vec3) -> Affine3A {
    Affine3A::from_scale_rotation_translation(scale, turn, at)
}

const LEAF: usize = 1;
const LAMP: usize = 2;
const FLOOR: usize = 3;
const GLASS: usize = 4;

/// Returns balls with bumpy, chequered surfaces, some mirrored, sheared or stretched, between leaves with holes, two
/// emissive and two glass balls, on a floor.
pub fn crowd() -> Scene {
    let mut scene = empty_scene("crowd");
    scene.images = vec![
        texels(|x, y| if (x + y) % 2 == 0 { [230, 180, 120, 255] } else { [60, 90, 140, 255] }),
        texels(|x, y| [90 + 9 * x as u8, 160 - 8 * y as u8, 235, 255]),
        texels(|x, y| [120, 200, 90, if (x / 2 + y / 2) % 2 == 0 { 255 } else { 0 }]),
    ];
    scene.textures =
        (0..3).map(|image| Texture { image, wrap_u: Wrap::Repeat, wrap_v: Wrap::Repeat, linear: image < 2 }).collect();
    let texture = |texture| TextureRef { texture, uv_set: 0, uv_from_uv: Affine2::IDENTITY };
    scene.materials = vec![
        Material {
            base_color_texture: Some(texture(0)),
            normal_map: Some(NormalMap { texture: texture(1), scale: 0.7 }),
            ..Material::default()
        },
        Material {
            base_color_texture: Some(texture(2)),
            alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
            double_sided: true,
            ..Material::default()
        },
        Material { emissive: Vec3::new(4.0, 3.0, 1.5), ..Material::default() },
        Material { base_color: Vec4::new(0.7, 0.7, 0.7, 1.0), ..Material::default() },
        Material { transmission: 1.0, specular: 1.0, roughness: 0.0, ..Material::default() },
    ];
    scene.meshes = vec![ball(12, 0), square(LEAF), ball(6, LAMP), square(FLOOR), ball(10, GLASS)];
    let turned = |i: usize| Quat::from_rotation_y(i as f32 * 0.9) * Quat::from_rotation_x(i as f32 * 0.37 - 1.0);
    let mut place = |mesh, world_from_local| scene.instances.push(Instance { mesh, world_from_local });
    let scales = [[0.5, 0.5, 0.5], [-0.5, 0.5, 0.5], [0.7, 0.3, 0.5], [0.3, -0.8, 0.4], [-0.4; 3]].map(Vec3::from);
    for i in 0..30 {
        let foot = Vec3::new((i % 6) as f32 * 1.3 - 3.2, 0.5 + (i % 3) as f32 * 0.1, -((i / 6) as f32) * 1.3);
        place(0, placed(scales[i % 5], turned(i), foot));
        let leaf = foot + Vec3::new(0.6, 0.9, 0.3);
        place(LEAF, placed(scales[(i + 1) % 5], turned(i + 3), leaf));
    }
    for x in [-1.9, 2.0] {
        place(LAMP, placed(Vec3::splat(0.3), Quat::IDENTITY, Vec3::new(x, 1.9, 0.2)));
        let glass = Vec3::new(0.4 * x, 0.45, 1.1);
        place(GLASS, placed(Vec3::splat(0.4), turned(2), glass));
    }
    // Transforms without an inverse: squares pressed flat.
    for x in [-0.6, 0.6] {
        let pressed = Affine3A::from_scale(Vec3::new(0.3, 0.2, 0.0));
        place(FLOOR, Affine3A::from_translation(Vec3::new(x, 1.8, -1.0)) * pressed);
    }
    place(FLOOR, placed(Vec3::splat(8.0), Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2), Vec3::ZERO));
    let kind = LightKind::Point { position: Vec3::new(1.0, 5.0, 4.0), radius: 0.3 };
    scene.lights.push(Light { kind, strength: Vec3::splat(30.0) });
    scene
}

/// Returns the scene seen from the front, after it was moved by `moved_by`.
pub fn subject(scene: &Scene, layout: Layout, moved_by: Vec3) -> Subject {
    let origin = Vec3::new(0.3, 2.2, 5.0) + moved_by;
    let rig = still_rig(origin, Vec3::new(-0.05, -0.28, -1.0), Vec3::Y, 0.5);
    Subject::laid_out(&format!("{} {layout:?}", scene.name), scene.clone(), rig, layout)
}

fn moved(mut scene: Scene, by: Vec3) -> Scene {
    scene.instances.iter_mut().for_each(|i| i.world_from_local.translation += glam::Vec3A::from(by));
    for light in &mut scene.lights {
        if let LightKind::Point { position, .. } = &mut light.kind {
            *position += by;
        }
    }
    scene
}

/// Returns the number of triangles without their copies.
fn stored(accel: &Accel) -> usize {
    accel.triangles.iter().enumerate().filter(|(row, t)| t.is_first(*row)).count()
}

#[test]
fn shared_meshes_are_stored_once_and_others_flattened() {
    let scene = crowd();
    let count = |layout| Accel::build_with(&scene, layout).unwrap();
    let (flat, shared) = (count(Layout::Flat), count(Layout::TwoLevel));
    let triangles = |mesh: usize| scene.meshes[mesh].triangles.len();
    assert_eq!(stored(&flat), scene.triangle_count());
    assert_eq!(flat.instances.len(), 1);
    // Balls and leaves have a plain and a mirrored version, glass only a plain one; lamps, pressed squares and the
    // floor are flattened.
    let once = 2 * triangles(0) + 2 * triangles(LEAF) + triangles(GLASS);
    let flattened = 2 * triangles(LAMP) + 3 * triangles(FLOOR);
    assert_eq!(stored(&shared), once + flattened);
    assert_eq!(shared.instances.len(), 1 + 30 + 30 + 2);
    // Small scenes are flattened by default.
    assert_eq!(count(Layout::Auto).instances.len(), 1);
}

/// Returns the values of an auxiliary image, pixel by pixel, of both eyes.
fn vectors(stage: &mut Stage, i: usize) -> Vec<Vec3> {
    let aov = stage.aov(i);
    let of = |planes: &[Vec<f32>]| {
        let channel = |c: usize| planes[c.min(planes.len() - 1)].clone();
        let [x, y, z] = [channel(0), channel(1), channel(2)];
        (0..x.len()).map(|p| Vec3::new(x[p], y[p], z[p])).collect::<Vec<_>>()
    };
    [of(aov.left()), of(aov.right())].concat()
}

#[test]
fn instanced_gbuffer_matches_flattened_scenes() {
    let scene = crowd();
    let aovs = [Aov::Position, Aov::Normal, Aov::Albedo, Aov::Depth];
    let seen = |layout| {
        let subject = subject(&scene, layout, Vec3::ZERO);
        let mut settings = subject.settings(EXTENT.width, EXTENT.height);
        settings.buffers.aovs = aovs.to_vec();
        let mut stage = Stage::alone(&subject, &settings);
        stage.frame(0);
        (0..aovs.len()).map(|i| vectors(&mut stage, i)).collect::<Vec<_>>()
    };
    let (flat, shared) = (seen(Layout::Flat), seen(Layout::TwoLevel));
    // Pixels whose centre is on an edge may show either side.
    let elsewhere = |p: &usize| flat[0][*p].distance(shared[0][*p]) > 1e-3;
    let count = flat[0].len();
    let on_edges = (0..count).filter(elsewhere).count();
    assert!(on_edges * 1000 < count, "{on_edges} of {count} pixels show another place");
    for (i, (name, bound)) in
        [("position", 2e-5), ("normal", 2e-4), ("albedo", 1e-4), ("depth", 2e-5)].iter().enumerate()
    {
        let same = (0..count).filter(|p| !elsewhere(p));
        let mut errors: Vec<f32> = same.map(|p| flat[i][p].distance(shared[i][p])).collect();
        errors.sort_by(f32::total_cmp);
        let beyond = errors.iter().filter(|e| **e > *bound).count();
        println!(
            "{name}: largest {:e}, 99.9% within {:e}, {beyond} beyond {bound:e}",
            errors[errors.len() - 1],
            errors[errors.len() * 999 / 1000]
        );
        assert!(beyond * 1000 < count, "{name}: {beyond} of {count} pixels differ by more than {bound:e}");
    }
}

/// Returns the peak signal-to-noise ratio of values up to 1, dB.
fn psnr(a: &RgbImage, b: &RgbImage) -> f64 {
    let display = |c: f32| f64::from(c.clamp(0.0, 1.0));
    let pairs = || a.pixels.as_flattened().iter().zip(b.pixels.as_flattened());
    let sum: f64 = pairs().map(|(&a, &b)| (display(a) - display(b)).powi(2)).sum();
    -10.0 * (sum / pairs().count() as f64).log10()
}

#[test]
fn instanced_images_match_flattened_scenes() {
    // In the first case the local origin of positions is not (0, 0, 0). Emissive triangles are numbered in tree order.
    // With lamps (the last case), the same random numbers select different triangles, so the difference is noise.
    let far = Vec3::new(65536.0, 0.0, -32768.0);
    let all = [(far, false, 60.0), (Vec3::ZERO, false, 60.0), (Vec3::ZERO, true, 50.0)];
    let (count, extent, spp) = if is_thorough() { (3, EXTENT, 64) } else { (1, Extent::new(48, 32), 16) };
    for (by, has_lamps, bound_db) in all.into_iter().take(count) {
        let mut scene = moved(crowd(), by);
        scene.instances.retain(|i| has_lamps || scene.meshes[i.mesh].material != LAMP);
        let render = |layout| {
            let subject = subject(&scene, layout, by);
            let mut settings = subject.settings(extent.width, extent.height);
            settings.envelope.most.spp = spp.into();
            Stage::alone(&subject, &settings).frame(0).linear
        };
        let (flat, shared) = (render(Layout::Flat), render(Layout::TwoLevel));
        for (a, b) in [(flat.left(), shared.left()), (flat.right(), shared.right())] {
            let between = psnr(a, b);
            let noise = psnr(flat.left(), flat.right());
            println!("moved by {by}, lamps {has_lamps}: {between:.1} dB; {noise:.1} dB between two of flat");
            assert!(between > bound_db && between > noise + 20.0, "moved by {by}: {between} dB, noise {noise} dB");
            assert!((mean(a) / mean(b) - 1.0).abs() < 2e-4, "moved by {by}: {} and {}", mean(a), mean(b));
        }
    }
}

/// From inside a closed mesh, no path sees anything outside.
#[test]
fn no_light_leaks_into_a_closed_instance() {
    for (scale, at) in [
        (Vec3::new(1.5, -0.7, 1.0), Vec3::new(3.0, 1.0, -2.0)),
        (Vec3::new(30.0, 55.0, 20.0), Vec3::new(-900.0, 400.0, 7000.0)),
        (Vec3::splat(-0.004), Vec3::new(2.0, -1.0, 0.5)),
    ] {
        let mut scene = empty_scene("inside");
        scene.environment = Environment::Constant(Vec3::splat(1e4));
        scene.meshes = vec![Mesh { tangents: vec![], ..ball(24, 0) }];
        let turn = Quat::from_rotation_y(0.8) * Quat::from_rotation_x(-0.5);
        // Two instances share the mesh; the camera is inside the first.
        for at in [at, at + 5.0 * scale.abs().max_element() * Vec3::Z] {
            let world_from_local = placed(scale, turn, at);
            scene.instances.push(Instance { mesh: 0, world_from_local });
        }
        let subject = Subject::laid_out("inside", scene, still_rig(at, Vec3::X, Vec3::Y, 1.0), Layout::TwoLevel);
        let (extent, spp) = (Extent::new(48, 32), 16);
        let mut settings = subject.settings(extent.width, extent.height);
        settings.envelope.most.spp = spp.into();
        let frame = Stage::alone(&subject, &settings).frame(0);
        assert!(frame.report.tallies[0].rays > 4 * u64::from(spp) * extent.area() as u64, "paths end early");
        for image in frame.linear.outer() {
            let leaks = image.pixels.iter().filter(|p| **p != [0.0; 3]).count();
            assert_eq!(leaks, 0, "pixels to which light leaks, scale {scale}");
        }
    }
}

/// 2,000 balls of 5,000 triangles: the flattened tables of ten million triangles would take a gibibyte.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn instanced_scenes_load_beyond_flattened_limits() {
    const RINGS: usize = 36;
    let mut scene = empty_scene("ten million");
    scene.meshes = vec![Mesh { tangents: vec![], ..ball(RINGS, 0) }];
    let at = |i: usize| Vec3::new((i % 20) as f32 - 9.5, (i / 20 % 10) as f32 - 4.5, -((i / 200) as f32) - 1.0);
    scene.instances = (0..2000)
        .map(|i| {
            let turn = Quat::from_rotation_x(i as f32);
            Instance { mesh: 0, world_from_local: placed(Vec3::splat(0.4), turn, at(i)) }
        })
        .collect();
    assert!(scene.triangle_count() > 10_000_000);
    let accel = Accel::build(&scene).unwrap();
    assert!(stored(&accel) == scene.meshes[0].triangles.len() && accel.instances.len() == 2001);
    let rig = still_rig(Vec3::new(0.0, 0.0, 3.0), Vec3::NEG_Z, Vec3::Y, 0.8);
    let subject = Subject::new("ten million", scene, rig);
    let mut settings = subject.settings(EXTENT.width, EXTENT.height);
    settings.buffers.aovs = vec![Aov::Position, Aov::Depth];
    let mut stage = Stage::alone(&subject, &settings);
    stage.frame(0);
    let (positions, depths) = (vectors(&mut stage, 0), vectors(&mut stage, 1));
    let hits: Vec<Vec3> = positions.into_iter().zip(depths).filter(|(_, d)| d.x > 0.0).map(|(p, _)| p).collect();
    assert!(hits.len() > EXTENT.area());
    // Facets lie inside the ball by up to the sagitta of a quad's diagonal.
    let inside = 1.0 - (std::f32::consts::PI / RINGS as f32).powi(2);
    for p in hits {
        let nearest = (0..2000).map(|i| p.distance(at(i))).fold(f32::INFINITY, f32::min);
        assert!((0.4 * inside..0.4001).contains(&nearest), "{p} is {nearest} from the middle of a ball");
    }
}
