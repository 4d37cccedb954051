//! Compiling out code that a scene does not need changes no byte, for each flag of [`SceneNeeds`].

use std::collections::BTreeMap;

use super::{assert_same_frames, even};
use crate::common::{Subject, is_thorough};
use crate::pictures::rig_of;
use crate::reference::Pinhole;
use crate::reference::scenes::studio::{add_panels, dielectric, glass, metal};
use crate::reference::scenes::{instance, lit, materials, matte, scaled_at, sky};
use diptych::accel::Layout;
use diptych::image::Extent;
use diptych::scene::needs::SceneNeeds;
use diptych::scene::{Anisotropy, DiffuseTransmission, Environment, Iridescence, Material, Scene, Sheen, Volume};
use glam::{Vec3, vec3};

/// Returns four scenes that together have each flag on and each off.
fn scenes() -> [(Scene, Pinhole, Layout); 4] {
    let add = |scene: &mut Scene, rows: &[lit::Row], name: &str| {
        let (_, light) = rows.iter().find(|row| row.0 == name).unwrap_or_else(|| panic!("there is no row {name}"));
        light(scene);
    };
    let (mut plain, before_plain) = matte::point_spot_directional();
    let again = plain.instances.last().expect("there is a block").mesh;
    instance(&mut plain, again, scaled_at(0.4, vec3(-0.1, 0.2, 1.2)));
    let (mut coated, before_coated) = lit::things("coated, under a sky and a sphere", |_| ());
    add(&mut coated, &lit::CARDS, "coated");
    add(&mut coated, &lit::ALL, "sphere");
    let base = dielectric(Vec3::splat(0.4), 0.5);
    let sheen = Sheen { color: Vec3::splat(0.7), roughness: 0.4, ..Sheen::default() };
    let film = Iridescence { factor: 1.0, ..Iridescence::default() };
    let volume = Some(Volume { attenuation_color: Vec3::ONE, attenuation_distance: 1.0 });
    let leaf = DiffuseTransmission { factor: 0.6, ..DiffuseTransmission::default() };
    let panels = [
        Material { sheen, ..base.clone() },
        Material { iridescence: film, ..base.clone() },
        Material { diffuse_transmission: leaf, ..base.clone() },
        Material { anisotropy: Anisotropy { strength: 0.8, ..Anisotropy::default() }, ..base },
        Material { volume, dispersion: 3.0, ..glass(Vec3::ONE, 0.0) },
    ];
    add_panels(&mut coated, panels);
    coated.environment = Environment::Map { image: sky(Extent::new(16, 8)).into(), rotation_deg: 0.0 };
    let (mut cut_out, before_cut_out) = lit::things("cut out, under a sun", |_| ());
    add(&mut cut_out, &lit::CARDS, "masked");
    add(&mut cut_out, &lit::CARDS, "textured_mask");
    add(&mut cut_out, &lit::ALL, "directional");
    let (mut unlit, before_unlit) = materials::named("unlit");
    add_panels(&mut unlit, [glass(Vec3::ONE, 0.0), metal(Vec3::ONE, 0.0), dielectric(Vec3::splat(0.2), 0.0)]);
    add(&mut unlit, &lit::ALL, "point");
    [
        (plain, before_plain, Layout::TwoLevel),
        (coated, before_coated, Layout::Flat),
        (cut_out, before_cut_out, Layout::Flat),
        (unlit, before_unlit, Layout::Flat),
    ]
}

fn subjects() -> [Subject; 4] {
    scenes().map(|(scene, camera, layout)| Subject::laid_out(&scene.name.clone(), scene, rig_of(&camera), layout))
}

/// Returns the scene's needs combined with those of its tables.
fn needs(subject: &Subject) -> SceneNeeds {
    SceneNeeds { instances: subject.tables.has_instances(), ..subject.needs }
}

/// Returns the flags by name, so that new fields of the struct count as well.
fn flags(needs: SceneNeeds) -> BTreeMap<String, bool> {
    serde_json::from_value(serde_json::to_value(needs).unwrap()).unwrap()
}

#[test]
fn scenes_cover_both_values_of_each_need() {
    let all = subjects().map(|subject| flags(needs(&subject)));
    for name in flags(SceneNeeds::ALL).keys() {
        let values = all.each_ref().map(|flags| flags[name]);
        assert!(values.contains(&true) && values.contains(&false), "the scenes have `{name}` as {values:?}");
    }
}

/// Frames from a scene's own shaders have the bytes of frames from shaders with all features.
#[test]
fn same_bytes_with_all_shader_features_compiled_in() {
    let mut cases: Vec<_> = subjects().into_iter().map(|subject| (subject, 1)).collect();
    if is_thorough() {
        // Several samples use additional code.
        let shots = [("builtin:cornell", 1), ("builtin:forest", 1), ("builtin:checker", 1), ("builtin:checker", 3)];
        cases.extend(shots.map(|(shot, spp)| (Subject::load(shot), spp)));
    }
    for (subject, spp) in &cases {
        let mut settings = subject.denoised(32, 18);
        settings.envelope.most.spp = (*spp).into();
        let [needed, all] = [needs(subject), needs(subject).widened()].map(|needs| {
            settings.buffers.needs = needs;
            even(1).frames(subject, &settings, &[0.0; 2])
        });
        assert_same_frames(&format!("{} at {spp} spp with everything compiled in", subject.name), &needed, &all);
    }
}
