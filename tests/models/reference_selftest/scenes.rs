//! Tests whole scenes by the z-test.

use diptych::image::Extent;
use diptych::scene::Scene;

use crate::effort::sampled;
use crate::reference::scenes::matte::{
    all, box_area_light, environment_only, instanced_mirrored, textured_masked_blend,
};
use crate::reference::scenes::{lit, lobes, materials};
use crate::reference::ztest::assert_agrees;
use crate::reference::{Emitters, Pinhole, Reference};

#[test]
fn every_scene_agrees_with_itself_under_another_seed() {
    let mut squares = 0.0;
    let scenes = all();
    for (scene, camera) in &scenes {
        let name = &scene.name;
        let reference = Reference::new(scene);
        let extent = Extent::new(48, 36);
        let [a, b] = [1, 2].map(|seed| reference.render(camera, extent, 128, 2, seed));
        let report = assert_agrees(name, &a, &b, 0.03);
        println!("{name}\n{report}");
        squares += report.block_mean_square() / scenes.len() as f64;
    }
    assert!(squares > 0.5, "mean z² {squares}: variances are too large");
}

/// Compares two estimators that share only the surfaces' values: bounces alone, and bounces weighted against explicit
/// samples.
fn hold_estimators_together(name: &str, (scene, camera): &(Scene, Pinhole), extent: Extent, resolution: f64) {
    let [a, b] = [(Emitters::Sampled, 128), (Emitters::BounceHits, 512)]
        .map(|(emitters, spp)| Reference::new(scene).with_emitters(emitters).render(camera, extent, spp, 2, 3));
    let report = assert_agrees(name, &a, &b, resolution);
    println!("{name}\n{report}");
}

#[test]
fn explicit_samples_and_bounce_hits_agree() {
    for scene in [box_area_light(), environment_only(), textured_masked_blend(), instanced_mirrored()] {
        hold_estimators_together(&scene.0.name, &scene, Extent::new(40, 32), 0.04);
    }
    for (name, light) in lit::ALL {
        // Bounces rarely hit these lights, and hardly ever hit smaller ones.
        if ["emissive_triangles", "sphere"].contains(&name) {
            hold_estimators_together(name, &lit::things(name, light), Extent::new(40, 32), 0.1);
        }
    }
}

#[test]
fn estimators_agree_on_every_material() {
    for row in sampled(materials::ALL.into_iter().chain(lobes::ALL), 3) {
        hold_estimators_together(row.0, &materials::build(row), Extent::new(24, 16), 0.06);
    }
}
