//! Whole scenes by the z-test.

use diptych::image::Extent;

use crate::reference::scenes::matte::all;
use crate::reference::scenes::{lit, materials};
use crate::reference::ztest::assert_agrees;
use crate::reference::{Emitters, Reference};

#[test]
fn every_scene_agrees_with_itself_under_another_seed() {
    let mut squares = 0.0;
    let scenes = all();
    for (name, scene, camera) in &scenes {
        let reference = Reference::new(scene);
        let extent = Extent::new(48, 36);
        let [a, b] = [1, 2].map(|seed| reference.render(camera, extent, 128, 2, seed));
        let report = assert_agrees(name, &a, &b, 0.03);
        println!("{name}\n{report}");
        squares += report.block_mean_square() / scenes.len() as f64;
    }
    assert!(squares > 0.5, "mean z² {squares}: variances are too large");
}

#[test]
fn explicit_samples_and_bounce_hits_agree() {
    let lit = ["emissive_triangles", "sphere", "sphere_spot"];
    let lit = lit::ALL.iter().filter(|(name, _)| lit.contains(name)).map(|(name, light)| {
        let (scene, camera) = lit::things(name, *light);
        (*name, scene, camera)
    });
    let matte = ["box_area_light", "environment_only", "textured_masked_blend", "instanced_mirrored"];
    for (name, scene, camera) in all().into_iter().filter(|(name, ..)| matte.contains(name)).chain(lit) {
        let extent = Extent::new(40, 32);
        let [a, b] = [(Emitters::Sampled, 128), (Emitters::BounceHits, 512)]
            .map(|(emitters, spp)| Reference::new(&scene).with_emitters(emitters).render(&camera, extent, spp, 2, 3));
        let report = assert_agrees(name, &a, &b, 0.04);
        println!("{name}\n{report}");
    }
}

/// The lobes as they are drawn against the lobes as they are weighed: two estimators that share the values only.
#[test]
fn explicit_samples_and_bounce_hits_agree_on_every_material() {
    for (name, scene) in materials::ALL {
        let (scene, camera) = scene();
        let extent = Extent::new(24, 16);
        let [a, b] = [(Emitters::Sampled, 128), (Emitters::BounceHits, 512)]
            .map(|(emitters, spp)| Reference::new(&scene).with_emitters(emitters).render(&camera, extent, spp, 3, 3));
        let report = assert_agrees(name, &a, &b, 0.06);
        println!("{name}\n{report}");
    }
}
