//! Closed forms: mirrors, glass, volumes.

use diptych::scene::{Environment, Light, LightKind, Material, Scene, Volume};
use glam::{Vec3, vec3};

use super::point;
use crate::reference::Reference;
use crate::reference::asserts::{assert_exact, assert_near};
use crate::reference::scenes::{
    add_material, add_quad, block, colored, empty, matte, place, place_at, quad, scaled_at,
};
use crate::reference::ztest::Estimate;

/// Transmitted fraction of light per unit of length.
const CLEARNESS: f64 = 0.64;

fn glass() -> Material {
    Material { specular: 1.0, transmission: 1.0, roughness: 0.0, ..matte() }
}

fn thick() -> Material {
    // 0.8 per half a unit is 0.64 per unit.
    let volume = Volume { attenuation_color: Vec3::splat(0.8), attenuation_distance: 0.5 };
    Material { volume: Some(volume), ..glass() }
}

/// Schlick's term at an index of 1.5.
fn fresnel(cosine: f64) -> f64 {
    0.04 + 0.96 * (1.0 - cosine).powi(5)
}

/// Adds a sheet of width 40 at that height that faces up or down.
fn sheet(scene: &mut Scene, height: f32, up: bool, material: &Material) {
    let material = add_material(scene, material.clone());
    let (u, v) = (40.0 * Vec3::Z, 40.0 * Vec3::X);
    let (u, v) = if up { (u, v) } else { (v, u) };
    place(scene, quad(vec3(-20.0, height, -20.0), u, v, material));
}

fn glowing(emissive: f32) -> Material {
    Material { emissive: Vec3::splat(emissive), base_color: glam::Vec4::W, ..matte() }
}

/// Looks down from (0, 5, 0) at an angle with a cosine of 0.8.
fn look_down(scene: &Scene, spp: u32, bounces: u32) -> Estimate {
    Reference::new(scene).probe(vec3(0.0, 5.0, 0.0), vec3(0.6, -0.8, 0.0), spp, bounces, 1)
}

#[test]
fn mirror_reflects_radiance_tinted_by_its_colour() {
    let mut scene = empty("mirror");
    let metal = Material { base_color: vec3(0.9, 0.6, 0.3).extend(1.0), metallic: 1.0, roughness: 0.0, ..matte() };
    sheet(&mut scene, 0.0, true, &metal);
    sheet(&mut scene, 9.0, false, &glowing(2.0));
    let grazing = 0.2f64.powi(5);
    let expected = [0.9, 0.6, 0.3].map(|base: f64| 2.0 * (f64::from(base as f32) * (1.0 - grazing) + grazing));
    assert_exact(&look_down(&scene, 10, 0), expected);
    assert_exact(&look_down(&scene, 10, 3), expected);
}

#[test]
fn mirror_shows_spherical_lights_but_no_sun_disc() {
    let mut scene = empty("mirrored lights");
    sheet(&mut scene, 0.0, true, &Material { metallic: 1.0, roughness: 0.0, ..matte() });
    let direction = vec3(-0.6, -0.8, 0.0);
    let kind = LightKind::Directional { direction, angle_rad: 0.1 };
    scene.lights.push(Light { kind, strength: Vec3::ONE });
    assert_exact(&look_down(&scene, 10, 2), [0.0; 3]);
    // The ray meets the mirror at (3.75, 0, 0).
    scene.lights.push(point(vec3(3.75, 0.0, 0.0) + 4.0 * vec3(0.6, 0.8, 0.0), 0.5, Vec3::splat(3.0)));
    assert_exact(&look_down(&scene, 10, 2), [3.0 / (std::f64::consts::PI * 0.25); 3]);
}

#[test]
fn thin_glass_lets_light_straight_on_from_both_sides() {
    for up in [true, false] {
        let mut scene = empty("pane");
        let tint = vec3(0.5, 0.75, 1.0);
        sheet(&mut scene, 0.0, up, &Material { base_color: tint.extend(1.0), ..glass() });
        sheet(&mut scene, -1.0, true, &glowing(2.0));
        sheet(&mut scene, 9.0, false, &glowing(7.0));
        let seen = look_down(&scene, 400_000, 0);
        for (c, tint) in tint.to_array().into_iter().enumerate() {
            let expected = 7.0 * fresnel(0.8) + 2.0 * f64::from(tint) * (1.0 - fresnel(0.8));
            let (mean, sigma) = (seen.mean[0][c], seen.variance_of_mean[0][c].sqrt());
            assert!((mean - expected).abs() < 4.5 * sigma && sigma < 0.002 * expected, "{mean} ± {sigma}, {expected}");
        }
    }
}

/// A lamp under a slab of height 0.5. Light passes the glass 1, 3, 5 … times, attenuated by each length.
#[test]
fn slab_equals_a_series_of_inner_reflections() {
    let mut scene = empty("slab");
    sheet(&mut scene, 0.0, true, &thick());
    sheet(&mut scene, -0.5, false, &thick());
    sheet(&mut scene, -1.0, true, &glowing(2.0));
    let cos_inside = (1.0f64 - 0.36 / 2.25).sqrt();
    let pass = CLEARNESS.powf(0.5 / cos_inside);
    let f = fresnel(0.8);
    for bounces in [1, 2, 3, 5] {
        // Light is refracted twice and reflected an even number of times inside.
        let series: f64 = (0..=(bounces - 1) / 2).map(|k| (f * pass).powi(2 * k)).sum();
        let expected = 2.0 * (1.0 - f).powi(2) * pass * series;
        assert_near(&look_down(&scene, 200_000, bounces as u32), expected, 0.002);
    }
    assert_exact(&look_down(&scene, 100, 0), [0.0; 3]);
}

/// Through an empty slab the background is equally bright, except for reflections: squared indices cancel.
#[test]
fn camera_in_glass_sees_attenuated_compressed_light() {
    let mut scene = empty("diver");
    sheet(&mut scene, 0.0, true, &thick());
    sheet(&mut scene, 9.0, false, &glowing(2.0));
    // Look straight up from 0.7 below.
    let up = Reference::new(&scene).probe(vec3(0.0, -0.7, 0.0), Vec3::Y, 100_000, 0, 1);
    assert_near(&up, 2.0 * 2.25 * (1.0 - 0.04) * CLEARNESS.powf(0.7), 0.002);
    // Beyond the critical angle the surface is a mirror seen from inside; light is attenuated on both ways.
    let mut scene = empty("total reflection");
    sheet(&mut scene, 0.0, true, &thick());
    sheet(&mut scene, -1.0, true, &glowing(2.0));
    let aslant = Reference::new(&scene).probe(vec3(0.0, -0.6, 0.0), vec3(0.8, 0.6, 0.0), 100, 0, 1);
    assert_exact(&aslant, [2.0 * CLEARNESS.powf(1.0 + 1.0 / 0.6); 3]);
}

#[test]
fn shadow_rays_stop_at_glass_and_attenuate_within() {
    let mut scene = empty("lamp in glass");
    sheet(&mut scene, 1.0, true, &thick());
    add_quad(&mut scene, (vec3(-20.0, 0.0, -20.0), 40.0 * Vec3::Z, 40.0 * Vec3::X), colored(Vec3::ONE));
    scene.lights.push(point(vec3(0.0, 0.5, 0.0), 0.0, Vec3::splat(std::f32::consts::PI)));
    scene.lights.push(point(vec3(0.0, 2.0, 0.0), 0.0, Vec3::splat(100.0)));
    // Look straight down through the surface at the floor under the inner light, over the inner length 1.
    let seen = Reference::new(&scene).probe(vec3(0.0, 3.0, 0.0), Vec3::NEG_Y, 100_000, 1, 1);
    let lit = CLEARNESS.powf(0.5) / 0.25;
    assert_near(&seen, 0.96 / 2.25 * CLEARNESS * lit, 0.002);
}

/// Adds a white floor under a pane, lit by one light from that direction or place.
#[test]
fn only_thin_smooth_panes_pass_delta_lights() {
    let direction = vec3(0.6, -0.8, 0.0);
    let sun = LightKind::Directional { direction, angle_rad: 0.0 };
    let tint = vec3(0.5, 0.75, 1.0);
    let lit = |pane: Option<Material>, light: Light| {
        let mut scene = empty("floor under a pane");
        add_quad(&mut scene, (vec3(-20.0, 0.0, -20.0), 40.0 * Vec3::Z, 40.0 * Vec3::X), colored(Vec3::ONE));
        if let Some(pane) = pane {
            sheet(&mut scene, 1.0, true, &pane);
        }
        scene.lights.push(light);
        Reference::new(&scene).probe(vec3(0.3, 0.5, 0.0), Vec3::NEG_Y, 100, 0, 1)
    };
    let pane = Material { base_color: tint.extend(1.0), ..glass() };
    let strength = Vec3::splat(std::f32::consts::PI);
    let sun = Light { kind: sun, strength };
    assert_exact(&lit(None, sun), [0.8; 3]);
    let passed = 0.8 * (1.0 - fresnel(0.8));
    assert_exact(&lit(Some(pane.clone()), sun), tint.to_array().map(|tint| f64::from(tint) * passed));
    assert_exact(
        &lit(Some(pane.clone()), point(vec3(0.3, 2.0, 0.0), 0.0, strength)),
        tint.to_array().map(|tint| f64::from(tint) * 0.96 / 4.0),
    );
    for pane in [thick(), Material { roughness: 0.5, ..pane }] {
        assert_exact(&lit(Some(pane), sun), [0.0; 3]);
    }
}

#[test]
fn ior_one_bends_nothing_and_ior_zero_reflects_all() {
    for roughness in [0.0, 0.7] {
        let mut scene = empty("haze");
        let haze = Material { ior: 1.0, specular: 0.0, roughness, ..thick() };
        let material = add_material(&mut scene, haze);
        place_at(&mut scene, block(material), scaled_at(2.0, Vec3::ZERO));
        scene.environment = Environment::Constant(Vec3::ONE);
        assert_exact(&look_down(&scene, 100, 0), [1.0; 3]); // past it
        let through = Reference::new(&scene).probe(vec3(0.0, 3.0, 0.3), Vec3::NEG_Y, 100, 1, 1);
        assert_exact(&through, [CLEARNESS.powi(2); 3]);
    }
    let mut scene = empty("all reflected");
    sheet(&mut scene, 0.0, true, &Material { ior: 0.0, ..thick() });
    sheet(&mut scene, 9.0, false, &glowing(2.0));
    assert_exact(&look_down(&scene, 100, 3), [2.0; 3]);
}
