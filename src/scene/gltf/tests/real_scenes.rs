//! Tests with third-party scenes, if they are available.

use std::env;
use std::path::PathBuf;

use super::{any, load};
use crate::scene::budget::Budget;
use crate::scene::gltf;
use crate::scene::motion::play::{Choice, Play};

/// Returns `DIPTYCH_SCENES`, else the folder beside the crate.
fn folder() -> PathBuf {
    env::var_os("DIPTYCH_SCENES")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/scenes")), PathBuf::from)
}

#[test]
fn real_scenes_have_all_their_triangles() {
    let scenes = [
        ("garage/garage.gltf", 11_358, 0, ""),
        ("hotel-room/scene.glb", 99_029, 6, "points and lines are left out (mesh 0 primitive 9)"),
        ("ww2-cityscene/scene.gltf", 146_842, 61, ""),
    ];
    for (file, triangles, images, warning) in scenes {
        let path = folder().join(file);
        if !path.is_file() {
            eprintln!("SKIPPED: '{}' is absent; set DIPTYCH_SCENES to the folder of scenes", path.display());
            continue;
        }
        let scene = load(&path).unwrap();
        assert_eq!((scene.triangle_count(), scene.images.len()), (triangles, images), "{file}");
        let bounds = scene.bounds();
        assert!(bounds.min.is_finite() && bounds.max.is_finite(), "{file}: {bounds:?}");
        for mesh in &scene.meshes {
            let count = mesh.positions.len();
            assert!(mesh.triangles.as_flattened().iter().all(|&v| (v as usize) < count));
            assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
            assert!(mesh.normals.is_empty() || mesh.normals.len() == count);
            assert!(mesh.material < scene.materials.len());
        }
        assert_eq!(scene.warnings.join(", "), warning, "{file}");
        let texels: usize = scene.images.iter().map(|i| i.pixels.len()).sum();
        eprintln!("{file}: {} meshes, {texels} texels, {bounds:?}", scene.meshes.len());
    }
}

#[test]
fn real_scenes_move() {
    for (file, skinned, animations) in [("fox/Fox.glb", 1, 3), ("fox/SimpleSkin.gltf", 1, 1)] {
        let path = folder().join(file);
        if !path.is_file() {
            eprintln!("SKIPPED: '{}' is absent; set DIPTYCH_SCENES to the folder of scenes", path.display());
            continue;
        }
        let names = if animations == 3 { vec!["Survey", "Walk", "Run"] } else { vec!["all"] };
        let size = |scene: &crate::scene::Scene| {
            let bounds = scene.bounds();
            (bounds.max - bounds.min).length()
        };
        let rest = load(&path).unwrap();
        assert_eq!(rest.motion.moves().unwrap().skinned_instances, skinned, "{file}");
        for name in names {
            let play = Play { animation: Choice::of(name), ..Play::default() };
            let scene = gltf::load(&path, &play, None, any(&Budget::unlimited())).unwrap();
            assert_eq!(scene.warnings, [""; 0], "{file}");
            let first = scene.at(0.0);
            let mut other = 0;
            for step in 1..20 {
                let still = scene.at(scene.motion.duration_s() * f64::from(step) / 20.0);
                other += u32::from(still.meshes[0].positions != first.meshes[0].positions);
                let ratio = size(&still) / size(&first);
                assert!((0.5..2.0).contains(&ratio), "{file} {name} {step}: {ratio}");
                assert!(still.meshes[0].normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
            }
            assert!(other >= 10, "{file} {name}: {other}");
        }
    }
}
